"""Hair drawn on a training crop, with exact labels: another colour, beards, fringes and caps.

Everything is random and comes from the generator that is given.  Pixels of the crop, x right, y down; images RGB uint8.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    BROWS,
    CHIN,
    FOREHEAD,
    HAIRLINE,
    JAW,
    LEFT_MOUTH_CORNER,
    LEFT_NOSTRIL,
    NOSE_BASE,
    NOSE_ROOT,
    OUTER_LIPS,
    RIGHT_MOUTH_CORNER,
    RIGHT_NOSTRIL,
    UPPER_LIP_TOP,
)
from guise.common.arrays import F32, U8
from training.canvas import SIZE, Canvas, whole
from training.parsing_labels import FACIAL_HAIR, HAIR, OCCLUDER

Picture = U8
Rng = np.random.Generator


def colour_of_hair(rng: Rng) -> F32:
    """A colour (3,) that hair can have."""
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
    hair = np.clip(_strands(rng)[..., None] * colour_of_hair(rng), 0, 255)
    shade = np.clip(crop.mean(2, keepdims=True) / 140, 0.35, 1.3)
    mixed = crop * (1 - alpha[..., None]) + hair * shade * alpha[..., None]
    canvas.crop = np.asarray(np.clip(mixed, 0, 255), np.uint8)
    canvas.cover(np.asarray(soft * min(1.0, 1.4 * most), np.uint8), kind)


def hair_of(canvas: Canvas) -> F32:
    """Mean colour (3,) of the hair; dark without any."""
    share = cv2.resize(canvas.maps[HAIR], (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)[..., None]
    return np.asarray((canvas.crop * share).sum((0, 1)) / max(float(share.sum()), 100.0), np.float32)


def dye(rng: Rng, canvas: Canvas) -> None:
    """Give the hair another colour, as light and as dark in parts as it was."""
    share = cv2.resize(canvas.maps[HAIR], (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)[..., None]
    factor = np.clip(colour_of_hair(rng) / np.maximum(hair_of(canvas), 4), 0.1, 8)
    canvas.crop = np.asarray(np.clip(canvas.crop * (1 + share * (factor - 1)), 0, 255), np.uint8)


def beard(rng: Rng, canvas: Canvas) -> None:
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


def fringe(rng: Rng, canvas: Canvas) -> None:
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
