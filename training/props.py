"""Beards and glasses for rendered people: geometry that moves with the head and has parsing labels of its own.

A beard is a stack of shells over the skin: the same triangles pushed out along the normals and drawn down, each shell
showing only the hairs that are long enough to reach it.  Glasses are tubes along the rims, the bridge and the temples,
with lenses that tint what is behind them and reflect the lamps.

Positions are in the renderer's units (decimetres, x right, y up, z to the viewer), texture coordinates v up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    BROWS,
    JAW,
    LEFT_EYE,
    LEFT_MOUTH_CORNER,
    LEFT_NOSTRIL,
    LEFT_TEMPLE,
    NOSE_BASE,
    NOSE_ROOT,
    NOSE_TIP,
    OUTER_LIPS,
    RIGHT_EYE,
    RIGHT_MOUTH_CORNER,
    RIGHT_NOSTRIL,
    RIGHT_TEMPLE,
    UPPER_LIDS,
    UPPER_LIP_TOP,
)
from guise.common.arrays import F32, F64, I32, U8, Int
from training.parsing_labels import FACIAL_HAIR, GLASSES

Rng = np.random.Generator

SHELL_COUNT = 7
TEXTURE_TEXELS = 1024  # the side of a beard's texture
_SOLID_OPACITY = 0.32  # opacity from which the renderer draws hair solid
STYLES = ("full", "boxed", "goatee", "moustache", "chinstrap")


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles as the renderer's actors want them: positions (n, 3), unit normals (n, 3), uv (n, 2), tri (m, 3)."""

    positions: F64
    normals: F64
    uv: F32
    tri: I32

    @property
    def vmap(self) -> Int:
        """Vertices that each of the uploaded ones shows."""
        return np.arange(len(self.positions))


@dataclass(frozen=True, eq=False)
class _Owner:
    surf: dict[str, Mesh]


class Prop:
    """Meshes with materials that the renderer draws along with a person.

    Parameters
    ----------
    render : the renderer's module; renderer : its `Renderer`
    meshes, materials : by the name of the surface whose place in the renderer's order they take
    parsing : class and least opacity of those that the labels show
    casts : whether it throws a shadow
    """

    def __init__(
        self, render: Any, renderer: Any, meshes: dict[str, Mesh], materials: dict[str, dict],
        parsing: dict[str, tuple[int, float]], casts: bool,
    ) -> None:  # fmt: skip
        self.actor = render.GpuActor(renderer, _Owner(meshes), materials)
        self.actor.parsing, self.actor.casts = parsing, casts
        self.meshes = meshes

    def place(self, skull: F64, camera: Any) -> None:
        """Carry it along with the head at rest -> its pose, (4, 4)."""
        turn = skull[:3, :3]
        self.actor.upload(
            {n: (m.positions @ turn.T + skull[:3, 3], m.normals @ turn.T) for n, m in self.meshes.items()},
            camera,
        )


def cast_only(renderer: Any) -> None:
    """Let the renderer's shadows leave out actors whose `casts` is False."""
    draw = renderer._depth_pass

    def filtered(target: Any, matrix: Any, actors: list[Any], *rest: Any, **named: Any) -> None:
        draw(target, matrix, [a for a in actors if getattr(a, "casts", True)], *rest, **named)

    renderer._depth_pass = filtered


# -- beards -------------------------------------------------------------------------------------------------------


def beard_area(uv: F64, style: str, size: int = TEXTURE_TEXELS) -> F32:
    """Where a beard grows (size, size), 0..1 with soft edges, in the skin's texture.

    uv : (68, 2) texture coordinates of the iBUG points.
    """
    middle, nose = uv[UPPER_LIP_TOP], uv[NOSE_BASE]

    def low(points: Int, out: float) -> F64:  # the jaw, carried on below it
        return uv[points] + out * (uv[points] - uv[NOSE_TIP])

    under_nose = nose + 0.25 * (middle - nose)
    right_corner, left_corner = uv[RIGHT_MOUTH_CORNER], uv[LEFT_MOUTH_CORNER]
    right_cheek, left_cheek = (
        0.6 * uv[JAW[2:4]] + 0.4 * right_corner,
        0.6 * uv[JAW[-4:-2]] + 0.4 * left_corner,
    )
    whiskers = [
        left_corner,
        0.6 * uv[LEFT_NOSTRIL] + 0.4 * left_corner,
        under_nose,
        0.6 * uv[RIGHT_NOSTRIL] + 0.4 * right_corner,
        right_corner,
    ]
    if style in ("full", "boxed"):
        jaw = low(JAW[1:-1], 0.14 if style == "full" else 0.06)
        outline = np.vstack([jaw, left_cheek[::-1], whiskers, right_cheek])
    elif style == "goatee":
        outline = np.vstack([low(JAW[6:11], 0.08), *whiskers])
    elif style == "moustache":
        outline = np.vstack([whiskers, uv[OUTER_LIPS[1:6:2]] * 0.9 + nose * 0.1])
    else:
        outline = np.vstack([low(JAW[1:-1], 0.12), uv[JAW[-2:0:-1]] * 0.84 + uv[NOSE_TIP] * 0.16])
    area, lips = np.zeros((size, size), np.uint8), uv[OUTER_LIPS]
    cv2.fillPoly(area, [_texels(outline, size)], 255, shift=4)
    cv2.fillPoly(area, [_texels(lips + 0.05 * (lips - lips.mean(0)), size)], 0, shift=4)
    return np.asarray(cv2.GaussianBlur(area, (0, 0), size / 300), np.float32) / 255


