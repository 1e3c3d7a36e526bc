"""The grid on which the face of a photo is computed, and the positions of its pixels in the other pictures."""

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

Box = tuple[slice, slice]  # rows and columns

MAX_FACE_PX = 512  # across the face, above which appearance is computed on a coarser grid
ANIMATED_FACE_PX = 128  # the same for the frames of a clip
MIN_FACE_PX = 32  # across the face
CONTOUR_INSET = 0.04  # of the way to the face's middle, by which its contour is pulled inwards


@dataclass(frozen=True)
class Grid:
    """A grid over a crop of the target: origin (x, y) and crop size (width, height) in the target, and the grid's size.

    factor : grid pixels per pixel of the target, at most 1.
    """

    origin: tuple[int, int]
    crop_size: tuple[int, int]
    size: tuple[int, int]
    factor: float

    @classmethod
    def around(cls, points: F64, ring: F64, picture: tuple[int, ...], max_face_px: int) -> Grid:
        """The grid that covers the ring (r, 2) around landmarks (81, 2), clipped to the picture (h, w, ..).

        max_face_px : across the face, above which the grid is coarser than the picture.
        """
        width = face_width(points)
        if width < MIN_FACE_PX:
            raise PhotoError(
                f"the target's face is {width:.0f} pixels wide, but at least {MIN_FACE_PX} are needed: use a larger "
                "picture"
            )
        low = np.maximum(np.floor(ring.min(0)), 0).astype(int)
        high = np.minimum(np.ceil(ring.max(0)) + 1, picture[1::-1]).astype(int)
        if (high - low < 2).any():
            raise PhotoError("the target's landmarks lie outside its picture: give those of this picture")
        factor = min(1.0, max_face_px / width)
        size = np.maximum(np.rint((high - low) * factor), 2).astype(int)
        x, y = (int(v) for v in high - low)
        return cls((int(low[0]), int(low[1])), (x, y), (int(size[0]), int(size[1])), factor)

    def crop(self, picture: NDArray[np.generic]) -> NDArray[np.generic]:
        """The crop of a picture (h, w, ..), as a view."""
        (x, y), (width, height) = self.origin, self.crop_size
        return picture[y : y + height, x : x + width]

    def to_grid(self, points: F64) -> F64:
        """Points (n, 2) of the target in pixels of the grid."""
        exact = np.array(self.size) / self.crop_size
        return (points - self.origin + 0.5) * exact - 0.5

    def downsample(self, picture: F32) -> F32:
        """The crop (h, w, ..), resampled on the grid."""
        if self.size == self.crop_size:
            return picture
        return np.asarray(cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA), np.float32)

    def upsample(self, field: F32) -> F32:
        """A field (h, w, ..) on the grid, resampled for the crop."""
        if self.size == self.crop_size:
            return field
        return np.asarray(cv2.resize(field, self.crop_size, interpolation=cv2.INTER_LINEAR), np.float32)


@dataclass(frozen=True, eq=False)
class RasterisedFace:
    """The template rasterised on a grid.

    covered : (h, w) bool.   face : (h, w) bool, within the inset contour of the face.
    part : (h, w) visible part of the template, 0 where there is none.
    values : (h, w, d) float32, interpolated from the vertices; 0 where not covered.
    """

    covered: Bool
    face: Bool
    part: Int
    values: F32

    def within(self, box: Box) -> RasterisedFace:
        """The part in a rectangle."""
        return RasterisedFace(self.covered[box], self.face[box], self.part[box], self.values[box])

    def face_box(self, margin: float) -> Box:
        """The rectangle that holds the face, with a margin in pixels; all if there is none."""
        if not self.face.any():
            return slice(None), slice(None)
        reach = int(np.ceil(margin))
        ends = [np.flatnonzero(self.face.any(axis))[[0, -1]] for axis in (1, 0)]
        down, across = (slice(max(low - reach, 0), high + reach + 1) for low, high in ends)
        return down, across

    @property
    def mouth_mask(self) -> Bool:
        """(h, w) bool, between the lips."""
        return np.asarray(self.part == 1)

    def eye_shares(self, shares: F64) -> F32:
        """(h, w) the shares (2,) of the right and left eye within them, 0 elsewhere."""
        return np.asarray(np.array([0, 0, *shares])[self.part], np.float32)


def rasterise(
    mesh: Template, vertices: F64, values: F64, size: tuple[int, int], within: Bool
) -> RasterisedFace:
    """Rasterise values (V, d) of a template at vertices (V, 2) on a grid of a size (width, height)."""
    flat = np.column_stack([vertices, np.zeros(len(vertices))])
    seen = visible(flat, mesh.triangles, size)
    out = np.zeros((*seen.triangle.shape, values.shape[1]), np.float32)
    out[seen.covered] = seen.interpolated(values.astype(np.float32), mesh.triangles)
    part = mesh.parts[seen.triangle] * seen.covered
    return RasterisedFace(seen.covered, within & seen.covered, part, out)


def face_width(points: F64) -> float:
    """Width of the face of landmarks (81, 2), pixels."""
    return float(np.ptp(points[SILHOUETTE, 0]))


def pixel_places(size: tuple[int, int]) -> F32:
    """(h, w, 2) coordinates of the pixels of a grid."""
    x, y = np.meshgrid(np.arange(size[0], dtype=np.float32), np.arange(size[1], dtype=np.float32))
    return np.stack([x, y], axis=2)


def face_mask(points: F64, size: tuple[int, int]) -> Bool:
    """(h, w) bool, the inside of the inset contour of landmarks (81, 2)."""
    outline = points[SILHOUETTE]
    pulled = outline + CONTOUR_INSET * (outline.mean(0) - outline)
    mask = np.zeros(size[::-1], np.uint8)
    cv2.fillPoly(mask, [np.rint(pulled * 16).astype(np.int32)], (1,), cv2.LINE_8, 4)
    return np.asarray(mask > 0)
