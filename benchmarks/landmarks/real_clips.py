"""Real clips: faces tracked as the commands track them, against the landmarks beside the clips.

Those are MediaPipe's output, not ground truth, and only frames that have them count.  A face is found when a tracked
one overlaps the given one.  Errors are mean distances in % of the given distance between the outer eye
corners, over the frames found.  Other faces are those that overlap no given one: false, or people whom MediaPipe did
not see.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.clips import HARD, RealClip, real_clips
from benchmarks.landmarks.metrics import face_errors, matches, mean_of, percent_errors
from guise.aam.landmarks import Landmarker
from guise.aam.landmarks.schemes import INNER51
from guise.aam.landmarks.tracking import MultiFaceTracker

NAME, TITLE = "landmarks.real_clips", "Landmarks on real clips"
FRAMES = 300  # of a clip


@dataclass(frozen=True)
class Result:
    """One clip: frames with given landmarks, those in which the face is found, errors in %, and other faces."""

    clip: RealClip
    frames: int
    found: int
    error: float
    inner: float
    p95: float
    other: int

    @property
    def share(self) -> float:
        """Frames found, %."""
        return 100 * self.found / max(self.frames, 1)


def result(clip: RealClip, landmarker: Landmarker, count: int | None) -> Result:
    """Track the faces of one clip."""
    tracker, points = MultiFaceTracker(landmarker), np.full(clip.points.shape, np.nan)
    other = 0
    for index, rgb in enumerate(clip.frames(count)):
        faces = setting.points_of(list(tracker.update(rgb).values()), 81)
        given = clip.points[index : index + 1]
        if np.isfinite(given).all():
            (match,) = matches(setting.boxes_of(faces), setting.boxes_of(given))
            other += len(faces) - (match is not None)
            if match is not None:
                points[index] = faces[match]
    return summary(clip, points[:count], clip.points[:count], other)


def summary(clip: RealClip, points: F64, given: F64, other: int) -> Result:
    """Shares and errors of points (t, 81, 2), NaN where not found."""
    errors = percent_errors(points, given)
    each = face_errors(errors)
    finite = each[np.isfinite(each)]
    p95 = float(np.quantile(finite, 0.95)) if len(finite) else float("nan")
    known = int(np.isfinite(given).all((1, 2)).sum())
    return Result(clip, known, len(finite), mean_of(each), mean_of(face_errors(errors, INNER51)), p95, other)


def measure(options: argparse.Namespace) -> Report:
    """All clips that have landmarks."""
    clips = [c for c in real_clips(options.shared) if np.isfinite(c.points).all((1, 2)).any()]
    if not clips:
        return setting.skipped(NAME, TITLE, f"no clips in {options.shared / 'data' / 'real'}")
    landmarker = setting.landmarker(options)
    count = 40 if options.quick else options.frames or None
    results = []
    for clip in clips:
        results.append(result(clip, landmarker, count))
        common.say(
            f"{clip.name}: {results[-1].share:.1f} % of {results[-1].frames}, {results[-1].error:.2f} %"
        )
    frontal = [r for r in results if r.clip.name not in HARD]
    hard = [r for r in results if r.clip.name in HARD]
    report = Report(NAME, TITLE, criteria(frontal, hard))
    report.tables = [table("Frontal clips", frontal), table("Hard clips", hard)]
    report.notes = [f"Hard: {', '.join(f'{r.clip.name} ({HARD[r.clip.name]})' for r in hard)}."]
    report.notes.append(f"At most {count} frames of a clip." if count else "All frames.")
    return report


def table(title: str, results: list[Result]) -> Table:
    """A row for each clip."""
    columns = (
        "clip", "frames", "found, %", "mean error, %", "inner 51, %", "95th percentile, %", "other faces a frame",
        "in the training data",
    )  # fmt: skip
    rows = [
        (r.clip.name, r.frames, r.share, r.error, r.inner, r.p95, r.other / max(r.frames, 1),
         "yes" if r.clip.seen else "no")
        for r in results
    ]  # fmt: skip
    return Table(title, columns, rows)


def criteria(frontal: list[Result], hard: list[Result]) -> list[Criterion]:
    """Targets for all frames of a group, and for its worst clip."""
    made = []
    for name, results, target in (("frontal", frontal, 99.0), ("hard", hard, 90.0)):
        if results:
            whole = 100 * sum(r.found for r in results) / sum(r.frames for r in results)
            worst = min(results, key=lambda r: r.share)
            made.append(Criterion(f"face found, frames of all {name} clips", whole, ">=", target, "%"))
            made.append(
                Criterion(f"the same, worst clip ({worst.clip.name})", worst.share, ">=", target, "%")
            )
    return made


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument("--frames", type=int, default=FRAMES, help="first frames of each clip; 0 for all")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