def _texels(uv: F64, size: int) -> I32:
    return np.round((np.asarray(uv) * (1, -1) + (0, 1)) * size * 16).astype(np.int32)


def beard_texture(rng: Rng, area: F32, density: float) -> U8:
    """RGBA of the hairs: grey in colour, and in alpha how far out each reaches."""
    size = len(area)
    noise = rng.normal(0, 1, (size, size)).astype(np.float32)
    # The texture's u axis runs down the face, and so do the hairs.
    hairs = cv2.GaussianBlur(noise, (0, 0), sigmaX=rng.uniform(1.5, 3), sigmaY=rng.uniform(0.5, 0.8))
    tufts = cv2.GaussianBlur(rng.normal(0, 1, (size, size)).astype(np.float32), (0, 0), rng.uniform(3, 7))
    reach = 0.5 + 0.22 * hairs / hairs.std() + 0.12 * tufts / tufts.std() + density
    alpha = np.clip(reach, 0, 1) * area
    shade = np.clip(120 + 40 * hairs / hairs.std() + 20 * tufts / tufts.std(), 10, 250)
    return np.dstack([np.repeat(shade[..., None], 3, 2), alpha * 255]).astype(np.uint8)


class Beard:
    """Shells over the skin of one person.

    Parameters
    ----------
    program : modules of the renderer; who : its actor
    style : one of STYLES; length : decimetres
    """

    def __init__(
        self, program: dict[str, Any], renderer: Any, who: Any, rng: Rng, style: str, length: float
    ) -> None:
        surface = who.p.surf["body"]
        area = beard_area(program["landmarks"].uv(), style)
        texture = beard_texture(rng, area, rng.uniform(-0.05, 0.35))
        at = np.clip(
            np.round((surface.uv * (1, -1) + (0, 1)) * TEXTURE_TEXELS), 0, TEXTURE_TEXELS - 1
        ).astype(int)
        covered = area[at[:, 1], at[:, 0]] > 0.02
        tri = surface.tri[covered[surface.tri].any(1)]
        used, index = np.unique(tri, return_inverse=True)
        self._surface, self._vertices, self._length = surface, surface.vmap[used], length
        mesh = Mesh(
            np.zeros((len(used), 3)), np.zeros((len(used), 3)), np.ascontiguousarray(surface.uv[used]),
            index.reshape(-1, 3).astype(np.int32),
        )  # fmt: skip
        tint = np.array(who.spec.get("hairc", ((0.1, 0.06, 0.04), (0.02, 0.01, 0.01)))) * rng.uniform(
            0.7, 1.2
        )
        self.actors = []
        for height in np.linspace(0, 1, SHELL_COUNT):
            least = _SOLID_OPACITY + 0.5 * height
            looks = {
                "tint": tuple(tint[0]),
                "tintB": tuple(tint[1]),
                "tintmix": 1.0,
                "gloss": 0.15,
                "bumpk": 2.5,
                "amin": least,
                "amax": 2.0,
            }
            prop = Prop(
                program["render"], renderer, {"prop": mesh}, {"prop": {"kind": "HAIR", "tex": texture, "u": looks}},
                {"prop": (FACIAL_HAIR, least)}, casts=False,
            )  # fmt: skip
            prop.actor.set_ao("prop", np.full(len(used), 0.45 + 0.5 * height))
            self.actors.append(prop.actor)

    def place(self, who: Any, skull: F64, camera: Any) -> None:
        """Follow the skin, which has been placed."""
        skin = who.g.pos["body"]
        normals = self._surface.normals(skin)[self._vertices]
        roots = skin[self._vertices] + camera.pos
        down = skull[:3, :3] @ (0, -1, 0.25)
        for height, actor in zip(np.linspace(0, 1, SHELL_COUNT), self.actors, strict=True):
            out = 0.008 + self._length * height
            places = roots + out * (1 - 0.5 * height) * normals + self._length * 0.7 * height**2 * down
            actor.upload({"prop": (places, normals)}, camera)


