"""The methods that vertex tents are compared with, on meshes of one topology.

Deformation transfer (Sumner and Popovic 2004) imposes the transformations of the source's triangles on the target's;
expression cloning (Noh and Neumann 2001) rotates and scales displacements vertex by vertex.  The deformable model
(Xiang et al. 2008, section 3.3) takes the source deformed onto the target for the target of a deformation transfer;
its displacements are then interpolated.  Any unit.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from guise.analogy.solver import factorise_least_squares
from guise.analogy.tents import MIN_HOLD_SHARE, STILL_MOTION_SHARE, Rings, tips
from guise.common.arrays import F64

MIN_TRIANGLE_RATIO = 0.05  # of the target's triangle; a thinner one on the source keeps its shape
MAX_SCALE_RATIO = 4.0  # times the median ratio of sizes, the most by which cloning scales


class GradientTransfer:
    """Deformation transfer; factorised once.

    Eqs. 3 to 5: the fourth vertex of each triangle represents the normal and, as it belongs to one triangle only, is
    eliminated.

    Parameters
    ----------
    source, target : (N, 3) neutral meshes, vertex to vertex, the source aligned with the target.
    rings : of both.

    Raises
    ------
    SolverError
        When the system of the target has no unique solution.
    """

    def __init__(self, source: F64, target: F64, rings: Rings) -> None:
        self.source, self.target, self.rings = source, target, rings
        self._before = np.linalg.pinv(_with_normal(source, rings))
        self._planes, flat = _plane_bases(target, rings)
        least = np.linalg.svd(_edge_matrices(source, rings), compute_uv=False)[:, 1]
        self._sound = least > MIN_TRIANGLE_RATIO * np.linalg.svd(flat, compute_uv=False)[:, 1]
        system = _operator(np.asarray(np.linalg.pinv(flat), np.float64), rings)
        self._hold = MIN_HOLD_SHARE * float(system.power(2).sum()) / rings.count
        self._solve = factorise_least_squares(system, self._hold)
        self._asked = sp.csr_array(system.T)

    def __call__(self, expressive: F64) -> F64:
        """The target (N, 3) with the expression of the source `expressive` (N, 3)."""
        changed = _with_normal(expressive, self.rings) @ self._before - np.eye(3)
        changed[~self._sound] = 0
        across = np.einsum("tij,tjk->tki", changed, self._planes).reshape(-1, 3)
        way = expressive - self.source
        return self.target + remove_drift(self._solve(self._asked @ across + self._hold * way), way)


def remove_drift(made: F64, wanted: F64) -> F64:
    """Displacements (N, 3), shifted so that vertices almost still in the source move on average as they do there."""
    size = np.linalg.norm(wanted, axis=1)
    still = size <= STILL_MOTION_SHARE * max(float(size.max()), 1e-300)
    return np.asarray(made - (made - wanted)[still].mean(0)) if still.any() else made


class ExpressionCloning:
    """Expression cloning: displacements rotated from the source's local frames to the target's, and scaled.

    Parameters
    ----------
    source, target : (N, 3) neutral meshes, vertex to vertex, the source aligned with the target.
    rings : of both.
    """

    def __init__(self, source: F64, target: F64, rings: Rings) -> None:
        self.source, self.target = source, target
        turns = np.einsum("nij,nkj->nik", _frames(target, rings), _frames(source, rings))
        scale = _mean_edge_lengths(target, rings) / np.maximum(_mean_edge_lengths(source, rings), 1e-300)
        usual = float(np.median(scale))
        self._linear = turns * scale.clip(usual / MAX_SCALE_RATIO, MAX_SCALE_RATIO * usual)[:, None, None]

    def __call__(self, expressive: F64) -> F64:
        """The target (N, 3) with the expression of the source `expressive` (N, 3)."""
        return np.asarray(self.target + np.einsum("nij,nj->ni", self._linear, expressive - self.source))


def _edge_matrices(vertices: F64, rings: Rings) -> F64:
    """(t, 3, 2) two sides of each triangle, as columns."""
    a, b, c = (vertices[rings.triangles[:, k]] for k in range(3))
    return np.stack([b - a, c - a], axis=2)


def _with_normal(vertices: F64, rings: Rings) -> F64:
    """(t, 3, 3) two sides of each triangle, and its normal divided by the square root of its length (eq. 3)."""
    sides = _edge_matrices(vertices, rings)
    normal = np.cross(sides[:, :, 0], sides[:, :, 1])
    size = np.sqrt(np.linalg.norm(normal, axis=1))
    return np.concatenate([sides, (normal / np.where(size > 0, size, 1)[:, None])[:, :, None]], axis=2)


def _plane_bases(vertices: F64, rings: Rings) -> tuple[F64, F64]:
    """(t, 3, 2) orthonormal bases of the planes of the triangles, and the sides (t, 2, 2) in them."""
    sides = _edge_matrices(vertices, rings)
    planes, _ = np.linalg.qr(sides)
    return planes, np.einsum("tij,tik->tjk", planes, sides)


def _operator(inverse: F64, rings: Rings) -> sp.csr_array:
    """(2 t, N): from one coordinate of all vertices to that row of every transformation, in its triangle's plane."""
    count = len(rings.triangles)
    weights = np.stack([-inverse.sum(1), inverse[:, 0], inverse[:, 1]], axis=2)  # (t, 2, 3 corners)
    rows = np.broadcast_to((2 * np.arange(count)[:, None] + np.arange(2))[:, :, None], weights.shape)
    columns = np.broadcast_to(rings.triangles[:, None, :], weights.shape)
    entries = (weights.ravel(), (rows.ravel(), columns.ravel()))
    return sp.csr_array(sp.coo_array(entries, shape=(2 * count, rings.count)))


def _frames(vertices: F64, rings: Rings) -> F64:
    """(N, 3, 3) local frames as columns: along the first edge, across it, along the normal."""
    normal = tips(vertices, rings)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True).clip(1e-300)
    first = np.full(rings.count, -1)
    first[rings.start[::-1]] = rings.end[::-1]
    edge = np.where((first >= 0)[:, None], vertices[first] - vertices, (1.0, 0.0, 0.0))
    along = edge - (edge * normal).sum(1, keepdims=True) * normal
    along /= np.linalg.norm(along, axis=1, keepdims=True).clip(1e-300)
    return np.stack([along, np.cross(normal, along), normal], axis=2)


def _mean_edge_lengths(vertices: F64, rings: Rings) -> F64:
    """(N,) mean edge length of each ring."""
    start, end = rings.sides
    return np.asarray(rings.mean @ np.linalg.norm(vertices[end] - vertices[start], axis=1))
