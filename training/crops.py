"""Plain crops of known faces, for measuring: as a good detector's box gives them, nothing added."""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F32, U8
from training.augment import ENLARGE, SIZE
from training.data import Pictures

TURN, GROWTH, SHIFT = 4.0, 0.05, 0.025  # standard deviations: degrees, log size, of the box


def plain_crops(pictures: Pictures, count: int, seed: int = 7) -> tuple[U8, F32]:
    """Crops (n, 128, 128, 3) and points (n, 81, 2) in them, of `count` pictures evenly taken."""
    rng = np.random.default_rng(seed)
    chosen = np.linspace(0, len(pictures) - 1, min(count, len(pictures))).astype(int)
    crops, points = [], []
    for i in chosen:
        shape = pictures.points[i].astype(np.float64)
        low, high = shape.min(0), shape.max(0)
        angle = np.radians(rng.normal(0, TURN))
        scale = SIZE / (ENLARGE * (high - low).max()) * np.exp(rng.normal(0, GROWTH))
        cos, sin = scale * np.cos(angle), scale * np.sin(angle)
        linear = np.array([[cos, -sin], [sin, cos]])
        middle = (SIZE - 1) / 2 + rng.normal(0, SHIFT, 2) * SIZE
        matrix = np.column_stack([linear, middle - linear @ (low + high) / 2])
        crops.append(cv2.warpAffine(pictures.images[i], matrix, (SIZE, SIZE), flags=cv2.INTER_LINEAR))
        points.append(shape @ linear.T + matrix[:, 2])
    return np.stack(crops).astype(np.uint8), np.stack(points).astype(np.float32)
