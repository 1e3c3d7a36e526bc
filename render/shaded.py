"""Studio pictures of a mesh: orthographic, smooth normals, key, fill and rim light, and soft ambient occlusion.

The lights are fixed to the viewer, so that what a surface reflects is a function of its normal alone: two pictures of a
lit ball (`_Ball`), looked up by the normals of `guise.render.visibility`'s pixels.  Drawn at twice the size
and averaged.

Mesh coordinates: x to the viewer's right, y up, z towards the viewer; a head looks along z.  Colours are sRGB in 0..1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from guise.common.arrays import F32, F64, U8, Bool, Floating
from guise.render.errors import RendererError
from guise.render.visibility import Visibility, visible

Faces = NDArray[np.integer]
Paint = Callable[[F64], F64]
_Float = TypeVar("_Float", np.float32, np.float64)

CLAY_COLOUR = (0.80, 0.69, 0.61)
_BACKDROP_COLOURS = (0.075, 0.082, 0.094), (0.016, 0.018, 0.021)  # linear: middle and corners
_BACKDROP_DEPTH = 1e9
_MARGIN_SHARE = 0.05  # of the picture, around the head
_BALL_TEXELS = 257  # across the lit ball
_SAMPLES = 2  # of a pixel, each way

# Direction to the light (right, up, towards the viewer), colour and strength in linear RGB, softness 0..1.
_KEY = (-0.62, 0.66, 0.62), (1.85, 1.70, 1.52), 0.10
_FILL = (0.90, 0.05, 0.50), (0.22, 0.27, 0.35), 0.40
_RIM_LEFT = (-0.90, 0.25, -0.55), (0.45, 0.60, 0.85), 0.0
_RIM_RIGHT = (0.92, 0.35, -0.42), (1.00, 0.97, 0.90), 0.0
_SKY, _GROUND = (0.19, 0.21, 0.245), (0.075, 0.062, 0.055)
_INNER_SIDE_LIGHT = 0.35  # share of the light that reaches the inner side of a surface


@dataclass(frozen=True)
class _Occlusion:
    """Ambient occlusion."""

    directions: int = 8  # around a pixel
    steps: int = 3  # along each direction
    reach_head_sizes: float = 0.085
    strength: float = 1.3
    flat_sine: float = 0.12  # up to which a slope isn't a hollow
    max_occlusion: float = 0.92
    blur_pixels: float = 1.6  # standard deviation, at a quarter of the samples


@dataclass(frozen=True)
class _Exposure:
    """How open a surface lies, from views around it."""

    view_pixels: int = 256  # side of a view
    open_share: float = 0.2  # of the views, from which a vertex counts as open
    min_light: float = 0.1
    views: tuple[tuple[int, int], ...] = (  # yaw, pitch
        *((yaw, 0) for yaw in range(0, 360, 45)),
        *((yaw, 50) for yaw in range(0, 360, 90)),
        *((yaw, -50) for yaw in range(45, 360, 90)),
    )


_OCCLUSION, _EXPOSURE = _Occlusion(), _Exposure()


@dataclass(frozen=True, eq=False)
class Camera:
    """Where the mesh is looked at from, and how large.

    centre : (3,) in mesh units, in the middle of the picture.   extent : (across, up) half sizes in mesh units that
    the picture holds, whatever the yaw.   yaw, pitch : degrees; the head turns to the viewer's right, and up.
    """

    centre: F64
    extent: tuple[float, float]
    yaw: float = 0.0
    pitch: float = 0.0

    @classmethod
    def around(cls, vertices: ArrayLike, yaw: float = 0.0, pitch: float = 0.0) -> Camera:
        """That holds vertices (N, 3) whichever way they are turned around the upright axis."""
        points = np.asarray(vertices, np.float64)
        low, high = points.min(0), points.max(0)
        centre = (low + high) / 2
        across = float(np.hypot(*(points - centre)[:, [0, 2]].T).max())
        return cls(centre, (max(across, 1e-12), max(float(high[1] - low[1]) / 2, 1e-12)), yaw, pitch)

    @property
    def rotation(self) -> F64:
        """(3, 3): from mesh axes to right, up, towards the viewer."""
        (sy, cy), (sp, cp) = ((np.sin(a), np.cos(a)) for a in np.radians((self.yaw, self.pitch)))
        turned = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        return np.asarray(np.array([[1, 0, 0], [0, cp, sp], [0, -sp, cp]]) @ turned)

    def scale(self, size: tuple[int, int]) -> float:
        """Pixels per unit of the mesh."""
        across, up = self.extent
        return (0.5 - _MARGIN_SHARE) * min(size[0] / across, size[1] / up)

    def project(self, vertices: ArrayLike, size: tuple[int, int]) -> F64:
        """(N, 3): x, y and depth, all in pixels of a picture of that width and height."""
        turned = (np.asarray(vertices, np.float64) - self.centre) @ self.rotation.T * self.scale(size)
        middle = (size[0] - 1) / 2, (size[1] - 1) / 2
        return np.stack([middle[0] + turned[:, 0], middle[1] - turned[:, 1], -turned[:, 2]], axis=1)


def shaded(
    vertices: ArrayLike,
    triangles: ArrayLike,
    size: tuple[int, int],
    yaw: float = 0.0,
    pitch: float = 0.0,
    colours: ArrayLike | None = None,
    *,
    paint: Paint | None = None,
    light: ArrayLike | None = None,
    camera: Camera | None = None,
) -> U8:
    """A picture of a mesh on a dark backdrop.

    Parameters
    ----------
    vertices : (N, 3).   triangles : (t, 3).   size : (w, h) in pixels.
    yaw, pitch : degrees by which the head is turned to the viewer's right, and up.
    colours : (N, 3) sRGB in 0..1 of the vertices; with `paint`, any values (N, d) of them. None is clay.
    paint : turns values at pixels (p, d) into their colours (p, 3): patterns and colour maps stay sharp.
    light : (N,) share of the light that reaches the vertices, such as their `exposure` at rest.
    camera : instead of one around these vertices with that yaw and pitch, for pictures that belong together.

    Returns
    -------
    (h, w, 3) uint8

    Raises
    ------
    RendererError
        When the shapes are wrong, or a vertex or colour is not finite.
    """
    points, faces = np.asarray(vertices, np.float64), np.asarray(triangles)
    _check(points, faces, colours)
    faces = outwards(points, faces)
    eye = camera or Camera.around(points, yaw, pitch)
    fine = size[0] * _SAMPLES, size[1] * _SAMPLES
    place = eye.project(points, fine)
    seen = visible(place, faces, fine)
    picture = _backdrop(fine).copy()
    if seen.covered.any():
        picture[seen.covered] = _srgb(_lit(place, faces, seen, colours, paint, light))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.asarray(np.rint(small * 255), np.uint8)


def _lit(
    place: F64, triangles: Faces, seen: Visibility, colours: ArrayLike | None, paint: Paint | None,
    light: ArrayLike | None,
) -> F32:  # fmt: skip
    """What the covered pixels (p, 3) send to the viewer, linear.  All of vertices is looked up at once."""
    normals = vertex_normals(place * (1, -1, -1), triangles)
    share = np.ones(len(place)) if light is None else np.asarray(light)
    given = () if colours is None else (np.asarray(colours),)
    columns = np.column_stack([normals, place[:, 2], share, *given]).astype(np.float32)
    known = np.asarray(seen.interpolated(columns, triangles), np.float32)
    normal = _unit(known[:, :3])
    inside = normal[:, 2] < -0.15  # smooth normals lean back a little at the outline
    normal[inside] *= -1
    own = _painted(known[:, 5:], paint) if given else _linear(np.array(CLAY_COLOUR, np.float32))
    reach = _OCCLUSION.reach_head_sizes * float(np.ptp(place, axis=0).max())
    arriving = _openness(known[:, 3], seen.covered, reach) * known[:, 4]
    arriving[inside] *= _INNER_SIDE_LIGHT
    ball = _Ball.lit()
    return (own * ball.diffuse(normal) + ball.gloss(normal)) * arriving[:, None]


def exposure(vertices: ArrayLike, triangles: ArrayLike) -> F64:
    """How open a surface lies: from how many directions each vertex (N,) is seen, as the light that reaches it.

    1 where it is open, down to a little inside a closed mouth: given for all expressions of a head at rest, it keeps
    the inside of an opened mouth dark.
    """
    points = np.asarray(vertices, np.float64)
    faces = outwards(points, np.asarray(triangles))
    times = np.zeros(len(points))
    around = Camera.around(points)
    size = _EXPOSURE.view_pixels, _EXPOSURE.view_pixels
    for yaw, pitch in _EXPOSURE.views:
        place = replace(around, yaw=yaw, pitch=pitch).project(points, size)
        numbers = np.unique(visible(place, faces, size).triangle)
        shown = faces[numbers[numbers >= 0]]
        (ux, uy), (vx, vy) = ((place[shown[:, k], :2] - place[shown[:, 0], :2]).T for k in (1, 2))
        hit = np.zeros(len(points), bool)
        hit[shown[ux * vy < uy * vx]] = True  # its outer side: y runs down
        times += hit
    least, enough = _EXPOSURE.min_light, _EXPOSURE.open_share * len(_EXPOSURE.views)
    return _blurred(least + (1 - least) * np.minimum(1, times / enough), faces)


def _blurred(values: F64, triangles: Faces) -> F64:
    """Values of vertices (N,), averaged over the triangles around."""
    mean = values[triangles].mean(1)
    total, count = (
        sum(np.bincount(triangles[:, k], w, len(values)) for k in range(3))
        for w in (mean, np.ones(len(mean)))
    )
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), values))


def _check(points: F64, triangles: Faces, colours: ArrayLike | None) -> None:
    if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
        raise RendererError(f"vertices must be (N, 3), N > 0, and finite, got {points.shape}")
    if colours is not None:
        values = np.asarray(colours)
        if values.ndim != 2 or len(values) != len(points) or not np.isfinite(values).all():
            raise RendererError(f"colours must be ({len(points)}, d) and finite, got {values.shape}")


def outwards(vertices: F64, triangles: Faces) -> Faces:
    """The triangles (t, 3), all turned over where on the whole they face the middle of the vertices (N, 3)."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(0) for k in range(3))
    return triangles if (np.cross(b - a, c - a) * (a + b + c)).sum() >= 0 else triangles[:, ::-1]


