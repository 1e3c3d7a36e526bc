"""From what a file holds to a mesh to compute with: seams closed, what is useless left out.

Welding.  Files split vertices where texture coordinates or normals change (glTF must), which would tear the surface
there.  Vertices are joined only along border edges that lie at one place in opposite directions, two and no more, and
only where the surface goes on from one border to the other: by the normals of both sides, in the mean over a run of
such edges.  Lips that touch in the neutral face thus stay apart: with a mouth behind them they have no border there.
Without one the surface folds back where they meet, or the file has texture coordinates, which are the same on both
sides, so that it splits the vertices on purpose (unless it splits all: each corner a vertex).  What the morph targets
of the file move apart is never joined.

Left out: faces without area (as high as rounding is), faces given twice, and vertices then in no face, which move with
the nearest vertex that is kept.  Polygons of more than four sides are fans of triangles.  Holes, several components and
edges with more than two faces are left as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.normals import BEYOND, smooth, unit
from guise.common.arrays import F64, Bool, Int

FLAT = 1e-5  # height by longest side up to which a triangle has no area: what float32 positions round to
GOES_ON = 0.5  # cosine between the normals of a seam's two sides, in the mean
TOGETHER = 1e-4  # of the largest displacement, up to which two vertices move together
SAME = 1e-3  # difference of unit normals up to which they are equal


@dataclass(frozen=True, eq=False)
class Cleaned:
    """What is computed with of a file's n vertices.

    mesh : clean, N vertices.   kept : (N,) which of the file's vertices they are.
    ids : (n,) which of them each of the file's vertices is, or moves with.
    """

    mesh: Mesh
    kept: Int
    ids: Int

    @classmethod
    def of(
        cls,
        vertices: F64,
        polygons: Polygons,
        *,
        normals: F64 | None = None,
        apart: F64 | None = None,
        together: F64 | None = None,
    ) -> Cleaned:
        """Of a file's vertices (n, 3) and polygons.

        normals : (n, 3) of the file's vertices, where it gives them.
        apart : (n, d) what else may tell a seam's two sides apart (texture coordinates), where it is given.
        together : (n, d) what must be the same of two vertices to be joined (the displacements of a rig).

        Raises
        ------
        MeshError
            When a vertex is not finite, or no face with area is left.
        """
        _check(vertices, polygons)
        first = _welded(vertices, polygons, normals, apart, together)
        triangles, quads = _faces(vertices, Polygons(first[polygons.corners], polygons.sizes))
        if not len(triangles) + len(quads):
            raise MeshError("none of its faces has an area")
        kept = np.unique(np.concatenate([triangles.ravel(), quads.ravel()]))
        new = np.full(len(vertices), -1)
        new[kept] = np.arange(len(kept))
        mesh = Mesh(vertices[kept], new[triangles], new[quads])
        ids = new[first]
        lost = np.flatnonzero(ids < 0)
        if len(lost):
            ids[lost] = cKDTree(mesh.vertices).query(vertices[lost])[1]
        return cls(mesh, kept, ids)


def _check(vertices: F64, polygons: Polygons) -> None:
    if not len(vertices):
        raise MeshError("it has no vertices")
    if not len(polygons.sizes):
        raise MeshError(f"it has {len(vertices)} vertices but no faces; a point cloud cannot be used")
    bad = int(np.count_nonzero(~(np.abs(vertices) <= BEYOND).all(axis=1)))
    if bad:
        raise MeshError(f"{bad} of its {len(vertices)} vertices are not finite (NaN, or beyond {BEYOND:g})")


def _faces(vertices: F64, polygons: Polygons) -> tuple[Int, Int]:
    """Triangles (t, 3) and quads (q, 4) with area, each once; a quad of which a half has none is its other half."""
    fans = polygons.corners[polygons.fans]
    good = ~_flat(vertices, fans)
    owner = np.repeat(np.arange(len(polygons.sizes)), polygons.sizes - 2)
    halves = np.bincount(owner, good, len(polygons.sizes))
    whole = (polygons.sizes == 4) & (halves == 2)
    quads = polygons.corners[polygons.starts[whole][:, None] + np.arange(4)]
    return _once(fans[good & ~whole[owner]]), _once(quads)


def _flat(vertices: F64, triangles: Int) -> Bool:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - q) ** 2).sum(1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return np.asarray(area <= FLAT * longest)


def _once(faces: Int) -> Int:
    """Faces (m, s) without those that have the vertices of an earlier one; order kept."""
    alike = np.sort(faces, axis=1)
    order = np.lexsort(alike.T)
    again = (alike[order[1:]] == alike[order[:-1]]).all(axis=1)
    return np.delete(faces, order[1:][again], axis=0)


def _welded(
    vertices: F64, polygons: Polygons, normals: F64 | None, apart: F64 | None, together: F64 | None
) -> Int:
    """(n,) the first of the vertices that each is joined with."""
    left, right = _facing_borders(vertices, polygons)
    if together is not None:
        same = (np.abs(together[left] - together[right]) <= TOGETHER * np.abs(together).max()).all(
            axis=(1, 2)
        )
        left, right = left[same], right[same]
    if not len(left):
        return np.arange(len(vertices))
    runs = _runs(left, right, len(vertices))
    seam = _goes_on(_filled(normals, vertices, polygons), left, right, runs)
    if apart is not None and len(np.unique(polygons.corners)) < len(polygons.corners):
        seam &= np.bincount(runs, _told_apart(normals, apart, left, right)) > 0
    chosen = seam[runs]
    label = _joined(left[chosen].ravel(), right[chosen].ravel(), len(vertices))
    return np.asarray(np.unique(label, return_index=True)[1][label], np.intp)


def _told_apart(normals: F64 | None, apart: F64, left: Int, right: Int) -> Bool:
    """(s,) whether anything but their ids tells two facing edges apart."""
    differs = (apart[left] != apart[right]).any(axis=(1, 2))
    if normals is not None:
        differs |= (np.abs(unit(normals)[left] - unit(normals)[right]) > SAME).any(axis=(1, 2))
    return np.asarray(differs)


def _facing_borders(vertices: F64, polygons: Polygons) -> tuple[Int, Int]:
    """(s, 2) and (s, 2) vertices of border edges at one place, where there are two, of opposite direction."""
    start, end = polygons.corners, polygons.corners[polygons.following]
    _, code, uses = np.unique(_code(start, end, len(vertices)), return_inverse=True, return_counts=True)
    border = (uses[code] == 1) & (start != end)
    edges = np.stack([start, end], axis=1)[border]
    place = _places(vertices, edges)
    codes = _code(place[:, 0], place[:, 1], len(vertices))
    order = np.argsort(codes, kind="stable")
    _, begin, many = np.unique(codes[order], return_index=True, return_counts=True)
    pairs = order[begin[many == 2][:, None] + np.arange(2)]
    one, two = edges[pairs[:, 0]], edges[pairs[:, 1], ::-1]
    facing = place[pairs[:, 0], 0] == place[pairs[:, 1], 1]
    return one[facing], two[facing]


def _code(a: Int, b: Int, count: int) -> Int:
    """One number for a pair of ids, whichever comes first."""
    return np.asarray(np.minimum(a, b) * count + np.maximum(a, b), np.intp)


def _places(vertices: F64, edges: Int) -> Int:
    """Ids of the places of edges' vertices (e, 2): the same where the positions are equal."""
    used, inverse = np.unique(edges, return_inverse=True)
    points = vertices[used]
    order = np.lexsort(points.T)
    new = np.ones(len(used), bool)
    new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    place = np.empty(len(used), np.intp)
    place[order] = np.cumsum(new) - 1
    return place[inverse.reshape(edges.shape)]


