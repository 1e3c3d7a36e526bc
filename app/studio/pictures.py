"""Pictures inside of pages."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from guise.app.media.images import encode_image
from guise.common.arrays import U8


def fitted_to(rgb: U8, width: int) -> U8:
    """A copy of a picture (h, w, 3), reduced to a width in pixels where it is larger."""
    scale = min(1.0, width / rgb.shape[1])
    size = round(scale * rgb.shape[1]), round(scale * rgb.shape[0])
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def data_url(rgb: U8) -> str:
    """A picture (h, w, 3) as a data URL (JPEG)."""
    data = base64.b64encode(encode_image(rgb, None, ".jpg", {})).decode()
    return f"data:image/jpeg;base64,{data}"
