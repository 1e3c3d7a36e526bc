"""Annealed elastic deformation of a surface onto another (Xiang et al. 2008, section 3.2).

In each round the displacements d of the surface at rest solve eq. 5,

    (-k_s L + k_b L^2 + M + C) d = b_m + b_c,

L the Laplacian by cotangents, M the given points by barycentric coordinates, C the matched closest points.

Units: the paper's constants assume its own.  Here everything is weighted by area and lengths are shares of the size of
the surface, the root of its area.  With weight 1 for the closest points, k_b is the fourth power of the length below
which the surface gives way, annealed from a tenth of a head to the size of an eyelid, and k_s the square of a part.

What departs from the paper, since a small distance between surfaces does not mean a right correspondence: matches are
sought both ways, from the surface to the target and back, which keeps the surface from sliding; borders match borders;
matches count normals as well as places; the state at rest is the surface deformed by the points alone; and each step
goes on as the one before did (momentum), which saves more than half of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from guise.analogy.geometry import (
    Surface,
    border,
    cotangent_laplacian,
    gathered,
    vertex_areas,
    vertex_normals,
)
from guise.analogy.solver import Solve, factorised, factoriser
from guise.common.arrays import F64, Bool, Int

ANGLE = 60.0  # degrees between the normals of what may match
TURN = 0.025  # of the size: what a radian of normals counts when closest points are sought
STIFF, SOFT = (
    0.11,
    0.012,
)  # of the size: lengths below which the surface gives way, in the first round and the last
STRETCH = 0.8  # of that length, against stretching
ROUNDS, STEPS = 4, 6  # closest points are sought in every step; a round has one factorisation
MOMENTUM = 0.7
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


@dataclass(frozen=True, eq=False)
class Matches:
    """For each vertex where it belongs (N, 3), and what that counts (N,), 0 for nothing."""

    positions: F64
    counts: F64


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
    if points is not None:
        rest = rest + Elastic(rest, faces, points).solve_by_points(STIFF * size)
    elastic, matching = Elastic(rest, faces, points), Matching(rest, faces, target, size)
    fitted = before = rest
    for length in size * np.geomspace(STIFF, SOFT, ROUNDS):
        for step in range(STEPS):
            matches = matching(fitted + MOMENTUM * (fitted - before))
            if step == 0:
                counts, solve = matches.counts, elastic.solver(length, matches.counts)
            before, fitted = fitted, rest + solve(counts[:, None] * (matches.positions - rest))
    return fitted


class Elastic:
    """The left side of eq. 5 for a surface at rest.

    Parameters
    ----------
    rest : (N, 3).   faces : (m, 3).   points : given ones, or None.
    """

    def __init__(self, rest: F64, faces: Int, points: Points | None) -> None:
        laplacian, areas = cotangent_laplacian(rest, faces)
        total, least = float(areas.sum()), np.maximum(areas, 1e-6 * areas.mean())
        self._stretching = laplacian / total
        self._bending = sp.csr_array(laplacian @ sp.diags_array(1 / least) @ laplacian) / total
        count = len(rest)
        self._fixed = sp.csr_array(sp.diags_array(np.full(count, HELD / count)))
        self._to_points = np.zeros((count, 3))
        if points is not None:
            at = points.matrix(count)
            self._fixed = self._fixed + POINT * (at.T @ at)
            self._to_points = POINT * (at.T @ (points.positions - at @ rest))

    @cached_property
    def _factorise(self) -> Callable[[sp.sparray], Solve]:
        return factoriser(abs(self._bending) + abs(self._stretching) + self._fixed)

    def solver(self, length: float, counts: F64) -> Solve:
        """From counts times wanted displacements (N, 3) to displacements (N, 3), with one stiffness."""
        system = self._fixed + sp.diags_array(counts) + length**4 * self._bending
        solve = self._factorise(system + (STRETCH * length) ** 2 * self._stretching)
        return lambda drawn: solve(self._to_points + drawn)

    def solve_by_points(self, length: float) -> F64:
        """Displacements (N, 3) by the given points alone; bending only, so that differences of size cost nothing."""
        return factorised(self._fixed + length**4 * self._bending)(self._to_points)


class Matching:
    """Closest points between a surface that is deformed and its target.

    Parameters
    ----------
    rest : (N, 3), whose areas tell what a vertex counts.   faces : (m, 3).   size : of the target.
    """

    def __init__(self, rest: F64, faces: Int, target: Surface, size: float) -> None:
        self.faces, self.target, self.size = faces, target, size
        self.border = border(faces, len(rest))
        self.areas = _shares(vertex_areas(rest, faces))
        self._other_areas = _shares(vertex_areas(target.vertices, target.faces))
        self._other_border = target.vertices[target.border]

    def __call__(self, fitted: F64) -> Matches:
        """Where each vertex of `fitted` (N, 3) belongs: the weighted mean of what it finds and of what finds it."""
        normals = vertex_normals(fitted, self.faces)
        there, back = self._there(fitted, normals), self._back(fitted, normals)
        counts = there.counts + back.counts
        mean = there.counts[:, None] * there.positions + back.positions
        positions = np.where(counts[:, None] > 0, mean / counts.clip(1e-300)[:, None], fitted)
        return self._bordered(fitted, Matches(positions, counts))

    def _there(self, fitted: F64, normals: F64) -> Matches:
        """The sample of the target that each vertex finds."""
        near = self.target.nearest(fitted, normals)
        positions = self.target.samples[near]
        good = self._good(positions - fitted, normals, self.target.normals[near])
        return Matches(positions, self.areas * (good & ~self.target.on_border[near]))

    def _back(self, fitted: F64, normals: F64) -> Matches:
        """The vertices of the target that find each vertex; their positions times what they count, summed."""
        turn, wanted, facing = self.target.turn, self.target.vertices, self.target.vertex_normals
        tree = cKDTree(np.concatenate([fitted, turn * normals], axis=1), balanced_tree=False)
        near = tree.query(np.concatenate([wanted, turn * facing], axis=1))[1]
        good = self._good(wanted - fitted[near], facing, normals[near]) & ~self.border[near]
        counts = self._other_areas * good
        summed = gathered(np.column_stack([wanted * counts[:, None], counts]), near, len(fitted))
        return Matches(summed[:, :3], summed[:, 3])

    def _good(self, ways: F64, normals: F64, others: F64) -> Bool:
        """Which matches face the same way and are not far beyond the others."""
        far = np.linalg.norm(ways, axis=1)
        alike = np.asarray((normals * others).sum(1) > np.cos(np.deg2rad(ANGLE)))
        limit = FAR * float(np.median(far[alike])) + NEAR * self.size if alike.any() else 0.0
        return np.asarray(alike & (far < limit))

    def _bordered(self, fitted: F64, matches: Matches) -> Matches:
        """Borders matched to borders, where both are near each other."""
        if not (len(self._other_border) and self.border.any()):
            return matches
        own = np.flatnonzero(self.border)
        far, other = cKDTree(self._other_border).query(fitted[own])
        own, other = own[far < BORDER_FAR * self.size], other[far < BORDER_FAR * self.size]
        positions, counts = matches.positions.copy(), matches.counts.copy()
        positions[own], counts[own] = self._other_border[other], BORDER * self.areas[own]
        return Matches(positions, counts)


def _shares(areas: F64) -> F64:
    return np.asarray(areas / areas.sum())
