"""Calibration: is a face's confidence the probability that its mean error is under 5 %?

Asked of all faces that the landmarker tells, sure or not, and that lie on a known one: of the annotated stills (errors
after each point's mean residual is taken off, two-fold, as in `landmarks.stills`, since the schemes differ), and with
--parts of held-out rendered people (all 81 points), as they are and made hard: blurred, half hidden, dark and noisy.
Ranking is the area under the ROC curve: the chance that a right face has more confidence than a wrong one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Picture, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.annotated import SETS, Still, stills
from benchmarks.landmarks.metrics import (
    Bools,
    brier,
    calibration_error,
    face_errors,
    matches,
    mean_of,
    offset_removed_errors,
    percent_errors,
    ranking,
    reliability,
)
from benchmarks.landmarks.rendered import Known, held_out, part_pictures
from guise.aam.landmarks.schemes import IBUG68
from training import definitions

NAME, TITLE = "landmarks.calibration", "Calibration of the confidence"
MAX_CORRECT_ERROR = 5.0  # %, the mean error below which a face is right
BIN_EDGES = np.array([0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0])
PICTURES = 400


@dataclass(frozen=True, eq=False)
class Judged:
    """Confidences (n,) and mean errors (n,) in %; `known` faces were there, n of them found."""

    confidence: F64
    error: F64
    known: int

    @property
    def right(self) -> Bools:
        """Which are right (n,)."""
        return np.asarray(self.error < MAX_CORRECT_ERROR)

    def __add__(self, other: Judged) -> Judged:
        """Both together."""
        return Judged(
            np.concatenate([self.confidence, other.confidence]), np.concatenate([self.error, other.error]),
            self.known + other.known,
        )  # fmt: skip


def predicted(landmarker: Any, rgb: Picture, boxes: F64, count: int) -> tuple[F64, F64]:
    """Confidences (n,) and points (n, count, 2) of the faces found on boxes (n, 4), NaN where none is."""
    faces = landmarker.detect(rgb)
    points, confidence = np.full((len(boxes), count, 2), np.nan), np.full(len(boxes), np.nan)
    for index, match in enumerate(matches(setting.boxes_of(setting.points_of(faces)), boxes)):
        if match is not None:
            points[index], confidence[index] = faces[match].points[:count], faces[match].confidence
    return confidence, points


def of_stills(landmarker: Any, pictures: list[Still]) -> Judged:
    """Of a data set."""
    rows = [predicted(landmarker, still.rgb(), still.boxes, 68) for still in pictures]
    confidence, points = (np.concatenate(column) for column in zip(*rows, strict=True))
    error = face_errors(offset_removed_errors(points, np.concatenate([still.points for still in pictures])))
    there = np.isfinite(confidence) & np.isfinite(error)
    return Judged(confidence[there], error[there], len(there))


def of_parts(
    landmarker: Any, pictures: Iterator[Known], harden: Callable[[Known, np.random.Generator], Picture]
) -> Judged:
    """Of rendered pictures, made harder."""
    rng = np.random.default_rng(5)
    confidence, error, known = [], [], 0
    for one in pictures:
        sure, points = predicted(landmarker, harden(one, rng), setting.boxes_of(one.points[:, IBUG68]), 81)
        known += 1
        if np.isfinite(sure[0]):
            confidence.append(float(sure[0]))
            error.append(float(percent_errors(points, one.points).mean()))
    return Judged(np.array(confidence), np.array(error), known)


# -- harder pictures ------------------------------------------------------------------------------------------


def as_rendered(one: Known, rng: np.random.Generator) -> Picture:
    """The picture itself."""
    return one.rgb


def blurred(one: Known, rng: np.random.Generator) -> Picture:
    """A face of 10 to 40 pixels, enlarged again."""
    height, width = one.rgb.shape[:2]
    face = float(np.ptp(one.points[0, IBUG68, 0]))
    scale = min(rng.uniform(10, 40) / face, 1.0)
    small = cv2.resize(one.rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)


def half_hidden(one: Known, rng: np.random.Generator) -> Picture:
    """A third to two thirds of the face's box behind a plain rectangle, from any side."""
    x0, y0, x1, y1 = setting.boxes_of(one.points)[0]
    share, side = rng.uniform(0.33, 0.67), int(rng.integers(4))
    w, h = share * (x1 - x0), share * (y1 - y0)
    corners = ((x0, y0, x0 + w, y1), (x1 - w, y0, x1, y1), (x0, y0, x1, y0 + h), (x0, y1 - h, x1, y1))[side]
    a, b, c, d = (int(max(value, 0)) for value in corners)
    picture = one.rgb.copy()
    picture[b:d, a:c] = rng.integers(0, 256, 3)
    return picture


