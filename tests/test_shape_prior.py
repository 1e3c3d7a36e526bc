"""What is expression and pose of a face goes; its own proportions stay."""

import numpy as np
import pytest

from guise.aam.landmarks.schemes import CHIN, INNER_LIPS, JAW, LOWER_INNER_LIP, LOWER_LIP, UPPER_INNER_LIP
from guise.aam.reference import ReferenceFrame
from guise.aam.shape_prior import at_rest
from guise.common.arrays import F64

FRAME = ReferenceFrame.canonical()
AVERAGE = at_rest(FRAME.points, FRAME)


def distance(a: F64, b: F64) -> float:
    """Mean, face widths."""
    return float(np.linalg.norm(a - b, axis=1).mean() / FRAME.resolution)


def gap(shape: F64) -> float:
    """Between the inner lips, face widths."""
    return float((shape[LOWER_INNER_LIP] - shape[UPPER_INNER_LIP])[:, 1].mean() / FRAME.resolution)


def test_a_face_at_rest_stays_as_it_is() -> None:
    assert distance(at_rest(AVERAGE, FRAME), AVERAGE) < 0.004


@pytest.mark.parametrize(("yaw", "pitch"), [(10, 0), (-10, 0), (0, 8), (0, -8), (8, -6)])
def test_a_turned_face_comes_back(yaw: float, pitch: float) -> None:
    turned = FRAME.align(AVERAGE + yaw * FRAME.yaw_mode + pitch * FRAME.pitch_mode)
    assert distance(at_rest(turned, FRAME), AVERAGE) < 0.45 * distance(turned, AVERAGE)


def test_an_open_mouth_shuts() -> None:
    opened = AVERAGE.copy()
    lower = np.union1d(LOWER_LIP, JAW[4:-4])
    opened[lower] += (0, 0.09 * FRAME.resolution)
    assert gap(opened) > gap(AVERAGE) + 0.08
    assert gap(at_rest(opened, FRAME)) < gap(AVERAGE) + 0.03


def test_a_long_face_stays_long() -> None:
    middle = AVERAGE.mean(0)
    for factor in (0.93, 1.07):
        long = middle + (AVERAGE - middle) * [1, factor]
        kept = np.ptp(at_rest(long, FRAME)[:, 1]) / np.ptp(AVERAGE[:, 1])
        assert 0.6 < (kept - 1) / (factor - 1) < 1.4
        assert np.isfinite(at_rest(long, FRAME)[[CHIN, *INNER_LIPS]]).all()


def test_place_size_and_roll_in_the_picture_do_not_matter() -> None:
    turn = 3.1 * np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    np.testing.assert_allclose(at_rest(AVERAGE @ turn + (200, 90), FRAME), at_rest(AVERAGE, FRAME), atol=1e-6)