def vertex_normals(vertices: F64, triangles: Faces) -> F64:
    """(N, 3) unit normals, of the triangles around weighted by their areas; zero where these cancel out."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    out = np.zeros_like(vertices)
    for axis in range(3):
        for k in range(3):
            out[:, axis] += np.bincount(triangles[:, k], weighted[:, axis], len(vertices))
    return _unit(out)


def _painted(values: Floating, paint: Paint | None) -> F32:
    """Linear colours (p, 3) of pixels with values (p, d)."""
    return _linear(np.asarray(values if paint is None else paint(values.astype(np.float64)), np.float32))


def _openness(depths: Floating, covered: Bool, reach: float) -> F32:
    """(p,) share of the ambient light that reaches the covered pixels, computed at a quarter of the samples.

    depths : (p,) of the covered pixels.   reach : both in fine pixels.
    """
    depth = np.full(covered.shape, _BACKDROP_DEPTH, np.float32)
    depth[covered] = depths
    small = np.ascontiguousarray(depth[::_SAMPLES, ::_SAMPLES])
    hidden = np.zeros(small.shape, np.float32)
    for turn in range(_OCCLUSION.directions):
        direction = np.exp(2j * np.pi * turn / _OCCLUSION.directions)
        highest = np.zeros(small.shape, np.float32)
        for step in range(1, _OCCLUSION.steps + 1):
            offset = direction * reach * ((step - turn % 2 / 2) / _OCCLUSION.steps) ** 2
            _rise(small, offset, reach, highest)
        hidden += highest
    mean = _OCCLUSION.strength * hidden / _OCCLUSION.directions
    smooth = cv2.GaussianBlur(1 - np.minimum(mean, _OCCLUSION.max_occlusion), (0, 0), _OCCLUSION.blur_pixels)
    return np.asarray(
        cv2.resize(smooth, depth.shape[::-1], interpolation=cv2.INTER_LINEAR)[covered], np.float32
    )


def _rise(depth: F32, offset: complex, reach: float, highest: F32) -> None:
    """Raise `highest` (h, w) to the sine of the angle under which the surface at an offset stands above each pixel.

    What stands far in front doesn't occlude.  depth, offset and reach in fine pixels.
    """
    x, y = round(offset.real / _SAMPLES), round(offset.imag / _SAMPLES)
    if x or y:
        rows, columns = _overlap(depth.shape[0], y), _overlap(depth.shape[1], x)
        above = depth[rows[0], columns[0]] - depth[rows[1], columns[1]]
        np.clip(above, 0, 1e3 * reach, out=above)  # backdrop before or behind
        sine = above / np.sqrt(above * above + np.float32(_SAMPLES**2 * (x * x + y * y)))
        sine -= _OCCLUSION.flat_sine
        sine /= 1 + np.square(above / np.float32(reach))
        kept = highest[rows[0], columns[0]]
        np.maximum(kept, sine, out=kept)


def _overlap(length: int, shift: int) -> tuple[slice, slice]:
    """Where a row of pixels and the same row shifted overlap: in the one and in the other."""
    return slice(max(0, -shift), length - max(0, shift)), slice(max(0, shift), length + min(0, shift))


@dataclass(frozen=True, eq=False)
class _Ball:
    """What a lit ball reflects, (_BALL_TEXELS, _BALL_TEXELS, 3) linear, by normal: diffusely, and as gloss."""

    matt: F32
    shine: F32

    @classmethod
    @cache
    def lit(cls) -> _Ball:
        y, x = np.mgrid[1 : -1 : _BALL_TEXELS * 1j, -1 : 1 : _BALL_TEXELS * 1j]
        inside = np.minimum(1.0, 1 / np.maximum(np.hypot(x, y), 1e-9))
        x, y = x * inside, y * inside
        normal = np.stack([x, y, np.sqrt(np.maximum(0, 1 - x * x - y * y))], axis=-1)
        up = 0.5 + 0.5 * y[..., None]
        matt = up * np.array(_SKY) + (1 - up) * np.array(_GROUND)
        shine = np.zeros_like(matt)
        edge = (1 - normal[..., 2:]) ** 3
        for direction, colour, softness in (_KEY, _FILL, _RIM_LEFT, _RIM_RIGHT):
            light, tint = _unit(np.array([direction])), np.array(colour)
            lit = np.maximum(0, (normal @ light.T + softness) / (1 + softness)) * tint
            matt += 0.62 * lit
            if direction[2] < 0:
                shine += 0.55 * edge * lit
            else:
                glint = np.maximum(0, normal @ _unit(light + np.array([0, 0, 1])).T)
                shine += (0.055 * glint**18 + 0.035 * glint**70) * tint
        return cls(matt.astype(np.float32), shine.astype(np.float32))

    def diffuse(self, normals: F32) -> F32:
        """Light (p, 3) that white reflects from normals (p, 3)."""
        return _looked_up(self.matt, normals)

    def gloss(self, normals: F32) -> F32:
        """Light (p, 3) of the highlights."""
        return _looked_up(self.shine, normals)


def _looked_up(ball: F32, normals: F32) -> F32:
    half = (_BALL_TEXELS - 1) / 2
    x, y = half * (1 + normals[:, 0]), half * (1 - normals[:, 1])
    rows = 4096  # remap takes fewer than 32768 rows
    padded = -(-len(x) // rows) * rows
    maps = [np.pad(m, (0, padded - len(m))).reshape(-1, rows) for m in (x, y)]
    return np.asarray(
        cv2.remap(ball, maps[0], maps[1], cv2.INTER_LINEAR).reshape(-1, 3)[: len(x)], np.float32
    )


@cache
def _backdrop(size: tuple[int, int]) -> F32:
    """(h, w, 3) sRGB."""
    width, height = size
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    away = np.clip(np.hypot(x, y + 0.15) / 1.6, 0, 1)[..., None] ** 1.3
    middle, corners = map(np.array, _BACKDROP_COLOURS)
    return _srgb(np.asarray((1 - away) * middle + away * corners, np.float32))


def _linear(colours: F32) -> F32:
    """sRGB to linear light."""
    c = np.clip(colours, 0, 1)
    return np.asarray(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4), np.float32)


def _srgb(light: F32) -> F32:
    """Linear light to sRGB in 0..1; what is brighter than about 0.8 is compressed, not clipped."""
    bright = np.maximum(light - 0.8, 0)
    c = np.minimum(light, 0.8) + 0.2 * (1 - np.exp(-bright / 0.2))
    return np.asarray(np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055), np.float32)


def _unit(vectors: NDArray[_Float]) -> NDArray[_Float]:
    """Rows (n, 3) made one long; zero stays."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(size > 0, size, 1), vectors.dtype)
