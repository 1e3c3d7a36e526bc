"""How far a tracked face can be trusted: whose it is, whether something hides it, whether it is a profile.

Where the landmarker's points and the person's tracker agree the face lies at their mean, otherwise at the points.  What
the person's model cannot explain there (a hand, a profile, another person) lowers the confidence, from which swap or
cover is decided.  Pixels as shown, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import INNER51, LEFT_EYE_OUTER, NOSE_TIP, RIGHT_EYE_OUTER
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit, Likeness, Tracker
from guise.common.arrays import F64

AGREE = 0.06  # mean distance of tracker and landmarker, inter-ocular distances, up to which the mean is taken
HIDDEN = 0.08  # share of the face that may be strange, at which the confidence is one half
HIDDEN_WIDTH = 0.015
PROFILE = (
    0.42  # share of the width between the eyes' outer corners at which the nose's tip lies from the middle
)


@dataclass(frozen=True, eq=False)
class Placed:
    """Where a face lies, (81, 2), and the confidence in [0, 1] that a swap there is right."""

    shape: F64
    confidence: float


def place(tracker: Tracker, luma: NDArray[np.uint8], points: F64, sure: float) -> Placed:
    """A person's face near the landmarker's points (81, 2) in luma (h, w).

    sure : the landmarker's confidence.
    """
    fit = tracker.fit(luma, points)
    shape = points
    if isinstance(fit, Fit) and _distance(fit.shape, points) < AGREE:
        shape = (fit.shape + points) / 2
    return Placed(shape, min(trust(tracker, luma, shape), _known(sure)))


def trust(tracker: Tracker, luma: NDArray[np.uint8], shape: F64) -> float:
    """Confidence in [0, 1] that the face at a shape (81, 2) in luma (h, w) is the person's, bare, and no profile."""
    look = tracker.likeness(luma, shape)
    return 0.0 if isinstance(look, Failed) else min(_like(look), _frontal(shape))


def _like(look: Likeness) -> float:
    strange = 1 / (1 + np.exp((look.hidden - HIDDEN) / HIDDEN_WIDTH))
    return float(min(look.confidence, strange))


def _known(sure: float) -> float:
    """The landmarker's confidence, which is about the points' last per cents, counted as doubt only when low."""
    return min(1.0, 1.25 * sure)


def _frontal(shape: F64) -> float:
    """1 for a face from the front, under one half for a profile."""
    right, left, nose = shape[RIGHT_EYE_OUTER], shape[LEFT_EYE_OUTER], shape[NOSE_TIP]
    across = left - right
    length = float(across @ across)
    if length <= 0:
        return 0.0
    turn = abs(float((nose - right) @ across) / length - 0.5)
    return float(1 / (1 + np.exp(np.clip((turn - PROFILE) / 0.03, -50, 50))))


def _distance(a: F64, b: F64) -> float:
    return float(np.linalg.norm(a[INNER51] - b[INNER51], axis=1).mean() / max(float(interocular(b)), 1e-6))
