"""Objects in front of a face, with exact labels: hands, mugs, microphones, phones, masks, cloth, strands of hair.

Each is a picture and an opacity, sometimes blurred by motion, and may cast a shadow on what is behind it.  Pixels of
the crop (128 x 128), x right, y down; images RGB uint8.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    CHIN,
    FOREHEAD,
    JAW,
    LEFT_MOUTH_CORNER,
    LEFT_TEMPLE,
    NOSE_BASE,
    NOSE_ROOT,
    NOSE_TIP,
    RIGHT_MOUTH_CORNER,
    RIGHT_TEMPLE,
)
from guise.common.arrays import F32, F64, I32, U8, Floating
from training.canvas import SIZE, Canvas, blend, whole
from training.parsing_labels import HAIR, OCCLUDER

Picture = U8
Rng = np.random.Generator
Layer = tuple[Picture, Picture]  # picture (128, 128, 3) and opacity (128, 128)


EXTENT_DECIMETRES = 1.2  # from the root of the nose to the chin


@dataclass(frozen=True, eq=False)
class Cutout:
    """A hand with its fingers up.

    Parameters
    ----------
    picture : (h, w, 4) uint8 RGBA
    scale : pixels per decimetre
    knuckles : (2,) pixels, their middle
    """

    picture: U8
    scale: float
    knuckles: Floating


def occluder(rng: Rng, canvas: Canvas, texture: Callable[[], Picture], hands: Sequence[Cutout]) -> None:
    """Put one object in front of the face.

    texture : gives random pictures (128, 128, 3); hands : cut-outs.
    """
    makers = [_fingers, _mug, _microphone, _card, _blob, _mask, _cloth]
    weights = np.array([0.14, 0.12, 0.12, 0.12, 0.18, 0.1, 0.08])
    if len(hands) and rng.random() < 0.6:
        picture, alpha = _hand(rng, canvas, hands[int(rng.integers(len(hands)))])
    else:
        maker = makers[int(rng.choice(len(makers), p=weights / weights.sum()))]
        picture, alpha = maker(rng, canvas, texture)
        if len(hands) and maker in (_mug, _microphone, _card) and rng.random() < 0.4:
            picture, alpha = _held(rng, picture, alpha, canvas, hands[int(rng.integers(len(hands)))])
    if rng.random() < 0.6:
        canvas.crop = _shadow(rng, canvas.crop, alpha)
    if rng.random() < 0.25:
        picture, alpha = _moved(rng, picture, alpha)
    else:
        alpha = np.asarray(cv2.GaussianBlur(alpha, (0, 0), rng.uniform(0.4, 1.2)), np.uint8)
    canvas.put(picture, alpha, OCCLUDER)


def strands_of_hair(rng: Rng, canvas: Canvas, colour: F32) -> None:
    """A few curved strands from the forehead or the temples down across the face."""
    alpha = np.zeros((SIZE, SIZE), np.uint8)
    start = canvas.points[FOREHEAD[rng.integers(len(FOREHEAD))]] + rng.normal(0, 4, 2)
    down = canvas.points[CHIN] - canvas.points[NOSE_ROOT]
    across = np.array([-down[1], down[0]])
    for _ in range(int(rng.integers(1, 12))):
        bend, reach = rng.normal(0, 0.35), rng.uniform(0.3, 1.3)
        t = np.linspace(0, 1, 12)[:, None]
        way = start + rng.normal(0, 5, 2) + reach * t * down + bend * t**2 * across
        thickness = 1 if rng.random() < 0.7 else int(rng.integers(2, 5))
        strength = int(rng.uniform(120, 255))
        cv2.polylines(alpha, [_fixed(way)], False, strength, thickness, cv2.LINE_AA, shift=4)
    shade = 1 + 0.1 * rng.normal(0, 1, (SIZE, SIZE, 1)).astype(np.float32)
    canvas.put(np.asarray(np.clip(colour * shade, 0, 255), np.uint8), alpha, HAIR)


def locks_of_hair(rng: Rng, canvas: Canvas, colour: F32) -> None:
    """Long hair beside the face, one side or both, from the temples down to the neck or the chest."""
    picture, alpha = np.zeros((SIZE, SIZE, 3), np.uint8), np.zeros((SIZE, SIZE), np.uint8)
    right, left = canvas.points[RIGHT_TEMPLE], canvas.points[LEFT_TEMPLE]
    down, sides = (
        canvas.points[CHIN] - canvas.points[NOSE_ROOT],
        ((right, right - left), (left, left - right)),
    )
    t = np.linspace(0, 1, 16)[:, None]
    reach, waves = rng.uniform(1, 2.9), rng.uniform(0, 3)
    for temple, outward in sides:
        if rng.random() < 0.2:
            continue
        bulge, drift, swing = rng.normal(0.08, 0.06), rng.normal(0.1, 0.15), rng.uniform(0, 0.05)
        for _ in range(int(rng.integers(12, 60))):
            start = temple + rng.uniform(-0.06, 0.2) * outward - rng.uniform(0, 0.7) * down
            wave = np.sin(2 * np.pi * (waves * t + rng.normal(0, 0.1)))
            aside = bulge * np.sin(np.pi * t) + drift * t**2 + swing * wave + rng.normal(0, 0.03) * t
            way = start + t * rng.uniform(0.8, 1.1) * reach * down + aside * outward
            thickness = max(1, round(float(np.linalg.norm(outward)) * rng.uniform(0.01, 0.07)))
            shade = tuple(int(c) for c in np.clip(colour * rng.uniform(0.55, 1.25), 0, 255))
            for layer, value in ((picture, shade), (alpha, 255)):
                cv2.polylines(layer, [_fixed(way)], False, value, thickness, cv2.LINE_AA, shift=4)
    middle = canvas.points.mean(0)
    cv2.fillConvexPoly(alpha, whole(cv2.convexHull(middle + 0.97 * (canvas.points - middle))), 0)
    canvas.put(picture, np.asarray(cv2.GaussianBlur(alpha, (0, 0), 0.5), np.uint8), HAIR)


# -- the objects --------------------------------------------------------------------------------------------------


def _somewhere(rng: Rng, canvas: Canvas) -> F64:
    return np.asarray(canvas.points[int(rng.integers(len(canvas.points)))] + rng.normal(0, 0.08, 2) * SIZE)


def _extent(canvas: Canvas) -> float:
    """Distance from the eyes' middle to the chin, pixels: how large things are drawn."""
    return float(np.linalg.norm(canvas.points[CHIN] - canvas.points[NOSE_ROOT])) + 1e-6


