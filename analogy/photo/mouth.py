"""The inside of a mouth that opens: from S', in the target's light, under the lips of T'."""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, LOWER_INNER_LIP, RIGHT_EYE, UPPER_INNER_LIP
from guise.common.arrays import F32, F64

OPENS = (0.005, 0.03)  # gap of the lips by their width, gained over the neutral one: nothing to all is filled
WHITE = 85  # percentile of an eye that is taken for its white
GAIN = 1.4  # at most, between two pictures' light


def opening(points: F64) -> float:
    """The gap of the inner lips of landmarks (81, 2), by their width."""
    corners = points[[INNER_LIPS[0], INNER_LIPS[4]]]
    across = float(np.linalg.norm(corners[1] - corners[0]))
    upper, lower = points[UPPER_INNER_LIP], points[LOWER_INNER_LIP]
    return float(np.linalg.norm(upper - lower, axis=1).mean()) / max(across, 1e-6)


def opened(neutral: F64, expressive: F64, strength: float) -> float:
    """How much of the mouth's inside is new in landmarks (81, 2) of an expression by its strength, 0 to 1."""
    low, high = OPENS
    share = float(np.clip((strength * (opening(expressive) - opening(neutral)) - low) / (high - low), 0, 1))
    return share * share * (3 - 2 * share)


def light(source: F32, source_points: F64, target: F32, target_points: F64) -> F32:
    """Gain (3,) of the target's light over the source's, of pictures (h, w, 3): by the whites of the eyes.

    Skin tells a face's own colour as much as the light; teeth have none of it.
    """
    gain = _white(target, target_points) / np.maximum(_white(source, source_points), 1e-3)
    return np.asarray(np.clip(gain, 1 / GAIN, GAIN), np.float32)


def _white(picture: F32, points: F64) -> F32:
    mask = np.zeros(picture.shape[:2], np.uint8)
    for eye in (RIGHT_EYE, LEFT_EYE):
        cv2.fillPoly(mask, [np.rint(points[eye] * 16).astype(np.int32)], (1,), cv2.LINE_8, 4)
    pixels = picture[mask > 0] if mask.any() else picture.reshape(-1, 3)
    return np.asarray(np.percentile(pixels, WHITE, axis=0), np.float32)
