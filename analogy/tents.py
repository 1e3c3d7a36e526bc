"""Vertex tent coordinates: expressions carried between meshes of one topology (Song et al. 2007, section IV).

A vertex's tent is its edges to its one-ring and a tip along its normal; the transformation Q of the source's tent by
the expression is asked of the target's.  Letters are those of the paper; eq. numbers too.

With w = [e_1 .. e_n, nu] the tent (3, n + 1), Q = w' w^T (w w^T)^-1 (eq. 2).  Eq. 4 is written in the target's
vertices, so that its constraint holds by itself.  A tip belongs to one tent alone: it is eliminated, which leaves two
equations a vertex and coordinate, and N unknowns.  Any units; results keep the target's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from analogy.solver import LeastSquares

F64 = NDArray[np.float64]
Int = NDArray[np.intp]

THIN = 1e-6  # of the trace, added to w w^T where all edges lie along a line
HELD = 1e-10  # weight by which a vertex is held where it is, which makes the solution unique
STILL = 1e-3  # of the longest way of a vertex, up to which one hardly moves


@dataclass(frozen=True, eq=False)
class Rings:
    """The one-rings of a mesh as directed edges, and its faces as triangles.

    Parameters
    ----------
    count : N, of vertices.   start, end : (E,) the edge from a ring's vertex to a neighbour.
    triangles : (t, 3), of which normals are made; a quad is two.
    """

    count: int
    start: Int
    end: Int
    triangles: Int

    @classmethod
    def of(cls, count: int, triangles: ArrayLike, quads: ArrayLike | None = None) -> Rings:
        """Of a mesh with `count` vertices, triangles (t, 3) and quads (q, 4); a quad's diagonal is no edge.

        >>> Rings.of(3, [[0, 1, 2]]).end.tolist()
        [1, 2, 0, 2, 0, 1]
        """
        tri = np.asarray(triangles, np.intp).reshape(-1, 3)
        quad = np.asarray(() if quads is None else quads, np.intp).reshape(-1, 4)
        sides = [face[:, [k, (k + 1) % n]] for face, n in ((tri, 3), (quad, 4)) for k in range(n)]
        edges = np.concatenate(sides)
        both = np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)
        both = both[both[:, 0] != both[:, 1]]
        split = np.concatenate([tri, quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
        return cls(count, both[:, 0], both[:, 1], split)


def tips(vertices: F64, rings: Rings) -> F64:
    """The tips nu (N, 3) relative to their vertices: along the normal, as long as the ring's mean edge."""
    a, b, c = (vertices[rings.triangles[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    normals = np.zeros((rings.count, 3))
    for k in range(3):
        for axis in range(3):
            normals[:, axis] += np.bincount(rings.triangles[:, k], weighted[:, axis], rings.count)
    lengths = np.linalg.norm(vertices[rings.end] - vertices[rings.start], axis=1)
    mean = np.bincount(rings.start, lengths, rings.count) / np.maximum(
        np.bincount(rings.start, minlength=rings.count), 1
    )
    size = np.linalg.norm(normals, axis=1)
    return np.asarray(normals * (mean / np.where(size > 0, size, 1))[:, None])


class Tents:
    """The tents of a neutral mesh, by which transformations of it are told.

    Parameters
    ----------
    neutral : (N, 3).   rings : Rings.
    """

    def __init__(self, neutral: F64, rings: Rings) -> None:
        self.rings = rings
        edges = neutral[rings.end] - neutral[rings.start]
        nu = tips(neutral, rings)
        square = nu[:, :, None] * nu[:, None, :]
        for i in range(3):
            for j in range(3):
                square[:, i, j] += np.bincount(rings.start, edges[:, i] * edges[:, j], rings.count)
        trace = np.trace(square, axis1=1, axis2=2)
        square += (THIN * trace + (trace == 0))[:, None, None] * np.eye(3)
        inverse = np.linalg.inv(square)
        self.edge_weights = np.einsum("eij,ej->ei", inverse[rings.start], edges)  # rows of w^T (w w^T)^-1
        self.tip_weights = np.einsum("nij,nj->ni", inverse, nu)
        self.operator = self._operator(self.edge_weights)

    def transformations(self, expressive: F64) -> F64:
        """Q^T (N, 3, 3) of each tent from the neutral mesh to (N, 3); eq. 2, transposed: columns are coordinates."""
        nu = tips(expressive, self.rings)
        flat = np.asarray(self.operator @ expressive).reshape(self.rings.count, 3, 3)
        return np.asarray(flat + self.tip_weights[:, :, None] * nu[:, None, :])

    def _operator(self, weights: F64) -> sp.csr_array:
        """(3 N, N): from a coordinate of all vertices to that row of every Q, tips left out."""
        rings, size = self.rings, self.rings.count
        rows = (3 * rings.start[:, None] + np.arange(3)).ravel()
        ends = sp.coo_array((weights.ravel(), (rows, np.repeat(rings.end, 3))), shape=(3 * size, size))
        starts = sp.coo_array((weights.ravel(), (rows, np.repeat(rings.start, 3))), shape=(3 * size, size))
        return sp.csr_array(ends - starts)


class TentTransfer:
    """Carries expressions of a source to a target of the same topology; factorised once.

    Parameters
    ----------
    source, target : (N, 3) neutral meshes, vertex to vertex, the source aligned with the target.
    rings : of both.

    Raises
    ------
    SolverError
        When the target cannot be solved for.
    """

    def __init__(self, source: F64, target: F64, rings: Rings) -> None:
        self.source, self.target, self.rings = source, target, rings
        self._tents = Tents(source, rings)
        own = Tents(target, rings)
        self._basis = _across(own.tip_weights)
        across = sp.csr_array(sp.block_diag(list(self._basis.transpose(0, 2, 1)), format="csr"))
        self._solve = LeastSquares(sp.csr_array(across @ own.operator), HELD)

    def __call__(self, expressive: F64) -> F64:
        """The target (N, 3) with the expression that the source has in `expressive` (N, 3)."""
        wanted = self._tents.transformations(expressive)
        across = np.einsum("nij,nik->njk", self._basis, wanted).reshape(-1, 3)
        made = self._solve(across, self.target)
        return self.target + settled(made - self.target, expressive - self.source)


def settled(made: F64, wanted: F64) -> F64:
    """Displacements (N, 3), shifted so that what hardly moves in the source moves in the mean as it does there."""
    way = np.linalg.norm(wanted, axis=1)
    still = way <= STILL * max(float(way.max()), 1e-300)
    return np.asarray(made - (made - wanted)[still].mean(0)) if still.any() else made


def _across(directions: F64) -> F64:
    """(N, 3, 2) orthonormal bases of the planes across directions (N, 3)."""
    size = np.linalg.norm(directions, axis=1, keepdims=True)
    unit = directions / np.where(size > 0, size, 1)
    least = np.eye(3)[np.abs(unit).argmin(1)]
    first = np.cross(unit, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True).clip(1e-300)
    return np.stack([first, np.cross(unit, first)], axis=2)


def vertex_error(source: F64, expressive: F64, made: F64) -> F64:
    """E of the appendix (N,), for an expression carried to the source itself; NaN where nothing moves.

    | |made - source| / |expressive - source| - 1 |
    """
    way = np.linalg.norm(expressive - source, axis=1)
    moves = way > STILL * max(float(way.max()), 1e-300)
    out = np.full(len(way), np.nan)
    out[moves] = np.abs(np.linalg.norm(made - source, axis=1)[moves] / way[moves] - 1)
    return out
