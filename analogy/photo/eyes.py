"""Eyes that close: lids come down over the eyeball, where T shows no skin that could be stretched.

The lid is taken from S' where T's eye was, and what is around the eye stays where it is.
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


def closed(neutral: F64, expressive: F64, strength: float) -> F64:
    """How much of each eye's lid is new in landmarks (81, 2): (2,), 0 to 1."""
    shares = [
        1 + strength * (_opening(expressive[e]) / max(_opening(neutral[e]), 1e-6) - 1) for e in BOTH_EYES
    ]
    first, last = CLOSES
    share = np.clip((first - np.array(shares)) / (first - last), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))


def opened_again(points: F64, rest: F64, shares: F64) -> F64:
    """Landmarks (81, 2) with the lids put back, in shares, to where they rest in the same picture (81, 2)."""
    out = points.copy()
    for eye, share in zip(BOTH_EYES, shares, strict=True):
        lids = [eye[k] for k in (1, 2, 4, 5)]
        out[lids] += share * (rest[lids] - points[lids])
    return out


def _opening(eye: F64) -> float:
    """The gap of the lids (6, 2), by their width."""
    gap = np.linalg.norm(eye[[1, 2]] - eye[[5, 4]], axis=1).mean()
    return float(gap / max(float(np.linalg.norm(eye[0] - eye[3])), 1e-6))
