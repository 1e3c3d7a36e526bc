"""What stands between a camera and people: slats, bars, wires, nets, shade, watermarks, walls, glass, screens.

As real ones look: at an angle, lit, moved, out of focus.  Others (chequers, dots, leaves) are left to be measured.
Pixels, x right, y down; pictures RGB uint8; opacities (h, w) float32 in [0, 1].
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from guise.aam.landmarks import LEFT_EYE, RIGHT_EYE
from guise.common.arrays import F32, F64, U8

Picture = U8
Rng = np.random.Generator
Layer = tuple[F32, F32]  # colour (h, w, 3) or (3,), and opacity (h, w)

MOST = 0.8  # opacity on average over a face, up to which it is plain to see
_CLEAR = 0.5  # opacity of a point that is in sight
_LETTERS = np.array(list("ABCDEFGHIKLMNOPRSTUVWZaeinorst0123456789©. "))


def before(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> tuple[Picture, F32]:
    """A picture behind something, and the opacity (h, w) of that.

    pitch : pixels, from one line to the next.   near : (2,) a place through which an edge may pass.
    behind : another picture of that size, for walls and reflections.
    """
    makers: tuple[Callable[[Rng, Picture, float, F64, Picture], Layer], ...] = (
        _slats, _slats, _wires, _wires, _net, _shade, _watermark, _watermark, _wall, _wall, _glass, _screen,
    )  # fmt: skip
    colour, opacity = makers[int(rng.integers(len(makers)))](rng, image, pitch, near, behind)
    if rng.random() < 0.4:  # out of focus
        opacity = np.asarray(
            cv2.GaussianBlur(opacity, (0, 0), rng.uniform(0.4, 0.12 * pitch + 0.5)), np.float32
        )
    if rng.random() < 0.15:  # moved
        length = int(rng.uniform(2, 3 + 0.3 * pitch))
        shape = (length, 1) if rng.random() < 0.5 else (1, length)
        opacity = np.asarray(cv2.blur(opacity, shape), np.float32)
    mixed = image + (colour - image) * opacity[..., None]
    return np.asarray(np.clip(mixed + 0.5, 0, 255), np.uint8), opacity


def is_plain(opacity: F32, face: F64) -> bool:
    """Whether people would still see a face with points (68, 2): not all is behind, or both eyes look over an edge."""
    height, width = opacity.shape
    low, high = np.clip(face.min(0), 0, (width - 1, height - 1)), np.clip(face.max(0) + 1, 1, (width, height))
    part = opacity[int(low[1]) : int(high[1]) + 1, int(low[0]) : int(high[0]) + 1]
    places = np.clip(np.round(face), 0, (width - 1, height - 1)).astype(int)
    seen = opacity[places[:, 1], places[:, 0]] < _CLEAR
    eyes = seen[[*RIGHT_EYE, *LEFT_EYE]].mean() > 0.9
    return bool(eyes or (part.mean() < MOST and seen.mean() > 1 - MOST))


def _phase(rng: Rng, shape: tuple[int, int], pitch: float, angle: float) -> F32:
    """How many lines lie before each pixel, (h, w): parallel lines seen at an angle, some of them bent."""
    height, width = shape
    y, x = np.mgrid[:height, :width].astype(np.float32) / max(shape) - 0.5
    depth = 1 + np.float32(rng.normal(0, 0.25)) * x + np.float32(rng.normal(0, 0.25)) * y
    across = (-np.sin(angle) * x + np.cos(angle) * y) / np.maximum(depth, 0.3)
    if rng.random() < 0.35:
        along = np.cos(angle) * x + np.sin(angle) * y
        across = across + rng.normal(0, 0.03) * np.sin(
            2 * np.pi * (rng.uniform(0.3, 2) * along + rng.random())
        )
    return np.asarray(across * (max(shape) / pitch) + rng.random(), np.float32)


def _lines(phase: F32, share: float, pitch: float) -> F32:
    """Opacity of lines that take a share of the pitch, with edges of a pixel."""
    off = np.abs(phase - np.round(phase))
    return np.asarray(np.clip((share / 2 - off) * pitch + 0.5, 0, 1), np.float32)


def _paint(rng: Rng) -> F32:
    """A colour: grey, wood, or any."""
    kind = rng.random()
    if kind < 0.55:
        return np.asarray(rng.uniform(5, 250) * rng.uniform(0.92, 1.08, 3), np.float32)
    if kind < 0.75:
        return np.asarray(np.array([150, 105, 70]) * rng.uniform(0.3, 1.5), np.float32)
    return np.asarray(rng.uniform(0, 255, 3), np.float32)


def _slats(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> Layer:
    """Blinds, a railing, a fence of boards: parallel, round or flat, each in its own light, mostly upright."""
    angle = rng.choice([0, np.pi / 2]) + (
        rng.normal(0, 0.12) if rng.random() < 0.7 else rng.uniform(-0.8, 0.8)
    )
    phase = _phase(rng, image.shape[:2], pitch, float(angle))
    share = float(rng.uniform(0.12, 0.62))
    inside = (phase - np.round(phase)) / share
    light = 1 + rng.normal(0, 0.5) * inside - rng.uniform(0, 1.5) * inside**2
    each = np.exp(rng.normal(0, rng.uniform(0, 0.25), 400)).astype(np.float32)
    light = light * each[np.round(phase).astype(int) % 400]
    opacity = _lines(phase, share, pitch) * np.float32(1 if rng.random() < 0.85 else rng.uniform(0.5, 1))
    colour = np.clip(_paint(rng) * np.clip(light, 0.1, 2)[..., None], 0, 255)
    if rng.random() < 0.2:  # a crossing rail, or the strings of blinds
        other = _phase(rng, image.shape[:2], pitch * rng.uniform(2, 6), float(angle) + np.pi / 2)
        opacity = np.maximum(opacity, _lines(other, rng.uniform(0.02, 0.15), pitch * 3))
    return colour.astype(np.float32), opacity


def _wires(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> Layer:
    """A fence of crossed wires, square or slanted."""
    first = rng.choice([0, np.pi / 4]) + rng.normal(0, 0.15)
    share = rng.uniform(0.05, 0.5)
    parts = [
        _lines(_phase(rng, image.shape[:2], pitch, float(first + turn)), share, pitch)
        for turn in (0, np.pi / 2 + rng.normal(0, 0.15))
    ]
    return _paint(rng), np.maximum(*parts)


def _net(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> Layer:
    """Chain links, nets and hexagons: wavy threads that meet."""
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float32) / pitch
    angle = rng.normal(0, 0.3)
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    sway = rng.uniform(0.15, 0.4)
    share, opacity = rng.uniform(0.06, 0.4), np.zeros((height, width), np.float32)
    for half in (0.0, 0.5):
        wave = sway * (2 * np.abs((v + half) % 1 - 0.5) - 0.5) * 2
        opacity = np.maximum(opacity, _lines((u + wave + half).astype(np.float32), share, pitch))
    return _paint(rng), opacity


def _shade(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> Layer:
    """Blotches of sun and shade, round or drawn out, some of them hard."""
    noise = np.zeros(image.shape[:2], np.float32)
    for scale in (1.0, 0.4):
        grain = rng.standard_normal(image.shape[:2]).astype(np.float32)
        spread = pitch * scale * 0.4
        soft = cv2.GaussianBlur(
            grain, (0, 0), spread * rng.uniform(0.5, 1.5), sigmaY=spread * rng.uniform(0.5, 1.5)
        )
        noise += scale * soft / max(float(soft.std()), 1e-6)
    hard = rng.uniform(1.5, 12)
    dark = np.clip(0.5 + hard * (noise - rng.normal(0, 0.3)), 0, 1)
    colour = image * np.asarray(rng.uniform(0.08, 0.5) * rng.uniform(0.85, 1.15, 3), np.float32)
    if rng.random() < 0.3:
        colour = np.clip(image * rng.uniform(1.5, 3) + 20, 0, 255)
    return np.asarray(colour, np.float32), np.asarray(dark, np.float32)


def _watermark(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> Layer:
    """Words, rings and strokes, tiled over the picture, turned, half transparent."""
    height, width = image.shape[:2]
    side = int(1.5 * max(height, width))
    tile = np.zeros((side, side), np.uint8)
    word = "".join(rng.choice(_LETTERS, int(rng.integers(2, 12))))
    font, thick = int(rng.choice([0, 2, 3, 4, 6, 7])), max(1, round(pitch * rng.uniform(0.02, 0.14)))
    size = pitch / rng.uniform(22, 70)
    step = max(int(cv2.getTextSize(word, font, size, thick)[0][0] * rng.uniform(1.05, 1.6)), 8)
    for row, y in enumerate(range(0, side + int(pitch), max(6, int(pitch * rng.uniform(0.6, 1.6))))):
        for x in range(-(row % 2) * step // 2, side, step):
            cv2.putText(tile, word, (x, y), font, size, 255, thick, cv2.LINE_AA)
            if rng.random() < 0.15:
                cv2.circle(tile, (x, y), max(2, int(0.4 * pitch)), 255, thick, cv2.LINE_AA)
    angle = 0.0 if rng.random() < 0.4 else rng.uniform(-60, 60)
    turn = cv2.getRotationMatrix2D((side / 2, side / 2), angle, 1)
    turn[:, 2] += np.array([width - side, height - side]) / 2
    drawn = cv2.warpAffine(tile, turn, (width, height), flags=cv2.INTER_LINEAR)
    shade = rng.uniform(200, 255) if rng.random() < 0.7 else rng.uniform(0, 80)
    return np.full(3, shade, np.float32), np.asarray(drawn * (rng.uniform(0.25, 0.9) / 255), np.float32)


def _wall(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> Layer:
    """A wall, a desk, a hedge or a lectern up to an edge, from one side, mostly from below."""
    height, width = image.shape[:2]
    angle = rng.normal(0, 0.15) if rng.random() < 0.8 else rng.uniform(0, 2 * np.pi)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    at = near if rng.random() < 0.7 else rng.uniform(0.15, 0.85) * np.array([width, height])
    beyond = np.cos(angle) * (y - at[1]) - np.sin(angle) * (x - at[0])
    if rng.random() < 0.25:
        beyond = beyond + rng.uniform(1, 0.1 * pitch + 2) * np.sin(x / rng.uniform(2, 12) + rng.random())
    plain = _paint(rng) * np.linspace(rng.uniform(0.7, 1.1), 1, height, dtype=np.float32)[:, None, None]
    colour = behind.astype(np.float32) if rng.random() < 0.5 else plain + np.zeros_like(image, np.float32)
    return np.clip(colour, 0, 255), np.asarray(np.clip(beyond + 0.5, 0, 1), np.float32)


def _glass(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> Layer:
    """A pane that mirrors another scene, stained by drops or steam."""
    height, width = image.shape[:2]
    slope = rng.uniform(0.1, 0.65, (3, 3)).astype(np.float32)
    slope = cv2.resize(slope, (width, height), interpolation=cv2.INTER_CUBIC)
    colour = cv2.GaussianBlur(behind, (0, 0), rng.uniform(0.5, 4)).astype(np.float32)
    if rng.random() < 0.5:
        colour = 0.4 * colour + 0.6 * rng.uniform(120, 255)
    return np.asarray(colour, np.float32), np.clip(slope, 0, 0.75)


def _screen(rng: Rng, image: Picture, pitch: float, near: F64, behind: Picture) -> Layer:
    """An insect screen, a curtain, the lines of a display: fine, half transparent."""
    fine = float(rng.uniform(2, 7))
    angle, shape = float(rng.normal(0, 0.2)), image.shape[:2]
    opacity = _lines(_phase(rng, shape, fine, angle), rng.uniform(0.2, 0.6), fine)
    if rng.random() < 0.7:
        opacity = np.maximum(
            opacity, _lines(_phase(rng, shape, fine, angle + np.pi / 2), rng.uniform(0.2, 0.5), fine)
        )
    return _paint(rng), np.asarray(opacity * rng.uniform(0.4, 1), np.float32)
