"""Exact parsing labels of rendered people: which part of the face, or of what is in front of it, each pixel shows.

A second pass draws the surfaces of the picture again, each in the number of its class, with the same geometry, depth
test and transparency as the picture. On the skin a map in texture coordinates tells lips and the inside of the mouth
apart.  Pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from guise.aam.landmarks import schemes
from guise.aam.parsing import FaceClass
from guise.common.arrays import F64, I32, U8, Bool

CLASSES = tuple(one.name.lower() for one in FaceClass)
BACKGROUND, SKIN, BROWS, EYES, LIPS, INNER_MOUTH, HAIR, FACIAL_HAIR, GLASSES, OCCLUDER = range(len(CLASSES))

MAP_TEXELS = 1024  # the side of the map in texture coordinates
_HAIR_GAP_PIXELS = 3  # between hairs, that still count as hair

_VERTEX = """
#version 330
uniform mat4 P;
in vec3 in_pos; in vec2 in_uv;
out vec2 uv;
void main() { uv = in_uv; gl_Position = P * vec4(in_pos, 1); }
"""
_FRAGMENT = """
#version 330
uniform sampler2D tex; uniform sampler2D regions;
uniform float cut; uniform float number; uniform bool mapped;
in vec2 uv;
out vec4 colour;
void main() {
    if (cut > 0. && texture(tex, uv).a < cut) discard;
    colour = mapped ? texture(regions, uv) : vec4(number / 255.);
}
"""
# Surface -> class, and the opacity from which it covers what is behind it; eyelashes are left out.
_SURFACES = {
    "clothes": (BACKGROUND, 0.3),
    "body": (SKIN, 0.0),
    "eyes": (EYES, 0.5),
    "teeth": (INNER_MOUTH, 0.4),
    "tongue": (INNER_MOUTH, 0.4),
    "hair": (HAIR, 0.4),
    "brows": (BROWS, 0.2),
}
_TWO_SIDED = {"clothes", "hair", "brows"}  # drawn from behind as well


def skin_regions(uv: NDArray[Any], inside: NDArray[Any] | None = None) -> U8:
    """Map (MAP_TEXELS, MAP_TEXELS) of the skin's texture: lips, inside of the mouth, skin elsewhere.

    uv : (68, 2) texture coordinates of the iBUG points, v up.
    inside : (m, k, 2) texture coordinates of the polygons that line the mouth.
    """
    regions = np.full((MAP_TEXELS, MAP_TEXELS), SKIN, np.uint8)
    places = _texels(uv)
    cv2.fillPoly(regions, [places[schemes.OUTER_LIPS]], LIPS, shift=4)
    cv2.fillPoly(regions, [places[schemes.INNER_LIPS]], INNER_MOUTH, shift=4)
    if inside is not None and len(inside):
        cv2.fillPoly(regions, list(_texels(inside)), INNER_MOUTH, shift=4)
    return regions


def _texels(uv: NDArray[Any]) -> I32:
    return np.round((np.asarray(uv) * (1, -1) + (0, 1)) * MAP_TEXELS * 16).astype(np.int32)


class Labeller:
    """Draws the classes of what a renderer has in view; one per renderer.

    Parameters
    ----------
    renderer : the renderer whose context, size and actors are used
    regions : (n, n) uint8
        Classes in texture coordinates of the skin, see `skin_regions`.
    """

    def __init__(self, renderer: Any, regions: U8) -> None:
        context = renderer.ctx
        self._renderer = renderer
        self._program = context.program(_VERTEX, _FRAGMENT)
        self._target = context.texture(renderer.size, 1)
        self._frame = context.framebuffer([self._target], context.depth_texture(renderer.size))
        texture = context.texture(regions.shape[::-1], 1, np.ascontiguousarray(regions[::-1]).tobytes())
        texture.filter = (0x2600, 0x2600)  # GL_NEAREST: classes have no means
        self._regions = texture

    def labels(self, actors: list[Any], camera: Any) -> U8:
        """Class of every pixel (h, w) at the renderer's supersampled size.

        actors : those drawn in the picture. One that has `parsing` shows the surfaces named there, each a pair of class
            and least opacity, instead of those of a person.
        """
        context = self._renderer.ctx
        self._frame.use()
        context.viewport = (0, 0, *self._renderer.size)
        self._frame.clear(0, 0, 0, 0, depth=1.0)
        self._program["P"].write(np.ascontiguousarray(camera.proj().T, np.float32).tobytes())
        self._program["tex"].value, self._program["regions"].value = 0, 1
        self._regions.use(1)
        for actor in actors:
            for name in _order(actor):
                self._draw(actor, name)
        rows = np.frombuffer(self._target.read(alignment=1), np.uint8)
        return _close_hair(rows.reshape(self._renderer.size[::-1])[::-1])

    def _draw(self, actor: Any, name: str) -> None:
        number, cut = getattr(actor, "parsing", _SURFACES)[name]
        context, part = self._renderer.ctx, actor.b[name]
        if "label" not in part:
            layout = [(part["vb"], "3f 12x", "in_pos"), (part["uv"], "2f", "in_uv")]
            part["label"] = context.vertex_array(self._program, layout, part["ib"], 4)
        context.enable_only(context.DEPTH_TEST | (0 if name in _TWO_SIDED else context.CULL_FACE))
        part["tex"].use(0)
        self._program["cut"].value, self._program["number"].value = cut, float(number)
        self._program["mapped"].value = name == "body"
        part["label"].render(vertices=part["ntri"] * 3)


def _order(actor: Any) -> list[str]:
    if hasattr(actor, "parsing"):
        return list(actor.parsing)
    hidden = ("teeth", "tongue") if getattr(actor, "mouth_closed", False) else ()
    return [name for name in _SURFACES if name in actor.b and name not in hidden]


def _close_hair(labels: U8) -> U8:
    """The labels with small gaps between the hairs of a beard filled."""
    beard = (labels == FACIAL_HAIR).astype(np.uint8)
    if not beard.any():
        return np.ascontiguousarray(labels)
    kernel = cv2.getStructuringElement(
        cv2.MORPH_ELLIPSE, (2 * _HAIR_GAP_PIXELS + 1, 2 * _HAIR_GAP_PIXELS + 1)
    )
    closed = cv2.morphologyEx(beard, cv2.MORPH_CLOSE, kernel)
    return np.where((closed > 0) & (labels == SKIN), np.uint8(FACIAL_HAIR), labels)


def encode(labels: U8) -> bytes:
    """Labels (h, w) as PNG."""
    return bytes(cv2.imencode(".png", labels, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1])


def decode(data: U8) -> U8:
    """Labels (h, w) from PNG."""
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)


def mouth_lining(base: Any, body: Bool, points: NDArray[Any]) -> F64:
    """Texture coordinates (m, 4, 2) of the base mesh's quads inside the mouth.

    They are an island of their own in the texture: that which most skin behind the lips belongs to.

    base : the base mesh; body : (faces,) which of them are skin; points : (68, 3) iBUG points on it.
    """
    corners = base.ft[body]
    pairs = np.concatenate([corners[:, [k, (k + 1) % 4]] for k in range(4)])
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(base.vt),) * 2)
    island = connected_components(graph, directed=False)[1][corners[:, 0]]
    centres = base.v[base.f[body]].mean(1)
    middle, behind = points[schemes.INNER_LIPS].mean(0), points[schemes.INNER_LIPS, 2].min() - 0.1
    near = (np.abs(centres[:, :2] - middle[:2]) < 0.2).all(1) & (centres[:, 2] < behind)
    near &= centres[:, 2] > behind - 0.6
    return np.asarray(base.vt[corners[island == np.bincount(island[near]).argmax()]], np.float64)
