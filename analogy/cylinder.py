"""Dense correspondence by cylindrical projection (Song et al. 2007, section III-A).

The target is aligned to the source by feature points (SVD).  Both are projected onto a cylinder around the head of the
source, u around it and v along it, and the source is rendered there as a mesh image: the triangle that each pixel shows
(`guise.render.visibility`).  The triangulated feature points and the corners of the bounding box (A, B, C, D of the
paper) define a piecewise affine map from the target's (u, v) to the source's (eq. 8).  Each target vertex takes the
triangle at its mapped position in the image, with its exact barycentric weights.

Departures from the paper: u is atan2, which covers the whole head (arccos folds the back onto the front); the source is
sampled at the target's vertices, whose order and faces are kept, instead of the reverse.  The paper's topology
correction removes unmatched vertices; here they are marked as not `found`, and the transfer continues their
surroundings.  The same holds for small parts such as eyes and teeth.

A cylinder shows the outermost layer only: the insides of mouth, eye sockets and nostrils and the area behind the ears
are hidden.  Target vertices there move with the outer skin around them and take the nearest point of the source that
faces the same way.  These layers are the weakness of the method, as is the crown, where v hardly changes:
`guise.analogy.registration` is slower but several times more accurate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from guise.analogy.correspondence import Correspondence
from guise.analogy.geometry import Surface, doubled_areas_2d, face_normals, vertex_normals
from guise.analogy.mesh import Mesh
from guise.analogy.normals import unit_vectors
from guise.analogy.registration import RegistrationError, align_by_points, check_point_pairs, skin_mask
from guise.common.arrays import F64, Bool, Int
from guise.render.visibility import visible

Interval = tuple[float, float]


@dataclass(frozen=True)
class CylinderSettings:
    """Settings of the cylindrical projection; radii are the cylinder's."""

    pixels_per_root_face: float = 1.6  # width of a mesh image once around, per square root of its face count
    min_width_px: int = 256
    max_width_px: int = 4096
    normal_weight_radii: float = 0.1  # distance that a difference of unit normals of 1 counts as
    min_point_gap_radii: float = 0.02  # in (u, v), below which two feature points are one
    max_outer_depth_radii: float = 0.01  # under the outermost layer, beyond which a vertex is hidden
    max_hidden_distance_radii: float = 0.15  # of a hidden vertex from its counterpart
    max_border_distance_radii: float = 0.03  # the same, where the counterpart lies on a border
    outer_neighbours: int = 8  # outer vertices that a hidden one moves along with
    min_axis_distance_radii: float = 0.3  # of feature points that make the map
    min_normal_cosine: float = 0.5  # between the normals of corresponding points
    max_outside_weight: float = 0.05  # by which barycentric weights may be negative: gaps between pixels