# -- glasses ------------------------------------------------------------------------------------------------------


def rim(width: float, height: float, roundness: float, slant: float, count: int = 40) -> F64:
    """Outline (count, 2) of a lens about its middle: an ellipse (roundness 2) to nearly a rectangle (6)."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    cos, sin = np.cos(angle), np.sin(angle)
    x = np.sign(cos) * np.abs(cos) ** (2 / roundness) * width / 2
    y = np.sign(sin) * np.abs(sin) ** (2 / roundness) * height / 2
    return np.column_stack([x * (1 + slant * y / height), y])


def tube(path: F64, thickness: float, depth: float, closed: bool) -> tuple[F64, F64, I32]:
    """Positions, normals and triangles of a band of rectangular section, rounded normals, along a path (n, 3).

    thickness : across the path in the picture; depth : along z; both in the path's unit.
    """
    ahead = np.roll(path, -1, 0) - np.roll(path, 1, 0)
    if not closed:
        ahead[0], ahead[-1] = path[1] - path[0], path[-1] - path[-2]
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True) + 1e-12
    reference = np.array([0, 0, 1.0]) if np.abs(ahead[:, 2]).mean() < 0.8 else np.array([0, 1.0, 0])
    side = np.cross(ahead, reference)
    side /= np.linalg.norm(side, axis=1, keepdims=True) + 1e-12
    front = np.cross(side, ahead)
    turns = np.arange(8) * np.pi / 4
    section = np.column_stack([np.cos(turns), np.sin(turns)])
    normals = section[None, :, :1] * side[:, None] + section[None, :, 1:] * front[:, None]
    offset = (
        section[None, :, :1] * side[:, None] * thickness / 2
        + section[None, :, 1:] * front[:, None] * depth / 2
    )
    places = path[:, None] + offset
    n, k = len(path), len(section)
    i = np.arange(n if closed else n - 1)[:, None]
    j = np.arange(k)[None]
    a, b = i * k + j, i * k + (j + 1) % k
    c, d = ((i + 1) % n) * k + j, ((i + 1) % n) * k + (j + 1) % k
    tri = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])
    return places.reshape(-1, 3), normals.reshape(-1, 3), tri.astype(np.int32)


def _outwards(positions: F64, normals: F64, tri: I32) -> I32:
    """The triangles wound so that they face along their normals."""
    a, b, c = (positions[tri[:, k]] for k in range(3))
    facing = (np.cross(b - a, c - a) * normals[tri].mean(1)).sum(1) > 0
    return np.where(facing[:, None], tri, tri[:, ::-1])


def _joined(pieces: list[tuple[F64, F64, I32]]) -> Mesh:
    starts = np.cumsum([0] + [len(p[0]) for p in pieces[:-1]])
    positions, normals = (np.concatenate([p[k] for p in pieces]) for k in (0, 1))
    tri = np.concatenate([p[2] + s for p, s in zip(pieces, starts, strict=True)])
    uv = np.full((len(positions), 2), 0.5, np.float32)
    return Mesh(positions, normals, uv, np.ascontiguousarray(_outwards(positions, normals, tri), np.int32))


class Glasses:
    """Glasses on one person's head at rest.

    tinted : opacity of the lenses, 0 clear
    """

    def __init__(self, program: dict[str, Any], renderer: Any, who: Any, rng: Rng, tinted: float) -> None:
        points = program["landmarks"].points(who.p.base)
        frame, lenses = self._shape(points, rng)
        colour = np.full((4, 4, 4), 255, np.uint8)
        colour[..., :3] = rng.integers(0, 60, 3) if rng.random() < 0.65 else rng.integers(0, 256, 3)
        metal = rng.uniform(0.05, 0.8)
        meshes = {"prop": frame, "eyes": lenses}
        clear = np.zeros((4, 4, 4), np.uint8)
        materials = {
            "prop": {
                "kind": "MOUTH",
                "tex": colour,
                "u": {"tone": (1.0, 1.0, 1.0), "amax": 0.0, "gloss": metal},
            },
            "eyes": {"tex": clear, "u": {"tone": (1.0, 1.0, 1.0), "sat": 1.0, "bumpk": 1.0}},
        }
        parsing = {"prop": (GLASSES, 0.0)}
        if tinted > 0.02:
            tint = np.empty((4, 4, 4), np.uint8)
            tint[..., :3], tint[..., 3] = rng.integers(5, 90, 3), round(255 * tinted)
            meshes["brows"] = lenses
            looks = {"tint": (0, 0, 0), "tintB": (0, 0, 0), "tintmix": 0.0, "gloss": 0.0, "bumpk": 1.0}
            materials["brows"] = {"tex": tint, "u": looks}
            if tinted >= 0.5:
                parsing["brows"] = (GLASSES, 0.0)
        self._prop = Prop(program["render"], renderer, meshes, materials, parsing, casts=True)
        self.actors = [self._prop.actor]

    def place(self, who: Any, skull: F64, camera: Any) -> None:
        """Follow the head."""
        self._prop.place(skull, camera)

    @staticmethod
    def _shape(points: F64, rng: Rng) -> tuple[Mesh, Mesh]:
        """Frame and lenses (both of them in one mesh) on the head whose 68 points are given."""
        right, left = points[RIGHT_EYE].mean(0), points[LEFT_EYE].mean(0)
        gap = left[0] - right[0]
        width = gap * rng.uniform(0.72, 0.88)
        height = width * rng.uniform(0.55, 0.95)
        outline = rim(width, height, rng.uniform(2, 5), rng.uniform(-0.05, 0.12))
        thickness, depth = rng.uniform(0.012, 0.06), rng.uniform(0.02, 0.05)
        front = max(points[[NOSE_ROOT, *UPPER_LIDS], 2].max(), points[BROWS, 2].mean()) + rng.uniform(
            0.03, 0.1
        )
        drop, wrap = rng.uniform(-0.02, 0.1) * height, rng.uniform(0.05, 0.3)
        pieces, glass = [], []
        rims = []
        for sign, eye in ((-1, right), (1, left)):
            middle = np.array([eye[0] + sign * 0.03 * gap, eye[1] - drop])
            flat = outline * (sign, 1) + middle
            ring = np.column_stack([flat, front - wrap * (flat[:, 0] - points[NOSE_ROOT, 0]) ** 2])
            rims.append(ring)
            pieces.append(tube(ring, thickness, depth, closed=True))
            glass.append(_lens(ring))
        pieces.append(tube(_bridge(rims, rng, height), thickness * 0.8, depth * 0.8, closed=False))
        for sign, ring, ear in ((-1, rims[0], points[RIGHT_TEMPLE]), (1, rims[1], points[LEFT_TEMPLE])):
            hinge = ring[np.argmax(sign * ring[:, 0] + 0.6 * ring[:, 1])]
            back = np.array([ear[0] + sign * 0.1, hinge[1] + rng.uniform(-0.05, 0.05), ear[2] - 0.5])
            bend = np.array([hinge[0] + sign * 0.06, hinge[1], hinge[2] - 0.08])
            path = np.vstack([hinge, bend + np.linspace(0, 1, 12)[:, None] * (back - bend)])
            pieces.append(tube(path, depth, thickness * 0.8, closed=False))
        return _joined(pieces), _joined(glass)


def _lens(ring: F64) -> tuple[F64, F64, I32]:
    """A slightly domed sheet within a rim."""
    centre = ring.mean(0)
    positions = np.vstack([centre + np.array([0, 0, 0.02]), ring])
    normals = positions - (centre - (0, 0, 1.1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    n = len(ring)
    i = np.arange(n)
    return positions, normals, np.column_stack([np.zeros(n, int), i + 1, (i + 1) % n + 1]).astype(np.int32)


def _bridge(rims: list[F64], rng: Rng, height: float) -> F64:
    """Path (n, 3) over the nose between the rims."""
    at = rng.uniform(0.0, 0.3) * height
    middle = np.mean([r[:, 1].mean() for r in rims])
    a, b = (
        r[np.argmin(s * r[:, 0] + 2 * np.abs(r[:, 1] - middle - at))]
        for s, r in zip((-1, 1), rims, strict=True)
    )
    t = np.linspace(0, 1, 9)[:, None]
    arch = 4 * t * (1 - t)
    return np.asarray(a + t * (b - a) + arch * np.array([0, 0.12 * height, 0.06]))
