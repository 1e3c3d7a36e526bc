"""Brow height and mouth opening over time on real clips, against MediaPipe's landmarks beside them.

Correlation says whether what moves is seen to move, the gain by how much of MediaPipe's motion.  A curve in which
MediaPipe's own moves by less than MIN_MOTION (standard deviation, in distances between the outer eye corners) is
mostly its noise, and is listed but not judged.  MediaPipe's distance between the eye corners is the unit of both, and
its answers are no ground truth.
"""

from __future__ import annotations

import argparse
from itertools import chain
from typing import Any

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.clips import HARD, RealClip, real_clips
from benchmarks.landmarks.jitter import INNER_LIP, Clip, timed, tracks
from benchmarks.landmarks.metrics import opening
from guise.aam.landmarks import Landmarker, interocular
from guise.aam.landmarks.schemes import (
    LEFT_BROW,
    LEFT_EYE_CORNERS,
    LEFT_EYE_OUTER,
    RIGHT_BROW,
    RIGHT_EYE_CORNERS,
    RIGHT_EYE_OUTER,
)

NAME, TITLE = "landmarks.expressions", "Brows and mouths over time"
FRAMES = 300  # of a clip
MIN_MOTION = {"brows": 0.006, "mouth": 0.01}


def brow_height(points: F64) -> F64:
    """Mean height (t,) of both brows over their eyes' corners, pixels, of points (t, 81, 2)."""
    along = (points[:, LEFT_EYE_OUTER] - points[:, RIGHT_EYE_OUTER]) / interocular(points)[:, None]
    up = np.stack([along[:, 1], -along[:, 0]], axis=1)
    pairs = ((RIGHT_BROW, RIGHT_EYE_CORNERS), (LEFT_BROW, LEFT_EYE_CORNERS))
    rise = np.mean([points[:, brow].mean(1) - points[:, eye].mean(1) for brow, eye in pairs], axis=0)
    return np.asarray((rise * up).sum(1))


def mouth_opening(points: F64) -> F64:
    """Opening (t,) of the inner lips, pixels, of points (t, 81, 2)."""
    return opening(points, INNER_LIP) * interocular(points)


def compared(ours: F64, theirs: F64) -> tuple[float, float, float]:
    """Correlation of two curves (t,), our motion over theirs, and the standard deviation of theirs."""
    spread = float(theirs.std())
    if spread == 0 or ours.std() == 0:
        return float("nan"), float("nan"), spread
    together = float(np.corrcoef(ours, theirs)[0, 1])
    return together, together * float(ours.std()) / spread, spread


def row(clip: RealClip, landmarker: Landmarker, count: int | None) -> tuple[Any, ...]:
    """Name and frames of a clip; correlation, gain and motion of brows and of the mouth."""
    found = tracks(landmarker, timed(Clip(clip.name, clip.video, clip.points), count)).smoothed
    given = clip.points[: len(found)]
    both = np.isfinite(found).all((1, 2)) & np.isfinite(given).all((1, 2))
    ours, theirs = found[both], given[both]
    if len(ours) < 2:
        return clip.name, len(ours), *[float("nan")] * 6
    size = interocular(theirs)
    brows = compared(brow_height(ours) / size, brow_height(theirs) / size)
    mouth = compared(mouth_opening(ours) / size, mouth_opening(theirs) / size)
    return clip.name, len(ours), *brows, *mouth


def measure(options: argparse.Namespace) -> Report:
    """Clips that show one person from the front."""
    landmarker = setting.landmarker(options)
    clips = [clip for clip in real_clips(options.shared) if clip.name not in HARD]
    rows = []
    for clip in clips[: 2 if options.quick else None]:
        rows.append(row(clip, landmarker, 60 if options.quick else FRAMES))
        common.say(str(rows[-1]))
    judged = {
        what: [r[place] for r in rows if r[place + 2] >= MIN_MOTION[what]]
        for what, place in (("brows", 2), ("mouth", 5))
    }
    values = list(chain(*judged.values()))
    criteria = [
        Criterion("correlation, worst curve", float(np.min(values)) if values else float("nan"), ">=", 0.8),
        Criterion("correlation, median", float(np.median(values)) if values else float("nan"), ">=", 0.93),
    ]
    columns = (
        "clip", "frames", "brows", "gain", "motion", "mouth", "gain ", "motion ",
    )  # fmt: skip
    notes = [f"Judged: brows of {len(judged['brows'])} clips, mouths of {len(judged['mouth'])}."]
    return Report(NAME, TITLE, criteria, [Table("Correlation, gain and motion", columns, rows)], notes)


if __name__ == "__main__":
    common.run(measure, setting.arguments(__doc__))
