"""One training sample of the landmarker from a picture: crop, background, objects in front of the face, light, camera.

Everything is random and comes from the generator that is given, so a seed gives the same samples. Pixels, x right,
y down, pixel centres at integers; images RGB uint8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    BROWS,
    CHIN,
    FOREHEAD,
    HAIRLINE,
    JAW,
    LEFT_EYE,
    LEFT_MOUTH_CORNER,
    LEFT_NOSTRIL,
    LEFT_TEMPLE,
    MIRROR,
    NOSE_BASE,
    NOSE_ROOT,
    OUTER_LIPS,
    RIGHT_EYE,
    RIGHT_MOUTH_CORNER,
    RIGHT_NOSTRIL,
    RIGHT_TEMPLE,
    UPPER_LIP_TOP,
)
from guise.aam.parsing import FACE_FRAMING, HEAD_FRAMING, Framing
from guise.common.arrays import F32, F64, U8, Bool
from training.canvas import SIZE, Canvas, blend, class_maps, possible_maps, whole
from training.data import Labelled
from training.occluders import Cutout, locks_of_hair, occluder, strands_of_hair
from training.parsing_labels import BACKGROUND, FACIAL_HAIR, GLASSES, HAIR, OCCLUDER

# Standard deviations of plain crops.
PLAIN_TURN_DEGREES = 4.0
PLAIN_LOG_SIZE = 0.05
PLAIN_SHIFT_CROP_SIDES = 0.025

Picture = U8
Rng = np.random.Generator


@dataclass(frozen=True)
class Strength:
    """How far the crop is off its place: standard deviations of turn, log size and shift."""

    turn: float = 18.0
    size: float = 0.11
    shift: float = 0.055
    wild: float = 0.2  # share of samples that are turned by up to 60 degrees
    hidden: float = 0.42  # share of samples with an object in front of the face
    hair: float = 0.0  # share of samples with hair of another colour, and of those with longer hair
    framing: Framing = FACE_FRAMING


# Crops of faces that are mostly upright and in sight.
NEARLY_PLAIN = Strength(turn=9.0, size=0.09, shift=0.04, wild=0.08, hidden=0.2)
# What the crops of a face that is being followed are like, where parsing is asked for.
FOLLOWED = Strength(turn=9.0, size=0.1, shift=0.045, wild=0.06, hidden=0.62)
# Likewise, of whole heads.
HEADS = Strength(turn=9.0, size=0.14, shift=0.04, wild=0.04, hidden=0.35, hair=0.35, framing=HEAD_FRAMING)


@dataclass(frozen=True, eq=False)
class Props:
    """What may appear behind and in front of a face.

    backgrounds : (m, s, s, 3) uint8
    hands : cut-outs of rendered hands; may be empty
    """

    backgrounds: U8
    hands: Sequence[Cutout] = ()


@dataclass(frozen=True, eq=False)
class Sample:
    """A crop with its ground truth, in pixels of the crop.

    Parameters
    ----------
    crop : (128, 128, 3) uint8
    points, seen : (81, 2) float32, (81,) bool
    iris, iris_seen : (2, 3) float32 centre and radius, (2,) bool
    maps : (classes, 64, 64) float32
        Share of each class in a cell if `exact`, otherwise 1 for the classes that a cell may show.
    exact : bool
    """

    crop: Picture
    points: F32
    seen: Bool
    iris: F32
    iris_seen: Bool
    maps: F32
    exact: bool


def sample(rng: Rng, face: Labelled, props: Props, strength: Strength = Strength()) -> Sample:
    """A random crop around a face, with random background, objects in front, light and camera."""
    matrix, mirrored = crop_matrix(rng, face.points, strength)
    canvas = _start(rng, face, matrix, mirrored)
    if face.mask is not None and rng.random() < 0.75:
        alpha = cv2.warpAffine(face.mask * np.uint8(255), matrix, (SIZE, SIZE))
        canvas.crop = _before(rng, canvas.crop, alpha, props.backgrounds)
    if canvas.exact and rng.random() < strength.hair:
        _dye(rng, canvas)
    if canvas.exact and rng.random() < strength.hair:
        locks_of_hair(rng, canvas, _hair_of(canvas) if rng.random() < 0.8 else _colour_of_hair(rng))
    _things(rng, canvas, props, strength.hidden)
    canvas.crop = camera(rng, light(rng, canvas.crop))
    _cut(rng, canvas)
    return canvas.finish()


def plain(rng: Rng, face: Labelled, props: Props | None = None, framing: Framing = FACE_FRAMING) -> Sample:
    """A crop as a good detector would give it, for measurements: unchanged, or with one occluder from `props`."""
    canvas = _plain(rng, face, rng.normal(0, PLAIN_TURN_DEGREES), framing)
    if props is not None:
        occluder(rng, canvas, lambda: background(rng, props.backgrounds), props.hands)
    return canvas.finish()


def turned(rng: Rng, face: Labelled, degrees: float) -> Sample:
    """A crop as a detector would give it, with the face turned clockwise."""
    return _plain(rng, face, degrees).finish()


def _plain(rng: Rng, face: Labelled, degrees: float, framing: Framing = FACE_FRAMING) -> Canvas:
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    side = framing.side * float(np.ptp(face.points @ turn.T, axis=0).max())
    linear = SIZE / side * np.exp(rng.normal(0, PLAIN_LOG_SIZE)) * turn
    middle = (face.points.min(0) + face.points.max(0)) / 2
    shift = _middle(framing) + rng.normal(0, PLAIN_SHIFT_CROP_SIDES, 2) * SIZE - linear @ middle
    return _start(rng, face, np.column_stack([linear, shift]), mirrored=False)


def _middle(framing: Framing) -> F64:
    """Where the middle of a face lies in a crop, pixels."""
    return (SIZE - 1) / 2 - np.array([0, framing.drop / framing.side * SIZE])


def _start(rng: Rng, face: Labelled, matrix: F64, mirrored: bool) -> Canvas:
    points = face.points @ matrix[:, :2].T + matrix[:, 2]
    visible = face.visible.copy()
    scale = float(np.sqrt(abs(np.linalg.det(matrix[:, :2]))))
    iris = np.zeros((2, 3), np.float32)
    if face.iris is not None:
        iris = np.column_stack([face.iris[:, :2] @ matrix[:, :2].T + matrix[:, 2], face.iris[:, 2] * scale])
    if mirrored:
        points, visible, iris = points[list(MIRROR)], visible[list(MIRROR)], iris[::-1]
    border = cv2.BORDER_REPLICATE if rng.random() < 0.5 else cv2.BORDER_REFLECT_101
    crop = cv2.warpAffine(face.image, matrix, (SIZE, SIZE), flags=cv2.INTER_LINEAR, borderMode=border)
    points = np.asarray(points, np.float32)
    exact = face.labels is not None
    maps = class_maps(face.labels, len(face.image), matrix, border) if exact else possible_maps(points)
    return Canvas(
        np.asarray(crop, np.uint8),
        points,
        visible,
        np.asarray(iris, np.float32),
        face.iris is not None,
        maps,
        exact,
    )


def negative(rng: Rng, image: Picture, points: F32, backgrounds: U8) -> Picture:
    """A crop (128, 128, 3) that shows no face, or too little or too much of one to be called found."""
    if rng.random() < 0.7:
        crop = background(rng, backgrounds)
    else:
        matrix, _ = crop_matrix(rng, points, Strength())
        if rng.random() < 0.6:  # beside the face
            angle = rng.uniform(0, 2 * np.pi)
            matrix[:, 2] += rng.uniform(0.75, 1.1) * SIZE * np.array([np.cos(angle), np.sin(angle)])
        elif rng.random() < 0.5:  # a part of it
            zoom, centre = rng.uniform(2.2, 5), rng.uniform(0.25, 0.75, 2) * SIZE
            matrix = np.column_stack([zoom * matrix[:, :2], zoom * (matrix[:, 2] - centre) + SIZE / 2])
        else:  # far away
            zoom = rng.uniform(0.15, 0.4)
            matrix = np.column_stack(
                [zoom * matrix[:, :2], zoom * (matrix[:, 2] - SIZE / 2) + rng.uniform(0.2, 0.8, 2) * SIZE]
            )
        crop = cv2.warpAffine(
            image, matrix, (SIZE, SIZE), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
        )
        if rng.random() < 0.3:
            crop = crop[::-1]
    return camera(rng, light(rng, np.ascontiguousarray(crop, np.uint8)))


def crop_matrix(rng: Rng, points: F32, strength: Strength) -> tuple[F64, bool]:
    """Affine (2, 3) from pixels of the picture to those of the crop, and whether it mirrors."""
    low, high = points.min(0), points.max(0)
    side = strength.framing.side * float((high - low).max())
    angle = rng.normal(0, strength.turn) if rng.random() > strength.wild else rng.uniform(-60, 60)
    scale = SIZE / side * float(np.exp(rng.normal(0, strength.size)))
    shift = rng.normal(0, strength.shift, 2) * SIZE
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    linear = scale * np.array([[cos, -sin], [sin, cos]])
    mirrored = bool(rng.random() < 0.5)
    if mirrored:
        linear = linear @ np.diag([-1.0, 1.0])
    return np.column_stack([linear, _middle(strength.framing) + shift - linear @ (low + high) / 2]), mirrored


def background(rng: Rng, backgrounds: U8) -> Picture:
    """A random part (128, 128, 3) of a random background."""
    picture = backgrounds[int(rng.integers(len(backgrounds)))]
    size = picture.shape[0]
    side = int(rng.uniform(0.3, 1) * size)
    x, y = rng.integers(0, size - side + 1, 2)
    part = picture[y : y + side, x : x + side]
    if rng.random() < 0.5:
        part = part[:, ::-1]
    if rng.random() < 0.3:
        part = np.rot90(part, int(rng.integers(1, 4)))
    interpolation = cv2.INTER_AREA if side > SIZE else cv2.INTER_LINEAR
    return np.asarray(
        cv2.resize(np.ascontiguousarray(part), (SIZE, SIZE), interpolation=interpolation), np.uint8
    )


def _before(rng: Rng, crop: Picture, alpha: Picture, backgrounds: U8) -> Picture:
    if rng.random() < 0.15:
        behind = np.empty_like(crop)
        behind[:] = rng.integers(0, 256, 3)
    else:
        behind = background(rng, backgrounds)
    if rng.random() < 0.3:
        alpha = np.asarray(cv2.GaussianBlur(alpha, (0, 0), rng.uniform(0.5, 1.5)), np.uint8)
    return blend(behind, crop, alpha)


# -- on or in front of the face ------------------------------------------------------------------------------------


def _things(rng: Rng, canvas: Canvas, props: Props, hidden: float) -> None:
    if rng.random() < 0.08:
        _beard(rng, canvas)
    if rng.random() < 0.15:
        _glasses(rng, canvas)
    if rng.random() < 0.12:
        _fringe(rng, canvas)
    if rng.random() < 0.12:
        strands_of_hair(rng, canvas, _colour_of_hair(rng))
    if rng.random() < hidden:
        for _ in range(1 if rng.random() < 0.75 else 2):
            occluder(rng, canvas, lambda: background(rng, props.backgrounds), props.hands)


def _colour_of_hair(rng: Rng) -> F32:
    base = np.array(
        [[12, 10, 9], [45, 30, 20], [90, 62, 40], [150, 115, 75], [120, 118, 115], [205, 200, 195]],
        np.float32,
    )
    return np.asarray(base[int(rng.integers(len(base)))] * rng.uniform(0.7, 1.25), np.float32)


def _strands(rng: Rng) -> F32:
    """Hair-like noise (128, 128), mean 1."""
    noise = rng.normal(0, 1, (SIZE, SIZE)).astype(np.float32)
    along = cv2.GaussianBlur(noise, (0, 0), sigmaX=0.7, sigmaY=rng.uniform(2, 6))
    return np.asarray(1 + 0.28 * along / (along.std() + 1e-6), np.float32)


def _hair_over(rng: Rng, canvas: Canvas, area: Picture, softness: float, most: float, kind: int) -> None:
    crop, soft = canvas.crop, np.asarray(cv2.GaussianBlur(area, (0, 0), softness), np.uint8)
    alpha = soft.astype(np.float32) / 255 * most
    hair = np.clip(_strands(rng)[..., None] * _colour_of_hair(rng), 0, 255)
    shade = np.clip(crop.mean(2, keepdims=True) / 140, 0.35, 1.3)
    mixed = crop * (1 - alpha[..., None]) + hair * shade * alpha[..., None]
    canvas.crop = np.asarray(np.clip(mixed, 0, 255), np.uint8)
    canvas.cover(np.asarray(soft * min(1.0, 1.4 * most), np.uint8), kind)


def _hair_of(canvas: Canvas) -> F32:
    """Mean colour (3,) of the hair; dark without any."""
    share = cv2.resize(canvas.maps[HAIR], (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)[..., None]
    return np.asarray((canvas.crop * share).sum((0, 1)) / max(float(share.sum()), 100.0), np.float32)


def _dye(rng: Rng, canvas: Canvas) -> None:
    """Give the hair another colour, as light and as dark in parts as it was."""
    share = cv2.resize(canvas.maps[HAIR], (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)[..., None]
    factor = np.clip(_colour_of_hair(rng) / np.maximum(_hair_of(canvas), 4), 0.1, 8)
    canvas.crop = np.asarray(np.clip(canvas.crop * (1 + share * (factor - 1)), 0, 255), np.uint8)


def _beard(rng: Rng, canvas: Canvas) -> None:
    """A beard or moustache: hair over the lower face, the lips left out."""
    points, area = canvas.points, np.zeros((SIZE, SIZE), np.uint8)
    start = int(rng.integers(1, 4))
    jaw = points[JAW][start : len(JAW) - start]
    drop = rng.uniform(0, 0.12) * (points[CHIN] - points[NOSE_BASE])
    upper = points[NOSE_BASE] * rng.uniform(0.35, 0.65)
    lip = upper + (1 - rng.uniform(0.35, 0.65)) * points[UPPER_LIP_TOP]
    kind = rng.random()
    if kind < 0.7:
        chain = np.concatenate([jaw + drop, [points[LEFT_MOUTH_CORNER]], [lip], [points[RIGHT_MOUTH_CORNER]]])
    else:
        chain = np.array(
            [
                points[RIGHT_MOUTH_CORNER],
                points[RIGHT_NOSTRIL],
                points[LEFT_NOSTRIL],
                points[LEFT_MOUTH_CORNER],
                points[UPPER_LIP_TOP],
            ]
        )
    cv2.fillPoly(area, [whole(chain)], 255)
    cv2.fillPoly(area, [whole(points[OUTER_LIPS])], 0)
    _hair_over(rng, canvas, area, rng.uniform(1, 3), rng.uniform(0.5, 0.95), FACIAL_HAIR)


def _fringe(rng: Rng, canvas: Canvas) -> None:
    """Hair, a cap or a headscarf from above down to somewhere between the hairline and the lids."""
    forehead, brows = canvas.points[FOREHEAD], canvas.points[BROWS]
    up = canvas.points[HAIRLINE] - canvas.points[NOSE_ROOT]
    depth = rng.uniform(0.1, 1.0)
    towards = np.linspace(brows[0], brows[9], 13)
    edge = forehead + depth * (towards - forehead) + rng.normal(0, 0.06, (13, 1)) * up
    area = np.zeros((SIZE, SIZE), np.uint8)
    cv2.fillPoly(area, [whole(np.concatenate([edge, (forehead + 0.9 * up)[::-1]]))], 255)
    if rng.random() < 0.75:
        _hair_over(rng, canvas, area, rng.uniform(0.7, 3), rng.uniform(0.7, 1), HAIR)
        return
    cloth = np.empty_like(canvas.crop)
    cloth[:] = rng.integers(0, 256, 3)
    canvas.put(cloth, np.asarray(cv2.GaussianBlur(area, (0, 0), 0.7), np.uint8), OCCLUDER)


def _glasses(rng: Rng, canvas: Canvas) -> None:
    """Frames with bridge and temples, lenses clear, tinted or dark, perhaps with a reflection."""
    points, out = canvas.points, canvas.crop.copy()
    right, left = points[RIGHT_EYE], points[LEFT_EYE]
    across = left.mean(0) - right.mean(0)
    gap = float(np.linalg.norm(across)) + 1e-6
    colour = tuple(
        int(c) for c in (rng.integers(0, 60, 3) if rng.random() < 0.7 else rng.integers(0, 256, 3))
    )
    thick = max(1, round(gap * rng.uniform(0.02, 0.09)))
    height = rng.uniform(0.24, 0.42) * gap
    round_ = rng.random() < 0.5
    lens_colour = rng.integers(0, 90, 3)
    tint = rng.uniform(0.6, 0.98) if rng.random() < 0.2 else rng.uniform(0, 0.25)
    drop = rng.uniform(0, 0.1) * gap * np.array([-across[1], across[0]]) / gap
    angle = float(np.arctan2(across[1], across[0]))
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    lens = np.zeros((SIZE, SIZE), np.uint8)
    rims = []
    for eye in (right, left):
        width = min(1.75 * float(np.linalg.norm(eye[3] - eye[0])), 0.9 * gap)
        rims.append(_rim(width, height, round_) @ rotation.T + eye.mean(0) + drop)
        cv2.fillPoly(lens, [whole(rims[-1])], 255)
    dark = np.empty_like(out)
    dark[:] = lens_colour
    tinted = np.asarray(lens * tint, np.uint8)
    canvas.crop = blend(out, dark, tinted)
    if tint > 0.5:
        canvas.cover(tinted, GLASSES)
    if rng.random() < 0.35:
        _reflect(rng, canvas, lens, rims[int(rng.integers(2))].mean(0), gap)
    frame = _frame(rims, (points[RIGHT_TEMPLE], points[LEFT_TEMPLE]), thick)
    canvas.put(np.full_like(out, colour), frame, GLASSES)


def _rim(width: float, height: float, round_: bool) -> Any:
    """(n, 2) outline of an upright lens about its middle: an ellipse, or a box that narrows below."""
    if round_:
        return cv2.ellipse2Poly((0, 0), (max(2, round(width / 2)), max(2, round(height / 2))), 0, 0, 360, 15)
    w, h = width / 2, height / 2
    return np.array([[-w, -h], [w, -h], [0.85 * w, h], [-0.85 * w, h]])


def _reflect(rng: Rng, canvas: Canvas, lens: Picture, middle: Any, gap: float) -> None:
    """A bright spot on the lenses (128, 128), near the middle (2,) of one."""
    glare = np.zeros((SIZE, SIZE), np.uint8)
    place = middle + rng.normal(0, 0.1 * gap, 2)
    axes = (max(1, int(0.2 * gap)), max(1, int(0.08 * gap)))
    cv2.ellipse(glare, tuple(map(int, place)), axes, rng.uniform(0, 180), 0, 360, 255, -1)
    glare = np.asarray(
        cv2.GaussianBlur(cv2.bitwise_and(glare, lens), (0, 0), 1.2) * rng.uniform(0.3, 0.9), np.uint8
    )
    canvas.crop = blend(canvas.crop, np.full_like(canvas.crop, 250), glare)
    canvas.cover(np.where(glare > 127, glare, np.uint8(0)), GLASSES)


def _frame(rims: Sequence[Any], ears: Sequence[Any], thick: int) -> Picture:
    """Alpha (128, 128) of rims (n, 2), right and left, the bridge between them and temples to the ears (2,)."""
    frame = np.zeros((SIZE, SIZE), np.uint8)
    for rim in rims:
        cv2.polylines(frame, [whole(rim)], True, 255, thick, cv2.LINE_AA)
    inner = rims[0][rims[0][:, 0].argmax()], rims[1][rims[1][:, 0].argmin()]
    cv2.line(frame, *(tuple(map(int, p)) for p in inner), 255, thick, cv2.LINE_AA)
    for rim, ear in zip(rims, ears, strict=True):
        outer = rim[np.linalg.norm(rim - ear, axis=1).argmin()]
        cv2.line(frame, tuple(map(int, outer)), tuple(map(int, ear)), 255, thick, cv2.LINE_AA)
    return frame


def _cut(rng: Rng, canvas: Canvas) -> None:
    """The picture ends within the crop: black beyond, as the landmarker fills it."""
    if rng.random() > 0.15:
        return
    amount = rng.uniform(0.05, 0.42)
    across, start = int(rng.integers(2)), rng.random() < 0.5
    edge = int(amount * SIZE) if start else int((1 - amount) * SIZE)
    part = slice(0, edge) if start else slice(edge, SIZE)
    beyond = np.zeros((SIZE, SIZE), np.uint8)
    beyond[(slice(None), part) if across == 0 else part] = 255
    canvas.put(np.zeros_like(canvas.crop), beyond, BACKGROUND)


# -- light and camera ---------------------------------------------------------------------------------------------


def light(rng: Rng, crop: Picture) -> Picture:
    """Uneven light, shadow edges, patches, gamma, gain and white balance, saturation, mixed channels, grey."""
    if rng.random() < 0.4:
        coarse = rng.normal(0, rng.uniform(0.1, 0.5), (3, 3, 1)).astype(np.float32)
        if rng.random() < 0.3:
            coarse = coarse + rng.normal(0, 0.1, (3, 3, 3)).astype(np.float32)
        field = np.exp(cv2.resize(coarse, (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)).reshape(
            SIZE, SIZE, -1
        )
        crop = np.asarray(np.clip(crop * field, 0, 255), np.uint8)
    if rng.random() < 0.14:
        angle = rng.uniform(0, 2 * np.pi)
        ys, xs = np.mgrid[:SIZE, :SIZE].astype(np.float32) / SIZE - 0.5
        side = np.cos(angle) * xs + np.sin(angle) * ys - rng.uniform(-0.3, 0.3)
        shade = 1 - rng.uniform(0.2, 0.7) / (1 + np.exp(-side * rng.uniform(10, 120)))
        crop = np.asarray(crop * shade[..., None], np.uint8)
    if rng.random() < 0.14:
        crop = _patches(rng, crop)
    levels = np.arange(256, dtype=np.float32)[:, None] / 255
    gamma = np.exp(rng.normal(0, 0.25)) * np.exp(rng.normal(0, 0.05, 3))
    gain = np.exp(rng.normal(0, 0.18)) * np.exp(rng.normal(0, 0.08, 3))
    if rng.random() < 0.1:  # dark, or under coloured lamps
        gain = gain * rng.uniform(0.25, 0.8) * np.exp(rng.normal(0, 0.25, 3))
    black = rng.uniform(-0.06, 0.1) if rng.random() < 0.4 else 0.0
    table = np.clip((levels**gamma * gain) * (1 - black) + black, 0, 1) * 255
    crop = np.asarray(cv2.LUT(crop, np.asarray(table + 0.5, np.uint8).reshape(1, 256, 3)), np.uint8)
    if rng.random() < 0.12:
        return np.repeat(cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    if rng.random() < 0.5:
        mix = np.eye(3) + rng.normal(0, 0.06, (3, 3))
        grey = np.full((3, 3), 1 / 3)
        keep = rng.uniform(0.3, 1.4)
        crop = np.asarray(cv2.transform(crop, keep * mix + (1 - keep) * grey), np.uint8)
    return crop


def _patches(rng: Rng, crop: Picture) -> Picture:
    """Patches of sun or shade with clear edges, as through blinds or leaves; the sun may be too bright to see."""
    area = np.zeros((SIZE, SIZE), np.uint8)
    for _ in range(int(rng.integers(1, 4))):
        corners = rng.uniform(0, SIZE, 2) + rng.normal(0, rng.uniform(8, 50), (int(rng.integers(3, 7)), 2))
        cv2.fillConvexPoly(area, cv2.convexHull(whole(corners)), 255, cv2.LINE_AA)
    share = cv2.GaussianBlur(area, (0, 0), np.exp(rng.uniform(-0.5, 2))).astype(np.float32) / 255
    gain = rng.uniform(1.3, 2.6) if rng.random() < 0.6 else rng.uniform(0.35, 0.8)
    lit = crop * (1 + (gain - 1) * share[..., None] * rng.uniform(0.9, 1.1, 3))
    return np.asarray(np.clip(lit, 0, 255), np.uint8)


def camera(rng: Rng, crop: Picture) -> Picture:
    """Blur, low resolution, noise, sharpening, JPEG."""
    if rng.random() < 0.25:
        crop = np.asarray(cv2.GaussianBlur(crop, (0, 0), rng.uniform(0.4, 2.2)), np.uint8)
    if rng.random() < 0.1:
        length = int(rng.integers(3, 10))
        kernel = np.zeros((length, length), np.float32)
        angle = rng.uniform(0, np.pi)
        half = (length - 1) / 2
        reach = half * np.array([np.cos(angle), np.sin(angle)])
        cv2.line(kernel, _pixel(half - reach), _pixel(half + reach), 1.0)
        crop = np.asarray(cv2.filter2D(crop, -1, kernel / kernel.sum()), np.uint8)
    if rng.random() < 0.3:
        small = int(rng.uniform(22, 110))
        shrink = (cv2.INTER_AREA, cv2.INTER_LINEAR)[int(rng.integers(2))]
        grow = (cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_NEAREST)[int(rng.choice(3, p=(0.6, 0.3, 0.1)))]
        tiny = _noise(rng, cv2.resize(crop, (small, small), interpolation=shrink), 0.4, 10)
        crop = np.asarray(cv2.resize(tiny, (SIZE, SIZE), interpolation=grow), np.uint8)
    crop = _noise(rng, crop, 0.4, 14)
    if rng.random() < 0.12:
        soft = cv2.GaussianBlur(crop, (0, 0), rng.uniform(0.8, 2))
        amount = rng.uniform(0.3, 1.5)
        crop = np.asarray(cv2.addWeighted(crop, 1 + amount, soft, -amount, 0), np.uint8)
    if rng.random() < 0.3:
        quality = int(rng.uniform(12, 85))
        code = cv2.imencode(".jpg", crop, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        crop = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)
    return crop


def _noise(rng: Rng, crop: Any, chance: float, most: float) -> Picture:
    if rng.random() > chance:
        return np.asarray(crop, np.uint8)
    h, w = crop.shape[:2]
    noise = np.empty((h, w, 3), np.int16)
    cv2.randn(noise, 0, float(rng.uniform(1, most)))
    return np.asarray(cv2.add(crop, noise, dtype=cv2.CV_8U), np.uint8)


def _pixel(point: Any) -> tuple[int, int]:
    x, y = np.round(point).astype(int)
    return int(x), int(y)
