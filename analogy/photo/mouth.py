"""The inside of an opening mouth: from S', in the target's light, below the lips of T'."""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, LOWER_INNER_LIP, RIGHT_EYE, UPPER_INNER_LIP
from guise.analogy.photo.pictures import LUMINANCE
from guise.common.arrays import F32, F64

OPENING_GAPS = (
    0.005,
    0.03,
)  # lip gap by lip width, above the neutral one: from where on a mouth is filled, and fully
EYE_WHITE_PERCENTILE = 85
MAX_LIGHT_GAIN = 1.4  # between two pictures' light
TOOTH_PERCENTILE, MAX_TOOTH_WHITES = 95, 1.0  # of the luminance inside a mouth, and of the whites of the eyes


def lip_gap(points: F64) -> float:
    """Gap between the inner lips of landmarks (81, 2), relative to their width."""
    corners = points[[INNER_LIPS[0], INNER_LIPS[4]]]
    across = float(np.linalg.norm(corners[1] - corners[0]))
    upper, lower = points[UPPER_INNER_LIP], points[LOWER_INNER_LIP]
    return float(np.linalg.norm(upper - lower, axis=1).mean()) / max(across, 1e-6)


def mouth_fill_share(neutral: F64, expressive: F64, strength: float) -> float:
    """Share, 0 to 1, of the inside of the mouth that is filled; landmarks (81, 2), strength of the expression."""
    low, high = OPENING_GAPS
    share = float(np.clip((strength * (lip_gap(expressive) - lip_gap(neutral)) - low) / (high - low), 0, 1))
    return share * share * (3 - 2 * share)


def light_gain(source: F32, source_points: F64, target: F32, target_points: F64) -> F32:
    """Gain (3,) of the target's light over the source's, from the whites of the eyes in pictures (h, w, 3).

    Skin depends on the colour of the face as much as on the light.
    """
    gain = eye_white(target, target_points) / np.maximum(eye_white(source, source_points), 1e-3)
    return np.asarray(np.clip(gain, 1 / MAX_LIGHT_GAIN, MAX_LIGHT_GAIN), np.float32)


def limit_teeth(light: F32, shown: F32, mouth: F32, white: float) -> F32:
    """The gain (3,), reduced until teeth are no brighter than the whites of the target's eyes; it never darkens S'.

    shown : (h, w, 3) the mouth of S', by shares (h, w).   white : luminance of those whites.
    """
    inside = shown[mouth > 0.5] @ LUMINANCE
    if not len(inside):
        return light
    teeth = float(np.percentile(inside, TOOTH_PERCENTILE)) * float(light @ LUMINANCE)
    least = min(1.0, 1 / max(float(light @ LUMINANCE), 1e-6))
    return np.asarray(light * np.clip(MAX_TOOTH_WHITES * white / max(teeth, 1e-6), least, 1), np.float32)


def eye_white(picture: F32, points: F64) -> F32:
    """RGB (3,) of the whites of the eyes of landmarks (81, 2) in a picture (h, w, 3)."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    for eye in (RIGHT_EYE, LEFT_EYE):
        cv2.fillPoly(mask, [np.rint(points[eye] * 16).astype(np.int32)], (1,), cv2.LINE_8, 4)
    pixels = picture[mask > 0] if mask.any() else picture.reshape(-1, 3)
    return np.asarray(np.percentile(pixels, EYE_WHITE_PERCENTILE, axis=0), np.float32)
