"""Light and camera of a training crop: shadows, white balance, blur, noise, compression.

Everything is random and comes from the generator that is given.  Pixels of the crop, x right, y down; images RGB uint8.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from guise.common.arrays import U8
from training.canvas import SIZE, whole

Picture = U8
Rng = np.random.Generator


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
