"""Geometry of triangulated surfaces: normals, the cotangent Laplacian, borders, closest points, geodesic patches.

Arrays: vertices (N, 3) in any unit, faces (m, 3) vertex ids, counter-clockwise from outside.

Closest points come from SciPy's cKDTree over samples of the surface, followed by a projection onto the triangles of
the nearest samples.  The tree was chosen over an AABB tree (libigl's wheels contain GPL parts; trimesh's is Python over
rtree and twenty times slower) because it searches positions and normals at once: of two surfaces back to back, such as
the lips, it finds the one that faces the same way.  Geodesic distances run along edges (SciPy's Dijkstra) and are up to
10 % too long, which is good enough to cut out a patch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from guise.analogy.normals import unit_vectors
from guise.analogy.solver import compact_rows
from guise.analogy.tents import triangle_normals
from guise.common.arrays import F64, Bool, Int

MIN_LENGTH = 1e-300  # below which lengths and areas count as zero


@dataclass(frozen=True)
class SamplingSettings:
    """How a surface is sampled for closest points."""

    long_edge_medians: float = 3.0  # median edge lengths, from which a face gets more samples than its centre
    max_samples_per_edge: int = 8
    candidates: int = 8  # nearest samples whose faces are projected onto
    points_at_once: int = 20_000  # whose candidates are in memory together


SAMPLING = SamplingSettings()


def face_normals(vertices: F64, faces: Int) -> F64:
    """(m, 3) normals; their length is twice the area of the face."""
    return triangle_normals(np.ascontiguousarray(vertices.T), faces.T).T


def sum_by_index(values: F64, at: Int, count: int) -> F64:
    """(count, d) sums of values (m, d) with the same index at (m,)."""
    return np.stack([np.bincount(at, column, count) for column in values.T], axis=1)


def vertex_normals(vertices: F64, faces: Int) -> F64:
    """(N, 3) unit normals, weighted by area; zero where the faces cancel out."""
    across = face_normals(vertices, faces)
    return unit_vectors(np.asarray(sum(sum_by_index(across, faces[:, k], len(vertices)) for k in range(3))))


def vertex_areas(vertices: F64, faces: Int) -> F64:
    """(N,) a third of the area of the faces at each vertex."""
    sixth = np.linalg.norm(face_normals(vertices, faces), axis=1) / 6
    return np.bincount(faces.ravel(), np.repeat(sixth, 3), len(vertices)).astype(np.float64)


def doubled_areas_2d(points: F64, triangles: Int) -> F64:
    """Twice the signed areas (t,) of triangles of points (n, 2); counter-clockwise is positive."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    return np.asarray(ux * vy - uy * vx)


def cotangent_laplacian(vertices: F64, faces: Int) -> tuple[sp.csr_array, F64]:
    """Negated Laplacian L (N, N), positive semidefinite, and the vertex areas (N,).

    Botsch et al. 2007 (cotangent weights, barycentric areas).  Cotangents are clipped to 0.001 .. 5, which leaves
    well-shaped triangles alone and keeps L definite for slivers.
    """
    count = len(vertices)
    weights = sp.csr_array((count, count))
    for k in range(3):
        i, j, opposite = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        a, b = vertices[i] - vertices[opposite], vertices[j] - vertices[opposite]
        double = np.linalg.norm(np.cross(a, b), axis=1)
        half = np.clip((a * b).sum(1) / double.clip(MIN_LENGTH), 1e-3, 5) / 2
        weights += sp.csr_array(sp.coo_array((half, (i, j)), shape=(count, count)))
    weights = weights + weights.T
    return sp.csr_array(sp.diags_array(weights.sum(axis=1)) - weights), vertex_areas(vertices, faces)


def border_mask(faces: Int, count: int) -> Bool:
    """(count,) whether a vertex lies on an open border, that is, on an edge with one face."""
    ends = faces, np.roll(faces, -1, axis=1)
    keys = np.sort((np.minimum(*ends) * count + np.maximum(*ends)).ravel())
    again = keys[1:] == keys[:-1]
    alone = keys[~(np.r_[again, False] | np.r_[False, again])]
    out = np.zeros(count, bool)
    out[np.concatenate(np.divmod(alone, count))] = True
    return out


