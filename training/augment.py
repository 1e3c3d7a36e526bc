"""One training sample of the landmarker from a picture: crop, background, objects in front of the face, light, camera.

Everything is random and comes from the generator that is given, so a seed gives the same samples. Pixels, x right,
y down, pixel centres at integers; images RGB uint8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.landmarks.schemes import MIRROR
from guise.aam.parsing import CELLS, FACE_FRAMING, HEAD_FRAMING, Framing
from guise.common.arrays import F32, F64, U8
from training.canvas import SIZE, Canvas, Sample, blend, class_maps, possible_maps
from training.data import Labelled
from training.drawn_glasses import glasses
from training.exposure import camera, light
from training.hair import beard, colour_of_hair, dye, fringe, hair_of
from training.occluders import Cutout, locks_of_hair, occluder, strands_of_hair
from training.parsing_labels import BACKGROUND, CLASSES

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


# Where nothing but points is asked for: more of the faces are upright and in sight.
ALONE = Strength(turn=12.0, size=0.1, shift=0.045, wild=0.12, hidden=0.3)
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


def sample(
    rng: Rng, face: Labelled, props: Props, strength: Strength = Strength(), *, mapped: bool = True
) -> Sample:
    """A random crop around a face, with random background, objects in front, light and camera.

    mapped : whether the maps are wanted, which take a quarter of the time.
    """
    matrix, mirrored = crop_matrix(rng, face.points, strength)
    canvas = _start(rng, face if mapped else replace(face, labels=None), matrix, mirrored, mapped)
    if face.mask is not None and rng.random() < 0.75:
        alpha = cv2.warpAffine(face.mask * np.uint8(255), matrix, (SIZE, SIZE))
        canvas.crop = _before(rng, canvas.crop, alpha, props.backgrounds)
    if canvas.exact and rng.random() < strength.hair:
        dye(rng, canvas)
    if canvas.exact and rng.random() < strength.hair:
        locks_of_hair(rng, canvas, hair_of(canvas) if rng.random() < 0.8 else colour_of_hair(rng))
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


def _start(rng: Rng, face: Labelled, matrix: F64, mirrored: bool, mapped: bool = True) -> Canvas:
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
    if exact:
        maps = class_maps(face.labels, len(face.image), matrix, border)
    else:
        maps = possible_maps(points) if mapped else np.zeros((len(CLASSES), CELLS, CELLS), np.float32)
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


def objects_alone(rng: Rng, face: Labelled, props: Props) -> Picture:
    """A crop (128, 128, 3) with hands and objects where they would hide a face, and no face."""
    matrix, mirrored = crop_matrix(rng, face.points, Strength())
    canvas = _start(rng, replace(face, labels=None), matrix, mirrored, mapped=False)
    canvas.crop = background(rng, props.backgrounds)
    for _ in range(int(rng.integers(1, 4))):
        occluder(rng, canvas, lambda: background(rng, props.backgrounds), props.hands)
    return camera(rng, light(rng, canvas.crop))


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
        beard(rng, canvas)
    if rng.random() < 0.15:
        glasses(rng, canvas)
    if rng.random() < 0.12:
        fringe(rng, canvas)
    if rng.random() < 0.12:
        strands_of_hair(rng, canvas, colour_of_hair(rng))
    if rng.random() < hidden:
        for _ in range(1 if rng.random() < 0.75 else 2):
            occluder(rng, canvas, lambda: background(rng, props.backgrounds), props.hands)


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
