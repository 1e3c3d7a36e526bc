"""Which triangle of a mesh each pixel shows, and where in it: a float image with a depth test.

Nothing is shaded here: colours, normals, depths or coordinates are looked up afterwards by triangle and weights, and
the weights are computed exactly from the triangle on demand.
Pixels, x right, y down, pixel centres at integers; depth in any unit, smaller is nearer.  Vertices are snapped to
1/256 pixel as in `guise.render.mesh`, so that GL and its NumPy twin cover the same pixels.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cache, cached_property
from typing import get_args

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from guise.common.arrays import F32, F64, I32, Bool, Floating, Int
from guise.common.closing import Closing
from guise.render.compositor import Renderer
from guise.render.context import GLMissing, check, create_context, probe_gl
from guise.render.errors import RendererError
from guise.render.gl import program
from guise.render.mesh import MAX_COORDINATE_PIXELS, SUBPIXELS, outline_box, snap, spans
from guise.render.pixel_centres import to_clip_space

MAX_TRIANGLES = 1 << 24  # a float holds each number below
_DEPTH_RANGE_SHARE = 0.98  # of GL's, so that rounding clips nothing


@dataclass(frozen=True, eq=False)
class Visibility:
    """What each pixel shows.

    triangle : (h, w) int32, the nearest triangle that covers the pixel's centre, -1 where none does.
    planes : (2, 3, t), a, b, c of each triangle with a x + b y + c the weight of its corners 1 and 2 at pixel (x, y).
    """

    triangle: I32
    planes: F64

    @cached_property
    def covered(self) -> Bool:
        """(h, w), where the mesh is seen."""
        return np.asarray(self.triangle >= 0)

    @cached_property
    def places(self) -> F32:
        """(p, 3) barycentric weights of the covered pixels' centres in their triangles, row by row; sums are 1."""
        line, column = np.nonzero(self.covered)
        one, other = (_at(plane, self.triangle[self.covered], column, line) for plane in self.planes)
        return np.stack([1 - one - other, one, other], axis=1).astype(np.float32)

    @property
    def weights(self) -> F32:
        """(h, w, 3) the same as a picture, zero where nothing is seen."""
        out = np.zeros((*self.triangle.shape, 3), np.float32)
        out[self.covered] = self.places
        return out

    def interpolated(self, values: Floating, triangles: NDArray[np.integer]) -> Floating:
        """Values of vertices (N, d) at the covered pixels, in rows (p, d); of the triangles (t, 3) drawn.

        >>> seen = visible([[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 1, 2]], (2, 1), "cpu")
        >>> seen.interpolated(np.array([[0.0], [4.0], [8.0]]), np.array([[0, 1, 2]])).tolist()
        [[0.0], [1.0]]
        """
        at_corners = values[triangles][self.triangle[self.covered]]
        return np.asarray(np.einsum("pk,pkd->pd", self.places, at_corners))


def visible(
    points: ArrayLike, triangles: ArrayLike, size: tuple[int, int], renderer: Renderer = "auto"
) -> Visibility:
    """The nearest triangle at every pixel of a picture, and the place in it.

    Parameters
    ----------
    points : (N, 3) float: x, y in pixels, which may lie outside the picture, and depth, smaller is nearer.
    triangles : (t, 3) int, indices of points, seen from both sides; of equally near ones the first is seen.
    size : (width, height) in pixels.
    renderer : 'auto' (GL where it is hardware, else the CPU), 'gl' or 'cpu'.

    Raises
    ------
    RendererError
        When an argument is wrong, or 'gl' is requested and missing.
    """
    if renderer not in get_args(Renderer):
        raise RendererError(f"renderer must be one of {', '.join(get_args(Renderer))}, got {renderer!r}")
    snapped, depth, corners = _checked(points, triangles, size)
    planes = _planes(snapped / SUBPIXELS, corners)
    if len(corners) and (renderer == "gl" or (renderer == "auto" and _hardware())):
        return Visibility(_drawer().draw(snapped, depth, corners, size), planes)
    return Visibility(_on_cpu(snapped, _towards(planes, depth, corners), corners, size), planes)


def _checked(points: ArrayLike, triangles: ArrayLike, size: tuple[int, int]) -> tuple[F64, F64, Int]:
    """Snapped places (N, 2), depths (N,) and triangles (t, 3)."""
    place, corners = np.asarray(points, np.float64), np.asarray(triangles)
    if place.ndim != 2 or place.shape[1] != 3:
        raise RendererError(f"points must be (N, 3), got {place.shape}")
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) >= MAX_TRIANGLES:
        raise RendererError(f"triangles must be (t, 3) with t < {MAX_TRIANGLES}, got {corners.shape}")
    bad = corners.dtype.kind not in "iu" or corners.min(initial=0) < 0
    if bad or corners.max(initial=-1) >= len(place):
        raise RendererError(f"triangles must hold integers from 0 to {len(place) - 1}")
    if min(size) < 1 or max(size) > MAX_COORDINATE_PIXELS:
        raise RendererError(f"size must be from 1 to {MAX_COORDINATE_PIXELS} pixels, got {size}")
    if not np.isfinite(place[:, 2]).all():
        raise RendererError("depths must be finite")
    return snap(place[:, :2], len(place)), place[:, 2], np.asarray(corners, np.intp)


