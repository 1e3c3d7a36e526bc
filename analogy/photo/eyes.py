"""Closing eyes: lids come down over the eyeball, where T shows no skin that could be stretched.

The lid is taken from S' where the eye of T was, and the surroundings of the eye stay in place.
"""

from __future__ import annotations

import numpy as np

from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.common.arrays import F64

BOTH_EYES = (RIGHT_EYE, LEFT_EYE)
CLOSES = (
    0.34,
    0.26,
)  # of the neutral opening: where a lid begins to be taken from S', and is wholly; squints stay


def lid_shares(neutral: F64, expressive: F64, strength: float) -> F64:
    """Shares (2,), 0 to 1, of the right and left lid that come from S'; landmarks (81, 2)."""
    shares = [
        1 + strength * (_lid_gap(expressive[e]) / max(_lid_gap(neutral[e]), 1e-6) - 1) for e in BOTH_EYES
    ]
    first, last = CLOSES
    share = np.clip((first - np.array(shares)) / (first - last), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))


def reopen_eyes(points: F64, rest: F64, shares: F64) -> F64:
    """Landmarks (81, 2) with the lids moved back, by shares (2,), to their rest positions (81, 2)."""
    out = points.copy()
    for eye, share in zip(BOTH_EYES, shares, strict=True):
        lids = [eye[k] for k in (1, 2, 4, 5)]
        out[lids] += share * (rest[lids] - points[lids])
    return out


def _lid_gap(eye: F64) -> float:
    """Gap between the lids of an eye (6, 2), relative to its width."""
    gap = np.linalg.norm(eye[[1, 2]] - eye[[5, 4]], axis=1).mean()
    return float(gap / max(float(np.linalg.norm(eye[0] - eye[3])), 1e-6))
