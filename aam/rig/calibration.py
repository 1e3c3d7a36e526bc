"""Calibrates the estimator for one person: what they look like at rest, and how far their own face goes.

Asked for in turn: rest, then brows up, smile, jaw open, pucker.  What is told of the frames is fitted to what was asked
for by a linear map, ridge regression towards no change; frames at rest are to give 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from guise.aam.rig.coefficients import TOLD, RigCalibration, RigEstimator, shipped
from guise.aam.rig.names import INDEX
from guise.common.arrays import F32, U8, Floating
from guise.common.errors import GuiseError
from guise.common.tuned import tuned

# What each step of a calibration asks for.
ASKED: Mapping[str, Mapping[str, float]] = {
    "rest": {},
    "brows": {"browInnerUp": 1.0, "browOuterUpLeft": 1.0, "browOuterUpRight": 1.0},
    "smile": {"mouthSmileLeft": 1.0, "mouthSmileRight": 1.0},
    "jaw": {"jawOpen": 1.0},
    "pucker": {"mouthPucker": 1.0},
}
# By which the map is drawn to no change: of what is told, and of what is seen.
TOLD_RIDGE = tuned(60.0, "frames", "rig.coefficients")
SEEN_RIDGE = tuned(300.0, "frames", "rig.coefficients")
PEAK_SHARE = tuned(0.5, "share", "rig.coefficients")  # of a step's frames, those that move most


class CalibrationError(GuiseError):
    """A calibration that lacks something, in one sentence."""


@dataclass(eq=False)
class Calibrator:
    """Gathers frames of a calibration; `result` may be asked for when rest and any other steps were seen."""

    estimator: RigEstimator = field(default_factory=RigEstimator)
    seen: dict[str, list[F32]] = field(default_factory=dict)

    def see(self, rgb: U8, points: Floating, step: str) -> None:
        """Add a frame in which the person does what a step of `ASKED` asks for."""
        self.seen.setdefault(step, []).append(self.estimator.components(rgb, points)[0])

    def result(self) -> RigCalibration:
        """What was learnt of the person.

        Raises
        ------
        CalibrationError
            When there is no frame at rest.
        """
        if not self.seen.get("rest"):
            raise CalibrationError(
                "a calibration needs a face at rest, but none was found in that step; try again"
            )
        rest = np.asarray(np.median(self.seen["rest"], axis=0), np.float32)
        network = shipped()
        told, away, asked = [], [], []
        for step, rows in self.seen.items():
            values, seen = np.array([network.tell(row, rest) for row in rows]), np.array(rows) - rest
            wanted = np.zeros(values.shape[1], np.float32)
            for name, value in ASKED[step].items():
                wanted[TOLD.index(INDEX[name])] = value
            if step != "rest":  # the face needs a moment to get there
                order = np.argsort(values @ wanted)[int(len(rows) * (1 - PEAK_SHARE)) :]
                values, seen = values[order], seen[order]
            told.append(values)
            away.append(seen)
            asked.append(np.where(wanted > 0, wanted, values.clip(0, 1) * (step != "rest")))
        return RigCalibration(rest, fit_map(*(np.concatenate(part) for part in (told, away, asked))))


def fit_map(told: Floating, away: Floating, truth: Floating) -> F32:
    """(47 + k, 46), see `RigCalibration.linear`: ridge regression of the truth (n, 46), drawn to no change.

    told : (n, 46).   away : (n, k) components beside those at rest.
    """
    outputs, seen = told.shape[1], away.shape[1]
    design = np.column_stack([told, np.ones(len(told)), away]).astype(np.float64)
    start = np.eye(outputs + 1 + seen, outputs)
    ridge = np.repeat([TOLD_RIDGE, TOLD_RIDGE / 10, SEEN_RIDGE], [outputs, 1, seen])
    normal = design.T @ design + np.diag(ridge)
    right = design.T @ (np.asarray(truth, np.float64) - design @ start)
    return np.asarray(start + np.linalg.solve(normal, right), np.float32)


def save(calibration: RigCalibration, path: Path) -> None:
    """Write a calibration as .npz."""
    linear = np.zeros((0, 0), np.float32) if calibration.linear is None else calibration.linear
    with path.open("wb") as file:
        np.savez(file, rest=calibration.rest, linear=linear)


def load(path: Path) -> RigCalibration:
    """A calibration that `save` wrote.

    Raises
    ------
    CalibrationError
        When the file is none, or of another version.
    """
    try:
        with np.load(path) as stored:
            rest, linear = stored["rest"], stored["linear"]
    except (OSError, ValueError, KeyError) as error:
        raise CalibrationError(f"cannot use {path} as a calibration: {error}") from error
    if rest.shape != (shipped().size,):
        raise CalibrationError(f"cannot use {path}: it was made by another version; calibrate again")
    return RigCalibration(rest, linear if linear.size else None)
