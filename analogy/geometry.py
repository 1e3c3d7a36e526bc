"""Geometry of triangulated surfaces: normals, the cotangent Laplacian, borders, closest places, geodesic patches.

Arrays: vertices (N, 3) in any unit, faces (m, 3) vertex ids, counter-clockwise from outside.

Closest places come from SciPy's cKDTree over samples of the surface, and a projection onto the triangles of the
nearest ones.  The tree is chosen over an AABB tree (libigl, whose wheels hold GPL parts; trimesh's, which is Python
over rtree and twenty times slower) as it searches places and normals at once: of two skins back to back, the lips, it
gives the one that faces the same way.  Geodesic distances are those along edges (SciPy's Dijkstra), up to a tenth too
long, which is enough to cut a patch out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from guise.analogy.normals import unit
from guise.analogy.tents import triangle_normals
from guise.common.arrays import F64, Bool, Int

TINY = 1e-300
LONG_EDGES = 3.0  # median edges, from which a face gets more samples than its centre
MOST_SAMPLES = 8  # along an edge
ABOUT = (
    0.5  # share by which the nearest sample may be farther than the nearest there is; twice as quick to find
)
CANDIDATES = 8  # samples whose faces are projected onto


def face_normals(vertices: F64, faces: Int) -> F64:
    """(m, 3) normals as long as twice the faces' areas."""
    return triangle_normals(np.ascontiguousarray(vertices.T), faces.T).T


def gathered(values: F64, at: Int, count: int) -> F64:
    """(count, d) sums of values (m, d) by their index at (m,)."""
    return np.stack([np.bincount(at, column, count) for column in values.T], axis=1)


def vertex_normals(vertices: F64, faces: Int) -> F64:
    """(N, 3) unit normals, weighted by area; zero where the faces cancel out."""
    across = face_normals(vertices, faces)
    return unit(np.asarray(sum(gathered(across, faces[:, k], len(vertices)) for k in range(3))))


def vertex_areas(vertices: F64, faces: Int) -> F64:
    """(N,) a third of the area of each vertex's faces."""
    sixth = np.linalg.norm(face_normals(vertices, faces), axis=1) / 6
    return np.bincount(faces.ravel(), np.repeat(sixth, 3), len(vertices)).astype(np.float64)


def cotangent_laplacian(vertices: F64, faces: Int) -> tuple[sp.csr_array, F64]:
    """Minus the Laplacian as a matrix L (N, N), positive semidefinite, and the vertices' areas (N,).

    Botsch et al. 2007 (cotangent weights, barycentric areas).  Cotangents are limited to 0.001 .. 5, which leaves
    well-shaped triangles alone and keeps L definite for slivers.
    """
    count = len(vertices)
    weights = sp.csr_array((count, count))
    for k in range(3):
        i, j, opposite = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        a, b = vertices[i] - vertices[opposite], vertices[j] - vertices[opposite]
        double = np.linalg.norm(np.cross(a, b), axis=1)
        half = np.clip((a * b).sum(1) / double.clip(TINY), 1e-3, 5) / 2
        weights += sp.csr_array(sp.coo_array((half, (i, j)), shape=(count, count)))
    weights = weights + weights.T
    return sp.csr_array(sp.diags_array(weights.sum(axis=1)) - weights), vertex_areas(vertices, faces)


def border(faces: Int, count: int) -> Bool:
    """(count,) whether a vertex lies on an open border: an edge with one face."""
    ends = faces, np.roll(faces, -1, axis=1)
    keys = np.sort((np.minimum(*ends) * count + np.maximum(*ends)).ravel())
    again = keys[1:] == keys[:-1]
    alone = keys[~(np.r_[again, False] | np.r_[False, again])]
    out = np.zeros(count, bool)
    out[np.concatenate(np.divmod(alone, count))] = True
    return out


def edge_lengths(vertices: F64, faces: Int) -> F64:
    """(m, 3) lengths of the faces' sides."""
    return np.asarray(np.linalg.norm(vertices[faces] - vertices[np.roll(faces, -1, axis=1)], axis=2))


