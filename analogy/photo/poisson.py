"""Integrates differences between neighbouring pixels (a Poisson equation) by multigrid.

The region changes with every expression, so a factorisation would not pay: a few V-cycles cost about as much as one
back-substitution.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.common.arrays import F32, Bool


@dataclass(frozen=True)
class MultigridSettings:
    """Settings of the solver."""

    cycles: int = 4  # off by 0.002 at most, where a step of 8 bits is 0.004
    sweeps: int = 2  # before and after each coarser grid
    damping: float = 0.8  # of Jacobi's step
    coarsest_px: int = 4  # down to which grids are halved


MULTIGRID = MultigridSettings()

_CROSS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], np.float32)


def integrate_edges(right: F32, down: F32, region: Bool) -> F32:
    """The field (h, w) whose edges fit the given ones best in least squares, zero outside a region.

    right, down : (h, w - 1) and (h - 1, w) edges, as from `guise.analogy.photo.height_field.edge_differences`.
    region : (h, w) bool; border pixels of the picture are excluded.

    Solves 4 u - sum of neighbours = divergence.
    """
    flow = np.zeros(region.shape, np.float32)
    flow[:, :-1] -= right
    flow[:, 1:] += right
    flow[:-1] -= down
    flow[1:] += down
    inner = region.astype(np.float32)
    inner[[0, -1]] = 0
    inner[:, [0, -1]] = 0
    regions = _region_pyramid(inner)
    flow *= inner
    field = np.zeros_like(flow)
    for _ in range(MULTIGRID.cycles):
        field = _v_cycle(field, flow, regions)
    return field


def _region_pyramid(region: F32) -> list[F32]:
    """The region on successively coarser grids; a coarse pixel belongs to it if all four fine ones do."""
    out = [region]
    while min(out[-1].shape) > 2 * MULTIGRID.coarsest_px:
        out.append(np.asarray(_restrict(out[-1]) == 1, np.float32))
    return out


def _v_cycle(field: F32, flow: F32, regions: list[F32]) -> F32:
    region, coarser = regions[0], regions[1:]
    field = _jacobi_sweeps(field, flow, region, MULTIGRID.sweeps if coarser else 8 * MULTIGRID.coarsest_px)
    if coarser:
        left = (flow - 4 * field + cv2.filter2D(field, -1, _CROSS, borderType=cv2.BORDER_CONSTANT)) * region
        halved = 4 * _restrict(np.asarray(left, np.float32))
        step = _v_cycle(np.zeros_like(halved), halved * coarser[0], coarser)
        field = field + _prolong(step, field.shape) * region
        field = _jacobi_sweeps(field, flow, region, MULTIGRID.sweeps)
    return np.asarray(field, np.float32)


def _jacobi_sweeps(field: F32, flow: F32, region: F32, sweeps: int) -> F32:
    """Damped Jacobi."""
    share = MULTIGRID.damping / 4 * region
    steady = share * flow
    for _ in range(sweeps):
        field = (
            (1 - MULTIGRID.damping) * field
            + share * cv2.filter2D(field, -1, _CROSS, borderType=cv2.BORDER_CONSTANT)
            + steady
        )
    return np.asarray(field, np.float32)


def _restrict(field: F32) -> F32:
    """Means of blocks of four pixels, zero beyond the picture."""
    height, width = field.shape
    whole = cv2.copyMakeBorder(field, 0, height % 2, 0, width % 2, cv2.BORDER_CONSTANT, value=0)
    size = (whole.shape[1] // 2, whole.shape[0] // 2)
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)


def _prolong(field: F32, shape: tuple[int, ...]) -> F32:
    wide = cv2.resize(field, (2 * field.shape[1], 2 * field.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide[: shape[0], : shape[1]], np.float32)