def _held(rng: Rng, thing: Picture, alpha: Picture, canvas: Canvas, cutout: Cutout) -> Layer:
    """The thing with a hand on it."""
    rows, columns = np.nonzero(alpha > 128)
    if not len(rows):
        return thing, alpha
    at = int(rng.integers(len(rows)))
    hand, cover = _hand(rng, canvas, cutout, np.array([columns[at], rows[at]], np.float64))
    return blend(thing, hand, cover), np.maximum(alpha, cover)


def _hand(rng: Rng, canvas: Canvas, cutout: Cutout, place: F64 | None = None) -> Layer:
    """A rendered hand, as large as it is before the face, at `place` or anywhere on it, in its colours for most."""
    scale = _extent(canvas) / EXTENT_DECIMETRES * rng.uniform(0.8, 1.45) / cutout.scale
    angle = np.radians(rng.uniform(-180, 180) if rng.random() < 0.3 else rng.normal(0, 35))
    cos, sin = scale * np.cos(angle), scale * np.sin(angle)
    linear = np.array([[cos, -sin], [sin, cos]])
    if rng.random() < 0.5:
        linear = linear @ np.diag([-1.0, 1.0])
    along = rng.uniform(-0.3, 0.9) * cutout.scale  # fingers lie above the knuckles
    anchor = cutout.knuckles - (0, along)
    place = _somewhere(rng, canvas) if place is None else place
    matrix = np.column_stack([linear, place - linear @ anchor])
    flags = cv2.INTER_AREA if scale < 0.5 else cv2.INTER_LINEAR
    warped = cv2.warpAffine(cutout.picture, matrix, (SIZE, SIZE), flags=flags)
    picture, alpha = warped[..., :3], warped[..., 3]
    if rng.random() < 0.75:
        picture = _in_colours_of(rng, picture, alpha, canvas)
    return np.ascontiguousarray(picture), np.ascontiguousarray(alpha)