def edge_lengths(vertices: F64, faces: Int) -> F64:
    """(m, 3) lengths of the sides of the faces."""
    return np.asarray(np.linalg.norm(vertices[faces] - vertices[np.roll(faces, -1, axis=1)], axis=2))


def geodesic_patch(vertices: F64, faces: Int, centre: int, radius: float) -> Int:
    """The vertices (p,) within a geodesic radius of the centre, sorted by distance: the centre comes first."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    lengths = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1).clip(MIN_LENGTH)
    both = (np.r_[ends[:, 0], ends[:, 1]], np.r_[ends[:, 1], ends[:, 0]])
    # an edge of two faces occurs twice; a plain sparse sum would double its length
    keys, first = np.unique(both[0] * len(vertices) + both[1], return_index=True)
    entries = (np.r_[lengths, lengths][first], (keys // len(vertices), keys % len(vertices)))
    graph = sp.csr_array(sp.coo_array(entries, shape=(len(vertices), len(vertices))))
    far = dijkstra(graph, indices=centre, limit=radius)
    inside = np.flatnonzero(np.isfinite(far))
    return np.asarray(inside[np.argsort(far[inside], kind="stable")], np.intp)


def interpolation_matrix(corners: Int, weights: F64, count: int) -> sp.csr_array:
    """(n, count) that interpolates vertex attributes at points with corners (n, 3) and barycentric weights (n, 3)."""
    rows = np.repeat(np.arange(len(corners)), 3)
    entries = (weights.ravel(), (rows, corners.ravel()))
    return compact_rows(sp.coo_array(entries, shape=(len(corners), count)))


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points on a surface: faces (n,), barycentric weights (n, 3), positions (n, 3) and normals (n, 3)."""

    faces: Int
    weights: F64
    positions: F64
    normals: F64