def dark(one: Known, rng: np.random.Generator) -> Picture:
    """A tenth of the light or less, with noise, brightened again."""
    light = rng.uniform(0.02, 0.1)
    seen = np.clip(light * one.rgb + rng.normal(0, 2, one.rgb.shape), 0, 255)
    return np.clip(np.round(seen / light), 0, 255).astype(np.uint8)


HARDER = {"as rendered": as_rendered, "blurred": blurred, "half hidden": half_hidden, "dark and noisy": dark}


# -- measurement ----------------------------------------------------------------------------------------------


def measure(options: argparse.Namespace) -> Report:
    """Stills, then parts."""
    landmarker = setting.landmarker(options)
    report, judged = Report(NAME, TITLE), {}
    real, rendered = [], []
    for name in SETS:
        pictures = stills(options.shared, name)[: 10 if options.quick else None]
        if not pictures:
            report.notes.append(f"Skipped: {name} is not in {options.shared}.")
            continue
        judged[name] = of_stills(landmarker, pictures)
        real.append(judged[name])
    if options.parts:
        pictures = held_out(options.parts, 40 if options.quick else options.pictures)
        defined = definitions.align_labels(pictures.points, *definitions.load_alignment("rendered"))
        pictures = replace(pictures, points=defined)
        for name, harden in HARDER.items():
            judged[f"parts, {name}"] = of_parts(landmarker, part_pictures(pictures), harden)
            rendered.append(judged[f"parts, {name}"])
            common.say(f"parts, {name}: {rendered[-1].right.mean():.3f} right")
    else:
        report.notes.append("Skipped: held-out parts; give --parts.")
    if not judged:
        return setting.skipped(NAME, TITLE, "no stills and no parts")
    report.tables.append(overview(judged))
    for name, group in (("stills", real), ("parts", rendered)):
        if group:
            report.tables.append(bins(name, sum(group[1:], group[0])))
    return report


def overview(judged: dict[str, Judged]) -> Table:
    """A row for each set."""
    columns = (
        "set", "faces", "told", "mean confidence", "share right", "Brier score", "mean |predicted - observed|",
        "ranking",
    )  # fmt: skip
    rows = []
    for name, j in judged.items():
        share = mean_of(j.right.astype(float))
        error = calibration_error(j.confidence, j.right, BIN_EDGES)
        score, order = brier(j.confidence, j.right), ranking(j.confidence, j.right)
        rows.append((name, j.known, len(j.error), mean_of(j.confidence), share, score, error, order))
    return Table(f"Each set; right is a mean error under {MAX_CORRECT_ERROR:g} %", columns, rows)


def bins(name: str, judged: Judged) -> Table:
    """Predicted probability against observed share."""
    rows = [
        (f"{low:g} to {high:g}", *rest)
        for low, high, *rest in reliability(judged.confidence, judged.right, BIN_EDGES)
    ]
    return Table(f"Reliability, all {name}", ("confidence", "faces", "mean confidence", "share right"), rows)


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = setting.with_parts(setting.arguments(__doc__))
    made.add_argument("--pictures", type=int, default=PICTURES, help="about so many pictures of the parts")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
