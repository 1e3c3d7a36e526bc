"""Glasses drawn on faces."""

import cv2
import numpy as np

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.common.arrays import F64


def with_glasses(picture: np.ndarray, shape: F64, bridge: bool = True) -> np.ndarray:
    """A picture (h, w, 3) uint8 with dark rims around the eyes of a face (81, 2), and what joins them."""
    worn, size = picture.copy(), float(interocular(shape))
    rim = (20, 20, 20), max(1, round(size / 25))
    middles = [np.round(shape[eye].mean(0)).astype(int) for eye in (RIGHT_EYE, LEFT_EYE)]
    half = round(0.27 * size), round(0.2 * size)
    for middle in middles:
        cv2.ellipse(worn, middle.tolist(), half, 0, 0, 360, *rim)
    if bridge:
        ends = middles[0] + [half[0], 0], middles[1] - [half[0], 0]
        cv2.line(worn, *(end.tolist() for end in ends), *rim)
    return worn
