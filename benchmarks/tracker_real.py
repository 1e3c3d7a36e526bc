"""Tracker on real footage: enrolled on the first third of a clip, tracked in the rest.

Errors are relative to the given landmarks, which are another tracker's output and not ground truth: mean distance over
all 81, in % of the inter-ocular distance, of frames that have landmarks.  A frame is lost when it has landmarks and
the tracker returns none.

Jitter is the root mean square, over points and frames, of the second difference of the points in time, in % of the
inter-ocular distance, where the face is still: frames around which the given landmarks, averaged over seven frames,
move by less than 0.15 % per frame.  Both trackers are compared on the same frames.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Report, Table
from benchmarks.tracker_synthetic import percent_errors, tracked
from guise.aam.landmarks.schemes import INNER51

CLIPS = ("franck", "webcam_a1", "studio_d6", "address_o1", "phone_d13", "studio_d3", "address_o3", "room_s18")
ENROLLED_SHARE = 1 / 3
SMOOTHING_FRAMES = 7
MAX_STILL_MOTION = 0.15  # % of the inter-ocular distance per frame
MIN_STILL_FRAMES = 10  # from which jitter is reported
MIN_PEOPLE = 4  # who must meet the targets
MAX_ERROR, MAX_LOST = 3.5, 1.0  # %


@dataclass(frozen=True)
class Result:
    """One clip: errors in %, lost share in %, jitter in %."""

    clip: str
    error: float
    inner: float
    p95: float
    frames: int
    lost: float
    still: int
    jitter: float
    landmarks_jitter: float

    @property
    def right(self) -> bool:
        """Whether this clip alone reaches the targets for error and loss."""
        return self.error <= MAX_ERROR and self.lost <= MAX_LOST

    @property
    def ratio(self) -> float:
        """Jitter over the landmarks' own; NaN when too few frames are still."""
        return self.jitter / self.landmarks_jitter


def still_frames(points: F64, interocular: F64) -> NDArray[np.bool_]:
    """(t,) bool: where smoothed points (t, n, 2) hardly move; never beside a frame without landmarks."""
    half = SMOOTHING_FRAMES // 2
    still = np.zeros(len(points), bool)
    kernel = np.ones(SMOOTHING_FRAMES) / SMOOTHING_FRAMES
    smooth = np.apply_along_axis(lambda v: np.convolve(v, kernel, "valid"), 0, points)
    step = np.linalg.norm(np.diff(smooth, axis=0), axis=2).mean(1)  # step k: from frame k + half to the next
    is_still = 100 * step / interocular[half : half + len(step)] < MAX_STILL_MOTION
    still[half + 1 : half + len(is_still)] = is_still[:-1] & is_still[1:]
    return still


def jitter(points: F64, interocular: F64, chosen: NDArray[np.bool_]) -> float:
    """Root mean square second difference of points (t, n, 2) at the chosen frames, %."""
    second = points[:-2] - 2 * points[1:-1] + points[2:]
    size = 100 * np.linalg.norm(second, axis=2) / interocular[1:-1, None]
    return float(np.sqrt((size[chosen[1:-1]] ** 2).mean()))


def result(clip: Clip) -> Result:
    """Enrol, track and compare one clip."""
    first = round(ENROLLED_SHARE * len(clip.points))
    shapes = tracked(clip, clip, ENROLLED_SHARE, first)
    errors = percent_errors(shapes, clip)[first:]
    known = np.isfinite(clip.points[first:]).all((1, 2))
    found = known & np.isfinite(errors).all(1)
    each = errors[found].mean(1)
    whole = np.isfinite(shapes).all((1, 2))
    steady = np.zeros(len(whole), bool)
    steady[1:-1] = whole[:-2] & whole[1:-1] & whole[2:]
    chosen = still_frames(clip.points, clip.interocular) & steady
    enough = chosen.sum() >= MIN_STILL_FRAMES
    values = [jitter(p, clip.interocular, chosen) if enough else float("nan") for p in (shapes, clip.points)]
    lost = 100 * float((known & ~found).sum() / known.sum())
    error, p95 = float(each.mean()), float(np.quantile(each, 0.95))
    return Result(
        clip.name,
        error,
        float(errors[found][:, INNER51].mean()),
        p95,
        int(known.sum()),
        lost,
        int(chosen.sum()),
        *values,
    )


def measure(options: argparse.Namespace) -> Report:
    """All clips."""
    results = []
    for name in CLIPS[-1:] if options.quick else CLIPS:
        results.append(result(common.real_clip(options.shared, name)))
        common.say(str(results[-1]))
    rows = [(*vars(r).values(), r.ratio) for r in results]
    columns = (
        "clip", "mean error, %", "inner points, %", "95th percentile, %", "frames", "lost, %", "still frames",
        "jitter, %", "landmarks' jitter, %", "ratio",
    )  # fmt: skip
    return Report(
        "tracker_real",
        "Tracker on real footage",
        criteria(results),
        [Table("Each clip", columns, rows)],
    )


def criteria(results: list[Result]) -> list[Criterion]:
    """Targets for each person, and for the mean of all; jitter only of clips that hold still."""
    ratios = [r.ratio for r in results if np.isfinite(r.ratio)] or [float("nan")]
    people = min(MIN_PEOPLE, len(results))
    return [
        Criterion(
            f"clips with error <= {MAX_ERROR} % and loss <= {MAX_LOST} %",
            sum(r.right for r in results),
            ">=",
            people,
        ),
        Criterion("mean error, all clips", float(np.mean([r.error for r in results])), "<=", MAX_ERROR, "%"),
        Criterion("frames lost, all clips", float(np.mean([r.lost for r in results])), "<=", MAX_LOST, "%"),
        Criterion("jitter over the landmarks' own, mean of clips", float(np.mean(ratios)), "<", 1.0),
        Criterion("the same, worst clip", float(np.max(ratios)), "<", 1.0),
    ]


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
