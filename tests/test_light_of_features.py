"""Raised brows, and what gleams around eyes and lips, are taken out of the light; shadows stay."""

import numpy as np
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import (
    BROW_TOPS,
    CHIN,
    HAIRLINE,
    LEFT_BROW,
    LEFT_EYE,
    LIPS,
    NOSE_TIP,
    RIGHT_BROW,
    RIGHT_EYE,
)
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.learned_light import CELL_FACE_WIDTHS, GRID, places
from guise.app.swapping.light_of_features import LightOfFeatures
from guise.common.arrays import F32

FRAME = ReferenceFrame.canonical(96)
FEATURES = LightOfFeatures(FRAME, FRAME.mask, GRID, places(FRAME), CELL_FACE_WIDTHS)
SEEN = np.ones(GRID, np.float32)
CHEEK = 3  # on the jaw line, far from eyes and lips
SKIN = np.array([180, 140, 120], np.float32)


def cell(point: int, up: float = 0.0) -> tuple[int, int]:
    """Row and column of the cell at a landmark, or some face widths above it."""
    x, y = (FRAME.points[point] - FRAME.points.min(0)) / (CELL_FACE_WIDTHS * FRAME.resolution) + 1
    return round(y - up / CELL_FACE_WIDTHS), round(x)


def even(gain: float = 1.0) -> F32:
    return np.concatenate([np.full((3, *GRID), gain, np.float32), np.zeros((3, *GRID), np.float32)])


def test_the_darkness_of_a_raised_brow_goes() -> None:
    light = even()
    for brow in BROW_TOPS:
        y, x = cell(brow, 0.04)
        light[:3, y - 1 : y + 2, x - 4 : x + 5] = 0.6
    without = FEATURES.without(light, SEEN, SKIN)
    for brow in BROW_TOPS:
        assert_allclose(without[:, *cell(brow, 0.04)], [1, 1, 1, 0, 0, 0], atol=0.1)


def test_what_gleams_around_eyes_and_lips_goes() -> None:
    light = even()
    for part in (RIGHT_EYE, LEFT_EYE, LIPS):
        ys, xs = zip(*(cell(point) for point in np.arange(81)[part]), strict=True)
        light[:3, min(ys) : max(ys) + 1, min(xs) : max(xs) + 1] = 1.5
    assert_allclose(FEATURES.without(light, SEEN, SKIN), even(), atol=0.15)


def test_brows_and_eyes_do_not_tint_the_light() -> None:
    light = even()
    for part in (RIGHT_BROW, LEFT_BROW, RIGHT_EYE, LEFT_EYE):
        ys, xs = zip(*(cell(point) for point in np.arange(81)[part]), strict=True)
        light[0, min(ys) : max(ys) + 1, min(xs) : max(xs) + 1] = 1.2
    x = cell(CHEEK)
    light[0, x[0], x[1]] = 1.2
    without = FEATURES.without(light, SEEN, SKIN)
    for point in (*BROW_TOPS, 37, 44):
        gain = without[:3, *cell(point)]
        assert gain[0] / gain[2] < 1.08
    assert without[0, *x] / without[2, *x] > 1.15


def test_what_is_dark_elsewhere_or_bright_stays() -> None:
    light = even()
    for point, gain in ((CHIN, 0.5), (NOSE_TIP, 0.6), (HAIRLINE, 0.7), (CHEEK, 1.5)):
        y, x = cell(point)
        light[:3, y - 1 : y + 2, x - 1 : x + 2] = gain
    assert_allclose(FEATURES.without(light, SEEN, SKIN), light, atol=1e-5)


def test_a_shadow_over_half_of_the_face_stays() -> None:
    light = even()
    light[:3, :, : GRID[1] // 2] = 0.5
    assert_allclose(FEATURES.without(light, SEEN, SKIN)[:3], light[:3], atol=0.12)


def test_a_face_of_which_nothing_is_seen_keeps_its_light() -> None:
    assert np.isfinite(FEATURES.without(even(0.7), 0 * SEEN, SKIN)).all()
