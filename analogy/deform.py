"""Annealed elastic deformation of a surface onto another (Xiang et al. 2008, section 3.2).

In each round the displacements d of the surface at rest solve eq. 5,

    (-k_s L + k_b L^2 + M + C) d = b_m + b_c,

L the Laplacian by cotangents, M the given points by barycentric coordinates, C the matched closest points.

Units: the constants of the paper depend on its unit.  Here everything is weighted by area, and lengths are relative to
the size of the surface (the root of its area).  With weight 1 for the closest points, k_b is the fourth power of the
length below which the surface gives way, annealed from a tenth of a head to the size of an eyelid; k_s is the square of
a fraction of that length.

Departures from the paper, because close surfaces do not imply a correct correspondence: matches are sought both ways,
from the surface to the target and back, which keeps the surface from sliding; borders match borders; matches consider
normals as well as positions; the rest state is the surface deformed by the given points alone; and steps have momentum,
which saves more than half of them.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from guise.analogy.geometry import (
    Surface,
    border_mask,
    cotangent_laplacian,
    interpolation_matrix,
    sum_by_index,
    vertex_areas,
    vertex_normals,
)
from guise.analogy.solver import Solve, factorise, make_factoriser
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True)
class DeformationSettings:
    """Settings of the annealed deformation; sizes are the target's (the root of its area)."""

    max_normal_angle_deg: float = 60.0  # between surfaces that may match
    normal_weight_sizes: float = 0.012  # distance that a difference of unit normals of 1 counts as
    first_length_sizes: float = 0.11  # lengths below which the surface gives way, in the first round
    last_length_sizes: float = 0.012  # and in the last
    stretch_length_ratio: float = 0.8  # of that length, against stretching
    rounds: int = 4  # one factorisation each
    guided_round: int = 1  # in which curves hold: before, ears are off; later, an inexact guide would stay
    steps_per_round: int = 6  # closest points are sought in each
    momentum: float = 0.7
    max_sought: int = 50_000  # vertices of the target, of which more than this many are sampled
    max_distance_medians: float = 4.0  # a match is at most this many median distances away
    distance_margin_sizes: float = 0.001  # plus this
    point_weight: float = 0.017  # of a given point, as a share of the area
    border_weight: float = 5.0  # of a border vertex that is matched to the other border
    max_border_distance_sizes: float = 0.05  # between borders that match
    rest_weight: float = 1e-9  # by which every vertex is held at rest, which makes the solution unique


DEFORMATION = DeformationSettings()


@dataclass(frozen=True, eq=False)
class PointConstraints:
    """Point constraints: corners (k, 3) and barycentric weights (k, 3) on the surface, and target positions (k, 3).

    trust : (k,) by which each counts.
    """

    corners: Int
    weights: F64
    positions: F64
    trust: F64


@dataclass(frozen=True, eq=False)
class CurveConstraints:
    """Points of the surface that may slide along curves of the target.

    Parameters
    ----------
    corners, weights, trust : of the points, as in `PointConstraints`.   number : (k,) the curve of each.
    curves : (p, 3) each, places close together on the target.
    """

    corners: Int
    weights: F64
    trust: F64
    number: Int
    curves: tuple[F64, ...]

    def at(self, places: F64) -> PointConstraints:
        """Constraints that take the points, now at places (k, 3), to the nearest places of their curves."""
        positions = places.copy()
        for number, curve in enumerate(self.curves):
            own = self.number == number
            positions[own] = curve[cKDTree(curve).query(places[own])[1]]
        return PointConstraints(self.corners, self.weights, positions, self.trust)


Guides = Callable[
    [F64], CurveConstraints | None
]  # by the vertices (N, 3) of the surface, about on the target


@dataclass(frozen=True, eq=False)
class Matches:
    """Target position (N, 3) and weight (N,) of each vertex; weight 0 means no match."""

    positions: F64
    counts: F64


