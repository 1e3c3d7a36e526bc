"""Coefficients of rendered people turned by 30 degrees and with glasses, and of the shipped rig's own shapes.

    python -m benchmarks.rig.rendered --shared ../shared

The controls of talk2 of data/synthetic move its people again, before the renderer in `shared/people`, as they are,
turned and with glasses; and the shapes of `training.arkit_shapes` on the head that ships, which is to give its curves
back.
Without calibration, smoothed as `guise rig from-video` does it; correlations as in `benchmarks.rig.coefficients`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.rig.coefficients import CURVES, NAMES, TARGETS, UNCALIBRATED, correlation, told, truth_of
from guise.aam.landmarks import FaceTracker
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.rig.coefficients import RigEstimator, smoothed
from guise.aam.rig.names import FULL_LOOK_DEGREES
from guise.common.arrays import F64, U8
from training.arkit_head import SPEC
from training.props import Glasses
from training.render_people import load_program, make_renderer
from training.rig_pictures import extend, give_shapes, weights_of

NAME, TITLE = "rig.rendered", "ARKit's coefficients of turned people, with glasses, and of the rig itself"
PEOPLE, EVERY, FPS = ("p03", "p06", "p13", "p14"), 2, 30  # frames of talk2
TURN_DEGREES = 30.0
WHOLE_RIG = 0.95
SIDE = 320  # pixels
CASES = {"plain": (0.0, False), "turned": (TURN_DEGREES, False), "glasses": (0.0, True)}


class Stage:
    """One person before the renderer."""

    def __init__(self, p: dict[str, Any], renderer: Any, spec: dict[str, Any]) -> None:
        self.p, self.renderer = p, renderer
        self.who = p["actor"].Actor(renderer, spec)
        give_shapes(p, self.who.p)
        self.light = p["looks"].LIGHTS[spec.get("light", "soft_front")]
        self.background = renderer.texture(p["looks"].background(5, w=SIDE, h=SIDE))
        self.glasses = Glasses(p, renderer, self.who, np.random.default_rng(3), 0.1)

    def frames(self, weights: F64, poses: F64, worn: bool) -> Iterator[U8]:
        """Pictures of the renderer's weights (t, k), heads turned by (t, 3) degrees."""
        p, who = self.p, self.who
        camera = p["render"].Camera(
            0.5 * SIDE * 9.5 / who.face_w, SIDE, SIDE, (0, who.face_c[1] + 0.1, who.face_c[2] + 9.5)
        )
        for w, pose in zip(weights, poses, strict=True):
            turn = p["human"].euler(*map(float, pose))
            skull = who.p.pose(w, turn, None)[1]
            who.place(w, turn, None, camera)
            self.glasses.place(who, skull, camera)
            actors = [who.g, *(self.glasses.actors if worn else [])]
            yield np.ascontiguousarray(self.renderer.frame(actors, camera, self.light, self.background))


def seen(pictures: Iterator[U8]) -> F64:
    """(t, 46) told of pictures, one after the other, without calibration."""
    tracker, estimator = FaceTracker(BuiltinLandmarker(turned=())), RigEstimator()
    rows = []
    for rgb in pictures:
        face = tracker.update(rgb)
        rows.append(estimator.components(rgb, face.points)[0] if face is not None else None)
    width = next(len(row) for row in rows if row is not None)
    found = np.array([np.full(width, np.nan) if row is None else row for row in rows], np.float32)
    return smoothed(told(found, None), np.arange(len(rows)) * EVERY / FPS)


def measure(options: argparse.Namespace) -> Report:
    """All figures."""
    folder = options.shared / "data" / "synthetic" / "people"
    p = load_program(options.shared / "people", SIDE)
    extend(p)
    renderer, found = make_renderer(p["render"]), dict[str, dict[str, list[float]]]()
    specs = {one["name"]: one for one in __import__("people").PEOPLE}
    for person in PEOPLE[: 1 if options.quick else None]:
        stage = Stage(p, renderer, specs[person])
        with np.load(folder / person / "talk2.npz") as stored:
            names, own = [str(n) for n in stored["weight_names"]], stored["weights"][::EVERY]
            poses = stored["yaw_pitch_roll_deg"][::EVERY].astype(np.float64)
        weights = np.array([weights_of(p, dict(zip(names, row, strict=True))) for row in own])
        truth = truth_of(folder / person / "talk2.npz")[::EVERY]
        for case, (turn, worn) in CASES.items():
            values = seen(stage.frames(weights, poses + np.array([turn, 0, 0]), worn))
            for curve, parts in CURVES.items():
                found.setdefault(case, {}).setdefault(curve, []).append(correlation(values, truth, parts))
        rig = Stage(p, renderer, {**specs["p10"], **SPEC, "hair": None})
        gaze = dict(zip(("gaze-yaw-deg", "gaze-pitch-deg"), FULL_LOOK_DEGREES * truth.T[-2:], strict=True))
        shapes = dict(zip(NAMES[:-2], truth.T[:-2].clip(0, 1), strict=True)) | gaze
        driven = np.array([weights_of(p, {n: v[k] for n, v in shapes.items()}) for k in range(len(truth))])
        values = seen(rig.frames(driven, poses, False))
        for curve, parts in CURVES.items():
            found.setdefault("rig", {}).setdefault(curve, []).append(correlation(values, truth, parts))
        common.say(
            person
            + " "
            + str({case: {c: round(v[-1], 2) for c, v in curves.items()} for case, curves in found.items()})
        )
    report, means = (
        Report(NAME, TITLE),
        {k: {c: float(np.nanmean(v)) for c, v in curves.items()} for k, curves in found.items()},
    )
    for curve, target in TARGETS.items():
        for case in ("turned", "glasses"):
            report.criteria.append(
                Criterion(f"{curve}, {case}", means[case][curve], ">=", UNCALIBRATED * target)
            )
        report.criteria.append(Criterion(f"{curve}, the rig", means["rig"][curve], ">=", WHOLE_RIG))
    rows = [(curve, *(f"{means[case][curve]:.2f}" for case in means)) for curve in CURVES]
    report.tables.append(Table("Mean of all people", ("curve", *means), rows))
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
