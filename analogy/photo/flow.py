"""What landmarks leave of the motion from S to S': found densely between the two, already warped together.

Skin slides and brows bend between landmarks.  Where S' is taken for a change of light what is one of place, its edges
would be seen twice in T'.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F32, U8, Bool

FARTHEST = 0.03  # of the face's width: motion that landmarks may leave
SMOOTH = 0.01  # of the face's width: sigma of the field
NEAR = 0.02  # of the face's width: sigma of the neighbourhoods whose contrast is made alike
CONTRAST = 0.05  # heights, below which contrast is not raised
GAIN = 0.7  # of the squared difference that must be gone for the motion to be believed fully


def left(after: F32, before: F32, region: Bool, width: float) -> F32:
    """(h, w, 2) pixels: the place in `before` of what each pixel of `after` shows, less its own.

    after, before : (h, w) heights of S' and S on the grid of T'.
    region : (h, w), where to look.   width : of the face, pixels.
    """
    one, two = _even(after, width), _even(before, width)
    engine = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    found = np.asarray(
        engine.calc(_bytes(one), _bytes(two), np.zeros((*one.shape, 2), np.float32)), np.float32
    )
    limit = np.float32(FARTHEST * width)
    found *= np.minimum(1, limit / np.maximum(np.linalg.norm(found, axis=2), 1e-6))[:, :, None]
    trust = _believed(one, two, found, width) * region
    sigma = SMOOTH * width
    total = cv2.GaussianBlur(trust, (0, 0), sigma)
    field = cv2.GaussianBlur(found * trust[:, :, None], (0, 0), sigma)
    return np.asarray(
        field / (total + 0.05)[:, :, None] * cv2.blur(region.astype(np.float32), (5, 5))[:, :, None]
    )


def followed(field: F32, places: F32) -> F32:
    """Values (h, w, d) of a field at places (h, w, 2) on its own grid."""
    return np.asarray(
        cv2.remap(
            np.ascontiguousarray(field), places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        ),  # type: ignore[call-overload]
        np.float32,
    )


def _even(field: F32, width: float) -> F32:
    """Heights (h, w) without their level, of even contrast."""
    sigma = NEAR * width
    detail = field - cv2.GaussianBlur(field, (0, 0), sigma)
    spread = np.sqrt(cv2.GaussianBlur(detail * detail, (0, 0), 2 * sigma) + CONTRAST**2)
    return np.asarray(detail / spread, np.float32)


def _bytes(field: F32) -> U8:
    return np.asarray(np.clip(field * 40 + 128, 0, 255), np.uint8)


def _believed(one: F32, two: F32, found: F32, width: float) -> F32:
    """(h, w) 0 to 1: how much of the difference the motion explains."""
    height, across = one.shape
    x, y = np.meshgrid(np.arange(across, dtype=np.float32), np.arange(height, dtype=np.float32))
    moved = followed(two, np.stack([x, y], axis=2) + found)
    sigma = NEAR * width
    before = cv2.GaussianBlur((one - two) ** 2, (0, 0), sigma)
    after = cv2.GaussianBlur((one - moved) ** 2, (0, 0), sigma)
    return np.asarray(np.clip((1 - after / (before + 1e-3)) / GAIN, 0, 1), np.float32)
