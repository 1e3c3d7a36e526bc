"""The grid on which a photograph's face is computed, and where its pixels lie in the other pictures."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import SILHOUETTE
from guise.analogy.photo.pictures import PhotoError
from guise.analogy.photo.template import Template
from guise.common.arrays import F32, F64, Bool, Int
from guise.render.visibility import visible

FINEST = 512  # pixels across the face, above which appearance is computed on a coarser grid
SMALLEST = 32  # pixels across the face
INWARD = 0.04


@dataclass(frozen=True)
class Grid:
    """A rectangle of the target: its origin (x, y) and size (width, height) there, and the grid's own.

    factor : grid pixels for each pixel of the target, at most 1.
    """

    origin: tuple[int, int]
    within: tuple[int, int]
    size: tuple[int, int]
    factor: float

    @classmethod
    def around(cls, points: F64, ring: F64, picture: tuple[int, ...]) -> Grid:
        """What holds the ring (r, 2) around landmarks (81, 2), as far as the picture (h, w, ..) does."""
        width = wide(points)
        if width < SMALLEST:
            raise PhotoError(f"the target's face is {width:.0f} pixels wide, at least {SMALLEST} are needed")
        low = np.maximum(np.floor(ring.min(0)), 0).astype(int)
        high = np.minimum(np.ceil(ring.max(0)) + 1, picture[1::-1]).astype(int)
        if (high - low < 2).any():
            raise PhotoError("the target's landmarks lie outside its picture")
        factor = min(1.0, FINEST / width)
        size = np.maximum(np.rint((high - low) * factor), 2).astype(int)
        x, y = (int(v) for v in high - low)
        return cls((int(low[0]), int(low[1])), (x, y), (int(size[0]), int(size[1])), factor)

    def of(self, picture: NDArray[np.generic]) -> NDArray[np.generic]:
        """The rectangle of a picture (h, w, ..), as a view."""
        (x, y), (width, height) = self.origin, self.within
        return picture[y : y + height, x : x + width]

    def places(self, points: F64) -> F64:
        """Points (n, 2) of the target in pixels of the grid."""
        exact = np.array(self.size) / self.within
        return (points - self.origin + 0.5) * exact - 0.5

    def coarse(self, picture: F32) -> F32:
        """The rectangle's pixels (h, w, ..) on the grid."""
        if self.size == self.within:
            return picture
        return np.asarray(cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA), np.float32)

    def fine(self, field: F32) -> F32:
        """A field (h, w, ..) on the grid for the rectangle's pixels."""
        if self.size == self.within:
            return field
        return np.asarray(cv2.resize(field, self.within, interpolation=cv2.INTER_LINEAR), np.float32)


@dataclass(frozen=True, eq=False)
class Seen:
    """What the mesh shows at each pixel of a grid.

    covered : (h, w) bool.   face : (h, w) bool, within its contour, which is pulled inward.
    part : (h, w) of the template that is seen, 0 where there is none.
    values : (h, w, d) float32 of the vertices; zero beyond them.
    """

    covered: Bool
    face: Bool
    part: Int
    values: F32

    @property
    def between(self) -> Bool:
        """(h, w), between the lips."""
        return np.asarray(self.part == 1)

    def eyes(self, shares: F64) -> F32:
        """(h, w) the shares (2,) of the right and the left eye where they are."""
        return np.asarray(np.array([0, 0, *shares])[self.part], np.float32)


def drawn(mesh: Template, vertices: F64, values: F64, size: tuple[int, int], within: Bool) -> Seen:
    """Values (V, d) over a grid of a size (width, height), the mesh lying at vertices (V, 2), the face within."""
    flat = np.column_stack([vertices, np.zeros(len(vertices))])
    seen = visible(flat, mesh.triangles, size)
    out = np.zeros((*seen.triangle.shape, values.shape[1]), np.float32)
    out[seen.covered] = seen.interpolated(values.astype(np.float32), mesh.triangles)
    part = mesh.parts[seen.triangle] * seen.covered
    return Seen(seen.covered, within & seen.covered, part, out)


def wide(points: F64) -> float:
    """Pixels across the face of landmarks (81, 2)."""
    return float(np.ptp(points[SILHOUETTE, 0]))


def own(size: tuple[int, int]) -> F32:
    """(h, w, 2) the places of a grid's own pixels."""
    x, y = np.meshgrid(np.arange(size[0], dtype=np.float32), np.arange(size[1], dtype=np.float32))
    return np.stack([x, y], axis=2)


def face(points: F64, size: tuple[int, int]) -> Bool:
    """(h, w), where the face of landmarks (81, 2) is, its contour pulled inward."""
    outline = points[SILHOUETTE]
    pulled = outline + INWARD * (outline.mean(0) - outline)
    mask = np.zeros(size[::-1], np.uint8)
    cv2.fillPoly(mask, [np.rint(pulled * 16).astype(np.int32)], (1,), cv2.LINE_8, 4)
    return np.asarray(mask > 0)
