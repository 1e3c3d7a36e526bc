"""Cleans the mesh of a file for computation: welds seams and drops what is useless.

Welding.  Files split vertices where texture coordinates or normals change (glTF must), which would tear the surface.
Vertices are welded only along pairs of border edges that coincide with opposite directions, and only where the surface
continues smoothly from one border to the other, judged by the normals of both sides over a run of such edges.  Lips
that touch in the neutral face therefore stay apart: with a mouth behind them they have no border there.  Without one,
either the surface folds back where they meet, or the file has texture coordinates that agree on both sides, which means
that it splits the vertices on purpose (unless it splits every corner).  Vertices that a morph target of the file moves
apart are never welded.

A mesh that is inside out, as a mirrored head whose faces kept their winding, is turned.

Dropped: faces without area (up to rounding), duplicate faces, and vertices that are then unused; these move with the
nearest vertex that is kept.  Polygons of more than four sides become fans of triangles.  Holes, several components and
edges with more than two faces stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.normals import MAX_MAGNITUDE, polygon_vertex_normals, unit_vectors
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True)
class CleaningLimits:
    """Thresholds of welding and of faces without area."""

    flat_triangle_ratio: float = (
        1e-5  # height / longest side, up to which a triangle is flat (float32 rounding)
    )
    min_seam_cosine: float = 0.5  # between the normals of a seam's two sides, mean
    same_motion_ratio: float = 1e-4  # of the largest displacement, up to which two vertices move together
    same_normal_difference: float = 1e-3  # of unit normals, up to which they are equal


CLEANING = CleaningLimits()


@dataclass(frozen=True, eq=False)
class CleanedMesh:
    """The clean mesh of a file with n vertices.

    mesh : clean, N vertices.   kept : (N,) their ids in the file.
    ids : (n,) for each vertex of the file, the clean vertex that it is or moves with.
    turned : whether the faces of the file are inside out, and those of the clean mesh wound the other way.
    """

    mesh: Mesh
    kept: Int
    ids: Int
    turned: bool = False

    @classmethod
    def of(
        cls,
        vertices: F64,
        polygons: Polygons,
        *,
        normals: F64 | None = None,
        apart: F64 | None = None,
        together: F64 | None = None,
    ) -> CleanedMesh:
        """Clean the vertices (n, 3) and polygons of a file.

        normals : (n, 3) of the vertices, if the file has them.
        apart : (n, d) attributes that may differ between the sides of a seam (texture coordinates), if there are any.
        together : (n, d) values that must agree for two vertices to be welded (displacements of a rig).

        Raises
        ------
        MeshError
            When a vertex is not finite, or no face with area remains.
        """
        _require_usable(vertices, polygons)
        first = _weld(vertices, polygons, normals, apart, together)
        triangles, quads = _faces(vertices, Polygons(first[polygons.corners], polygons.sizes))
        if not len(triangles) + len(quads):
            raise MeshError("all of its faces have zero area")
        kept = np.unique(np.concatenate([triangles.ravel(), quads.ravel()]))
        new = np.full(len(vertices), -1)
        new[kept] = np.arange(len(kept))
        mesh = Mesh(vertices[kept], new[triangles], new[quads])
        ids = new[first]
        lost = np.flatnonzero(ids < 0)
        if len(lost):
            ids[lost] = cKDTree(mesh.vertices).query(vertices[lost])[1]
        turned = mesh.is_inside_out
        return cls(mesh.turned() if turned else mesh, kept, ids, turned)


def _require_usable(vertices: F64, polygons: Polygons) -> None:
    if not len(vertices):
        raise MeshError("it has no vertices")
    if not len(polygons.sizes):
        raise MeshError(f"it has {len(vertices)} vertices but no faces: point clouds cannot be used")
    bad = int(np.count_nonzero(~(np.abs(vertices) <= MAX_MAGNITUDE).all(axis=1)))
    if bad:
        raise MeshError(
            f"{bad} of its {len(vertices)} vertices are not finite (NaN, or beyond {MAX_MAGNITUDE:g})"
        )


def _faces(vertices: F64, polygons: Polygons) -> tuple[Int, Int]:
    """Triangles (t, 3) and quads (q, 4) with area, each once; a quad with a flat half becomes its other half."""
    fans = polygons.corners[polygons.fans]
    good = ~_has_no_area(vertices, fans)
    owner = np.repeat(np.arange(len(polygons.sizes)), polygons.sizes - 2)
    halves = np.bincount(owner, good, len(polygons.sizes))
    whole = (polygons.sizes == 4) & (halves == 2)
    quads = polygons.corners[polygons.starts[whole][:, None] + np.arange(4)]
    return _without_duplicates(fans[good & ~whole[owner]]), _without_duplicates(quads)


def _has_no_area(vertices: F64, triangles: Int) -> Bool:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - q) ** 2).sum(1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return np.asarray(area <= CLEANING.flat_triangle_ratio * longest)


def _without_duplicates(faces: Int) -> Int:
    """Faces (m, s) without those that repeat the vertices of an earlier one; order kept."""
    alike = np.sort(faces, axis=1)
    order = np.lexsort(alike.T)
    again = (alike[order[1:]] == alike[order[:-1]]).all(axis=1)
    return np.delete(faces, order[1:][again], axis=0)


def _weld(
    vertices: F64, polygons: Polygons, normals: F64 | None, apart: F64 | None, together: F64 | None
) -> Int:
    """(n,) for each vertex, the first of those that it is welded with."""
    left, right = _facing_borders(vertices, polygons)
    if together is not None:
        same = (
            np.abs(together[left] - together[right]) <= CLEANING.same_motion_ratio * np.abs(together).max()
        ).all(axis=(1, 2))
        left, right = left[same], right[same]
    if not len(left):
        return np.arange(len(vertices))
    runs = _seam_runs(left, right, len(vertices))
    seam = _is_smooth(_with_missing_normals(normals, vertices, polygons), left, right, runs)
    if apart is not None and len(np.unique(polygons.corners)) < len(polygons.corners):
        seam &= np.bincount(runs, _differ(normals, apart, left, right)) > 0
    chosen = seam[runs]
    label = _component_labels(left[chosen].ravel(), right[chosen].ravel(), len(vertices))
    return np.asarray(np.unique(label, return_index=True)[1][label], np.intp)


def _differ(normals: F64 | None, apart: F64, left: Int, right: Int) -> Bool:
    """(s,) whether anything but their ids differs between two facing edges."""
    differs = (apart[left] != apart[right]).any(axis=(1, 2))
    if normals is not None:
        differs |= (
            np.abs(unit_vectors(normals)[left] - unit_vectors(normals)[right])
            > CLEANING.same_normal_difference
        ).any(axis=(1, 2))
    return np.asarray(differs)


def _facing_borders(vertices: F64, polygons: Polygons) -> tuple[Int, Int]:
    """Vertices (s, 2) and (s, 2) of pairs of border edges that coincide with opposite directions."""
    start, end = polygons.corners, polygons.corners[polygons.next_corners]
    _, code, uses = np.unique(_edge_keys(start, end, len(vertices)), return_inverse=True, return_counts=True)
    border = (uses[code] == 1) & (start != end)
    edges = np.stack([start, end], axis=1)[border]
    place = _position_ids(vertices, edges)
    codes = _edge_keys(place[:, 0], place[:, 1], len(vertices))
    order = np.argsort(codes, kind="stable")
    _, begin, many = np.unique(codes[order], return_index=True, return_counts=True)
    pairs = order[begin[many == 2][:, None] + np.arange(2)]
    one, two = edges[pairs[:, 0]], edges[pairs[:, 1], ::-1]
    facing = place[pairs[:, 0], 0] == place[pairs[:, 1], 1]
    return one[facing], two[facing]


def _edge_keys(a: Int, b: Int, count: int) -> Int:
    """One number per unordered pair of ids."""
    return np.asarray(np.minimum(a, b) * count + np.maximum(a, b), np.intp)


def _position_ids(vertices: F64, edges: Int) -> Int:
    """Position ids of the vertices of edges (e, 2): equal where the positions are equal."""
    used, inverse = np.unique(edges, return_inverse=True)
    points = vertices[used]
    order = np.lexsort(points.T)
    new = np.ones(len(used), bool)
    new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    place = np.empty(len(used), np.intp)
    place[order] = np.cumsum(new) - 1
    return place[inverse.reshape(edges.shape)]


def _seam_runs(left: Int, right: Int, count: int) -> Int:
    """(s,) the run of each pair of facing edges: pairs that share vertices of either side."""
    ends = np.concatenate([left, right], axis=1)
    label = _component_labels(np.repeat(ends[:, 0], 3), ends[:, 1:].ravel(), count)
    return np.asarray(np.unique(label[ends[:, 0]], return_inverse=True)[1], np.intp)


def _component_labels(a: Int, b: Int, count: int) -> Int:
    """(count,) component labels of the graph with edges a - b."""
    graph = sp.coo_array((np.ones(len(a), np.int8), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp)


def _with_missing_normals(normals: F64 | None, vertices: F64, polygons: Polygons) -> F64:
    """Normals (n, 3), computed where the file has none."""
    own = polygon_vertex_normals(vertices, polygons)
    return own if normals is None else np.where(normals.any(axis=1, keepdims=True), normals, own)


def _is_smooth(normals: F64, left: Int, right: Int, runs: Int) -> Bool:
    """(r,) whether the normals of the two sides of a run agree on average."""
    unit_normals = unit_vectors(normals)
    cosine = np.einsum("sij,sij->si", unit_normals[left], unit_normals[right])
    split = left != right
    sums = np.bincount(runs, np.where(split, cosine, 0).sum(1))
    return np.asarray(sums > CLEANING.min_seam_cosine * np.bincount(runs, split.sum(1)))
