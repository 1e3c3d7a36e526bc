"""Errors of the network's output on crops: points, irises, parsing.

Errors of points are in per cent of the distance of the outer eye corners, those of irises in per cent of the eye's
width; parsing is measured as intersection over union of the most likely classes in the 64 x 64 cells.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import LEFT_EYE, RIGHT_EYE, interocular
from guise.common.arrays import F32, F64, U8
from training.canvas import Sample
from training.parsing_labels import CLASSES, OCCLUDER

AGREEMENT_EVERY = 5  # crops of those at hand are compared fused and not
FACE_PARTS = (1, 2, 3, 4, 5, 7)  # skin, brows, eyes, lips, inner mouth, facial hair


@dataclass(frozen=True, eq=False)
class Answers:
    """What a network gives, of these.

    points (n, 81, 2), sigma (n, 81), face logit (n,), iris (n, 2, 4), parsing (n, classes, 64, 64)
    """

    points: F32 | None = None
    sigma: F32 | None = None
    face: F32 | None = None
    iris: F32 | None = None
    parsing: F32 | None = None


Answer = Callable[[U8], Answers]


def answers_of(net: Any) -> Answer:
    """Predictions of a PyTorch network."""
    import torch

    def answer(crops: U8) -> Answers:
        net.eval()
        with torch.no_grad():
            rows = [net(torch.from_numpy(crops[i : i + 32])) for i in range(0, len(crops), 32)]
        return Answers(*(torch.cat(column).float().numpy() for column in zip(*rows, strict=True)))

    return answer


def answers_of_file(path: Path, *, fused: bool = True) -> Answer:
    """Predictions of an ONNX file, on one thread as the package runs it; fused: else operator by operator."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    if not fused:
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]

    def answer(crops: U8) -> Answers:
        rows = [session.run(names, {"crop": crop[None]}) for crop in crops]
        columns = (np.concatenate(column) for column in zip(*rows, strict=True))
        return Answers(**dict(zip(names, columns, strict=True)))

    return answer


def fused_apart(path: Path, crops: U8) -> float:
    """Greatest difference of an ONNX file's answers fused and not, as a share of each output's range."""
    fused, plain = (vars(answers_of_file(path, fused=fused)(crops)) for fused in (True, False))
    return max(
        float(np.abs(value - plain[name]).max() / np.ptp(value))
        for name, value in fused.items()
        if value is not None
    )


def figures_of(answer: Answer, samples: Sequence[Sample]) -> dict[str, float | F64]:
    """Means over samples, and the IoU of every class (classes,), NaN where neither has it."""
    found = answer(np.stack([s.crop for s in samples]))
    figures: dict[str, float | F64] = {}
    if found.points is not None:
        figures["points"] = float(point_errors(found, samples).mean())
    if found.iris is not None and any(s.iris_seen.any() for s in samples):
        centre, radius = iris_errors(found, samples)
        figures |= {"iris": float(centre.mean()), "iris_radius": float(radius.mean())}
    exact = np.array([s.exact for s in samples])
    if found.parsing is not None and exact.all():
        truth = np.stack([s.maps for s in samples]).argmax(1)
        classes = found.parsing.argmax(1)
        each = iou(classes, truth)
        figures |= {"iou": float(np.nanmean(each)), "occluder_iou": float(each[OCCLUDER]), "each": each}
        face = np.isin(truth, FACE_PARTS)
        figures["false_occluder"] = float(100 * (classes[face] == OCCLUDER).mean())
    return figures


def point_errors(found: Answers, samples: Sequence[Sample]) -> F64:
    """Mean error (n,) of the points of each sample, per cent."""
    assert found.points is not None
    truth = np.stack([s.points for s in samples])
    return np.asarray(100 * np.linalg.norm(found.points - truth, axis=2).mean(1) / interocular(truth))


def iris_errors(found: Answers, samples: Sequence[Sample]) -> tuple[F64, F64]:
    """Errors of centres in per cent of the eye's width, and of radii in per cent, of all irises to be seen (m,).

    The eye's width is the larger of both as seen, so that it does not vanish in profile.
    """
    assert found.iris is not None
    truth, seen = np.stack([s.iris for s in samples]), np.stack([s.iris_seen for s in samples])
    points = np.stack([s.points for s in samples])
    widths = [np.linalg.norm(points[:, eye[0]] - points[:, eye[3]], axis=1) for eye in (RIGHT_EYE, LEFT_EYE)]
    width = np.maximum(*widths)[:, None].repeat(2, 1)
    centre = 100 * np.linalg.norm(found.iris[..., :2] - truth[..., :2], axis=2) / width
    radius = 100 * np.abs(found.iris[..., 2] / np.maximum(truth[..., 2], 1e-6) - 1)
    return np.asarray(centre[seen]), np.asarray(radius[seen])


def iou(found: NDArray[np.integer], truth: NDArray[np.integer]) -> F64:
    """Intersection over union (classes,) of two class maps of any one shape; NaN where the truth lacks the class."""
    count = len(CLASSES)
    table = np.bincount(truth.ravel() * count + found.ravel(), minlength=count**2).reshape(count, count)
    both = np.diag(table).astype(np.float64)
    either = table.sum(0) + table.sum(1) - both
    return np.divide(both, either, out=np.full(count, np.nan), where=table.sum(1) > 0)
