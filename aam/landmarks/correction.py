"""What the landmarker's points lack, by their own configuration.

A small network that sees 128 pixels errs alike on like faces: it draws a turned far cheek inwards, and an unusual
outline towards the usual one.  Polynomial regression of the exact points of rendered people on the found ones
(`training/point_correction.py`) takes that back: principal components of the upright points, and their products with
the turn and its square.  Pixels, x right, y down.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from guise.aam.landmarks.schemes import LEFT_EYE, LEFT_TEMPLE, NOSE_TIP, RIGHT_EYE, RIGHT_TEMPLE
from guise.common.arrays import F32, F64, Int
from guise.common.kernels import kernel
from guise.common.small import lengths, mean

DATA = Path(__file__).parents[1] / "data" / "point_correction.npz"
MAX_FEATURE = 3.0  # standard deviations
# The turn from which the points are corrected in full; the less a head is turned the less, and from the front not at
# all: there the places of features and the light are learnt with the points as they are found.
FULL_TURN = 0.45
_POWERS = np.arange(1, 4)
PARTS: Int = np.array([*RIGHT_EYE, *LEFT_EYE, NOSE_TIP, RIGHT_TEMPLE, LEFT_TEMPLE], np.intp)


class PointCorrection:
    """The regression.

    Parameters
    ----------
    path : arrays `centre` (162,) and `axes` (162, k) of upright points, `scale` (3,) of the turn's powers, `weights`
        (1 + 3 k + 3, 162).
    """

    def __init__(self, path: Path) -> None:
        with np.load(path) as stored:
            self._centre, self._axes, self._scale, self._weights = (
                np.ascontiguousarray(stored[name], np.float32)
                for name in ("centre", "axes", "scale", "weights")
            )

    def __call__(self, points: F64) -> F64:
        """The corrected points (81, 2) for found ones."""
        corrected = np.empty(points.shape)
        correct_points(
            np.ascontiguousarray(points), PARTS, self._centre, self._axes, self._scale, self._weights,
            MAX_FEATURE, FULL_TURN, corrected,
        )  # fmt: skip
        return corrected


@kernel
def correct_points(
    points: F64, parts: Int, centre: F32, axes: F32, scale: F32, weights: F32, most: float, full: float, corrected: F64
) -> None:  # fmt: skip
    """Take back what found points lack.

    Parameters
    ----------
    points, corrected : (n, 2), pixels; the second is written.
    parts : (15,) of them: either eye's six, the nose's tip, and the temples.
    centre, axes, scale, weights : of `PointCorrection`.
    most, full : standard deviations that a feature may reach, and the turn from which the correction is whole.
    """
    upright, back = made_upright(points[None], parts)
    known = features(upright, centre, axes, scale, parts, most)
    share = min(abs(float(turn_of(upright, parts)[0])) / full, 1.0)
    corrected[:] = points + share * (known @ weights).reshape(points.shape) @ back[0]


def made_upright(shapes: F64, parts: Int = PARTS) -> tuple[F32, F64]:
    """Shapes (m, 162) without place, size and roll, and matrices (m, 2, 2) that take differences of them back."""
    eyes = mean(shapes[:, parts[6:12]], 1) - mean(shapes[:, parts[:6]], 1)
    x, y = (eyes / lengths(eyes)[:, None]).T
    level = np.array([[x, y], [-y, x]]).transpose(2, 0, 1)
    away = shapes - mean(shapes, 1)[:, None]
    size = np.sqrt(mean(np.add.reduce(np.square(away), 2), 1))[:, None, None]
    upright = away @ level.swapaxes(1, 2) / size
    return np.asarray(upright.reshape(len(shapes), -1), np.float32), level * size


def turn_of(upright: F32, parts: Int = PARTS) -> F32:
    """(m,) how far the nose's tip lies from the middle of the temples, an angle."""
    xs = upright.reshape(len(upright), -1, 2)[:, :, 0]
    nose, right, left = xs[:, parts[12:]].T
    return np.asarray(np.arctan(nose - (right + left) / 2))


def features(
    upright: F32, centre: F32, axes: F32, scale: F32, parts: Int = PARTS, most: float = MAX_FEATURE
) -> F32:
    """(m, 1 + 3 k + 3) what the regression sees of upright shapes (m, 162)."""
    found = np.minimum(np.maximum((upright - centre) @ axes, -most), most)
    powers = np.empty((len(upright), 4))  # from the zeroth on
    powers[:, 0] = 1
    powers[:, 1:] = turn_of(upright, parts)[:, None] ** _POWERS / scale
    products = found[:, :, None] * powers[:, None, :3]
    seen = np.empty((len(upright), 1 + 3 * found.shape[1] + 3), np.float32)
    seen[:, 0], seen[:, -3:] = 1, powers[:, 1:]
    seen[:, 1:-3] = products.reshape(len(upright), -1)
    return seen


@cache
def shipped() -> PointCorrection:
    """The regression that ships with the package."""
    return PointCorrection(DATA)
