"""Square crops about faces, as landmark models are fed.

Pixels, x right, y down, pixel centres at integers; turns in radians, by which a face is rolled clockwise.
"""

from __future__ import annotations

import numpy as np

from guise.aam.landmarks.schemes import OUTER_EYE_CORNERS
from guise.common.arrays import F64, Int
from guise.common.kernels import kernel

MIN_SIDE_PIXELS = 1e-3


def roll(points: F64) -> float:
    """The turn of a face with points (n, 2), n >= 46: that of the line through its outer eye corners."""
    right, left = points[OUTER_EYE_CORNERS]
    return float(np.arctan2(left[1] - right[1], left[0] - right[0]))


def upright_square(points: F64) -> tuple[F64, float, float]:
    """Centre (2,), side and turn of the box of points (n, 2) in the frame in which the eyes are level."""
    made = np.empty(4)
    upright_box(np.ascontiguousarray(points, np.float64), OUTER_EYE_CORNERS, made)
    return made[:2], float(made[2]), float(made[3])


@kernel
def upright_box(points: F64, eyes: Int, made: F64) -> None:
    """Centre x and y, side and turn of `upright_square`, written to `made` (4,).

    points : (n, 2), pixels.   eyes : (2,) of them, the outer eye corners.
    """
    right, left = points[eyes]
    x, y = left - right
    turn = np.arctan2(y, x)
    back = _rotation(turn)
    level = points @ back
    low, high = np.minimum.reduce(level), np.maximum.reduce(level)
    made[:2], made[2], made[3] = back @ ((low + high) / 2), np.maximum.reduce(high - low), turn


def crop_to_picture(centre: F64, side: float, turn: float, size: tuple[int, int]) -> F64:
    """Affine (2, 3) from the pixels of a crop to those of the picture.

    centre, side : of the square that the crop covers, pixels of the picture.   size : width and height of the crop.
    """
    side = max(side, MIN_SIDE_PIXELS)
    made, middle = np.empty((2, 3)), np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    linear = _rotation(turn) * (side / size[0], side / size[1])
    made[:, :2], made[:, 2] = linear, centre - linear @ middle
    return made


def _rotation(turn: float) -> F64:
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array([[cos, -sin], [sin, cos]])
