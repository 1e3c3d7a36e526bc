"""Faces rolled by every 15 degrees: how many are found, and their error beside that of the upright ones.

Stills are 20 of lfpw with one face and six people of imm_frontal.  Clips are three of rendered people, tracked from
frame to frame: rolled by each angle, and rolling over once in four seconds.  Errors are mean distances to the true
points in % of the true distance between the outer eye corners.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.annotated import Still, stills
from benchmarks.landmarks.metrics import matches
from benchmarks.rolled import moved, rolled
from guise.aam.landmarks import FaceTracker
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER

NAME, TITLE = "landmarks.rolls", "Faces at any roll"
STEP_DEGREES, LFPW, IMM_STEP = 15, 20, 10
PEOPLE, FRAMES = 3, 120
MAX_ERROR_RATIO = 1.2


def chosen(shared: Path) -> list[Still]:
    """The stills: of lfpw those with one face, of imm_frontal one of each person."""
    alone = [still for still in stills(shared, "lfpw") if len(still.points) == 1]
    return alone[:LFPW] + stills(shared, "imm_frontal")[::IMM_STEP]


def error(points: F64, truth: F64) -> float:
    """Mean distance of points (n, 2) to the true ones, NaN left out, %."""
    eyes = np.linalg.norm(truth[LEFT_EYE_OUTER] - truth[RIGHT_EYE_OUTER])
    return float(100 * np.nanmean(np.linalg.norm(points - truth, axis=1)) / eyes)


def still_error(landmarker: Any, still: Still, degrees: float) -> float:
    """Error of the face of a still rolled clockwise; NaN when it is not found with the default confidence."""
    picture, forward = rolled(still.rgb(), degrees)
    truth = moved(still.points, forward)
    found = setting.points_of(setting.sure(landmarker.detect(picture)))
    (match,) = matches(setting.boxes_of(found), setting.boxes_of(truth))
    return float("nan") if match is None else error(found[match], truth[0])


def clip_errors(landmarker: Any, pictures: Iterator[tuple[Picture, F64]]) -> list[float]:
    """Errors of a face tracked through pictures with true points (81, 2); NaN where it is lost."""
    tracker, errors = FaceTracker(landmarker), []
    for picture, truth in pictures:
        face = tracker.update(picture)
        errors.append(float("nan") if face is None else error(face.points.astype(np.float64), truth))
    return errors


def rolled_clip(clip: common.Clip, count: int, degrees: Sequence[float]) -> Iterator[tuple[Picture, F64]]:
    """The first frames, rolled by an angle each, and their true points."""
    for frame, angle in zip(islice(common.frames(clip), count), degrees, strict=True):
        picture, forward = rolled(frame.rgb(), angle)
        yield picture, moved(clip.points[frame.index], forward)


@dataclass(frozen=True)
class Row:
    """A roll: number of faces, share found in %, mean error in %, and its ratio to upright over those found in both."""

    roll: object
    faces: int
    found: float
    error: float
    ratio: float

    @classmethod
    def of(cls, roll: object, errors: Sequence[float], upright: Sequence[float]) -> Row:
        """From the errors of the same faces rolled and upright, NaN where not found."""
        these, those = np.array(errors), np.array(upright)
        seen, both = np.isfinite(these), np.isfinite(these) & np.isfinite(those)
        mean = float(these[seen].mean()) if seen.any() else float("nan")
        ratio = float(these[both].mean() / those[both].mean()) if both.any() else float("nan")
        return cls(roll, len(these), 100 * float(seen.mean()), mean, ratio)


def measure(options: argparse.Namespace) -> Report:
    """Stills at every roll, clips at every roll, and clips that roll over."""
    landmarker, quick = setting.landmarker(options), options.quick
    rolls = range(0, 360, 45 if quick else STEP_DEGREES)
    report, columns = (
        Report(NAME, TITLE),
        ("roll, degrees", "faces", "found, %", "mean error, %", "over upright"),
    )
    pictures = chosen(options.shared)[:: 4 if quick else 1]
    people = common.synthetic_people(options.shared)[: 1 if quick else PEOPLE]
    clips = [common.synthetic_clip(options.shared, person) for person in people]
    rows = {
        "stills": still_rows(landmarker, pictures, rolls) if pictures else [],
        "rendered clips": clip_rows(landmarker, clips, 30 if quick else FRAMES, rolls) if clips else [],
    }
    for name, lines in rows.items():
        if not lines:
            report.notes.append(f"Skipped: {name} are not in {options.shared}.")
            continue
        report.tables.append(Table(name.capitalize(), columns, [astuple(line) for line in lines]))
        report.criteria += criteria(name, lines)
    return report


def still_rows(landmarker: Any, pictures: Sequence[Still], rolls: Sequence[int]) -> list[Row]:
    """A row for each roll."""
    upright = [still_error(landmarker, still, 0) for still in pictures]
    return [
        Row.of(roll, [still_error(landmarker, still, roll) for still in pictures], upright) for roll in rolls
    ]


def clip_rows(landmarker: Any, clips: Sequence[common.Clip], count: int, rolls: Sequence[int]) -> list[Row]:
    """A row for each roll, and one for clips that roll over."""

    def errors(degrees: Sequence[float]) -> list[float]:
        found = (clip_errors(landmarker, rolled_clip(clip, count, degrees)) for clip in clips)
        return [one for several in found for one in several]

    upright = errors([0.0] * count)
    rows = [Row.of(roll, errors([float(roll)] * count), upright) for roll in rolls]
    over = np.linspace(0, 360, count, endpoint=False)
    return [*rows, Row.of("rolling over", errors(over.tolist()), upright)]


def criteria(name: str, rows: Sequence[Row]) -> list[Criterion]:
    """The worst roll beside upright, which is the first row."""
    upright, found, ratio = rows[0].found, min(r.found for r in rows), max(r.ratio for r in rows)
    return [
        Criterion(f"{name}: found at the worst roll; target: upright", found, ">=", upright, "%"),
        Criterion(f"{name}: error over upright at the worst roll", ratio, "<=", MAX_ERROR_RATIO),
    ]


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
