"""Turn trained weights into what ships: ONNX files, confidence calibration, report and model card.

    python -m training.finish_face --run OUT --parts PARTS --real DATA [--hands HANDS] [--ship]

OUT is the output of `train_face.py`. Of its landmarker (`landmarks.onnx`: points, sigma, face) an 8-bit variant is
made, and used if it is faster and no less accurate; `report.json`, `landmarks.json` and `face.md` are written beside
it. With --ship the landmarker goes to aam/data. What ships for irises and parsing is made by `finish_parsing.py`.
"""

from __future__ import annotations

import argparse
import copy
import json
import shutil
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)
from scipy.optimize import minimize
from torch import Tensor, nn

from guise.aam.landmarks import interocular
from guise.common.arrays import F64, U8
from training.augment import Props, negative, sample
from training.canvas import SIZE, Sample
from training.crops import plain_samples
from training.cutouts import make_props
from training.data import Pictures, by_hands, load_parts, load_real
from training.definitions import read_alignment
from training.exact_rounding import powers_of_two
from training.face_net import FaceNet
from training.measure import Answer, answers_of_file, figures_of, point_errors
from training.report import report, tables
from training.stored_weights import halve

DATA = Path(__file__).parents[1] / "aam" / "data"
OUTPUTS = ("points", "sigma", "face")
GOOD_ERROR_INTEROCULAR = 0.05  # the mean error that the confidence speaks of
UNROUNDED = (
    "/fine.0/fine.0.0/Conv",
    "/classes/Conv",
)  # the first layer, and the parsing's last, whose steps would show
ROUNDED = ("Conv", "Relu", "Add", "Resize")
MAX_ERROR_RATIO = 1.02  # of the 8-bit variant's error to the float32 one's


