"""The jaw line of the frame follows the drawn one, and nothing else does."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from guise.aam.landmarks.schemes import JAW
from guise.aam.reference import ReferenceFrame
from guise.aam.shape_transfer import LIMITS as SHAPE_LIMITS
from guise.aam.shape_transfer import ShapeTransfer, jaw_moves
from guise.app.media import Frame
from guise.app.swapping.outline import LIMITS, warp_outline
from guise.common.arrays import F64, U8

REFERENCE = ReferenceFrame.canonical(160)
WIDTH = float(REFERENCE.resolution)
HEAD = REFERENCE.points + np.array([120.0, 60.0])


def scene() -> U8:
    """A bright head on a dark ground with noise, 400 x 420."""
    picture = np.random.default_rng(1).integers(20, 60, (420, 400, 3), dtype=np.uint8)
    cv2.fillConvexPoly(picture, cv2.convexHull(np.round(HEAD).astype(np.int32)), (220, 190, 170))
    return picture


def wider(share: float) -> F64:
    """The head with a wider jaw."""
    mesh = HEAD.copy()
    mesh[JAW] += share * (HEAD[JAW] - HEAD[JAW].mean(0)) * [1, 0]
    return mesh


def after(mesh: F64) -> U8:
    frame = Frame.from_rgb(scene())
    warp_outline(frame, HEAD, mesh, WIDTH)
    return frame.rgb()


def test_the_heads_edge_goes_where_the_drawn_jaw_is() -> None:
    row = int(HEAD[JAW][4, 1])
    before, now = (picture[row].mean(1) > 120 for picture in (scene(), after(wider(0.08))))
    moved = wider(0.08)[JAW][4, 0] - HEAD[JAW][4, 0]
    assert moved < -3
    assert now.argmax() - before.argmax() == pytest.approx(moved, abs=1.5)


def test_pixels_beyond_the_reach_stay_as_they_are() -> None:
    mesh = wider(0.08)
    ys, xs = np.mgrid[:420, :400]
    away = np.linalg.norm(np.stack([xs, ys], -1)[:, :, None] - mesh[JAW], axis=3).min(2)
    far = away > (LIMITS.outer_reach + LIMITS.cell + 0.05) * WIDTH
    assert far.mean() > 0.3
    np.testing.assert_array_equal(after(mesh)[far], scene()[far])


def test_where_the_outlines_agree_nothing_changes() -> None:
    np.testing.assert_array_equal(after(HEAD), scene())


def test_a_head_that_leaves_the_picture_is_no_error() -> None:
    frame = Frame.from_rgb(scene())
    warp_outline(frame, HEAD + 1000, wider(0.08) + 1000, WIDTH)
    np.testing.assert_array_equal(frame.rgb(), scene())


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_jaw_at_rest_goes_a_share_of_the_way_and_ears_stay(share: float) -> None:
    other = wider(0.1)[JAW]
    moves = jaw_moves(HEAD[JAW], other, share)
    assert np.abs(moves[[0, -1]]).max() == 0
    assert np.linalg.norm(moves, axis=1).max() <= SHAPE_LIMITS.max_jaw_move * WIDTH
    if share == 0:
        assert not moves.any()
    else:
        assert moves[4, 0] < -0.5 * share * (HEAD[JAW][4, 0] - other[4, 0])


def test_by_default_the_outline_is_the_heads_own() -> None:
    target = REFERENCE.align(wider(0.1))
    plain, led = (ShapeTransfer(REFERENCE.points, target, REFERENCE, outline=share) for share in (0.0, 1.0))
    np.testing.assert_allclose(plain.solid[JAW], plain.source.rest[JAW], atol=1e-9)
    width = np.ptp(plain.solid[JAW, 0])
    assert np.abs(led.solid - plain.solid)[JAW].max() > 0.01 * width
