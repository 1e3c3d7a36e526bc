"""Points on the rendered swap scenes, tracked as `guise swap` does, against ground truth.

People are enrolled from their first clip by the built-in landmarker, so the scenes show them in other light, turned,
hidden and with other expressions. The error is the mean distance over all 81 landmarks in % of the true distance of
the outer eye corners; each point's mean difference over all scenes, which is one of definition, is removed. Beside it
stands the person's own tracker without a landmarker, which says only whose face it is.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.aam.solid_shape import SolidPrior, SolidTracker, pulled
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.media import open_input

TURNED_DEGREES = 30.0


def tracked(person: Identity, video: Path, *, landmarker: bool) -> F64:
    """(t, 81, 2) shapes, NaN where lost."""
    finder = open_landmarker("builtin") if landmarker else common.detector()
    tracker = PersonTracker(person.tracker, finder, rest=person.rest_frame)
    rest = SolidPrior.shipped().rest_of(person.appearance.neutral_shape, still=person.knows_rest)
    solid = SolidTracker(rest)
    shapes = []
    with open_input(video) as media:
        for frame in media:
            shape = common.shape_of(tracker.update(frame.luma))
            shapes.append(np.full((81, 2), np.nan) if shape is None else pulled(shape, solid.update(shape)))
    return np.array(shapes)


def enrolled(shared: Path, names: list[str]) -> dict[str, Identity]:
    """Models from the people's first clips, with the built-in landmarker's points."""
    clips = [common.synthetic_clip(shared, name).video for name in names]
    source = LandmarkSource(landmarker=open_landmarker("builtin"))
    return {name: enrol([clip], source, name=name) for name, clip in zip(names, clips, strict=True)}


def differences(shapes: F64, truth: F64) -> F64:
    """(t, 81, 2) from the truth to the shapes in % of the inter-ocular distance, eyes level; NaN where lost."""
    eyes = truth[:, LEFT_EYE_OUTER] - truth[:, RIGHT_EYE_OUTER]
    along = eyes / (eyes**2).sum(1, keepdims=True)  # one inter-ocular distance is 1
    level = np.stack([along, np.stack([-along[:, 1], along[:, 0]], axis=1)], axis=2)
    return np.asarray(100 * (shapes - truth) @ level)


def _mean(errors: F64) -> float | str:
    found = errors[np.isfinite(errors)]
    return float(found.mean()) if len(found) else "lost"


def measure(options: argparse.Namespace) -> Report:
    """All scenes."""
    scenes = sorted((options.shared / "data" / "synthetic" / "swap").glob("*_gets_*"))[
        : 2 if options.quick else None
    ]
    people = enrolled(options.shared, sorted({scene.name.split("_")[1] for scene in scenes}))
    away: dict[bool, list[F64]] = {True: [], False: []}
    yaws = []
    for scene in scenes:
        truth = np.load(scene / "source.npz")
        yaws.append(np.abs(truth["yaw_pitch_roll_deg"][:, 0]))
        for landmarker, all_ in away.items():
            shapes = tracked(people[scene.name.split("_")[1]], scene / "source.mp4", landmarker=landmarker)
            all_.append(differences(shapes, truth["landmarks"].astype(np.float64)[: len(shapes)]))
        common.say(scene.name)
    rows, errors = [], {}
    for landmarker, all_ in away.items():
        definition = np.nanmean(np.concatenate(all_), axis=0)
        errors[landmarker] = [np.linalg.norm(one - definition, axis=2).mean(1) for one in all_]
    for scene, own, alone in zip(scenes, errors[True], errors[False], strict=True):
        lost = int(np.isnan(own).sum()), int(np.isnan(alone).sum())
        rows.append((scene.name, float(np.nanmean(own)), lost[0], _mean(alone), lost[1]))
    turned = np.concatenate(
        [e[y[: len(e)] > TURNED_DEGREES] for e, y in zip(errors[True], yaws, strict=True)]
    )
    means = [row[1] for row in rows]
    criteria = [
        Criterion("mean error, all scenes", float(np.mean(means)), "<=", 1.8, "%"),
        Criterion("mean error, worst scene", float(np.max(means)), "<=", 2.5, "%"),
        Criterion("frames lost", sum(row[2] for row in rows), "<=", 0),
    ]
    if len(turned):
        criteria.append(
            Criterion("mean error, yaw over 30 degrees", float(np.nanmean(turned)), "<=", 3.5, "%")
        )
    columns = ("scene", "mean error, %", "lost", "without landmarker, %", "lost ")
    return Report(
        "tracker_scenes", "Points on the rendered swap scenes", criteria, [Table("Scenes", columns, rows)]
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
