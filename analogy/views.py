"""Shaded grey pictures of a mesh from any side, and the way back from a pixel to the mesh.

Any unit of length; pixels, x right, y down, pixel centres at integers.  Orthographic: lines of sight are parallel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from guise.analogy.geometry import barycentric, vertex_normals
from guise.analogy.mesh import Mesh
from guise.analogy.normals import unit_vectors
from guise.common.arrays import F32, F64, U8, Bool, Int
from guise.render.visibility import Visibility, visible

LIGHT_DIRECTION = np.array([0.3, 0.5, 1.0]) / np.sqrt(
    1.34
)  # from the viewer's upper right, in the axes of a view


@dataclass(frozen=True)
class ShadingSettings:
    """Grey values of the pictures."""

    ambient_grey: int = 50
    diffuse_grey: int = 150
    inside_grey: int = 25  # of faces seen from behind
    background_grey: int = 128
    depth_sigma_px: float = 2.0  # by which depths are smoothed before they are shaded


SHADING = ShadingSettings()


@dataclass(frozen=True, eq=False)
class OrthographicView:
    """A square orthographic view.

    Parameters
    ----------
    axes : (3, 3) orthonormal rows: to the right, up and towards the viewer, in the mesh's coordinates.
    centre : (3,) in the middle.   half : half the side, in the unit of the mesh.   pixels : the side.
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
        """Coordinates (n, 2) of the lines of sight of pixels (n, 2) along the first two axes of the view."""
        across = (np.asarray(points, np.float64) - (self.pixels - 1) / 2) * (2 * self.half / self.pixels)
        return np.asarray(across * (1, -1) + self.axes[:2] @ self.centre)

    def rotated(self, yaw: float, pitch: float) -> OrthographicView:
        """The view from `yaw` degrees further to the left and `pitch` degrees further up."""
        y, p = np.radians([yaw, pitch])
        around = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        over = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
        return replace(self, axes=over @ around @ self.axes)


@dataclass(frozen=True, eq=False)
class ViewedMesh:
    """Vertices (N, 3) and triangles (m, 3) to be rendered.

    normals : (N, 3), unit; None when they are unreliable: pictures are then shaded by depth.
    """

    vertices: F64
    faces: Int
    normals: F64 | None

    @classmethod
    def of(cls, mesh: Mesh) -> ViewedMesh:
        """From a mesh."""
        return cls(mesh.vertices, mesh.faces, vertex_normals(mesh.vertices, mesh.faces))

    def without_normals(self) -> ViewedMesh:
        """The mesh without normals."""
        return ViewedMesh(self.vertices, self.faces, None)

    def crop(self, centre: F64, reach: float) -> ViewedMesh:
        """The triangles with a corner within `reach` of a point."""
        away = np.linalg.norm(self.vertices - centre, axis=1)
        return self.submesh((away < reach)[self.faces].any(1))

    def transformed(self, matrix: F64) -> ViewedMesh:
        """The mesh with its vertices multiplied by a matrix (3, 3)."""
        return ViewedMesh(self.vertices @ matrix, self.faces, self.normals)

    def submesh(self, kept: Bool) -> ViewedMesh:
        """The triangles of a mask (m,), and their vertices."""
        used, faces = np.unique(self.faces[kept], return_inverse=True)
        normals = None if self.normals is None else self.normals[used]
        return ViewedMesh(self.vertices[used], faces.reshape(-1, 3).astype(np.intp), normals)

    def closest_points(self, places: F64) -> F64:
        """The points (n, 3) of the surface nearest to points (n, 3)."""
        corners = self.vertices[self.faces]
        middle = corners.mean(1)
        radius = np.linalg.norm(corners - middle[:, None], axis=2).max(1)
        return np.array([_closest_point(place, corners, middle, radius) for place in places])

    def render(self, view: OrthographicView) -> tuple[U8, Visibility]:
        """The shaded mesh, RGB uint8 (pixels, pixels, 3), its inside dark; and which triangle is visible where."""
        places = view.project(self.vertices)
        seen = visible(places, self.faces, (view.pixels, view.pixels))
        if self.normals is None:
            return _grey_to_rgb(_shade_depths(_depths(places, self.faces, seen))), seen
        normal = (
            unit_vectors(np.asarray(seen.interpolated(self.normals, self.faces), np.float64)) @ view.axes.T
        )
        grey = _shade(normal)
        grey[normal[:, 2] < 0] = SHADING.inside_grey
        picture = np.full(seen.triangle.shape, SHADING.background_grey, np.uint8)
        picture[seen.covered] = grey
        return _grey_to_rgb(picture), seen

    def whole_view(self, axes: F64, pixels: int) -> OrthographicView:
        """The view along `axes` that contains the whole mesh."""
        across = self.vertices @ axes.T
        low, high = across.min(0), across.max(0)
        half = 0.56 * float((high - low)[:2].max())
        return OrthographicView(axes, (low + high) / 2 @ axes, max(half, 1e-300), pixels)


def _grey_to_rgb(grey: U8) -> U8:
    return np.repeat(grey[:, :, None], 3, axis=2)


def _shade(normal: F64) -> F64:
    """Grey values of normals (..., 3) in the axes of a view."""
    return np.asarray(
        SHADING.ambient_grey + SHADING.diffuse_grey * np.clip(normal @ LIGHT_DIRECTION, 0, None)
    )


def _depths(places: F64, faces: Int, seen: Visibility) -> F32:
    """(h, w), infinite where nothing is seen."""
    depth = np.full(seen.triangle.shape, np.inf, np.float32)
    depth[seen.covered] = seen.interpolated(places[:, 2:], faces)[:, 0]
    return depth


def _shade_depths(depth: F32) -> U8:
    """Grey values (h, w) of a surface given by depths (h, w), which may be noisy and have small holes."""
    import cv2

    far = np.float32(depth[np.isfinite(depth)].max(initial=0) + 1)
    closed = cv2.medianBlur(np.where(np.isfinite(depth), depth, far), 5)
    down, right = np.gradient(cv2.GaussianBlur(closed, (0, 0), SHADING.depth_sigma_px))
    grey = _shade(unit_vectors(np.stack([right, -down, np.ones_like(down)], axis=2)))
    return np.where(closed < far, grey, SHADING.background_grey).astype(np.uint8)


def _closest_point(place: F64, corners: F64, middle: F64, radius: F64) -> F64:
    """The point (3,) of triangles (m, 3, 3), given with centres and radii, nearest to a point (3,)."""
    away = np.linalg.norm(middle - place, axis=1)
    close = corners[away - radius <= (away + radius).min()]
    weights = barycentric(np.broadcast_to(place, (len(close), 3)), close)
    points = np.einsum("mk,mki->mi", weights, close)
    return np.asarray(points[np.argmin(np.linalg.norm(points - place, axis=1))])