CYLINDER = CylinderSettings()


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A cylinder around a head.

    axes : (3, 3) rows to the person's left, up, forward.   middle : (3,) on its axis.   radius : in mesh units.
    """

    axes: F64
    middle: F64
    radius: float

    @classmethod
    def around(cls, mesh: Mesh, points: F64) -> Cylinder:
        """The cylinder around a head with feature points (k, 3); the mean normal around them gives the front.

        Up is the y axis of the file, or z if the head looks along y.
        """
        centre = points.mean(0)
        reach = np.linalg.norm(points - centre, axis=1).mean()
        near = np.linalg.norm(mesh.vertices - centre, axis=1) < 1.5 * reach
        forward = face_normals(mesh.vertices, mesh.faces[near[mesh.faces[:, 0]]]).sum(0)
        up = np.eye(3)[1 if np.abs(forward).argmax() != 1 else 2]
        level = mesh.vertices[np.abs((mesh.vertices - centre) @ up) < reach]
        if not forward.any() or not len(level):
            raise RegistrationError("the points do not lie on the source: give points on its surface")
        across = unit_vectors(np.cross(up, forward))
        axes = np.stack([across, up, np.cross(across, up)])
        low, high = (level @ axes.T).min(0), (level @ axes.T).max(0)
        radius, middle = float(high[0] - low[0]) / 2, (low + high) / 2
        middle[2] = min(middle[2], high[2] - radius)  # a mask ends before the middle of the head
        return cls(axes, middle @ axes, radius)

    @property
    def length(self) -> float:
        """Circumference."""
        return 2 * np.pi * self.radius

    def project(self, points: F64) -> tuple[F64, F64]:
        """(n, 2) u and v, as lengths on the cylinder, and (n,) distances from its axis, of points (n, 3)."""
        x, y, z = ((points - self.middle) @ self.axes.T).T
        return np.stack([self.radius * np.arctan2(x, z), y], axis=1), np.hypot(x, z)


class TriangleLookup:
    """Looks up the triangle at a position in the (u, v) of a cylinder.

    Parameters
    ----------
    cylinder : gives the width.   places : (p, 2) u, v.   distance : (p,) from the axis; the farthest is visible.
    triangles : (t, 3) ids of places.   low, high : range of v.
    """

    def __init__(
        self, cylinder: Cylinder, places: F64, distance: F64, triangles: Int, low: float, high: float
    ) -> None:
        self.places, self.triangles = places, triangles
        around = int(
            np.clip(
                CYLINDER.pixels_per_root_face * np.sqrt(len(triangles)),
                CYLINDER.min_width_px,
                CYLINDER.max_width_px,
            )
        )
        self._length, self._low, self._scale = cylinder.length, low, around / cylinder.length
        pixels = np.column_stack([self._pixels(places), -distance])
        seen = visible(pixels, triangles, (around, int((high - low) * self._scale) + 2))
        self._triangle = np.pad(seen.triangle, 1, constant_values=-1)

    def find(self, places: F64) -> tuple[Int, F64]:
        """The triangles (n,) visible at positions (n, 2), and weights (n, 3) in them; all -inf where there is none.

        A triangle smaller than a pixel may not be visible in it.  Among the neighbouring pixels, the triangle that
        contains the position is taken, or else the one it lies least outside of; weights are negative there.
        """
        row, column = self._at(places)
        best = np.full(len(places), -np.inf)
        chosen, weights = np.zeros(len(places), np.intp), np.full((len(places), 3), -np.inf)
        for dy, dx in _PIXEL_NEIGHBOURS:
            left = np.flatnonzero(best < 0)
            triangle = self._triangle[row[left] + dy, column[left] + dx]
            left, triangle = left[triangle >= 0], triangle[triangle >= 0]
            inside = _barycentric_2d(places[left], self.places[self.triangles[triangle]])
            least = _row_minima(inside)
            better = least > best[left]
            at = left[better]
            best[at], chosen[at], weights[at] = least[better], triangle[better], inside[better]
        return chosen, weights

    def _pixels(self, places: F64) -> F64:
        return np.asarray((places - (-self._length / 2, self._low)) * self._scale - (0.5, 0))

    def _at(self, places: F64) -> tuple[Int, Int]:
        """Rows and columns in the padded image."""
        high, wide = self._triangle.shape
        column, row = np.rint(self._pixels(places)).T + 1
        return np.clip(row, 1, high - 2).astype(np.intp), np.clip(column, 1, wide - 2).astype(np.intp)


_PIXEL_NEIGHBOURS = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))


class MeshImage:
    """A mesh unrolled from a cylinder, of which the outermost faces are visible.

    Parameters
    ----------
    cylinder : around it.   vertices : (N, 3).   faces : (m, 3).

    Faces across the seam at the back are drawn at both edges; faces around the axis, at the crown, are left out.
    """

    def __init__(self, cylinder: Cylinder, vertices: F64, faces: Int) -> None:
        self._length = cylinder.length
        self.places, self._distance = cylinder.project(vertices)
        self.low, self.high = float(self.places[:, 1].min()), float(self.places[:, 1].max())
        self._owners, triangles, origins, places = unroll_faces(self.places, faces, cylinder.length)
        self._plane = TriangleLookup(
            cylinder, places, self._distance[origins], triangles, self.low, self.high
        )
        self._faces = faces

    def depth(self) -> F64:
        """(N,) depth of the vertices under the visible face at their position; infinite where there is none."""
        faces, weights, found = self.find(self.places)
        seen = np.einsum("nk,nk->n", weights, self._distance[self._faces[faces]])
        return np.where(found, seen - self._distance, np.inf)

    def find(self, places: F64) -> tuple[Int, F64, Bool]:
        """The faces (n,) visible at positions (n, 2), weights (n, 3) in them, and where there is one.

        u may be whole turns off.
        """
        within = np.column_stack([_nearest_turn(places[:, 0], 0.0, self._length), places[:, 1]])
        triangles, weights = self._plane.find(within)
        found = _row_minima(weights) >= -CYLINDER.max_outside_weight
        weights = np.maximum(weights, 0)
        weights[found] /= weights[found].sum(1, keepdims=True)
        return self._owners[triangles], weights, found


def unroll_faces(places: F64, faces: Int, length: float) -> tuple[Int, Int, Int, F64]:
    """The faces of a mesh in the plane; those across the seam occur at both edges, those around the axis are left out.

    Parameters
    ----------
    places : (N, 2) u, v.   faces : (m, 3).   length : of u, once around.

    Returns
    -------
    owners (k,) original faces, corners (k, 3) ids of places, origins (p,) vertices of the places, places (p, 2).
    """
    u = places[faces, 0]
    across = _row_extents(u) > length / 2
    right = u[across] + length * (u[across] < 0)
    around = _row_extents(right) > length / 2
    seam, right = np.flatnonzero(across)[~around], right[~around]
    plain = np.flatnonzero(~across)
    moved = np.stack([right.ravel(), places[faces[seam].ravel(), 1]], axis=1)
    fresh = len(places) + np.arange(2 * len(moved)).reshape(-1, 3)
    return (
        np.concatenate([plain, seam, seam]),
        np.concatenate([faces[plain], fresh]),
        np.concatenate([np.arange(len(places)), faces[seam].ravel(), faces[seam].ravel()]),
        np.concatenate([places, moved, moved - (length, 0)]),
    )


def _row_extents(u: F64) -> F64:
    """(m,) extents of rows (m, 3) (NumPy reductions are slow along short rows)."""
    a, b, c = u.T
    return np.asarray(np.maximum(np.maximum(a, b), c) - _row_minima(u))


def _row_minima(rows: F64) -> F64:
    """(n,) minima of rows (n, 3)."""
    a, b, c = rows.T
    return np.asarray(np.minimum(np.minimum(a, b), c))


class PiecewiseAffineMap:
    """The piecewise affine map from the target's (u, v) to the source's, by triangulated feature points (eq. 8).

    Parameters
    ----------
    cylinder : of the projection.   source, target : (k, 2) u, v of the points.
    source_ends, target_ends : (low, high) of the bounding boxes.

    The points half-way between both are triangulated, as a triangle that is thin in one may be flipped in the other.
    Where that still happens, points are left out one by one.  Points and corners are repeated five times, one turn
    apart, so that there is no seam.
    """

    def __init__(
        self, cylinder: Cylinder, source: F64, target: F64, source_ends: Interval, target_ends: Interval
    ) -> None:
        edge = -cylinder.length / 2
        source = np.column_stack([_nearest_turn(source[:, 0], target[:, 0], cylinder.length), source[:, 1]])
        kept = _well_separated(source, target, CYLINDER.min_point_gap_radii * cylinder.radius)
        while True:
            to, own = (
                _repeat_turns(np.concatenate([points[kept], [[edge, low], [edge, high]]]), cylinder.length)
                for points, (low, high) in ((source, source_ends), (target, target_ends))
            )
            triangles = Delaunay((to + own) / 2).simplices
            triangles = triangles[(triangles < len(kept) + 2).any(1)]  # of the middle turn
            areas = np.minimum(doubled_areas_2d(to, triangles), doubled_areas_2d(own, triangles))
            turned = triangles[areas <= 0]
            worst = np.bincount(turned.ravel() % (len(kept) + 2), minlength=len(kept))[: len(kept)]
            if not worst.any():
                break
            kept = np.delete(kept, worst.argmax())
        self._to = to
        self._plane = TriangleLookup(cylinder, own, np.zeros(len(own)), triangles, *target_ends)

    def __call__(self, places: F64) -> F64:
        """(n, 2) positions on the source for positions (n, 2) on the target."""
        triangles, weights = self._plane.find(places)
        inside = np.isfinite(weights[:, 0])
        out = places.copy()
        corners = self._plane.triangles[triangles[inside]]
        out[inside] = np.einsum("nk,nkd->nd", weights[inside], self._to[corners])
        return out


def _nearest_turn(u: F64, to: F64 | float, length: float) -> F64:
    """u shifted by whole turns so that it is nearest to another u."""
    return np.asarray(u - np.rint((u - to) / length) * length)


def _repeat_turns(places: F64, length: float) -> F64:
    """Positions (n, 2), and copies one and two turns to either side: (5 n, 2)."""
    return np.concatenate([places + np.array([k * length, 0]) for k in (0, -1, 1, -2, 2)])


def cylindrical_correspondence(
    source: Mesh, target: Mesh, source_points: F64, target_points: F64
) -> Correspondence:
    """For each vertex of the target a point on the source, by cylindrical projection.

    Parameters
    ----------
    source_points, target_points : (k, 3) corresponding feature points on or near the meshes, k >= 3; the meshes may
        differ by any similarity.

    Raises
    ------
    RegistrationError
        When the points do not correspond.
    """
    points = check_point_pairs((source_points, target_points))
    pose = align_by_points(*points).inverse()
    moved = target.with_vertices(pose.apply(target.vertices))
    cylinder = Cylinder.around(source, points[0])
    faces, skin = source.faces[skin_mask(source)[source.faces].all(1)], skin_mask(target)
    image = MeshImage(cylinder, source.vertices, faces)
    own = MeshImage(cylinder, moved.vertices, moved.faces[skin[moved.faces].all(1)])
    low = min(image.low, own.low)  # a head ends at its crown, its neck anywhere
    places = _off_axis_points(cylinder, points[0], pose.apply(points[1]))
    warp = PiecewiseAffineMap(cylinder, *places, (low, image.high), (low, own.high))
    chosen, weights, found = image.find(warp(own.places))
    found &= skin & (own.depth() <= CYLINDER.max_outer_depth_radii * cylinder.radius)
    surface = Surface(source.vertices, faces, CYLINDER.normal_weight_radii * cylinder.radius)
    normals = vertex_normals(moved.vertices, moved.faces)
    there = np.einsum("nk,nkd->nd", weights, surface.vertex_normals[faces[chosen]])
    found &= (unit_vectors(there) * normals).sum(
        1
    ) > CYLINDER.min_normal_cosine  # upper lips are not matched with lower ones
    done = _match_hidden(surface, moved.vertices, normals, faces[chosen], weights, found, cylinder.radius)
    return Correspondence(done.corners, done.weights, done.found & skin)


def _off_axis_points(cylinder: Cylinder, source: F64, target: F64) -> tuple[F64, F64]:
    """(j, 2) u, v of feature points (k, 3), without those near the axis, where u is meaningless."""
    (one, near), (other, near_too) = cylinder.project(source), cylinder.project(target)
    far = np.minimum(near, near_too) > CYLINDER.min_axis_distance_radii * cylinder.radius
    return one[far], other[far]


def _match_hidden(
    surface: Surface, vertices: F64, normals: F64, corners: Int, weights: F64, outer: Bool, radius: float
) -> Correspondence:
    """Hidden vertices, moved with the outer ones around them, take the nearest point that faces the same way."""
    at = np.flatnonzero(~outer)
    if not len(at):
        return Correspondence(corners, weights, outer)
    points = vertices[at]
    if outer.any():
        moves = np.einsum("nk,nkd->nd", weights[outer], surface.vertices[corners[outer]]) - vertices[outer]
        facing = np.concatenate([vertices, surface.normal_weight * normals], axis=1)
        near = cKDTree(facing[outer]).query(facing[at], k=min(CYLINDER.outer_neighbours, len(moves)))[1]
        points = points + moves[near.reshape(len(at), -1)].mean(1)
    places = surface.closest_points(points, normals[at])
    corners[at], weights[at] = surface.faces[places.faces], places.weights
    on_border = (surface.border[corners[at]] | (places.weights < 1e-9)).all(1)
    limit = radius * np.where(
        on_border, CYLINDER.max_border_distance_radii, CYLINDER.max_hidden_distance_radii
    )
    found = outer.copy()
    found[at] = np.linalg.norm(places.positions - points, axis=1) < limit
    return Correspondence(corners, weights, found)


def _well_separated(source: F64, target: F64, near: float) -> Int:
    """The points (k,) that are at least `near` from every earlier one in both planes (n, 2)."""
    kept: list[int] = []
    for k in range(len(source)):
        gaps = [np.linalg.norm(p[kept] - p[k], axis=1).min(initial=np.inf) for p in (source, target)]
        if min(gaps) >= near:
            kept.append(k)
    return np.array(kept, np.intp)


def _barycentric_2d(points: F64, triangles: F64) -> F64:
    """Barycentric weights (n, 3) of points (n, 2) in triangles (n, 3, 2); -1 where a triangle has no area."""
    a = triangles[:, 0]
    (ux, uy), (vx, vy), (x, y) = (triangles[:, 1] - a).T, (triangles[:, 2] - a).T, (points - a).T
    area = ux * vy - uy * vx
    inverse = np.divide(1.0, area, out=np.full_like(area, np.nan), where=area != 0)
    second, third = (x * vy - y * vx) * inverse, (ux * y - uy * x) * inverse
    return np.asarray(np.nan_to_num(np.stack([1 - second - third, second, third], axis=1), nan=-1.0))