class Landmarker(nn.Module):
    """The network without irises and parsing."""

    def __init__(self, net: FaceNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        _, pyramid, coarse = self.net.features(images)
        points, _, _, log_sigma, face = self.net.points_of(pyramid, coarse)
        return points, torch.exp(log_sigma), face


def export(module: nn.Module, path: Path, outputs: tuple[str, ...]) -> None:
    """Write a module as ONNX: input `crop` uint8 (1, 128, 128, 3)."""
    torch.onnx.export(
        module.eval(), (torch.zeros(1, SIZE, SIZE, 3, dtype=torch.uint8),), str(path), dynamo=False,
        opset_version=17, input_names=["crop"], output_names=list(outputs),
    )  # fmt: skip


class _Feed(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, crops: U8) -> None:
        self._rows = iter(crops)

    def get_next(self) -> dict[str, U8] | None:
        row = next(self._rows, None)
        return None if row is None else {"crop": row[None]}


def eight_bit(source: Path, target: Path, crops: U8) -> None:
    """Convolutions in 8 bits, calibrated on crops, but for `UNROUNDED`; what places the points in half precision.

    The answer is the same on every processor (`exact_rounding.py`). Rounding the first layer, or for the sake of the
    rarest values, made points jitter by a quarter more.
    """
    quantize_static(
        source, target, _Feed(crops), quant_format=QuantFormat.QDQ, op_types_to_quantize=list(ROUNDED),
        activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, per_channel=True,
        reduce_range=True,  # or older processors overflow
        calibrate_method=CalibrationMethod.Percentile, nodes_to_exclude=[*UNROUNDED, *last_sums(source)],
    )  # fmt: skip
    powers_of_two(source, target)
    halve(target)


def last_sums(path: Path) -> list[str]:
    """Names of the additions of an ONNX file behind which there is no convolution."""
    nodes = onnx.load(path).graph.node
    leading: set[str] = set()  # what convolutions are made of
    for node in reversed(nodes):
        if node.op_type == "Conv" or leading & set(node.output):
            leading |= set(node.input)
    return [node.name for node in nodes if node.op_type == "Add" and not leading & set(node.output)]


def milliseconds(paths: list[Path], crop: U8, rounds: int = 80) -> list[float]:
    """Median processor time of one crop for every model on one thread, measured in turns."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    sessions = [onnxruntime.InferenceSession(p, options, providers=["CPUExecutionProvider"]) for p in paths]
    times = np.zeros((rounds, len(paths)))
    for row in times:
        for k, session in enumerate(sessions):
            start = time.thread_time()
            session.run(None, {"crop": crop[None]})
            row[k] = 1e3 * (time.thread_time() - start)
    return [float(t) for t in np.median(times[10:], axis=0)]


# -- confidence ---------------------------------------------------------------------------------------------------


def hard_samples(pictures: list[Pictures], props: Props, count: int, seed: int) -> tuple[list[Sample], U8]:
    """Augmented samples of the sources in turn, and a seventh as many crops that show no face."""
    rng = np.random.default_rng(seed)
    cv2.setRNGSeed(seed)
    faces, others = [], []
    for k in range(count):
        source = pictures[k % len(pictures)]
        one = source[int(rng.integers(len(source)))]
        if rng.random() > 0.125:
            faces.append(sample(rng, one, props))
        else:
            others.append(negative(rng, one.image, one.points, props.backgrounds))
    return faces, np.stack(others)


def calibrate(
    answer: Answer, pictures: list[Pictures], props: Props, count: int = 4000, seed: int = 5
) -> dict[str, Any]:
    """Weights of the confidence and how well they hold on a second sample.

    See guise.aam.landmarks.builtin.Calibration.
    """
    features, good, ratio = _features(answer, *hard_samples(pictures, props, count, seed))

    def cost(weights: F64) -> float:
        z = features @ weights
        return float(np.mean(np.logaddexp(0, z) - good * z) + 1e-5 * (weights**2).sum())

    weights = minimize(cost, np.array([-10.0, -4.0, 0.5]), method="BFGS").x
    features, good, _ = _features(answer, *hard_samples(pictures, props, count, seed + 1))
    chance = 1 / (1 + np.exp(-features @ weights))
    table = []
    for low in np.arange(0, 1, 0.2):
        inside = (chance >= low) & (chance < low + 0.2 + 1e-9)
        if inside.any():
            table.append([float(chance[inside].mean()), float(good[inside].mean()), int(inside.sum())])
    return {
        "face": [round(float(w), 4) for w in weights], "sigma": round(ratio, 4),
        "brier": round(float(np.mean((chance - good) ** 2)), 4), "reliability": np.round(table, 3).tolist(),
    }  # fmt: skip


def _features(answer: Answer, faces: list[Sample], others: U8) -> tuple[NDArray[Any], NDArray[Any], float]:
    """Rows (1, log spread, clipped logit), whether the mean error is small, and measured over told deviation."""
    found = answer(np.concatenate([np.stack([s.crop for s in faces]), others]))
    spread = np.log(np.maximum(found.sigma.mean(1) / np.maximum(interocular(found.points), 1e-3), 1e-6))
    features = np.column_stack([np.ones(len(spread)), spread, np.clip(found.face, -8, 8)])
    truth = np.stack([s.points for s in faces])
    miss = np.linalg.norm(found.points[: len(faces)] - truth, axis=2)
    good = np.zeros(len(spread))
    good[: len(faces)] = miss.mean(1) < GOOD_ERROR_INTEROCULAR * np.maximum(interocular(truth), 1e-3)
    ratio = float(np.sqrt(np.median(miss**2 / found.sigma[: len(faces)] ** 2) / (2 * np.log(2))))
    return features, good, ratio


# -- what ships ---------------------------------------------------------------------------------------------------


def variants(run: Path, net: FaceNet, crops: U8) -> dict[str, Path]:
    """Export float32 and 8-bit files of the landmarker: paths by name."""
    paths = {kind: run / f"landmarks_{kind}.onnx" for kind in ("float32", "8bit")}
    export(Landmarker(copy.deepcopy(net).float()), paths["float32"], OUTPUTS)
    eight_bit(paths["float32"], paths["8bit"], crops)
    return paths


def measured(paths: dict[str, Path], unseen: list[Sample], real: list[Sample]) -> dict[str, dict[str, float]]:
    """Errors on rendered and real people held out, time and size of every file."""
    times = milliseconds(list(paths.values()), real[0].crop)
    rows = {}
    for (name, path), ms in zip(paths.items(), times, strict=True):
        answer = answers_of_file(path)
        figures = figures_of(answer, unseen)
        found = answer(np.stack([s.crop for s in real]))
        rows[name] = {k: v for k, v in figures.items() if isinstance(v, float)} | {
            "real": float(point_errors(found, real).mean()), "ms": ms, "bytes": path.stat().st_size,
        }  # fmt: skip
    return rows


def choose(rows: dict[str, dict[str, float]]) -> str:
    """The 8-bit file if it is faster and no less accurate, otherwise float32."""
    plain, small = rows["float32"], rows["8bit"]
    same = all(small[k] <= MAX_ERROR_RATIO * plain[k] for k in ("points", "real"))
    return "8bit" if same and small["ms"] < 0.9 * plain["ms"] else "float32"


CARD = """# Model card: the built-in landmarker

A small convolutional network (`training/landmark_net.py`) that finds, in an upright crop of 128 x 128 pixels, the 81
points of a face with a standard deviation for each, and whether there is a face at all. Made by
`training/train_face.py`, `training/face_logit.py` and `training/finish_face.py`; the last writes this page.

- Licence: that of Guise (Apache-2.0).
- Data: {rendered:,} pictures of {people} rendered fictional people (CC0, `training/render_people.py`), cut-outs of
  rendered hands (`training/render_hands.py`), procedural objects in front (`training/occluders.py`), and {real}
  pictures of {real_people} real people under CC BY 4.0: photographs of the Face Research Lab London Set (DeBruine and
  Jones 2017, doi:10.6084/m9.figshare.5047666), without those kept for evaluation, and frames of clips of the GRID
  corpus (Cooke et al. 2006), labelled with MediaPipe's points, both kinds of labels brought to one definition
  (`training/definitions.py`). The annotated stills that the benchmarks measure on were not trained on.
- Training: {done:,} batches of {batch} augmented crops, seed {seed}, {start}.
- What tells faces from other things is a head of its own on the trunk's features (`training/face_head.py`): trained on
  faces behind what `training/patterns.py` draws, beyond the picture's sides, small, filled, blurred and as negatives,
  and on what the detector mistakes for faces (`training/mistaken.py`). It changes no point, takes a sixth of the time,
  and doesn't run where the input `looks` is false. Points, a third of the time, are NaN where it is below the input
  `least` (`training/branches.py`).
- Meant for faces from about 24 pixels up, turned by up to 75 degrees and rolled by up to 60 in the crop.
- Not meant for recognising people or their emotions; it does neither.

## Held out

Errors of points in per cent of the distance of the outer eye corners.

{tables}

## Variants

{variants}

## Confidence

Predicted and observed share of faces whose mean error is under 5 %, on samples made hard (a second draw, not the one
that the calibration was fitted to). Brier score {brier}.

| predicted | observed | samples |
|---|---|---|
{reliability}
"""


def card(facts: dict[str, Any]) -> str:
    """The model card."""
    columns = ("points", "real", "ms", "bytes")
    rows = ["| file | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for name, row in facts["variants"].items():
        rows.append(f"| {name} | " + " | ".join(f"{row[c]:.5g}" if c in row else "" for c in columns) + " |")
    reliability = "\n".join(f"| {a:.2f} | {b:.2f} | {int(c)} |" for a, b, c in facts["reliability"])
    return CARD.format(
        **facts["training"], tables=tables(facts),
        variants="\n".join(rows), brier=facts["brier"], reliability=reliability,
    )  # fmt: skip


def arguments(about: str, shipping: str) -> argparse.Namespace:
    """The command line of a script that measures and ships trained weights."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--real", type=Path, required=True)
    parser.add_argument("--hands", type=Path)
    parser.add_argument("--alignment", type=Path)
    parser.add_argument("--count", type=int, default=600, help="held-out pictures that are measured on")
    parser.add_argument("--ship", action="store_true", help=shipping)
    return parser.parse_args()


