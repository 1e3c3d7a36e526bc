"""Tracker accuracy on rendered people: enrolled on the first clip, tracked in the second, against ground truth.

The error is the mean distance over all 81 landmarks in % of the true inter-ocular distance (outer eye corners).
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Report, Table
from guise.aam.landmarks.schemes import INNER51
from guise.aam.person_tracker import PersonTracker


def tracked(person_clip: Clip, clip: Clip, share: float = 1.0, first: int = 0) -> F64:
    """Shapes (t, 81, 2) in a clip from frame `first` on, NaN where lost, by a tracker enrolled on another's share."""
    person = common.enrolled(person_clip, share)
    person_tracker = PersonTracker(person.tracker, common.detector())
    shapes = np.full(clip.points.shape, np.nan)
    for frame in common.frames(clip):
        if frame.index >= first:
            shape = common.shape_of(person_tracker.update(frame.luma))
            shapes[frame.index] = np.nan if shape is None else shape
    return shapes


def percent_errors(shapes: F64, clip: Clip) -> F64:
    """(t, 81) distances to the clip's landmarks, % of its inter-ocular distance."""
    return np.asarray(100 * np.linalg.norm(shapes - clip.points, axis=2) / clip.interocular[:, None])


def measure(options: argparse.Namespace) -> Report:
    """All people."""
    rows = []
    for name in common.synthetic_people(options.shared)[: 1 if options.quick else None]:
        clip = common.synthetic_clip(options.shared, name, "talk2")
        errors = percent_errors(tracked(common.synthetic_clip(options.shared, name), clip), clip)
        found = np.isfinite(errors).all(1)
        each = errors[found].mean(1)
        inner, p95 = errors[found][:, INNER51].mean(), np.quantile(each, 0.95)
        rows.append((name, float(each.mean()), float(inner), float(p95), len(errors), int((~found).sum())))
        common.say(str(rows[-1]))
    columns = ("person", "mean error, %", "inner points, %", "95th percentile of frames, %", "frames", "lost")
    return Report(
        "tracker_synthetic",
        "Tracker accuracy on rendered people",
        [
            Criterion("mean error, all people", float(np.mean([r[1] for r in rows])), "<=", 2.0, "%"),
            Criterion("mean error, worst person", float(np.max([r[1] for r in rows])), "<=", 2.0, "%"),
            Criterion("frames lost, all people", int(sum(r[-1] for r in rows)), "<=", 0),
        ],
        [Table("Each person", columns, rows)],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
