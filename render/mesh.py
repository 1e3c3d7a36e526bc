"""The face's triangle mesh, its place in the frame's rectangle, and exact rasterisation.

Pixels, x right, y down, pixel centres at integers. Vertices are snapped to 1/256 pixel before either
compositor sees them: GL rasterisers snap to that grid anyway, and on a known grid coverage is exact
arithmetic, so that GL and its twin agree pixel by pixel even where the mesh folds over itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from guise.common.arrays import F32, F64, I32, U8, Floating, Int
from guise.render.errors import RendererError

SUBPIXELS = 256
MAX_COORDINATE_PIXELS = (
    8000  # pixels; the mesh fits GL's viewport, and every product here is exact in float64
)


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """Triangles and the place of their vertices on the reference grid.

    triangles : (t, 3) int32, vertex indices; later triangles are drawn over earlier ones.
    uv : (v, 2) float32, texture pixels.
    height, width : the reference grid in texels.
    """

    triangles: I32
    uv: F32
    height: int
    width: int

    def __post_init__(self) -> None:
        uv = np.array(self.uv, np.float32, order="C")
        triangles = np.asarray(self.triangles)
        _check_mesh(triangles, uv, self.height, self.width)
        for name, array in (("triangles", np.array(triangles, np.int32, order="C")), ("uv", uv)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @cached_property
    def grid(self) -> F64:
        """(7, t) of each triangle on the grid, texels, which every frame needs.

        Its first side x, y and its second, from its first corner; that corner; whether its area is negative.
        """
        corners = self.uv.astype(np.float64)[self.triangles]
        sides = (corners[:, k] - corners[:, 0] for k in (1, 2))
        turned = _areas(self.uv.astype(np.float64), self.triangles) < 0
        return np.ascontiguousarray(np.column_stack([*sides, corners[:, 0], turned]).T)


class Box(NamedTuple):
    """Pixels x0 <= x < x1, y0 <= y < y1."""

    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def width(self) -> int:
        """Pixels across."""
        return self.x1 - self.x0

    @property
    def height(self) -> int:
        """Pixels down."""
        return self.y1 - self.y0

    @property
    def empty(self) -> bool:
        """Whether the box holds no pixel."""
        return self.x1 <= self.x0 or self.y1 <= self.y0

    def of(self, image: NDArray[Any]) -> NDArray[Any]:
        """The box's part of an (h, w, ...) image, as a view."""
        return image[self.y0 : self.y1, self.x0 : self.x1]


def back_first(snapped: F64, triangles: I32, grid: F64) -> Int:
    """Order (t,) in which triangles of snapped vertices are drawn: those turned over from the grid come first.

    grid : (7, t), see `TexturedMesh.grid`.

    Where a turned face folds over itself, what is seen from behind lies behind what is seen from the front.
    """
    turned = (_areas(snapped, triangles) < 0) != grid[6]
    return np.asarray((~turned).argsort(kind="stable"))


