"""How far a tracked face can be trusted: whose it is, whether something hides it, whether it is in profile.

Where the landmarker's points and the person's tracker agree, the face lies at their mean, otherwise at the points.
What the person's model cannot explain there (a hand, a profile, another person) lowers the confidence, which decides
between swap and cover.  Pixels as shown, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import INNER51, LEFT_EYE_OUTER, NOSE_TIP, RIGHT_EYE_OUTER
from guise.aam.similarity import Failed
from guise.aam.tracker import FaceMatch, Fit, Tracker
from guise.common.arrays import F64, U8


@dataclass(frozen=True)
class TrustLimits:
    """Thresholds of trust; each logistic function gives a confidence of one half at its limit."""

    agreement_interocular: float = (
        0.06  # mean distance of tracker and landmarker, up to which their mean is taken
    )
    occluded_share: float = 0.08  # of the face
    occluded_share_width: float = 0.015  # of the logistic function
    profile_offset: float = 0.42  # of the nose's tip from the middle, in distances of the outer eye corners
    profile_offset_width: float = 0.03
    landmarker_gain: float = 1.25  # by which a landmarker's confidence counts


LIMITS = TrustLimits()


@dataclass(frozen=True, eq=False)
class LocatedFace:
    """Where a face lies, (81, 2), and the confidence in [0, 1] that a swap there is right."""

    shape: F64
    confidence: float


def locate(tracker: Tracker, luma: U8, points: F64, confidence: float) -> LocatedFace:
    """A person's face near a landmarker's points (81, 2) in luma (h, w).

    confidence : the landmarker's, in [0, 1].
    """
    fit = tracker.fit(luma, points)
    shape = points
    if isinstance(fit, Fit) and _distance(fit.shape, points) < LIMITS.agreement_interocular:
        shape = (fit.shape + points) / 2
    return LocatedFace(shape, min(trust(tracker, luma, shape), _landmarker_trust(confidence)))


def trust(tracker: Tracker, luma: U8, shape: F64) -> float:
    """Confidence in [0, 1] that the face at a shape (81, 2) in luma (h, w) is the person's, unhidden and frontal."""
    match = tracker.match(luma, shape)
    return 0.0 if isinstance(match, Failed) else min(_match_trust(match), _frontal_trust(shape))


def _match_trust(match: FaceMatch) -> float:
    excess = match.occluded_share - LIMITS.occluded_share
    return float(min(match.confidence, 1 / (1 + np.exp(excess / LIMITS.occluded_share_width))))


def _landmarker_trust(confidence: float) -> float:
    """A landmarker's confidence, which is about the last per cents of the points' accuracy: a doubt only when low."""
    return min(1.0, LIMITS.landmarker_gain * confidence)


def _frontal_trust(shape: F64) -> float:
    """1 for a frontal face, less than one half for a profile."""
    right, left, nose = shape[RIGHT_EYE_OUTER], shape[LEFT_EYE_OUTER], shape[NOSE_TIP]
    across = left - right
    length = float(across @ across)
    if length <= 0:
        return 0.0
    turn = abs(float((nose - right) @ across) / length - 0.5)
    return float(
        1 / (1 + np.exp(np.clip((turn - LIMITS.profile_offset) / LIMITS.profile_offset_width, -50, 50)))
    )


def _distance(a: F64, b: F64) -> float:
    return float(np.linalg.norm(a[INNER51] - b[INNER51], axis=1).mean() / max(float(interocular(b)), 1e-6))
