"""Rigid motions of point sets, robust against points that move on their own.

Any unit.  Point sets are (..., n, 3); leading axes are batches.
"""

from __future__ import annotations

import numpy as np

from guise.aam.similarity import align_rigid
from guise.common.arrays import F64

REWEIGHTING_ROUNDS = 8
TOLERANCE_DECAY = 0.4  # of the tolerance, from one round to the next


def apply_rigid(points: F64, turn: F64, shift: F64) -> F64:
    """R x + t of points (..., n, 3)."""
    return np.asarray(points @ np.swapaxes(turn, -1, -2) + shift[..., None, :])


def rotation_angle(rotation: F64) -> float:
    """Angle of a rotation (3, 3), degrees."""
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def align_rigid_robust(source: F64, target: F64, weights: F64) -> tuple[F64, F64]:
    """As `align_rigid`, for the points that move as one body; others are left out.

    Iteratively reweighted: w / (r^2 + e^2) for residuals r, with e shrinking from their root mean square.
    """
    turn, shift = align_rigid(source, target, weights)
    square = _squared_residuals(source, target, turn, shift)
    limit = (weights * square).sum(-1, keepdims=True) / weights.sum(-1, keepdims=True)
    limit = np.maximum(limit, 1e-30 * np.square(source).sum((-2, -1))[..., None] + 1e-300)
    for _ in range(REWEIGHTING_ROUNDS):
        turn, shift = align_rigid(source, target, weights * (limit / (square + limit)))
        square = _squared_residuals(source, target, turn, shift)
        limit = limit * TOLERANCE_DECAY**2
    return turn, shift


def _squared_residuals(source: F64, target: F64, turn: F64, shift: F64) -> F64:
    return np.asarray(np.square(apply_rigid(source, turn, shift) - target).sum(-1))
