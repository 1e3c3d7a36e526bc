"""Annealed elastic deformation of a surface onto another (Xiang et al. 2008, section 3.2).

In each round the displacements d of the surface at rest solve eq. 5,

    (k_b L^2 + M + C) d = b_m + b_c,

L the cotangent Laplacian, M the given points by barycentric coordinates, C the matched closest points.  The stretching
term k_s L of the paper is left out: it draws displacements to a constant and so opposes any difference of size.

The paper's constants assume its units.  Here everything is area-weighted and lengths are shares of the surface's
size, the root of its area: with weight 1 for the closest points, k_b is the fourth power of the length below which the
surface gives way, annealed from a tenth of a head to the size of an eyelid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from analogy.geometry import Surface, border, cotangent_laplacian, vertex_normals
from analogy.solver import factorised

F64 = NDArray[np.float64]
Int = NDArray[np.intp]
Bool = NDArray[np.bool_]

ANGLE = 60.0  # degrees between the normals of what may match
TURN = 0.025  # of the size: what a radian of normals counts when closest points are sought
STIFF, SOFT = (
    0.11,
    0.008,
)  # of the size: lengths below which the surface gives way, in the first round and the last
ROUNDS, STEPS = 8, 5  # closest points are sought in every step; a round has one factorisation
FAR, NEAR = 4.0, 0.001  # matches farther than FAR times the median and NEAR of the size are none
POINT = 0.017  # share of the area that a given point counts
BORDER = 5.0  # what a border vertex counts, matched to the other border
BORDER_FAR = 0.05  # of the size: borders farther apart do not match
HELD = 1e-9  # by which every vertex is held at rest, which makes the solution unique


@dataclass(frozen=True, eq=False)
class Points:
    """Given points: corners (k, 3) and barycentric weights (k, 3) on the surface, and where they belong (k, 3)."""

    corners: Int
    weights: F64
    positions: F64

    def matrix(self, count: int) -> sp.csr_array:
        """(k, count): from the vertices to the points."""
        rows = np.repeat(np.arange(len(self.corners)), 3)
        entries = (self.weights.ravel(), (rows, self.corners.ravel()))
        return sp.csr_array(sp.coo_array(entries, shape=(len(self.corners), count)))


def deform(rest: F64, faces: Int, target: Surface, points: Points | None, size: float) -> F64:
    """The surface `rest` (N, 3), roughly aligned with the target, deformed onto it: (N, 3).

    Parameters
    ----------
    faces : (m, 3), of which every vertex is in one.   size : the target's, the root of its area.

    Raises
    ------
    SolverError
        When the surface cannot be solved for.
    """
    problem = _Problem(rest, faces, target, points, size)
    fitted = problem.by_points()
    for length in np.geomspace(STIFF, SOFT, ROUNDS):
        fitted = problem.round(fitted, length * size)
    return fitted


@dataclass(frozen=True, eq=False)
class Matches:
    """For each vertex where it belongs (N, 3), and what that counts (N,), 0 for nothing."""

    positions: F64
    counts: F64


class _Problem:
    """What stays the same over the rounds."""

    def __init__(self, rest: F64, faces: Int, target: Surface, points: Points | None, size: float) -> None:
        self.rest, self.faces, self.target, self.size = rest, faces, target, size
        laplacian, areas = cotangent_laplacian(rest, faces)
        total = float(areas.sum())
        least = np.maximum(areas, 1e-6 * areas.mean())
        self._bending = sp.csr_array(laplacian @ sp.diags_array(1 / least) @ laplacian) / total
        self.areas = areas / total
        self.border = border(faces, len(rest))
        edge = target.vertices[target.border]
        self._other_border = edge if len(edge) else None
        self._border_tree = cKDTree(edge) if len(edge) else None
        self._held = sp.diags_array(np.full(len(rest), HELD / len(rest)))
        self._at_points = sp.csr_array((len(rest), len(rest)))
        self._to_points = np.zeros((len(rest), 3))
        if points is not None:
            at = points.matrix(len(rest))
            self._at_points = sp.csr_array(POINT * (at.T @ at))
            self._to_points = POINT * (at.T @ (points.positions - at @ rest))

    def by_points(self) -> F64:
        """Deformed by the given points alone."""
        if not self._at_points.nnz:
            return self.rest
        system = self._held + (STIFF * self.size) ** 4 * self._bending + self._at_points
        return np.asarray(self.rest + factorised(system)(self._to_points))

    def round(self, fitted: F64, length: float) -> F64:
        """Some steps with one stiffness; which vertices match is settled in the first."""
        matches = self.matches(fitted)
        counts = matches.counts
        system = self._held + length**4 * self._bending + self._at_points + sp.diags_array(counts)
        solve = factorised(system)
        for step in range(STEPS):
            if step:
                matches = self.matches(fitted)
            drawn = counts[:, None] * (matches.positions - self.rest)
            fitted = self.rest + solve(self._to_points + drawn)
        return fitted

    def matches(self, fitted: F64) -> Matches:
        """Closest points that face the same way; borders to borders."""
        normals = vertex_normals(fitted, self.faces)
        near = self.target.nearest(fitted, normals)
        positions = self.target.samples[near]
        far = np.linalg.norm(positions - fitted, axis=1)
        alike: Bool = np.asarray((normals * self.target.normals[near]).sum(1) > np.cos(np.deg2rad(ANGLE)))
        alike &= ~self.target.on_border[near]
        limit = FAR * float(np.median(far[alike])) + NEAR * self.size if alike.any() else 0.0
        counts = self.areas * (alike & (far < limit))
        if self._border_tree is None or not self.border.any():
            return Matches(positions, counts)
        own = np.flatnonzero(self.border)
        away, other = self._border_tree.query(fitted[own])
        own, other = own[away < BORDER_FAR * self.size], other[away < BORDER_FAR * self.size]
        positions, counts = positions.copy(), counts.copy()
        positions[own] = self._other_border[other]  # type: ignore[index]
        counts[own] = BORDER * self.areas[own]
        return Matches(positions, counts)
