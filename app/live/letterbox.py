"""Fit a picture of any size into a frame of another: whole, as large as possible, on black."""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import U8


def letterboxed(rgb: U8, width: int, height: int) -> U8:
    """The picture (h, w, 3) uint8 as (height, width, 3) with its aspect ratio kept.

    >>> letterboxed(np.full((10, 10, 3), 255, np.uint8), 20, 10)[0, :, 0].tolist() == [0] * 5 + [255] * 10 + [0] * 5
    True
    """
    h, w = rgb.shape[:2]
    if (w, h) == (width, height):
        return rgb
    scale = min(width / w, height / h)
    size = max(round(w * scale), 1), max(round(h * scale), 1)
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    whole = np.zeros((height, width, 3), np.uint8)
    whole[top : top + size[1], left : left + size[0]] = cv2.resize(rgb, size, interpolation=method)
    return whole
