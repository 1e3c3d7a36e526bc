"""Vertex tent coordinates: expression transfer between meshes of one topology (Song et al. 2007, section IV).

The tent of a vertex consists of the edges to its one-ring and a tip along its normal.  The transformation Q of the
source's tent by the expression is imposed on the target's.  Letters and equation numbers are those of the paper.

With w = [e_1 .. e_n, nu] the tent (3, n + 1), Q = w' w^T (w w^T)^-1 (eq. 2).  Eq. 4 is written in the target's
vertices, so that its constraint holds automatically.  A tip belongs to one tent only and is eliminated, which leaves
two equations per vertex and coordinate, and N unknowns.

Tents alone do not fix positions, and their errors accumulate away from what stays still.  Each vertex is therefore also
pulled weakly to where the displacement of the source would take it: tents dominate over lengths below `reach`, the
displacements over longer ones.  Any unit; results keep that of the target.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from guise.analogy.solver import compact_rows, factorise_least_squares
from guise.common.arrays import F64, Int

RIDGE_TRACE_SHARE = 1e-6  # of the trace, added to w w^T where all edges lie along a line
MIN_HOLD_SHARE = 1e-10  # of the system's mean diagonal: least weight of the displacements
STILL_MOTION_SHARE = 1e-3  # of the largest displacement, up to which a vertex hardly moves


@dataclass(frozen=True, eq=False)
class Rings:
    """The one-rings of a mesh as directed edges, and its faces as triangles.

    Parameters
    ----------
    count : N, of vertices.   start, end : (E,) the edge from a ring's vertex to a neighbour.
    triangles : (t, 3), from which normals are computed; a quad gives two.
    """

    count: int
    start: Int
    end: Int
    triangles: Int

    @classmethod
    def of(cls, count: int, triangles: ArrayLike, quads: ArrayLike | None = None) -> Rings:
        """From a mesh with `count` vertices, triangles (t, 3) and quads (q, 4); the diagonal of a quad is not an edge.

        >>> Rings.of(3, [[0, 1, 2]]).end.tolist()
        [1, 2, 0, 2, 0, 1]
        """
        tri = np.asarray(triangles, np.intp).reshape(-1, 3)
        quad = np.asarray(() if quads is None else quads, np.intp).reshape(-1, 4)
        sides = [face[:, [k, (k + 1) % n]] for face, n in ((tri, 3), (quad, 4)) for k in range(n)]
        edges = np.concatenate(sides)
        edges = edges[edges[:, 0] != edges[:, 1]]
        start, end = np.divmod(np.unique(np.concatenate([edges @ (count, 1), edges @ (1, count)])), count)
        split = np.concatenate([tri, quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
        return cls(count, start, end, split)

    @cached_property
    def corners(self) -> Int:
        """(3, t) the triangles, corner by corner."""
        return np.ascontiguousarray(self.triangles.T)

    @cached_property
    def around(self) -> sp.csr_array:
        """(N, t) of ones: sums values of triangles at their vertices."""
        columns = np.repeat(np.arange(len(self.triangles)), 3)
        entries = (np.ones(len(columns)), (self.triangles.ravel(), columns))
        return compact_rows(sp.coo_array(entries, shape=(self.count, len(self.triangles))))

    @cached_property
    def sides(self) -> tuple[Int, Int]:
        """Both ends (E / 2,) of each undirected edge."""
        once = self.start < self.end
        return self.start[once], self.end[once]

    @cached_property
    def mean(self) -> sp.csr_array:
        """(N, E / 2): means, at each vertex, of the values of its edges (those of `sides`)."""
        ends = np.concatenate(self.sides)
        columns = np.tile(np.arange(len(ends) // 2), 2)
        share = 1 / np.bincount(ends, minlength=self.count).clip(1)[ends]
        return compact_rows(sp.coo_array((share, (ends, columns)), shape=(self.count, len(ends) // 2)))


def tips(vertices: F64, rings: Rings) -> F64:
    """The tips nu (N, 3) relative to their vertices: along the normal, as long as the ring's mean edge."""
    columns = np.ascontiguousarray(vertices.T)  # by coordinate: several times faster
    normals = np.asarray(rings.around @ triangle_normals(columns, rings.corners).T)
    start, end = rings.sides
    square = sum(np.square(x.take(end) - x.take(start)) for x in columns)
    mean = np.asarray(rings.mean @ np.sqrt(square))
    size = np.sqrt(np.einsum("ni,ni->n", normals, normals))
    return np.asarray(normals * (mean / np.where(size > 0, size, 1))[:, None])


def triangle_normals(columns: F64, corners: Int) -> F64:
    """(3, t) normals of triangles (3, t) with coordinates (3, N); their length is twice the area."""
    a, b, c = (columns.take(corner, axis=1) for corner in corners)
    (ux, uy, uz), (vx, vy, vz) = b - a, c - a
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])