def deform(
    rest: F64,
    faces: Int,
    target: Surface,
    points: PointConstraints | None,
    size: float,
    guides: Guides | None = None,
) -> F64:
    """The surface `rest` (N, 3), roughly aligned with the target, deformed onto it: (N, 3).

    Parameters
    ----------
    faces : (m, 3), covering every vertex.   size : of the target, the root of its area.
    guides : gives the curves that hold in the second round.

    Raises
    ------
    SolverError
        When the system has no unique solution.
    """
    if points is not None:
        rest = rest + ElasticSystem(rest, faces, points).solve_by_points(
            DEFORMATION.first_length_sizes * size
        )
    elastic, matching = ElasticSystem(rest, faces, points), MatchSearch(rest, faces, target, size)
    fitted = before = rest
    lengths = np.geomspace(DEFORMATION.first_length_sizes, DEFORMATION.last_length_sizes, DEFORMATION.rounds)
    for number, length in enumerate(size * lengths):
        if guides is not None:
            elastic.guide(guides(fitted) if number == DEFORMATION.guided_round else None)
        for step in range(DEFORMATION.steps_per_round):
            ahead = fitted + DEFORMATION.momentum * (fitted - before)
            matches = matching(ahead)
            if step == 0:
                counts, solve = matches.counts, elastic.solver(length, matches.counts)
            drawn = counts[:, None] * (matches.positions - rest) + elastic.drawn_by_curves(ahead)
            before, fitted = fitted, rest + solve(drawn)
    return fitted


class ElasticSystem:
    """Left-hand side of eq. 5 for a surface at rest.

    Parameters
    ----------
    rest : (N, 3).   faces : (m, 3).   points : given ones, or None.
    """

    def __init__(self, rest: F64, faces: Int, points: PointConstraints | None) -> None:
        laplacian, areas = cotangent_laplacian(rest, faces)
        total, least = float(areas.sum()), np.maximum(areas, 1e-6 * areas.mean())
        self._stretching = laplacian / total
        self._bending = sp.csr_array(laplacian @ sp.diags_array(1 / least) @ laplacian) / total
        count = len(rest)
        self._fixed = sp.csr_array(sp.diags_array(np.full(count, DEFORMATION.rest_weight / count)))
        self._to_points = np.zeros((count, 3))
        self._rest = rest
        self._curves: CurveConstraints | None = None
        if points is not None:
            self._fixed = self._fixed + operator.matmul(*self._pull(points))
            self._to_points = self._drawn(points)
        self._held = self._fixed

    def _pull(self, points: PointConstraints | CurveConstraints) -> tuple[sp.csr_array, sp.csr_array]:
        """(N, k) by which points draw the vertices, and (k, N) from these to the points."""
        at = interpolation_matrix(points.corners, points.weights, len(self._rest))
        return sp.csr_array(at.T @ sp.diags_array(DEFORMATION.point_weight * points.trust)), at

    def _drawn(self, points: PointConstraints) -> F64:
        """(N, 3) the pull of points on the surface at rest."""
        pull, at = self._pull(points)
        return np.asarray(pull @ (points.positions - at @ self._rest))

    def guide(self, curves: CurveConstraints | None) -> None:
        """Hold points of the surface on these curves from now on, and no longer on others."""
        self._curves, self._held = curves, self._fixed
        if curves is not None:
            self._held = self._fixed + operator.matmul(*self._pull(curves))

    def drawn_by_curves(self, fitted: F64) -> F64:
        """(N, 3) the pull of the curves, as near as they are to the surface (N, 3)."""
        if self._curves is None:
            return np.zeros_like(fitted)
        places = np.einsum("kc,kci->ki", self._curves.weights, fitted[self._curves.corners])
        return self._drawn(self._curves.at(places))

    @cached_property
    def _factorise(self) -> Callable[[sp.sparray], Solve]:
        return make_factoriser(abs(self._bending) + abs(self._stretching) + self._fixed)

    def solver(self, length: float, counts: F64) -> Solve:
        """From counts times wanted displacements (N, 3) to displacements (N, 3), with one stiffness."""
        system = self._held + sp.diags_array(counts) + length**4 * self._bending
        solve = self._factorise(system + (DEFORMATION.stretch_length_ratio * length) ** 2 * self._stretching)
        return lambda drawn: solve(self._to_points + drawn)

    def solve_by_points(self, length: float) -> F64:
        """Displacements (N, 3) from the given points alone; bending energy only, so that scaling is free."""
        return factorise(self._fixed + length**4 * self._bending)(self._to_points)


