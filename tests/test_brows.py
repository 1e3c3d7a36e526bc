"""Brows that tracking has left behind are found again by their looks."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from made_up import FRAME, appearance

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel
from guise.aam.brows import BROW_PAIR, LIMITS, BrowFollower
from guise.aam.landmarks.schemes import BROWS, LEFT_BROW, RIGHT_BROW
from guise.common.arrays import F64, U8

SCALE = 2.0
WIDTH = SCALE * FRAME.resolution


def drawn(raised: tuple[float, float] = (0.0, 0.0)) -> U8:
    """A face of even skin with dark brows, raised by so many face widths, as luma twice as large as the grid."""
    h, w = FRAME.size
    luma = np.full((int(SCALE * h) + 40, int(SCALE * w) + 40), 170, np.uint8)
    for brow, up in zip(BROW_PAIR, raised, strict=True):
        line = SCALE * FRAME.points[brow] + [0, -up * WIDTH]
        cv2.polylines(luma, [np.round(line * 16).astype(np.int32)], False, 60, 9, cv2.LINE_AA, 4)
    return np.asarray(cv2.GaussianBlur(luma, (0, 0), 1.5), np.uint8)


def person() -> AppearanceModel:
    """Somebody who looks so at rest."""
    model = appearance(1)
    neutral = model.neutral.copy()
    grey = FRAME.sampler.sample(drawn(), SCALE * FRAME.points)
    neutral[SHAPE_ENTRIES:] = np.repeat(grey, 3)
    return replace(model, neutral=neutral)


def risen(luma: U8) -> F64:
    """By how much each brow's points are raised, face widths."""
    shape = SCALE * FRAME.points
    moved = shape - BrowFollower(person()).corrected(luma, shape)
    np.testing.assert_array_equal(np.delete(moved, BROWS, axis=0), 0)
    return np.array([moved[brow, 1].mean() for brow in BROW_PAIR]) / WIDTH


@pytest.mark.parametrize("up", [(0.03, 0.03), (0.04, 0.0), (0.0, -0.02)])
def test_each_brow_goes_where_the_picture_shows_it(up: tuple[float, float]) -> None:
    np.testing.assert_allclose(risen(drawn(up)), up, atol=0.006)


def test_at_rest_nothing_moves() -> None:
    assert np.abs(risen(drawn())).max() < 0.003


def test_where_no_brow_is_seen_nothing_moves() -> None:
    noise = np.random.default_rng(4).integers(0, 255, drawn().shape).astype(np.uint8)
    assert np.abs(risen(noise)).max() < 0.3 * LIMITS.search


def test_a_jitter_counts_less_than_a_movement() -> None:
    follower, shape = BrowFollower(person()), SCALE * FRAME.points
    follower.corrected(drawn(), shape)
    small = (shape - follower.corrected(drawn((0.002, 0.002)), shape))[RIGHT_BROW, 1].mean() / WIDTH
    large = (shape - follower.corrected(drawn((0.04, 0.04)), shape))[LEFT_BROW, 1].mean() / WIDTH
    assert small < 0.8 * 0.002
    assert large > 0.85 * 0.04