def _on_cpu(snapped: F64, depths: F64, triangles: Int, size: tuple[int, int]) -> I32:
    """The NumPy twin: of all triangles at every pixel (h, w), whose depths are planes (3, t), the nearest."""
    width, height = size
    owner, row, left, right = spans(snapped, triangles, width, height)
    length = right - left
    number = np.repeat(owner, length)
    column = np.arange(len(number)) - np.repeat(np.cumsum(length) - length - left, length)
    line = np.repeat(row, length)
    away = _at(depths, number, column, line)
    pixel = line * width + column
    nearest = np.full(width * height, np.inf)
    np.minimum.at(nearest, pixel, away)
    first = np.flatnonzero(away == nearest[pixel])[::-1]  # the last assigned stays
    seen = np.full(width * height, -1, np.int32)
    seen[pixel[first]] = number[first]
    return seen.reshape(height, width)


def _planes(places: F64, triangles: Int) -> F64:
    """(2, 3, t): a, b, c with a x + b y + c the weight of corner 1, of corner 2, at (x, y); zero without area."""
    origin = places[triangles[:, 0]]
    (ux, uy), (vx, vy) = ((places[triangles[:, k]] - origin).T for k in (1, 2))
    area = ux * vy - uy * vx
    inverse = np.divide(1.0, area, out=np.zeros_like(area), where=area != 0)
    slopes = np.array([[vy, -vx], [-uy, ux]]) * inverse
    return np.concatenate([slopes, -np.einsum("kjt,tj->kt", slopes, origin)[:, None]], axis=1)


def _towards(planes: F64, depth: F64, triangles: Int) -> F64:
    """(3, t): a, b, c with a x + b y + c the depth of each triangle at (x, y)."""
    first, second, third = depth[triangles.T]
    out = (second - first) * planes[0] + (third - first) * planes[1]
    out[2] += first
    return np.asarray(out)


def _at(plane: F64, number: NDArray[np.integer], column: Int, line: Int) -> F64:
    """a x + b y + c (p,) of planes (3, t) chosen by number (p,)."""
    a, b, c = plane
    return np.asarray(a[number] * column + b[number] * line + c[number])


class GLVisibility(Closing):
    """`visible` in GL: one pass into a float target with a depth buffer.  Use it in the thread that made it."""

    def __init__(self) -> None:
        self._context = create_context()
        with self._context:
            self._program = program(self._context, "visibility")
            self._target = self._new_target((1, 1))
            check(self._context, "building the shaders")

    def draw(self, snapped: F64, depth: F64, triangles: Int, size: tuple[int, int]) -> I32:
        """The triangle (h, w) seen at each pixel, -1 for none.

        Places (N, 2) in whole 1/256 pixels, depths (N,), triangles (t, 3); at least one of them.
        """
        with self._context:
            self._resize(size)
            self._render(snapped, depth, triangles)
            picture = np.frombuffer(self._target.read(components=1, dtype="f4"), np.float32)
            check(self._context, "drawing a mesh's triangles")
        return picture.reshape(size[1], size[0]).astype(np.int32)

    def close(self) -> None:
        """Release the context with everything in it."""
        self._context.release()

    def _render(self, snapped: F64, depth: F64, triangles: Int) -> None:
        """The viewport is the whole mesh, of which the scissor keeps the picture, as in `guise.render.gl`."""
        context, target, whole = self._context, self._target, outline_box(snapped)
        places = to_clip_space(snapped / SUBPIXELS - (whole.x0, whole.y0), whole.width, whole.height)
        corners = np.concatenate([places, _clip_depth(depth)[:, None]], axis=1)[triangles]
        vertices = context.buffer(np.ascontiguousarray(corners).tobytes())
        array = context.vertex_array(self._program, [(vertices, "3f", "position")])
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        target.use()
        target.viewport = target.scissor = (0, 0, *target.size)
        target.clear(-1.0, depth=1.0)
        target.viewport = (whole.x0, whole.y0, whole.width, whole.height)
        array.render(moderngl.TRIANGLES)
        target.viewport = target.scissor
        array.release()
        vertices.release()

    def _resize(self, size: tuple[int, int]) -> None:
        if self._target.size != size:
            old = self._target
            self._target = self._new_target(size)
            for part in (old, *old.color_attachments, old.depth_attachment):
                part.release()  # only now: making a framebuffer binds again the one bound before, which must exist

    def _new_target(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        context = self._context
        return context.framebuffer([context.texture(size, 1, dtype="f4")], context.depth_texture(size))


def _clip_depth(depth: F64) -> F32:
    """Depths (N,) within GL's range, -1 nearest."""
    low, span = depth.min(), max(float(np.ptp(depth)), 1e-300)
    return np.asarray(_DEPTH_RANGE_SHARE * (2 * (depth - low) / span - 1), np.float32)


_here = threading.local()


def _drawer() -> GLVisibility:
    """The GL of this thread, made on first use."""
    if not hasattr(_here, "drawer"):
        _here.drawer = GLVisibility()
    drawer: GLVisibility = _here.drawer
    return drawer


@cache
def _hardware() -> bool:
    """Whether GL is there and is hardware."""
    found = probe_gl()
    return not isinstance(found, GLMissing) and not found.software
