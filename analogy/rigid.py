"""Rigid motions of parts of a mesh, found although some of their vertices move by themselves.

Any units.  Sets of points are (..., n, 3): leading axes are fitted each on their own.
"""

from __future__ import annotations

import numpy as np

from guise.common.arrays import F64

ROUNDS = 8  # of reweighting
SHARPER = 0.4  # the tolerance of each round, of the one before


def fit(source: F64, target: F64, weights: F64) -> tuple[F64, F64]:
    """R (..., 3, 3), t (..., 3) of the motion x -> R x + t that takes source to target (..., n, 3).

    weights : (..., n), positive.  Least squares (Kabsch 1976).
    """
    w = (weights / weights.sum(-1, keepdims=True))[..., None]
    middle, to = (w * source).sum(-2), (w * target).sum(-2)
    z = np.swapaxes(w * (target - to[..., None, :]), -1, -2) @ (source - middle[..., None, :])
    u, _, vt = np.linalg.svd(z)
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    turn = u @ vt
    return turn, to - np.einsum("...ij,...j->...i", turn, middle)


def moved(points: F64, turn: F64, shift: F64) -> F64:
    """R x + t of points (..., n, 3)."""
    return np.asarray(points @ np.swapaxes(turn, -1, -2) + shift[..., None, :])


def fit_most(source: F64, target: F64, weights: F64) -> tuple[F64, F64]:
    """As `fit`, of the vertices that move as one, those that move otherwise left out.

    Iteratively reweighted: w / (r^2 + e^2) for residuals r, with e from their root mean square downwards.
    """
    turn, shift = fit(source, target, weights)
    square = _squares(source, target, turn, shift)
    limit = (weights * square).sum(-1, keepdims=True) / weights.sum(-1, keepdims=True)
    limit = np.maximum(limit, 1e-30 * np.square(source).sum((-2, -1))[..., None] + 1e-300)
    for _ in range(ROUNDS):
        turn, shift = fit(source, target, weights * (limit / (square + limit)))
        square = _squares(source, target, turn, shift)
        limit = limit * SHARPER**2
    return turn, shift


def _squares(source: F64, target: F64, turn: F64, shift: F64) -> F64:
    return np.asarray(np.square(moved(source, turn, shift) - target).sum(-1))