class Surface:
    """A surface on which closest points are found.

    Parameters
    ----------
    vertices : (N, 3).   faces : (m, 3).
    normal_weight : the length that a difference of unit normals of 1 counts as; opposite normals count twice that.
    """

    def __init__(self, vertices: F64, faces: Int, normal_weight: float) -> None:
        self.vertices, self.faces, self.normal_weight = vertices, faces, normal_weight
        self.vertex_normals = vertex_normals(vertices, faces)
        self.border = border_mask(faces, len(vertices))
        self.sample_faces, weights = self._make_samples()
        self.samples = self._interpolate(self.vertices, self.sample_faces, weights)
        self.normals = unit_vectors(self._interpolate(self.vertex_normals, self.sample_faces, weights))
        at_vertex = (weights > 1 - 1e-9) & self.border[faces[self.sample_faces]]
        self.border_samples: Bool = np.asarray(at_vertex.any(axis=1))
        self._tree = cKDTree(
            np.concatenate([self.samples, normal_weight * self.normals], axis=1), balanced_tree=False
        )

    def nearest_samples(self, points: F64, normals: F64) -> Int:
        """(n,) the sample nearest to each point (n, 3) with its normal (n, 3), by position and normal."""
        query = np.concatenate([points, self.normal_weight * normals], axis=1)
        return np.asarray(self._tree.query(query)[1], np.intp)

    def closest_points(self, points: F64, normals: F64) -> SurfacePoints:
        """The points of the surface closest to points (n, 3) with normals (n, 3).

        Among the faces of the nearest samples, the one with the least squared distance of position and normal.
        """
        count = SAMPLING.points_at_once
        parts = [
            self._closest_points(points[first : first + count], normals[first : first + count])
            for first in range(0, max(len(points), 1), count)
        ]
        return SurfacePoints(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _closest_points(self, points: F64, normals: F64) -> tuple[Int, F64, F64, F64]:
        """Faces, weights, positions and normals of `closest_points`."""
        query = np.concatenate([points, self.normal_weight * normals], axis=1)
        near = self._tree.query(query, k=min(SAMPLING.candidates, len(self.samples)))[1]
        faces = self.sample_faces[near.reshape(len(points), -1)]  # (n, k)
        weights = barycentric(
            np.repeat(points, faces.shape[1], axis=0), self.vertices[self.faces[faces.ravel()]]
        )
        weights = weights.reshape(*faces.shape, 3)
        positions = self._interpolate(self.vertices, faces, weights)
        across = unit_vectors(self._interpolate(self.vertex_normals, faces, weights))
        far = ((positions - points[:, None]) ** 2).sum(2)
        far += self.normal_weight**2 * ((across - normals[:, None]) ** 2).sum(2)
        best = (np.arange(len(points)), far.argmin(axis=1))
        return faces[best], weights[best], positions[best], across[best]

    def _interpolate(self, values: F64, faces: Int, weights: F64) -> F64:
        a, b, c = (
            values[self.faces[faces, k]] * weights[..., k, None] for k in range(3)
        )  # faster than a sum
        return np.asarray(a + b + c)

    def _make_samples(self) -> tuple[Int, F64]:
        """Faces (s,) and barycentric weights (s, 3): every vertex once, and one or more points in every face."""
        corners = self.faces.ravel()
        first = np.full(len(self.vertices), -1)
        first[corners[::-1]] = np.arange(len(corners))[::-1]
        first = first[first >= 0]
        faces, weights = [first // 3], [np.eye(3)[first % 3]]
        longest = edge_lengths(self.vertices, self.faces).max(axis=1)
        parts = np.ceil(longest / max(SAMPLING.long_edge_medians * float(np.median(longest)), MIN_LENGTH))
        parts = np.clip(parts, 1, SAMPLING.max_samples_per_edge).astype(int)
        for count in np.unique(parts):
            inner = _subdivision_centres(int(count))
            at = np.flatnonzero(parts == count)
            faces.append(np.repeat(at, len(inner)))
            weights.append(np.tile(inner, (len(at), 1)))
        return np.concatenate(faces), np.concatenate(weights)


def _subdivision_centres(parts: int) -> F64:
    """(parts^2, 3) barycentric centres of a triangle divided into parts^2."""
    thirds = [
        (3 * i + step, 3 * j + step)
        for step, short in ((1, 0), (2, 1))
        for i in range(parts - short)
        for j in range(parts - short - i)
    ]
    first = np.array(thirds, np.float64) / (3 * parts)
    return np.concatenate([first, 1 - first.sum(axis=1, keepdims=True)], axis=1)


def barycentric(points: F64, triangles: F64) -> F64:
    """Barycentric weights (n, 3), >= 0 with sum 1, of the points of triangles (n, 3, 3) closest to points (n, 3).

    Ericson, Real-Time Collision Detection, section 5.1.5: the foot on the plane if it lies inside, otherwise the
    closest point of the three sides.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    inside = _plane_feet(points - a, b - a, c - a)
    outside = (inside < 0).any(axis=1)
    if outside.any():
        inside[outside] = _closest_on_sides(points[outside], triangles[outside])
    return inside


def _plane_feet(p: F64, u: F64, v: F64) -> F64:
    """Barycentric weights of the feet of p on planes along u, v; (-1, 1, 1) where a triangle has no area."""
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    pu, pv = (p * u).sum(1), (p * v).sum(1)
    det = uu * vv - uv * uv
    flat = det <= 1e-14 * uu * vv
    det = np.where(flat, 1, det)
    s, t = (vv * pu - uv * pv) / det, (uu * pv - uv * pu) / det
    s, t = np.where(flat, 1, s), np.where(flat, 1, t)
    return np.stack([1 - s - t, s, t], axis=1)


def _closest_on_sides(points: F64, triangles: F64) -> F64:
    best, out = np.full(len(points), np.inf), np.zeros((len(points), 3))
    for k in range(3):
        start, way = triangles[:, k], triangles[:, (k + 1) % 3] - triangles[:, k]
        along = np.clip(((points - start) * way).sum(1) / (way * way).sum(1).clip(MIN_LENGTH), 0, 1)
        far = ((start + along[:, None] * way - points) ** 2).sum(1)
        nearer = far < best
        best[nearer] = far[nearer]
        out[nearer] = 0
        out[nearer, k], out[nearer, (k + 1) % 3] = 1 - along[nearer], along[nearer]
    return out
