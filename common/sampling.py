"""Bilinear samples of a picture at points.  Pixels, x right, y down, pixel centres at integers."""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F32, U8

_ROW = 32766  # cv2.remap makes pictures of fewer than 32767 columns


def remap_points(image: U8 | F32, points: F32, border: int = cv2.BORDER_REPLICATE) -> F32:
    """Bilinear samples of an image at points (n, 2): (n,) or (n, c) float32, those of eight bits rounded.

    border : of OpenCV, what lies beyond the image; zeros where it is constant.
    """
    n, _ = points.shape
    if n > _ROW:
        return np.concatenate([remap_points(image, points[i : i + _ROW], border) for i in range(0, n, _ROW)])
    values = cv2.remap(image, points[None], None, cv2.INTER_LINEAR, borderMode=border, borderValue=0)  # type: ignore[call-overload]
    return np.asarray(values, np.float32).reshape(n, *image.shape[2:])
