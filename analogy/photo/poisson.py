"""Heights of which the slopes are known, by multigrid.

The region changes with every expression, so nothing is factorised: a few V-cycles cost about as much as one
back-substitution.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F32, Bool

CYCLES = 6
SWEEPS = 2  # before and after each coarser grid
DAMPING = 0.8  # of Jacobi's step
COARSEST = 4  # pixels; grids are halved down to it
_CROSS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], np.float32)


def integrated(right: F32, down: F32, region: Bool) -> F32:
    """The field (h, w) whose edges are as near as can be to those given, zero outside a region.

    right, down : (h, w - 1) and (h - 1, w) edges, as of `guise.analogy.photo.heights.slopes`.
    region : (h, w), of which the picture's rim is no part.

    The sum of squared differences over all edges is least: 4 u - sum of neighbours = what flows out.
    """
    flow = np.zeros(region.shape, np.float32)
    flow[:, :-1] -= right
    flow[:, 1:] += right
    flow[:-1] -= down
    flow[1:] += down
    inner = region.astype(np.float32)
    inner[[0, -1]] = 0
    inner[:, [0, -1]] = 0
    regions = _pyramid(inner)
    flow *= inner
    field = np.zeros_like(flow)
    for _ in range(CYCLES):
        field = _cycle(field, flow, regions)
    return field


def _pyramid(region: F32) -> list[F32]:
    """The region on ever coarser grids, where whole blocks of four are of it."""
    out = [region]
    while min(out[-1].shape) > 2 * COARSEST:
        out.append(np.asarray(_halved(out[-1]) == 1, np.float32))
    return out


def _cycle(field: F32, flow: F32, regions: list[F32]) -> F32:
    region, coarser = regions[0], regions[1:]
    field = _smoothed(field, flow, region, SWEEPS if coarser else 8 * COARSEST)
    if coarser:
        left = (flow - 4 * field + cv2.filter2D(field, -1, _CROSS, borderType=cv2.BORDER_CONSTANT)) * region
        halved = 4 * _halved(np.asarray(left, np.float32))
        step = _cycle(np.zeros_like(halved), halved * coarser[0], coarser)
        field = field + _doubled(step, field.shape) * region
        field = _smoothed(field, flow, region, SWEEPS)
    return np.asarray(field, np.float32)


def _smoothed(field: F32, flow: F32, region: F32, sweeps: int) -> F32:
    """Damped Jacobi."""
    share = DAMPING / 4 * region
    steady = share * flow
    for _ in range(sweeps):
        field = (
            (1 - DAMPING) * field
            + share * cv2.filter2D(field, -1, _CROSS, borderType=cv2.BORDER_CONSTANT)
            + steady
        )
    return np.asarray(field, np.float32)


def _halved(field: F32) -> F32:
    """Means of blocks of four; what lies beyond the picture is zero."""
    height, width = field.shape
    whole = cv2.copyMakeBorder(field, 0, height % 2, 0, width % 2, cv2.BORDER_CONSTANT, value=0)
    size = (whole.shape[1] // 2, whole.shape[0] // 2)
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)


def _doubled(field: F32, shape: tuple[int, ...]) -> F32:
    wide = cv2.resize(field, (2 * field.shape[1], 2 * field.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide[: shape[0], : shape[1]], np.float32)