def geodesic_patch(vertices: F64, faces: Int, centre: int, radius: float) -> Int:
    """The vertices (p,) within a geodesic distance of the centre, itself the first."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    lengths = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1).clip(TINY)
    both = (np.r_[ends[:, 0], ends[:, 1]], np.r_[ends[:, 1], ends[:, 0]])
    # an edge of two faces comes twice: the lower entry wins, where a plain sparse sum would double it
    keys, first = np.unique(both[0] * len(vertices) + both[1], return_index=True)
    entries = (np.r_[lengths, lengths][first], (keys // len(vertices), keys % len(vertices)))
    graph = sp.csr_array(sp.coo_array(entries, shape=(len(vertices), len(vertices))))
    far = dijkstra(graph, indices=centre, limit=radius)
    inside = np.flatnonzero(np.isfinite(far))
    return np.asarray(inside[np.argsort(far[inside], kind="stable")], np.intp)


@dataclass(frozen=True, eq=False)
class Places:
    """Places on a surface: faces (n,), barycentric weights (n, 3), positions (n, 3), and the normals there (n, 3)."""

    faces: Int
    weights: F64
    positions: F64
    normals: F64


class Surface:
    """A surface to find closest places on.

    Parameters
    ----------
    vertices : (N, 3).   faces : (m, 3).
    turn : what a difference of normals counts, as a length: two opposite ones are 2 turn apart.
    """

    def __init__(self, vertices: F64, faces: Int, turn: float) -> None:
        self.vertices, self.faces, self.turn = vertices, faces, turn
        self.vertex_normals = vertex_normals(vertices, faces)
        self.border = border(faces, len(vertices))
        self.sample_faces, weights = self._samples()
        self.samples = self._at(self.vertices, self.sample_faces, weights)
        self.normals = unit(self._at(self.vertex_normals, self.sample_faces, weights))
        at_vertex = (weights > 1 - 1e-9) & self.border[faces[self.sample_faces]]
        self.on_border: Bool = np.asarray(at_vertex.any(axis=1))
        self._tree = cKDTree(np.concatenate([self.samples, turn * self.normals], axis=1), balanced_tree=False)

    def nearest(self, points: F64, normals: F64) -> Int:
        """(n,) the nearest sample to each of points (n, 3) with normals (n, 3), both counted."""
        query = np.concatenate([points, self.turn * normals], axis=1)
        return np.asarray(self._tree.query(query)[1], np.intp)

    def closest(self, points: F64, normals: F64) -> Places:
        """The closest places to points (n, 3) that face the way of normals (n, 3).

        Of the faces of the nearest samples, the one of least squared distance, of place and normal together.
        """
        query = np.concatenate([points, self.turn * normals], axis=1)
        near = self._tree.query(query, k=min(CANDIDATES, len(self.samples)))[1]
        faces = self.sample_faces[near.reshape(len(points), -1)]  # (n, k)
        weights = barycentric(
            np.repeat(points, faces.shape[1], axis=0), self.vertices[self.faces[faces.ravel()]]
        )
        weights = weights.reshape(*faces.shape, 3)
        positions = self._at(self.vertices, faces, weights)
        across = unit(self._at(self.vertex_normals, faces, weights))
        far = ((positions - points[:, None]) ** 2).sum(2)
        far += self.turn**2 * ((across - normals[:, None]) ** 2).sum(2)
        best = (np.arange(len(points)), far.argmin(axis=1))
        return Places(faces[best], weights[best], positions[best], across[best])

    def _at(self, values: F64, faces: Int, weights: F64) -> F64:
        a, b, c = (
            values[self.faces[faces, k]] * weights[..., k, None] for k in range(3)
        )  # quicker than a sum
        return np.asarray(a + b + c)

    def _samples(self) -> tuple[Int, F64]:
        """Faces (s,) and barycentric weights (s, 3): every vertex once, and faces' centres, more in large faces."""
        corners = self.faces.ravel()
        first = np.full(len(self.vertices), -1)
        first[corners[::-1]] = np.arange(len(corners))[::-1]
        first = first[first >= 0]
        faces, weights = [first // 3], [np.eye(3)[first % 3]]
        longest = edge_lengths(self.vertices, self.faces).max(axis=1)
        parts = np.ceil(longest / max(LONG_EDGES * float(np.median(longest)), TINY))
        parts = np.clip(parts, 1, MOST_SAMPLES).astype(int)
        for count in np.unique(parts):
            inner = _centres(int(count))
            at = np.flatnonzero(parts == count)
            faces.append(np.repeat(at, len(inner)))
            weights.append(np.tile(inner, (len(at), 1)))
        return np.concatenate(faces), np.concatenate(weights)


def _centres(parts: int) -> F64:
    """(parts^2, 3) barycentric centres of a triangle cut into parts^2."""
    thirds = [
        (3 * i + step, 3 * j + step)
        for step, short in ((1, 0), (2, 1))
        for i in range(parts - short)
        for j in range(parts - short - i)
    ]
    first = np.array(thirds, np.float64) / (3 * parts)
    return np.concatenate([first, 1 - first.sum(axis=1, keepdims=True)], axis=1)


def barycentric(points: F64, triangles: F64) -> F64:
    """Weights (n, 3), >= 0 with sum 1, of the place in triangles (n, 3, 3) that is closest to points (n, 3).

    Ericson, Real-Time Collision Detection, section 5.1.5: the plane's foot if it lies inside, else the closest
    place of the three sides.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    inside = _foot(points - a, b - a, c - a)
    outside = (inside < 0).any(axis=1)
    if outside.any():
        inside[outside] = _on_sides(points[outside], triangles[outside])
    return inside


def _foot(p: F64, u: F64, v: F64) -> F64:
    """Barycentric weights of the feet of p on planes along u, v; (-1, 1, 1) where a triangle has no area."""
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    pu, pv = (p * u).sum(1), (p * v).sum(1)
    det = uu * vv - uv * uv
    flat = det <= 1e-14 * uu * vv
    det = np.where(flat, 1, det)
    s, t = (vv * pu - uv * pv) / det, (uu * pv - uv * pu) / det
    s, t = np.where(flat, 1, s), np.where(flat, 1, t)
    return np.stack([1 - s - t, s, t], axis=1)


def _on_sides(points: F64, triangles: F64) -> F64:
    best, out = np.full(len(points), np.inf), np.zeros((len(points), 3))
    for k in range(3):
        start, way = triangles[:, k], triangles[:, (k + 1) % 3] - triangles[:, k]
        along = np.clip(((points - start) * way).sum(1) / (way * way).sum(1).clip(TINY), 0, 1)
        far = ((start + along[:, None] * way - points) ** 2).sum(1)
        nearer = far < best
        best[nearer] = far[nearer]
        out[nearer] = 0
        out[nearer, k], out[nearer, (k + 1) % 3] = 1 - along[nearer], along[nearer]
    return out
