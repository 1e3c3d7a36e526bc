"""Shapes carried over one to one: rest stays rest, movements keep their size, shut lids and lips stay shut."""

import numpy as np
import pytest
from made_up import FRAME, appearance
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import (
    BROWS,
    JAW,
    LOWER_INNER_LIP,
    LOWER_LIDS,
    NOSE,
    OUTLINE,
    RIGHT_MOUTH_CORNER,
    UPPER_INNER_LIP,
    UPPER_LIDS,
)
from guise.aam.shape_transfer import MAX_LID_RATIO, ShapeTransfer, laid_over
from guise.common.arrays import F64

SOURCE, TARGET = (FRAME.align(appearance(seed).neutral_shape) for seed in (1, 2))


def with_eyes(factor: float) -> F64:
    """The reference frame's face with lids this far apart, of its own."""
    shape = FRAME.points.copy()
    middle = (shape[UPPER_LIDS] + shape[LOWER_LIDS]) / 2
    for lids in (UPPER_LIDS, LOWER_LIDS):
        shape[lids] = middle + factor * (shape[lids] - middle)
    return shape


def posed(shape: F64) -> F64:
    """The shape somewhere in a picture, turned and larger."""
    turn = 3.1 * np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    return np.asarray(shape @ turn + (200, 90))


def test_a_neutral_face_becomes_the_targets_face_at_rest() -> None:
    transfer = ShapeTransfer(SOURCE, TARGET, FRAME)
    assert_allclose(transfer.apply(posed(SOURCE)), transfer.rest, atol=1e-5)


def test_who_is_enrolled_turned_and_elsewhere_lies_on_the_head_as_it_is() -> None:
    turned = FRAME.points + 6 * FRAME.pitch_mode - 4 * FRAME.yaw_mode
    away = np.abs(laid_over(posed(turned), FRAME.points, FRAME) - FRAME.points).max()
    assert away < 0.01 * FRAME.resolution
    assert away < 0.3 * np.abs(FRAME.align(turned) - FRAME.points).max()


def test_features_keep_their_own_proportions_within_the_heads_outline() -> None:
    narrow = FRAME.points.copy()
    narrow[JAW] += 0.1 * (narrow[JAW].mean(0) - narrow[JAW]) * [1, 0]
    long_nosed = FRAME.points.copy()
    long_nosed[NOSE[4:]] += (0, 0.04 * FRAME.resolution)
    rest = ShapeTransfer(FRAME.align(narrow), FRAME.align(long_nosed), FRAME).rest
    assert_allclose(rest[OUTLINE], FRAME.align(narrow)[OUTLINE], atol=1e-4)
    own, there = (np.ptp(shape[NOSE][:, 1]) for shape in (FRAME.points, rest))
    assert there > 1.06 * own


def test_movements_keep_their_size() -> None:
    moved = SOURCE.copy()
    moved[BROWS] -= (0, 2)
    moved[RIGHT_MOUTH_CORNER] -= (1.5, 0.5)
    transfer = ShapeTransfer(SOURCE, TARGET, FRAME)
    made = transfer.apply(posed(moved)) - transfer.rest
    own = FRAME.align(moved) - SOURCE
    assert_allclose(made[BROWS], own[BROWS], atol=1e-5)
    assert_allclose(made[RIGHT_MOUTH_CORNER], own[RIGHT_MOUTH_CORNER], atol=1e-5)


@pytest.mark.parametrize(("own", "other"), [(0.6, 1.5), (1.0, 1.0), (1.5, 0.6)])
def test_shut_lids_stay_shut_whatever_the_two_eye_sizes(own: float, other: float) -> None:
    made = ShapeTransfer(with_eyes(own), with_eyes(other), FRAME).apply(posed(with_eyes(0.0)))
    assert_allclose(made[UPPER_LIDS], made[LOWER_LIDS], atol=1e-5)


@pytest.mark.parametrize("share", [0.5, 1.3, 3.0])
def test_lids_open_by_the_share_of_the_sources(share: float) -> None:
    transfer = ShapeTransfer(with_eyes(0.7), with_eyes(1.2), FRAME)
    made = transfer.apply(posed(with_eyes(0.7 * share)))
    rest = transfer.rest
    expected = min(share, MAX_LID_RATIO) * (rest[LOWER_LIDS] - rest[UPPER_LIDS])
    assert_allclose(made[LOWER_LIDS] - made[UPPER_LIDS], expected, atol=1e-4)


def test_lips_that_touch_touch_and_an_open_mouth_opens_as_far() -> None:
    transfer = ShapeTransfer(SOURCE, TARGET, FRAME)
    shut, wide = SOURCE.copy(), SOURCE.copy()
    shut[LOWER_INNER_LIP] = shut[UPPER_INNER_LIP]
    wide[LOWER_INNER_LIP] = wide[UPPER_INNER_LIP] + (0, 8)
    made = transfer.apply(posed(shut))
    assert_allclose(made[UPPER_INNER_LIP], made[LOWER_INNER_LIP], atol=1e-5)
    gaps, rest, own = (
        s[LOWER_INNER_LIP] - s[UPPER_INNER_LIP] for s in (transfer.apply(posed(wide)), transfer.rest, SOURCE)
    )
    seen = FRAME.align(wide)
    assert_allclose(gaps, seen[LOWER_INNER_LIP] - seen[UPPER_INNER_LIP] + rest - own, atol=1e-5)