def main() -> None:
    options = arguments("Turn trained weights into what ships.", "copy the landmarker to aam/data")
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
    run: Path = options.run
    alignment = read_alignment(options.alignment)
    unseen, _ = by_hands(alignment.rendered(load_parts(options.parts, held_out=True)))
    real = alignment.real(load_real(options.real, held_out=True))
    props = make_props(99, options.hands, held_out=True, backgrounds=300)
    net = FaceNet()
    net.load_state_dict(torch.load(run / "face.pt", map_location="cpu"))
    plain, real_plain = plain_samples(unseen, min(options.count, 300)), plain_samples(real, len(real))
    paths = variants(run, net, np.stack([s.crop for s in plain[::3] + real_plain]))
    rows = measured(paths, plain, real_plain)
    chosen = choose(rows)
    shutil.copy(paths[chosen], run / "landmarks.onnx")
    facts = report(answers_of_file(run / "landmarks.onnx"), unseen, real, props, options.count)
    facts |= {"variants": rows, "chosen": chosen, "training": json.loads((run / "facts.json").read_text())}
    facts |= calibrate(answers_of_file(run / "landmarks.onnx"), [unseen, real], props)
    (run / "report.json").write_text(json.dumps(facts, indent=1) + "\n")
    calibration = json.dumps({"face": facts["face"], "sigma": facts["sigma"]}, indent=1)
    (run / "landmarks.json").write_text(calibration + "\n")
    (run / "face.md").write_text(card(facts))
    print(card(facts))
    if options.ship:
        shutil.copy(run / "landmarks.onnx", DATA / "landmarks.onnx")
        shutil.copy(run / "landmarks.json", DATA / "landmarks.json")
        shutil.copy(run / "face.md", DATA / "landmarks.md")


if __name__ == "__main__":
    main()