def _runs(left: Int, right: Int, count: int) -> Int:
    """(s,) the run that each pair of facing edges belongs to: those that hang together by vertices of either side."""
    ends = np.concatenate([left, right], axis=1)
    label = _joined(np.repeat(ends[:, 0], 3), ends[:, 1:].ravel(), count)
    return np.asarray(np.unique(label[ends[:, 0]], return_inverse=True)[1], np.intp)


def _joined(a: Int, b: Int, count: int) -> Int:
    """(count,) labels of what pairs a - b join."""
    graph = sp.coo_array((np.ones(len(a), np.int8), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp)


def _filled(normals: F64 | None, vertices: F64, polygons: Polygons) -> F64:
    """Normals (n, 3), computed where the file gives none."""
    own = smooth(vertices, polygons)
    return own if normals is None else np.where(normals.any(axis=1, keepdims=True), normals, own)


def _goes_on(normals: F64, left: Int, right: Int, runs: Int) -> Bool:
    """(r,) whether the two sides of a run have the same normals, in the mean."""
    unit_normals = unit(normals)
    cosine = np.einsum("sij,sij->si", unit_normals[left], unit_normals[right])
    split = left != right
    sums = np.bincount(runs, np.where(split, cosine, 0).sum(1))
    return np.asarray(sums > GOES_ON * np.bincount(runs, split.sum(1)))
