"""Glasses drawn on a training crop, with exact labels.

Everything is random and comes from the generator that is given.  Pixels of the crop, x right, y down; images RGB uint8.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_EYE, LEFT_TEMPLE, RIGHT_EYE, RIGHT_TEMPLE
from guise.common.arrays import U8
from training.canvas import SIZE, Canvas, blend, whole
from training.parsing_labels import GLASSES

Picture = U8
Rng = np.random.Generator


def glasses(rng: Rng, canvas: Canvas) -> None:
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
