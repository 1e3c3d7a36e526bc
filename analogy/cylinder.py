"""Dense correspondence by cylindrical projection (Song et al. 2007, section III-A).

The target is aligned to the source by feature points (SVD), both are projected onto a cylinder around the source's
head, u around it and v along it, and the source is drawn there as a mesh image: which triangle each pixel shows
(`guise.render.visibility`).  The triangulated feature points and the corners of the bounding box (A, B, C, D
of the paper)
make a piecewise affine map from the target's (u, v) to the source's (eq. 8); each target vertex takes the triangle that
the image has at its place, and its barycentric weights in it, computed exactly.

Departures from the paper: u is atan2, whose range is the whole head (arccos folds its back onto its front); the source
is sampled at the target's vertices, whose order and faces are kept, instead of the reverse.  The paper's topology
correction removes unmatched vertices: here they are not `found`, and whoever carries expressions leaves them out, as
are small parts such as eyes and teeth.

A cylinder shows the outermost layer alone: the insides of mouth, eye sockets and nostrils, and what lies behind the
ears, lie under it.  Target vertices there move along with the outer skin around them, and take the nearest place of
the source that faces their way.  These layers are the method's weakness, as is the crown, where v hardly changes:
`guise.analogy.register` is slower and several times more exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from guise.analogy.correspondence import Correspondence
from guise.analogy.geometry import Surface, face_normals, vertex_normals
from guise.analogy.mesh import Mesh
from guise.analogy.normals import unit
from guise.analogy.register import RegistrationError, aligned_by_points, checked, skin_of
from guise.common.arrays import F64, Bool, Int
from guise.render.visibility import visible

Ends = tuple[float, float]

FINE = 1.6  # pixels of a mesh image around the whole cylinder, of the root of the number of its faces
FEWEST, MOST = 256, 4096  # the same: at least, at most
TURN = 0.1  # of the cylinder's radius: what a difference of normals counts as distance
NEAR = 0.02  # the same: what lies closer in (u, v) than that is one point of the map
DEEP = 0.01  # the same: what lies deeper under the outermost layer is hidden
FAR, BORDER_FAR = 0.15, 0.03  # the same: from which a hidden vertex has no counterpart, and none on a border
MOVED_ALONG = 8  # outer vertices that a hidden one moves along with
AXIS = 0.3  # the same: points of the map are so far from the axis
ALIKE = 0.5  # cosine of the angle between the normals of places that correspond, at least
OUTSIDE = 0.05  # barycentric weights may be so negative, which a gap between pixels explains


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
        """Of a head with feature points (k, 3): it looks as the surface around them does on the whole.

        Up is the file's y, or its z where the head looks along y.
        """
        centre = points.mean(0)
        reach = np.linalg.norm(points - centre, axis=1).mean()
        near = np.linalg.norm(mesh.vertices - centre, axis=1) < 1.5 * reach
        forward = face_normals(mesh.vertices, mesh.faces[near[mesh.faces[:, 0]]]).sum(0)
        up = np.eye(3)[1 if np.abs(forward).argmax() != 1 else 2]
        level = mesh.vertices[np.abs((mesh.vertices - centre) @ up) < reach]
        if not forward.any() or not len(level):
            raise RegistrationError("the points do not lie on the source: give points on it")
        across = unit(np.cross(up, forward))
        axes = np.stack([across, up, np.cross(across, up)])
        low, high = (level @ axes.T).min(0), (level @ axes.T).max(0)
        radius, middle = float(high[0] - low[0]) / 2, (low + high) / 2
        middle[2] = min(middle[2], high[2] - radius)  # a mask ends before the middle of the head
        return cls(axes, middle @ axes, radius)

    @property
    def length(self) -> float:
        """Once around."""
        return 2 * np.pi * self.radius

    def project(self, points: F64) -> tuple[F64, F64]:
        """(n, 2) u and v, as lengths on the cylinder, and (n,) distances from its axis, of points (n, 3)."""
        x, y, z = ((points - self.middle) @ self.axes.T).T
        return np.stack([self.radius * np.arctan2(x, z), y], axis=1), np.hypot(x, z)


class Plane:
    """Triangles in the (u, v) of a cylinder, drawn so that the one that a place lies in is looked up.

    Parameters
    ----------
    cylinder : which is once around wide.   places : (p, 2).   distance : (p,) from the axis; the farthest is seen.
    triangles : (t, 3) places.   low, high : v of the image's edges.
    """

    def __init__(
        self, cylinder: Cylinder, places: F64, distance: F64, triangles: Int, low: float, high: float
    ) -> None:
        self.places, self.triangles = places, triangles
        around = int(np.clip(FINE * np.sqrt(len(triangles)), FEWEST, MOST))
        self._length, self._low, self._scale = cylinder.length, low, around / cylinder.length
        pixels = np.column_stack([self._pixels(places), -distance])
        seen = visible(pixels, triangles, (around, int((high - low) * self._scale) + 2))
        self._triangle = np.pad(seen.triangle, 1, constant_values=-1)

    def find(self, places: F64) -> tuple[Int, F64]:
        """The triangles (n,) seen at places (n, 2), and weights (n, 3) in them; all -inf where there is none.

        A triangle smaller than a pixel may not be seen in it: of those around, the one that the place lies in, or
        else that it lies least outside of, is taken; weights are negative there.
        """
        row, column = self._at(places)
        best = np.full(len(places), -np.inf)
        chosen, weights = np.zeros(len(places), np.intp), np.full((len(places), 3), -np.inf)
        for dy, dx in _AROUND:
            left = np.flatnonzero(best < 0)
            triangle = self._triangle[row[left] + dy, column[left] + dx]
            left, triangle = left[triangle >= 0], triangle[triangle >= 0]
            inside = _weights(places[left], self.places[self.triangles[triangle]])
            least = _least(inside)
            better = least > best[left]
            at = left[better]
            best[at], chosen[at], weights[at] = least[better], triangle[better], inside[better]
        return chosen, weights

    def _pixels(self, places: F64) -> F64:
        return np.asarray((places - (-self._length / 2, self._low)) * self._scale - (0.5, 0))

    def _at(self, places: F64) -> tuple[Int, Int]:
        """Rows and columns of the padded image."""
        high, wide = self._triangle.shape
        column, row = np.rint(self._pixels(places)).T + 1
        return np.clip(row, 1, high - 2).astype(np.intp), np.clip(column, 1, wide - 2).astype(np.intp)


_AROUND = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))


class MeshImage:
    """A mesh unrolled from a cylinder, of which the outermost faces are seen.

    Parameters
    ----------
    cylinder : around it.   vertices : (N, 3).   faces : (m, 3).

    Faces across the seam at the back are drawn at both edges; faces around the axis, at the crown, are not drawn.
    """

    def __init__(self, cylinder: Cylinder, vertices: F64, faces: Int) -> None:
        self._length = cylinder.length
        self.places, self._distance = cylinder.project(vertices)
        self.low, self.high = float(self.places[:, 1].min()), float(self.places[:, 1].max())
        self._owners, triangles, origins, places = unrolled(self.places, faces, cylinder.length)
        self._plane = Plane(cylinder, places, self._distance[origins], triangles, self.low, self.high)
        self._faces = faces

    def depth(self) -> F64:
        """(N,) how deep the vertices lie under the face that is seen at their place; infinite where none is."""
        faces, weights, found = self.find(self.places)
        seen = np.einsum("nk,nk->n", weights, self._distance[self._faces[faces]])
        return np.where(found, seen - self._distance, np.inf)

    def find(self, places: F64) -> tuple[Int, F64, Bool]:
        """The faces (n,) seen at places (n, 2), weights (n, 3) in them, and where there is one.

        u may be some turns further.
        """
        within = np.column_stack([_nearest_turn(places[:, 0], 0.0, self._length), places[:, 1]])
        triangles, weights = self._plane.find(within)
        found = _least(weights) >= -OUTSIDE
        weights = np.maximum(weights, 0)
        weights[found] /= weights[found].sum(1, keepdims=True)
        return self._owners[triangles], weights, found


def unrolled(places: F64, faces: Int, length: float) -> tuple[Int, Int, Int, F64]:
    """The faces of a mesh in the plane, those across the seam once at each edge, those around the axis left out.

    Parameters
    ----------
    places : (N, 2) u, v.   faces : (m, 3).   length : of u, once around.

    Returns
    -------
    owners (k,) faces, corners (k, 3) places, of each of which origins (p,) is the vertex and places (p, 2).
    """
    u = places[faces, 0]
    across = _wide(u) > length / 2
    right = u[across] + length * (u[across] < 0)
    around = _wide(right) > length / 2
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


def _wide(u: F64) -> F64:
    """(m,) the width of three columns (m, 3) (NumPy's reductions are slow along short rows)."""
    a, b, c = u.T
    return np.asarray(np.maximum(np.maximum(a, b), c) - _least(u))


def _least(rows: F64) -> F64:
    """(n,) the least of three columns (n, 3)."""
    a, b, c = rows.T
    return np.asarray(np.minimum(np.minimum(a, b), c))


class FeatureMap:
    """The piecewise affine map from the target's (u, v) to the source's, by triangulated feature points (eq. 8).

    Parameters
    ----------
    cylinder : both are projected on.   source, target : (k, 2) places of the points.
    source_ends, target_ends : (low, high) of the bounding boxes.

    The triangulation is that of the points half-way between both, as a triangle that is thin in one may be turned over
    in the other.  Where that happens still, points are left out, one by one.  Points and corners are there five times,
    one turn apart, so that the seam is none.
    """

    def __init__(
        self, cylinder: Cylinder, source: F64, target: F64, source_ends: Ends, target_ends: Ends
    ) -> None:
        edge = -cylinder.length / 2
        source = np.column_stack([_nearest_turn(source[:, 0], target[:, 0], cylinder.length), source[:, 1]])
        kept = _apart(source, target, NEAR * cylinder.radius)
        while True:
            to, own = (
                _repeated(np.concatenate([points[kept], [[edge, low], [edge, high]]]), cylinder.length)
                for points, (low, high) in ((source, source_ends), (target, target_ends))
            )
            triangles = Delaunay((to + own) / 2).simplices
            triangles = triangles[(triangles < len(kept) + 2).any(1)]  # of the middle turn
            turned = triangles[np.minimum(_areas(to, triangles), _areas(own, triangles)) <= 0]
            worst = np.bincount(turned.ravel() % (len(kept) + 2), minlength=len(kept))[: len(kept)]
            if not worst.any():
                break
            kept = np.delete(kept, worst.argmax())
        self._to = to
        self._plane = Plane(cylinder, own, np.zeros(len(own)), triangles, *target_ends)

    def __call__(self, places: F64) -> F64:
        """(n, 2) places on the source of places (n, 2) on the target."""
        triangles, weights = self._plane.find(places)
        inside = np.isfinite(weights[:, 0])
        out = places.copy()
        corners = self._plane.triangles[triangles[inside]]
        out[inside] = np.einsum("nk,nkd->nd", weights[inside], self._to[corners])
        return out


def _nearest_turn(u: F64, to: F64 | float, length: float) -> F64:
    """u, some whole turns further, so that it lies nearest to another u."""
    return np.asarray(u - np.rint((u - to) / length) * length)


def _repeated(places: F64, length: float) -> F64:
    """Places (n, 2) as they are, and one and two turns to either side, (5 n, 2)."""
    return np.concatenate([places + np.array([k * length, 0]) for k in (0, -1, 1, -2, 2)])


def cylindrical(source: Mesh, target: Mesh, source_points: F64, target_points: F64) -> Correspondence:
    """For each vertex of the target a place on the source, by cylindrical projection.

    Parameters
    ----------
    source_points, target_points : (k, 3) feature points on or near the meshes, that belong together, k >= 3; the
        meshes may differ in place, turn and scale by anything.

    Raises
    ------
    RegistrationError
        When the points do not belong together.
    """
    points = checked((source_points, target_points))
    pose = aligned_by_points(*points).inverse()
    moved = target.moved(pose.apply(target.vertices))
    cylinder = Cylinder.around(source, points[0])
    faces, skin = source.faces[skin_of(source)[source.faces[:, 0]]], skin_of(target)
    image = MeshImage(cylinder, source.vertices, faces)
    own = MeshImage(cylinder, moved.vertices, moved.faces[skin[moved.faces[:, 0]]])
    low = min(image.low, own.low)  # a head ends at its crown, its neck anywhere
    places = _usable(cylinder, points[0], pose.apply(points[1]))
    warp = FeatureMap(cylinder, *places, (low, image.high), (low, own.high))
    chosen, weights, found = image.find(warp(own.places))
    found &= skin & (own.depth() <= DEEP * cylinder.radius)
    surface = Surface(source.vertices, faces, TURN * cylinder.radius)
    normals = vertex_normals(moved.vertices, moved.faces)
    there = np.einsum("nk,nkd->nd", weights, surface.vertex_normals[faces[chosen]])
    found &= (unit(there) * normals).sum(1) > ALIKE  # upper lips are not matched with lower ones
    done = _with_hidden(surface, moved.vertices, normals, faces[chosen], weights, found, cylinder.radius)
    return Correspondence(done.corners, done.weights, done.found & skin)


def _usable(cylinder: Cylinder, source: F64, target: F64) -> tuple[F64, F64]:
    """(j, 2) places of feature points (k, 3), those left out that lie near the axis, where u tells nothing."""
    (one, near), (other, near_too) = cylinder.project(source), cylinder.project(target)
    far = np.minimum(near, near_too) > AXIS * cylinder.radius
    return one[far], other[far]


def _with_hidden(
    surface: Surface, vertices: F64, normals: F64, corners: Int, weights: F64, outer: Bool, radius: float
) -> Correspondence:
    """What was not seen on the cylinder, moved along with what was, takes the nearest place that faces its way."""
    at = np.flatnonzero(~outer)
    if not len(at):
        return Correspondence(corners, weights, outer)
    points = vertices[at]
    if outer.any():
        moves = np.einsum("nk,nkd->nd", weights[outer], surface.vertices[corners[outer]]) - vertices[outer]
        facing = np.concatenate([vertices, surface.turn * normals], axis=1)
        near = cKDTree(facing[outer]).query(facing[at], k=min(MOVED_ALONG, len(moves)))[1]
        points = points + moves[near.reshape(len(at), -1)].mean(1)
    places = surface.closest(points, normals[at])
    corners[at], weights[at] = surface.faces[places.faces], places.weights
    on_border = (surface.border[corners[at]] | (places.weights < 1e-9)).all(1)
    limit = radius * np.where(on_border, BORDER_FAR, FAR)
    found = outer.copy()
    found[at] = np.linalg.norm(places.positions - points, axis=1) < limit
    return Correspondence(corners, weights, found)


def _apart(source: F64, target: F64, near: float) -> Int:
    """The points (k,) that are no closer than `near` to an earlier one in either plane (n, 2)."""
    kept: list[int] = []
    for k in range(len(source)):
        gaps = [np.linalg.norm(p[kept] - p[k], axis=1).min(initial=np.inf) for p in (source, target)]
        if min(gaps) >= near:
            kept.append(k)
    return np.array(kept, np.intp)


def _areas(points: F64, triangles: Int) -> F64:
    """Twice the areas (t,) of triangles of points (n, 2); counter-clockwise is positive."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    return np.asarray(ux * vy - uy * vx)


def _weights(points: F64, triangles: F64) -> F64:
    """Barycentric weights (n, 3) of points (n, 2) in triangles (n, 3, 2); -1 where a triangle has no area."""
    a = triangles[:, 0]
    (ux, uy), (vx, vy), (x, y) = (triangles[:, 1] - a).T, (triangles[:, 2] - a).T, (points - a).T
    area = ux * vy - uy * vx
    inverse = np.divide(1.0, area, out=np.full_like(area, np.nan), where=area != 0)
    second, third = (x * vy - y * vx) * inverse, (ux * y - uy * x) * inverse
    return np.asarray(np.nan_to_num(np.stack([1 - second - third, second, third], axis=1), nan=-1.0))
