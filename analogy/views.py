"""Shaded grey pictures of a mesh from any side, and the way back from a pixel to the mesh.

Any unit of length; pixels, x right, y down, pixel centres at integers.  Seen from far away: sight lines are parallel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from guise.analogy.geometry import barycentric, vertex_normals
from guise.analogy.mesh import Mesh
from guise.analogy.normals import unit
from guise.common.arrays import F32, F64, U8, Bool, Int
from guise.render.visibility import Visibility, visible

LIGHT = np.array([0.3, 0.5, 1.0]) / np.sqrt(1.34)  # from the viewer's upper right, in the axes of a view
AMBIENT, BRIGHT, INSIDE, BEHIND = 50, 150, 25, 128  # grey values: of skin, of an inside, of nothing
SMOOTH = 2.0  # pixels, by which depths are smoothed before they are shaded


@dataclass(frozen=True, eq=False)
class View:
    """A square window onto a mesh, seen from far away.

    Parameters
    ----------
    axes : (3, 3) orthonormal rows: to the right, up and towards the viewer, in the mesh's coordinates.
    centre : (3,) seen in the middle.   half : half the window's side, in the mesh's unit.   pixels : its side.
    """

    axes: F64
    centre: F64
    half: float
    pixels: int

    def project(self, places: F64) -> F64:
        """Pixels x, y and depth (n, 3), smaller is nearer, of places (n, 3)."""
        across = (places - self.centre) @ self.axes.T * (self.pixels / (2 * self.half))
        return np.asarray(across * (1, -1, -1) + ((self.pixels - 1) / 2, (self.pixels - 1) / 2, 0))

    def unproject(self, points: NDArray[np.floating]) -> F64:
        """Where the lines of sight of pixels (n, 2) pass, along the first two axes from the mesh's origin."""
        across = (np.asarray(points, np.float64) - (self.pixels - 1) / 2) * (2 * self.half / self.pixels)
        return np.asarray(across * (1, -1) + self.axes[:2] @ self.centre)

    def turned(self, yaw: float, pitch: float) -> View:
        """The same from `yaw` degrees further to the left and `pitch` degrees further up."""
        y, p = np.radians([yaw, pitch])
        around = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        over = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
        return replace(self, axes=over @ around @ self.axes)


@dataclass(frozen=True, eq=False)
class Solid:
    """Vertices (N, 3) and triangles (m, 3), of which pictures are made.

    normals : (N, 3), unit; None when they are not to be trusted: pictures are then shaded by their depths.
    """

    vertices: F64
    faces: Int
    normals: F64 | None

    @classmethod
    def of(cls, mesh: Mesh) -> Solid:
        """Of a mesh."""
        return cls(mesh.vertices, mesh.faces, vertex_normals(mesh.vertices, mesh.faces))

    def plain(self) -> Solid:
        """The same without normals."""
        return Solid(self.vertices, self.faces, None)

    def near(self, centre: F64, reach: float) -> Solid:
        """The triangles with a corner within `reach` of a place."""
        away = np.linalg.norm(self.vertices - centre, axis=1)
        return self.part((away < reach)[self.faces].any(1))

    def times(self, matrix: F64) -> Solid:
        """The same with its vertices multiplied by a matrix (3, 3)."""
        return Solid(self.vertices @ matrix, self.faces, self.normals)

    def part(self, kept: Bool) -> Solid:
        """The triangles of a mask (m,), and their vertices."""
        used, faces = np.unique(self.faces[kept], return_inverse=True)
        normals = None if self.normals is None else self.normals[used]
        return Solid(self.vertices[used], faces.reshape(-1, 3).astype(np.intp), normals)

    def nearest(self, places: F64) -> F64:
        """The points (n, 3) of the surface that are nearest to places (n, 3)."""
        corners = self.vertices[self.faces]
        middle = corners.mean(1)
        radius = np.linalg.norm(corners - middle[:, None], axis=2).max(1)
        return np.array([_nearest(place, corners, middle, radius) for place in places])

    def picture(self, view: View) -> tuple[U8, Visibility]:
        """The solid in a studio's light, RGB uint8 (pixels, pixels, 3), its inside black; and what is seen where."""
        places = view.project(self.vertices)
        seen = visible(places, self.faces, (view.pixels, view.pixels))
        if self.normals is None:
            return _coloured(_relief(_depths(places, self.faces, seen))), seen
        normal = unit(np.asarray(seen.interpolated(self.normals, self.faces), np.float64)) @ view.axes.T
        grey = _lit(normal)
        grey[normal[:, 2] < 0] = INSIDE
        picture = np.full(seen.triangle.shape, BEHIND, np.uint8)
        picture[seen.covered] = grey
        return _coloured(picture), seen

    def whole(self, axes: F64, pixels: int) -> View:
        """The view along `axes` that holds all."""
        across = self.vertices @ axes.T
        low, high = across.min(0), across.max(0)
        half = 0.56 * float((high - low)[:2].max())
        return View(axes, (low + high) / 2 @ axes, max(half, 1e-300), pixels)


def _coloured(grey: U8) -> U8:
    return np.repeat(grey[:, :, None], 3, axis=2)


def _lit(normal: F64) -> F64:
    """Grey values of normals (..., 3) in the axes of a view."""
    return np.asarray(AMBIENT + BRIGHT * np.clip(normal @ LIGHT, 0, None))


def _depths(places: F64, faces: Int, seen: Visibility) -> F32:
    """(h, w), infinite where nothing is seen."""
    depth = np.full(seen.triangle.shape, np.inf, np.float32)
    depth[seen.covered] = seen.interpolated(places[:, 2:], faces)[:, 0]
    return depth


def _relief(depth: F32) -> U8:
    """Grey values (h, w) of a surface told by depths (h, w), which may be noisy and have small holes."""
    import cv2

    far = np.float32(depth[np.isfinite(depth)].max(initial=0) + 1)
    closed = cv2.medianBlur(np.where(np.isfinite(depth), depth, far), 5)
    down, right = np.gradient(cv2.GaussianBlur(closed, (0, 0), SMOOTH))
    grey = _lit(unit(np.stack([right, -down, np.ones_like(down)], axis=2)))
    return np.where(closed < far, grey, BEHIND).astype(np.uint8)


def _nearest(place: F64, corners: F64, middle: F64, radius: F64) -> F64:
    """The point (3,) of triangles (m, 3, 3), given with middles and radii, that is nearest to a place (3,)."""
    away = np.linalg.norm(middle - place, axis=1)
    close = corners[away - radius <= (away + radius).min()]
    weights = barycentric(np.broadcast_to(place, (len(close), 3)), close)
    points = np.einsum("mk,mki->mi", weights, close)
    return np.asarray(points[np.argmin(np.linalg.norm(points - place, axis=1))])
