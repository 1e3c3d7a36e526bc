"""What people in the detector's scenes wear and hold before their faces, and heads whose face is taken away.

Images RGB uint8, changed in place; points (68, 2) pixels, x right, y down.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import LEFT_EYE, RIGHT_EYE
from guise.aam.landmarks.schemes import (
    BROWS,
    CHIN,
    JAW,
    LEFT_MOUTH_CORNER,
    NOSE_BASE,
    NOSE_BRIDGE,
    NOSE_ROOT,
    RIGHT_MOUTH_CORNER,
    UPPER_LIP_TOP,
)
from guise.common.arrays import F64, U8
from training.backgrounds import hand, skin
from training.canvas import blend, pixel, whole

Picture = U8
Floats = F64
Rng = np.random.Generator


def wipe(rng: Rng, image: Picture, points: Floats) -> None:
    """Take the face away: skin, hair or a wild blur where it was, so that a head without a face remains."""
    hull = cv2.convexHull(whole(points.mean(0) + rng.uniform(1.05, 1.35) * (points - points.mean(0))))
    area = np.zeros(image.shape[:2], np.uint8)
    cv2.fillConvexPoly(area, hull, 255)
    area = np.asarray(cv2.GaussianBlur(area, (0, 0), 3), np.uint8)
    size = float(np.ptp(points, axis=0).max())
    if rng.random() < 0.5:
        blank = cv2.GaussianBlur(image, (0, 0), 0.25 * size)
    else:
        blank = np.empty_like(image)
        blank[:] = np.array([60, 45, 35]) * rng.uniform(0.2, 3)
        blank = cv2.add(blank, np.asarray(rng.integers(0, 30, image.shape), np.uint8))
    image[:] = blend(image, np.asarray(blank, np.uint8), area)


def dress(rng: Rng, image: Picture, points: Floats) -> None:
    """Glasses, beard, cap or fringe, a mask over mouth and nose: each now and then."""
    up = points[NOSE_ROOT] - points[CHIN]
    if rng.random() < 0.15:
        jaw = points[JAW][int(rng.integers(1, 5)) : len(JAW) - int(rng.integers(1, 5))]
        lip = 0.5 * (points[NOSE_BASE] + points[UPPER_LIP_TOP])
        area = np.concatenate(
            [jaw - rng.uniform(0, 0.08) * up, [points[LEFT_MOUTH_CORNER], lip, points[RIGHT_MOUTH_CORNER]]]
        )
        _over(rng, image, area, np.array([60, 45, 35]) * rng.uniform(0.2, 3.5), rng.uniform(0.4, 0.95))
    if rng.random() < 0.2:
        _glasses(rng, image, points)
    if rng.random() < 0.12:
        brow = points[BROWS] + rng.uniform(0.02, 0.35) * up
        area = np.concatenate([brow, (brow + rng.uniform(0.5, 1.0) * up)[::-1] * 1.0])
        _over(rng, image, area, rng.uniform(0, 255, 3) * rng.uniform(0.2, 1), 1.0)
    if rng.random() < 0.05:
        area = points[[*JAW[1:-1], NOSE_BRIDGE[2]]]
        _over(rng, image, area, rng.uniform(60, 255, 3), 1.0)


def _over(rng: Rng, image: Picture, polygon: Floats, colour: Floats, most: float) -> None:
    area = np.zeros(image.shape[:2], np.uint8)
    cv2.fillPoly(area, [whole(polygon)], int(255 * most))
    area = np.asarray(cv2.GaussianBlur(area, (0, 0), rng.uniform(0.6, 2)), np.uint8)
    front = np.empty_like(image)
    front[:] = np.clip(colour, 0, 255)
    image[:] = blend(image, front, area)


def _glasses(rng: Rng, image: Picture, points: Floats) -> None:
    right, left = points[list(RIGHT_EYE)].mean(0), points[list(LEFT_EYE)].mean(0)
    gap = float(np.linalg.norm(left - right)) + 1e-6
    turn = float(np.degrees(np.arctan2(left[1] - right[1], left[0] - right[0])))
    r, g, b = (int(c) for c in rng.integers(0, 90, 3))
    axes = (max(2, int(gap * rng.uniform(0.27, 0.42))), max(2, int(gap * rng.uniform(0.2, 0.36))))
    dark = rng.random() < 0.4
    for eye in (right, left):
        at = (int(eye[0]), int(eye[1] + 0.04 * gap))
        if dark:
            cv2.ellipse(image, at, axes, turn, 0, 360, (r, g, b), -1, cv2.LINE_AA)
        cv2.ellipse(image, at, axes, turn, 0, 360, (r, g, b), max(1, int(0.05 * gap)), cv2.LINE_AA)


def cover(rng: Rng, image: Picture, owner: NDArray[np.int16], face: Floats) -> None:
    """A hand, a microphone, a card or a bar before a face."""
    low, high = face.min(0), face.max(0)
    side = float((high - low).max())
    at = low + rng.uniform(0, 1, 2) * (high - low)
    before = image.copy()
    kind = rng.random()
    if kind < 0.5:
        hand(rng, image, at, side * rng.uniform(0.12, 0.35), skin(rng))
    else:
        r, g, b = (int(c) for c in rng.integers(0, 256, 3))
        if kind < 0.75:
            axes = (max(1, int(side * rng.uniform(0.1, 0.35))), max(1, int(side * rng.uniform(0.1, 0.35))))
            cv2.ellipse(image, pixel(at), axes, rng.uniform(0, 180), 0, 360, (r, g, b), -1, cv2.LINE_AA)
        else:
            end = at + rng.normal(0, 2 * side, 2)
            thick = max(1, int(side * rng.uniform(0.05, 0.3)))
            cv2.line(image, pixel(at), pixel(end), (r, g, b), thick, cv2.LINE_AA)
    owner[(image != before).any(2)] = -1