class VertexTents:
    """The tents of a neutral mesh, which give its transformations.

    Parameters
    ----------
    neutral : (N, 3).   rings : Rings.

    Attributes
    ----------
    edges : (3 N, N), from a coordinate of all vertices to that row of every Q, tips left out.
    tip_weights : (N, 3), by which the tip enters Q.
    """

    def __init__(self, neutral: F64, rings: Rings) -> None:
        self.neutral, self.rings = neutral, rings
        edges = neutral[rings.end] - neutral[rings.start]
        nu = tips(neutral, rings)
        square = nu[:, :, None] * nu[:, None, :]
        for i in range(3):
            for j in range(3):
                square[:, i, j] += np.bincount(rings.start, edges[:, i] * edges[:, j], rings.count)
        trace = np.trace(square, axis1=1, axis2=2)
        square += (RIDGE_TRACE_SHARE * trace + (trace == 0))[:, None, None] * np.eye(3)
        inverse = np.linalg.inv(square)
        self.edges = self._operator(np.einsum("eij,ej->ei", inverse[rings.start], edges))
        self.tip_weights = np.einsum("nij,nj->ni", inverse, nu)

    @property
    def tips(self) -> sp.csr_array:
        """(3 N, N), from a coordinate of all tips to that row of every Q."""
        count = self.rings.count
        rows, columns = np.arange(3 * count), np.repeat(np.arange(count), 3)
        return sp.csr_array(
            sp.coo_array((self.tip_weights.ravel(), (rows, columns)), shape=(3 * count, count))
        )

    def transformations(self, expressive: F64) -> F64:
        """Q^T (N, 3, 3) of each tent from the neutral mesh to (N, 3); eq. 2, transposed: columns are coordinates."""
        flat = self.edges @ expressive + self.tips @ tips(expressive, self.rings)
        return np.asarray(flat).reshape(self.rings.count, 3, 3)

    def _operator(self, weights: F64) -> sp.csr_array:
        rings, size = self.rings, self.rings.count
        rows = (3 * rings.start[:, None] + np.arange(3)).ravel()
        ends = sp.coo_array((weights.ravel(), (rows, np.repeat(rings.end, 3))), shape=(3 * size, size))
        starts = sp.coo_array((weights.ravel(), (rows, np.repeat(rings.start, 3))), shape=(3 * size, size))
        return sp.csr_array(ends - starts)


class TentTransfer:
    """Transfers expressions of a source to a target of the same topology; factorised once.

    An expression costs its normals, two sparse products and one back-substitution.

    Parameters
    ----------
    source, target : (N, 3) neutral meshes, vertex to vertex, the source aligned with the target.
    rings : of both.
    reach : length below which tents dominate; infinite is the paper's method, with the mean displacement kept.
    own : tents of the target, where they are known.

    Raises
    ------
    SolverError
        When the system of the target has no unique solution.
    """

    def __init__(
        self,
        source: F64,
        target: F64,
        rings: Rings,
        reach: float = math.inf,
        own: VertexTents | None = None,
    ) -> None:
        self.source, self.target, self.rings = source, target, rings
        tents, own = VertexTents(source, rings), own or VertexTents(target, rings)
        across = _perpendicular_projection(own.tip_weights)
        system = sp.csr_array(across @ own.edges)
        hold = max(1 / reach**2, MIN_HOLD_SHARE * float(system.power(2).sum()) / rings.count)
        self._solve = factorise_least_squares(system, hold)
        asked = sp.csr_array(system.T @ across)
        self._by_vertices = compact_rows(asked @ (tents.edges - own.edges))
        self._by_tips = compact_rows(asked @ tents.tips)
        self._tips = tips(source, rings)

    def __call__(self, expressive: F64) -> F64:
        """The target (N, 3) with the expression of the source `expressive` (N, 3)."""
        return self.each([expressive])[0]

    def each(self, expressions: Sequence[F64]) -> list[F64]:
        """The same for several expressions (N, 3) with one back-substitution, which reads the factors only once."""
        if not expressions:
            return []
        ways = np.concatenate([expressive - self.source for expressive in expressions], axis=1)
        turned = np.concatenate([tips(each, self.rings) - self._tips for each in expressions], axis=1)
        moved = ways + self._solve(self._by_vertices @ ways + self._by_tips @ turned)
        return [self.target + moved[:, k : k + 3] for k in range(0, 3 * len(expressions), 3)]


def _perpendicular_projection(directions: F64) -> sp.csr_array:
    """(2 N, 3 N): projects stacked vectors (N, 3) onto the planes perpendicular to `directions` (N, 3)."""
    size = np.linalg.norm(directions, axis=1, keepdims=True)
    unit = directions / np.where(size > 0, size, 1)
    least = np.eye(3)[np.abs(unit).argmin(1)]
    first = np.cross(unit, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True).clip(1e-300)
    bases = np.stack([first, np.cross(unit, first)], axis=1)  # (N, 2, 3)
    blocks = sp.bsr_array((bases, np.arange(len(bases)), np.arange(len(bases) + 1)))
    return sp.csr_array(blocks)


def vertex_error(source: F64, expressive: F64, made: F64) -> F64:
    """E of the appendix (N,), for an expression transferred to the source itself; NaN where nothing moves.

    | |made - source| / |expressive - source| - 1 |
    """
    way = np.linalg.norm(expressive - source, axis=1)
    moves = way > STILL_MOTION_SHARE * max(float(way.max()), 1e-300)
    out = np.full(len(way), np.nan)
    out[moves] = np.abs(np.linalg.norm(made - source, axis=1)[moves] / way[moves] - 1)
    return out