def _in_colours_of(rng: Rng, picture: Picture, alpha: Picture, canvas: Canvas) -> Picture:
    """The picture with the mean colour of the face's middle, more or less."""
    y, x = np.clip(canvas.points[NOSE_TIP][::-1], 4, SIZE - 5).astype(int)
    face = canvas.crop[y - 4 : y + 5, x - 4 : x + 5].reshape(-1, 3).mean(0)
    inside = alpha > 128
    own = picture[inside].mean(0) if inside.any() else np.full(3, 128.0)
    gain = np.clip(face / np.maximum(own, 1), 0.2, 5) * rng.uniform(0.75, 1.25)
    return np.asarray(np.clip(picture * gain, 0, 255), np.uint8)


def _skin(rng: Rng, canvas: Canvas) -> F64:
    y, x = np.clip(canvas.points[NOSE_TIP][::-1], 0, SIZE - 1).astype(int)
    return np.asarray(canvas.crop[y, x] * rng.uniform(0.7, 1.2), np.float64)


def _fingers(rng: Rng, canvas: Canvas, texture: Callable[[], Picture]) -> Layer:
    """A few rounded, shaded fingers side by side."""
    extent, centre, direction = _extent(canvas), _somewhere(rng, canvas), rng.uniform(0, 2 * np.pi)
    width = extent * rng.uniform(0.12, 0.2)
    colour = _skin(rng, canvas) if rng.random() < 0.75 else rng.uniform(0, 255, 3)
    picture, alpha = np.zeros((SIZE, SIZE, 3), np.uint8), np.zeros((SIZE, SIZE), np.uint8)
    for k in range(int(rng.integers(1, 5))):
        direction += rng.normal(0, 0.12)
        along = np.array([np.cos(direction), np.sin(direction)])
        side = np.array([-along[1], along[0]])
        tip = centre + k * width * rng.uniform(0.95, 1.15) * side + rng.normal(0, 0.15) * width * along
        root = tip + extent * rng.uniform(1.0, 2.0) * along
        for layer in range(5):
            shade = tuple(int(c) for c in np.clip(colour * (0.6 + 0.1 * layer), 0, 255))
            thickness = max(1, round(width * (1 - 0.2 * layer)))
            ends = _fixed(np.stack([tip, root]))
            cv2.polylines(picture, [ends], False, shade, thickness, cv2.LINE_AA, shift=4)
        cv2.polylines(
            alpha, [_fixed(np.stack([tip, root]))], False, 255, max(1, round(width)), cv2.LINE_AA, shift=4
        )
    return picture, alpha


def _mug(rng: Rng, canvas: Canvas, texture: Callable[[], Picture]) -> Layer:
    """An upright shaded cylinder with a handle, in front of mouth and chin."""
    extent = _extent(canvas)
    mouth = (canvas.points[RIGHT_MOUTH_CORNER] + canvas.points[LEFT_MOUTH_CORNER]) / 2 + rng.normal(
        0, 0.25, 2
    ) * extent
    width, height = extent * rng.uniform(0.5, 1.1), extent * rng.uniform(0.6, 1.3)
    frame = mouth + _turned(rng, np.array([[-1, 0], [1, 0], [0.9, 1], [-0.9, 1]]) * (width / 2, height), 0.25)
    alpha = np.zeros((SIZE, SIZE), np.uint8)
    cv2.fillPoly(alpha, [_fixed(frame)], 255, cv2.LINE_AA, 4)
    rim = (frame[0] + frame[1]) / 2
    cv2.ellipse(
        alpha, _pixel(rim), (max(1, int(width / 2)), max(1, int(width / 7))), 0, 0, 360, 255, -1, cv2.LINE_AA
    )
    middle = (frame[1] + frame[2]) / 2
    cv2.circle(
        alpha, _pixel(middle), max(2, int(0.28 * height)), 255, max(2, int(0.09 * height)), cv2.LINE_AA
    )
    across = np.linspace(-1, 1, SIZE)[None, :, None]
    shade = np.clip(1.1 - 0.6 * np.roll(across, int(rng.integers(SIZE)), 1) ** 2, 0.3, 1.2)
    return np.asarray(np.clip(_filled(rng, texture) * shade, 0, 255), np.uint8), alpha