class MatchSearch:
    """Finds closest points between a surface that is being deformed and its target.

    Parameters
    ----------
    rest : (N, 3), whose areas weight the vertices.   faces : (m, 3).   size : of the target.
    """

    def __init__(self, rest: F64, faces: Int, target: Surface, size: float) -> None:
        self.faces, self.target, self.size = faces, target, size
        self.border = border_mask(faces, len(rest))
        self.areas = _area_shares(vertex_areas(rest, faces))
        self._sought = np.arange(0, len(target.vertices), 1 + len(target.vertices) // DEFORMATION.max_sought)
        self._other_areas = _area_shares(vertex_areas(target.vertices, target.faces)[self._sought])
        self._other_border = target.vertices[target.border]

    def __call__(self, fitted: F64) -> Matches:
        """Matches of vertices `fitted` (N, 3): weighted means of what they find and of what finds them."""
        normals = vertex_normals(fitted, self.faces)
        there, back = self._there(fitted, normals), self._back(fitted, normals)
        counts = there.counts + back.counts
        mean = there.counts[:, None] * there.positions + back.positions
        positions = np.where(counts[:, None] > 0, mean / counts.clip(1e-300)[:, None], fitted)
        return self._bordered(fitted, Matches(positions, counts))

    def _there(self, fitted: F64, normals: F64) -> Matches:
        """The nearest sample of the target for each vertex."""
        near = self.target.nearest_samples(fitted, normals)
        positions = self.target.samples[near]
        good = self._good(positions - fitted, normals, self.target.normals[near])
        return Matches(positions, self.areas * (good & ~self.target.border_samples[near]))

    def _back(self, fitted: F64, normals: F64) -> Matches:
        """Weighted sums of the target vertices whose nearest vertex is each vertex."""
        turn, wanted = self.target.normal_weight, self.target.vertices[self._sought]
        facing = self.target.vertex_normals[self._sought]
        tree = cKDTree(np.concatenate([fitted, turn * normals], axis=1), balanced_tree=False)
        near = tree.query(np.concatenate([wanted, turn * facing], axis=1))[1]
        good = self._good(wanted - fitted[near], facing, normals[near]) & ~self.border[near]
        counts = self._other_areas * good
        summed = sum_by_index(np.column_stack([wanted * counts[:, None], counts]), near, len(fitted))
        return Matches(summed[:, :3], summed[:, 3])

    def _good(self, ways: F64, normals: F64, others: F64) -> Bool:
        """Which matches face the same way and are not much farther than the others."""
        far = np.linalg.norm(ways, axis=1)
        alike = np.asarray((normals * others).sum(1) > np.cos(np.deg2rad(DEFORMATION.max_normal_angle_deg)))
        limit = (
            DEFORMATION.max_distance_medians * float(np.median(far[alike]))
            + DEFORMATION.distance_margin_sizes * self.size
            if alike.any()
            else 0.0
        )
        return np.asarray(alike & (far < limit))

    def _bordered(self, fitted: F64, matches: Matches) -> Matches:
        """The matches, with borders matched to nearby borders."""
        if not (len(self._other_border) and self.border.any()):
            return matches
        own = np.flatnonzero(self.border)
        far, other = cKDTree(self._other_border).query(fitted[own])
        own, other = (
            own[far < DEFORMATION.max_border_distance_sizes * self.size],
            other[far < DEFORMATION.max_border_distance_sizes * self.size],
        )
        positions, counts = matches.positions.copy(), matches.counts.copy()
        positions[own], counts[own] = self._other_border[other], DEFORMATION.border_weight * self.areas[own]
        return Matches(positions, counts)


def _area_shares(areas: F64) -> F64:
    return np.asarray(areas / areas.sum())
