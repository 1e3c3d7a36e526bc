"""Light on a person and a camera before a whole scene, for the pictures that the detector is trained on.

Images RGB uint8.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import U8
from training.canvas import pixel

Picture = U8
Rng = np.random.Generator


def lit(rng: Rng, image: Picture) -> Picture:
    """A person in a light of their own: gain, white balance, gamma, now and then a slope from side to side."""
    gain = np.exp(rng.normal(0, 0.2)) * np.exp(rng.normal(0, 0.07, 3))
    if rng.random() < 0.12:
        gain = gain * rng.uniform(0.25, 0.6)
    levels = np.arange(256)[:, None] / 255
    table = np.clip(levels ** np.exp(rng.normal(0, 0.2)) * gain, 0, 1) * 255
    lit = cv2.LUT(image, np.asarray(table, np.uint8).reshape(1, 256, 3))
    if rng.random() < 0.2:
        slope = cv2.resize(
            np.exp(rng.normal(0, 0.4, (2, 2))), image.shape[1::-1], interpolation=cv2.INTER_LINEAR
        )
        lit = np.clip(lit * slope[..., None], 0, 255)
    return np.asarray(lit, np.uint8)


def _moved(rng: Rng, image: Picture) -> Picture:
    """Blurred by a motion in a random direction."""
    length = int(rng.integers(2, 8))
    kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
    angle = rng.uniform(0, np.pi)
    reach = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    middle = np.full(2, float(length))
    cv2.line(kernel, pixel(middle - reach), pixel(middle + reach), 1.0)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), np.uint8)


def camera(rng: Rng, image: Picture) -> Picture:
    """The whole scene through a camera: exposure, colour or grey, blur, low resolution, noise, JPEG."""
    gain = np.exp(rng.normal(0, 0.2)) * np.exp(rng.normal(0, 0.06, 3))
    if rng.random() < 0.12:
        gain = gain * rng.uniform(0.15, 0.6)
    black = rng.uniform(-0.05, 0.12) if rng.random() < 0.3 else 0.0
    levels = np.arange(256)[:, None] / 255
    table = np.clip(levels ** np.exp(rng.normal(0, 0.2)) * gain * (1 - black) + black, 0, 1) * 255
    image = np.asarray(cv2.LUT(image, np.asarray(table, np.uint8).reshape(1, 256, 3)), np.uint8)
    kind = rng.random()
    if kind < 0.15:
        image = np.repeat(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    elif kind < 0.5:
        keep = rng.uniform(0.2, 1.5)
        mix = keep * (np.eye(3) + rng.normal(0, 0.05, (3, 3))) + (1 - keep) / 3
        image = np.asarray(cv2.transform(image, mix), np.uint8)
    if rng.random() < 0.25:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.3)), np.uint8)
    if rng.random() < 0.12:
        image = _moved(rng, image)
    if rng.random() < 0.2:
        share = rng.uniform(0.5, 0.95)
        small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        image = np.asarray(cv2.resize(small, image.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.uint8)
    if rng.random() < 0.4:
        noise = np.empty(image.shape, np.int16)
        cv2.randn(noise, 0, rng.uniform(1, 12))
        image = np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)
    if rng.random() < 0.15:
        soft = cv2.GaussianBlur(image, (0, 0), 1.0)
        image = np.asarray(cv2.addWeighted(image, 1.8, soft, -0.8, 0), np.uint8)
    if rng.random() < 0.5:
        code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.uniform(20, 92))])[1]
        image = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)
    return np.ascontiguousarray(image)