def _microphone(rng: Rng, canvas: Canvas, texture: Callable[[], Picture]) -> Layer:
    """A dark or coloured ball on a rod that comes from below or the side."""
    extent = _extent(canvas)
    mouth = (canvas.points[RIGHT_MOUTH_CORNER] + canvas.points[LEFT_MOUTH_CORNER]) / 2
    head = mouth + rng.normal(0, 0.3, 2) * extent
    radius = extent * rng.uniform(0.1, 0.32)
    angle = rng.normal(np.pi / 2, 0.6)
    foot = head + 3 * extent * np.array([np.cos(angle), np.sin(angle)])
    alpha = np.zeros((SIZE, SIZE), np.uint8)
    rod = max(1, round(radius * rng.uniform(0.25, 1.1)))
    cv2.line(alpha, _pixel(head), _pixel(foot), 255, rod, cv2.LINE_AA)
    axes = (max(1, int(radius)), max(1, int(radius * rng.uniform(1, 1.5))))
    cv2.ellipse(alpha, _pixel(head), axes, float(np.degrees(angle) - 90), 0, 360, 255, -1, cv2.LINE_AA)
    grey = rng.uniform(10, 110) if rng.random() < 0.8 else rng.uniform(0, 255)
    grain = rng.normal(0, rng.uniform(2, 25), (SIZE, SIZE, 1))
    ys, xs = np.mgrid[:SIZE, :SIZE] - head[::-1][:, None, None]
    light = np.exp(-((xs + 0.4 * radius) ** 2 + (ys + 0.4 * radius) ** 2) / (0.5 * radius**2))[..., None]
    tint = rng.uniform(0.8, 1.2, 3)
    return np.asarray(np.clip((grey + grain + 70 * light) * tint, 0, 255), np.uint8), alpha


def _card(rng: Rng, canvas: Canvas, texture: Callable[[], Picture]) -> Layer:
    """A phone, a book, a sheet of paper: a flat quadrilateral."""
    extent = _extent(canvas)
    size = extent * np.array([rng.uniform(0.3, 1.3), rng.uniform(0.4, 1.6)]) / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size
    frame = _somewhere(rng, canvas) + _turned(rng, corners, 0.6) + rng.normal(0, 0.05, (4, 2)) * extent
    alpha = np.zeros((SIZE, SIZE), np.uint8)
    cv2.fillPoly(alpha, [_fixed(frame)], 255, cv2.LINE_AA, 4)
    return _filled(rng, texture), alpha


def _blob(rng: Rng, canvas: Canvas, texture: Callable[[], Picture]) -> Layer:
    """A random textured cut-out, round or cornered."""
    alpha, extent, centre = np.zeros((SIZE, SIZE), np.uint8), _extent(canvas), _somewhere(rng, canvas)
    if rng.random() < 0.5:
        angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(5, 14))))
        reach = extent * rng.uniform(0.12, 0.7) * rng.uniform(0.5, 1.3, len(angles))
        outline = centre + reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        cv2.fillPoly(alpha, [_fixed(outline)], 255, cv2.LINE_AA, 4)
    else:
        axes = tuple(max(1, int(a)) for a in rng.uniform(0.08, 0.55, 2) * extent)
        cv2.ellipse(alpha, _pixel(centre), axes, rng.uniform(0, 180), 0, 360, 255, -1, cv2.LINE_AA)
    if rng.random() < 0.35:  # of skin, as an elbow or somebody's head is: darker towards its rim
        grain = rng.normal(1, 0.12, (SIZE, SIZE)).astype(np.float32)
        soft = cv2.GaussianBlur(grain, (0, 0), rng.uniform(0.5, 3))
        relief = cv2.GaussianBlur(alpha, (0, 0), 0.08 * extent).astype(np.float32) / 255
        shade = soft * (rng.uniform(0.3, 0.8) + 0.5 * relief)
        return np.asarray(np.clip(_skin(rng, canvas) * shade[..., None], 0, 255), np.uint8), alpha
    return _filled(rng, texture), alpha