def _areas(points: F64, triangles: NDArray[np.integer]) -> F64:
    """Twice the signed areas (t,)."""
    (ax, bx, cx), (ay, by, cy) = points[triangles].T
    return np.asarray((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


def snap(vertices: Floating, count: int) -> F64:
    """Vertices in whole 1/256 pixels.

    Parameters
    ----------
    vertices : (count, 2) float, pixels.

    Returns
    -------
    (count, 2) float64 holding integers.

    Raises
    ------
    RendererError
        When the shape is wrong, a coordinate is not finite or beyond 8000 pixels.
    """
    points = np.asarray(vertices, np.float64)
    if points.shape != (count, 2):
        raise RendererError(f"vertices must be ({count}, 2), got {points.shape}")
    if not np.maximum.reduce(np.abs(points), None) <= MAX_COORDINATE_PIXELS:  # true for nan too
        raise RendererError(
            f"vertices must be finite and within {MAX_COORDINATE_PIXELS} pixels of the rectangle"
        )
    return np.rint(points * SUBPIXELS)


def bounding_box(snapped: F64, width: int, height: int) -> Box:
    """The pixels of a width x height image that a mesh of snapped vertices can cover."""
    low = np.maximum(np.ceil(np.minimum.reduce(snapped) / SUBPIXELS), 0)
    high = np.minimum(np.floor(np.maximum.reduce(snapped) / SUBPIXELS) + 1, (width, height))
    return Box(int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def outline_box(snapped: F64) -> Box:
    """The pixels around the whole mesh, inside the picture or not; every vertex lies inside."""
    low, high = np.floor(snapped.min(0) / SUBPIXELS), np.ceil(snapped.max(0) / SUBPIXELS) + 1
    return Box(int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def rasterise(snapped: F64, triangles: I32, ids: U8 | NDArray[np.uint16], order: Int | None = None) -> None:
    """Write into each pixel of `ids` the index of the last triangle that covers its centre.

    A pixel is covered when its centre lies in the triangle, on its left edge or on its top edge: GL's
    rule, so that neighbouring triangles leave no hole and share no pixel. Pixels of no triangle keep
    their value.

    Parameters
    ----------
    snapped : (v, 2) float64, whole 1/256 pixels.
    triangles : (t, 3).
    ids : (h, w) uint8 or uint16, C-contiguous, written in place.
    order : (t,) in which they are drawn, by default that of the triangles.
    """
    height, width = ids.shape
    order = np.arange(len(triangles)) if order is None else order
    triangle, row, left, right = spans(snapped, triangles[order], width, height)
    length = right - left
    pixels = (row * width + left - (length.cumsum() - length)).repeat(length)
    pixels += np.arange(len(pixels))
    ids.reshape(-1)[pixels] = order.astype(ids.dtype)[triangle].repeat(length)  # the last of equals stays


def texture_gradients(snapped: F64, triangles: I32, grid: F64) -> F64:
    """The affine map from pixels to texture pixels of each triangle.

    Parameters
    ----------
    snapped : (v, 2) float64, whole 1/256 pixels.
    triangles, grid : (t, 3) and (7, t), see `TexturedMesh`.

    Returns
    -------
    (6, t) float64: rows a, b, c, d, e, f with u = a x + b y + c and v = d x + e y + f; zero for triangles
    without area, which cover no pixel.
    """
    (x, x1, x2), (y, y1, y2) = (snapped[triangles] / SUBPIXELS).T
    dx1, dy1, dx2, dy2 = x1 - x, y1 - y, x2 - x, y2 - y
    area = dx1 * dy2 - dx2 * dy1
    some = area != 0
    inverse = some / (area + ~some)
    first, second, corner = grid[:2], grid[2:4], grid[4:6]
    made = np.empty((2, 3, len(area)))
    along_x, along_y = made[:, 0], made[:, 1]
    along_x[:] = (first * dy2 - second * dy1) * inverse
    along_y[:] = (second * dx1 - first * dx2) * inverse
    made[:, 2] = (corner - along_x * x - along_y * y) * some
    return made.reshape(6, -1)


def spans(snapped: F64, triangles: NDArray[np.integer], width: int, height: int) -> tuple[Int, Int, Int, Int]:
    """Runs of covered pixels (triangle, row, left, right), right exclusive, in drawing order."""
    corners = snapped[triangles]
    downwards = corners[:, :, 1].argsort(1).T
    top, middle, bottom = corners[np.arange(len(corners)), downwards]
    triangle, row = _rows(top[:, 1], bottom[:, 1], height)
    y = row.astype(np.float64) * SUBPIXELS
    below_middle = y >= middle[:, 1].take(triangle)
    long_edge = _crossing(top, bottom, triangle, y)
    upper, lower = np.concatenate([top, middle]), np.concatenate([middle, bottom])
    short_edge = _crossing(upper, lower, triangle + len(triangles) * below_middle, y)
    left, right = np.minimum(long_edge, short_edge), np.maximum(long_edge, short_edge)
    return triangle, row, _within(left, width), _within(right, width)


def _rows(top: F64, bottom: F64, height: int) -> tuple[Int, Int]:
    """Every (triangle, row) with the row's centre in top <= y < bottom."""
    first, last = _within(np.ceil(top / SUBPIXELS), height), _within(np.ceil(bottom / SUBPIXELS), height)
    count = last - first
    triangle = np.arange(len(count)).repeat(count)
    return triangle, np.arange(len(triangle)) + (first - (count.cumsum() - count)).repeat(count)


def _within(places: F64, size: int) -> Int:
    """Whole places clipped to an axis of a size."""
    return np.minimum(np.maximum(places, 0), size).astype(np.intp)


def _crossing(start: F64, end: F64, edge: Int, y: F64) -> F64:
    """First pixel whose centre is not left of the edge at height y (1/256 pixels).

    Numerator and denominator are exact integers and one division is correctly rounded, so the ceiling is
    exact.
    """
    (dx, dy), (x0, y0) = (end - start).T, start.T
    numerator = (x0 * dy - y0 * dx).take(edge) + y * dx.take(edge)
    denominator = (dy + (dy == 0)) * SUBPIXELS
    return np.asarray(np.ceil(numerator / denominator.take(edge)))


def _check_mesh(triangles: NDArray[Any], uv: F32, height: int, width: int) -> None:
    if uv.ndim != 2 or uv.shape[1] != 2 or len(uv) < 3:
        raise RendererError(f"uv must be (v, 2) with v >= 3, got {uv.shape}")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) < 1:
        raise RendererError(f"triangles must be (t, 3) with t >= 1, got {triangles.shape}")
    if triangles.dtype.kind not in "iu" or triangles.min() < 0 or triangles.max() >= len(uv):
        raise RendererError(f"triangles must hold integers from 0 to {len(uv) - 1}")
    if len(triangles) >= np.iinfo(np.uint16).max:
        raise RendererError(f"triangles must be fewer than 65535, got {len(triangles)}")
    inside = (uv >= -0.5) & (uv <= np.array([width, height]) - 0.5)
    if not inside.all():
        raise RendererError(f"uv must lie on the texture of {width} x {height} texels")