def _mask(rng: Rng, canvas: Canvas, texture: Callable[[], Picture]) -> Layer:
    """A mask or a scarf over nose or mouth and chin."""
    p = canvas.points
    top = p[NOSE_ROOT] + rng.uniform(0.3, 1.1) * (p[NOSE_BASE] - p[NOSE_ROOT])
    first = int(rng.integers(1, 4))
    jaw = p[JAW][first : len(JAW) - first] + rng.uniform(0, 0.12) * (p[CHIN] - p[NOSE_BASE])
    alpha = np.zeros((SIZE, SIZE), np.uint8)
    cv2.fillPoly(alpha, [_fixed(np.vstack([jaw, top]))], 255, cv2.LINE_AA, 4)
    if rng.random() < 0.4:
        picture = _filled(rng, texture)
    else:
        colour = (
            (235, 240, 245) if rng.random() < 0.4 else (120, 190, 215) if rng.random() < 0.5 else (25, 25, 28)
        )
        folds = cv2.GaussianBlur(
            rng.normal(0, 1, (SIZE, SIZE)).astype(np.float32), (0, 0), sigmaX=14, sigmaY=2.5
        )
        picture = np.asarray(np.clip(np.array(colour) * (0.9 + 1.2 * folds[..., None]), 0, 255), np.uint8)
    return picture, alpha


def _cloth(rng: Rng, canvas: Canvas, texture: Callable[[], Picture]) -> Layer:
    """Something large that comes in from one side: a door, a shoulder, a curtain, an arm."""
    angle = rng.uniform(0, 2 * np.pi)
    normal = np.array([np.cos(angle), np.sin(angle)])
    edge = _somewhere(rng, canvas) + rng.uniform(0, 0.5) * _extent(canvas) * normal
    ys, xs = np.mgrid[:SIZE, :SIZE].astype(np.float32)
    bend = 8 * rng.random() * np.sin((xs * -normal[1] + ys * normal[0]) / rng.uniform(8, 40))
    side = (xs - edge[0]) * normal[0] + (ys - edge[1]) * normal[1] + bend
    return _filled(rng, texture), np.asarray(np.clip(side * 255, 0, 255), np.uint8)


# -- texture, shadow, motion --------------------------------------------------------------------------------------


def _filled(rng: Rng, texture: Callable[[], Picture]) -> Picture:
    """A random picture, or one colour with a soft shade over it."""
    if rng.random() < 0.6:
        return texture()
    slope = np.linspace(rng.uniform(0.6, 1), rng.uniform(0.8, 1.3), SIZE)
    shade = slope[:, None, None] if rng.random() < 0.5 else slope[None, :, None]
    return np.asarray(np.clip(rng.uniform(0, 255, 3) * shade + np.zeros((SIZE, SIZE, 3)), 0, 255), np.uint8)


def _shadow(rng: Rng, crop: Picture, alpha: Picture) -> Picture:
    """The crop darkened beside what is opaque, softly."""
    move = np.array([[1, 0, rng.normal(0, 4)], [0, 1, rng.uniform(-1, 7)]])
    shade = cv2.GaussianBlur(cv2.warpAffine(alpha, move, (SIZE, SIZE)), (0, 0), rng.uniform(1, 6))
    return blend(crop, np.zeros_like(crop), np.asarray(shade * rng.uniform(0.15, 0.65), np.uint8))


def _moved(rng: Rng, picture: Picture, alpha: Picture) -> Layer:
    """Motion blur along a random direction; colours bleed only where something is."""
    length = int(rng.integers(3, 16))
    kernel = np.zeros((length, length), np.float32)
    half, angle = (length - 1) / 2, rng.uniform(0, np.pi)
    reach = half * np.array([np.cos(angle), np.sin(angle)])
    cv2.line(kernel, _pixel(half - reach), _pixel(half + reach), 1.0)
    kernel /= kernel.sum()
    weight = alpha.astype(np.float32) / 255
    soft = cv2.filter2D(weight, -1, kernel)
    colour = cv2.filter2D(picture * weight[..., None], -1, kernel) / np.maximum(soft, 1e-3)[..., None]
    return np.asarray(np.clip(colour, 0, 255), np.uint8), np.asarray(np.clip(soft * 255, 0, 255), np.uint8)


def _turned(rng: Rng, corners: F64, spread: float) -> F64:
    angle = rng.normal(0, spread)
    cos, sin = np.cos(angle), np.sin(angle)
    return np.asarray(corners @ np.array([[cos, sin], [-sin, cos]]))


def _fixed(points: Floating) -> I32:
    """Points for OpenCV's drawing with four fractional bits."""
    return np.round(np.asarray(points) * 16).astype(np.int32)


def _pixel(point: Floating) -> tuple[int, int]:
    x, y = np.round(np.asarray(point)).astype(int)
    return int(x), int(y)
