"""Shapes carried over one to one: rest stays rest, movements keep their size, shut lids and lips stay shut."""

from typing import Any

import numpy as np
import pytest
from drawing import turned_head
from made_up import FRAME, appearance
from numpy.testing import assert_allclose

from guise.aam.hull import beyond_hull
from guise.aam.landmarks.schemes import (
    BROWS,
    BROWS_AND_EYES,
    JAW,
    LEFT_BROW,
    LEFT_EYE,
    LIPS,
    LOWER_INNER_LIP,
    LOWER_LIDS,
    NOSE,
    NOSE_TIP,
    OUTLINE,
    RIGHT_BROW,
    RIGHT_EYE,
    RIGHT_MOUTH_CORNER,
    UPPER_INNER_LIP,
    UPPER_LIDS,
)
from guise.aam.reference import ReferenceFrame
from guise.aam.shape_transfer import (
    LIMITS,
    MAX_LID_RATIO,
    ShapeTransfer,
    jaw_moves,
    laid_over,
    placement,
)
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.common.arrays import F64

SOURCE, TARGET = (FRAME.align(appearance(seed).neutral_shape) for seed in (1, 2))
PRIOR = SolidPrior.shipped()
STRAIGHT = HeadPose(np.eye(3), float(FRAME.resolution), np.array([80.0, 90.0]))


def carried(transfer: ShapeTransfer, shape: F64) -> F64:
    """What is made of a shape of a head that is turned as at its rest."""
    return transfer.apply(shape, PRIOR.fit(shape, known=transfer.source.identity, deviation=0.1).pose)


def straight(solid: F64) -> F64:
    """A solid face as seen from the front, on the grid."""
    return FRAME.align(STRAIGHT.apply(solid))


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


def transfer_of(source: F64, target: F64, reference: ReferenceFrame, **options: Any) -> ShapeTransfer:
    """Between faces at points (81, 2)."""
    return ShapeTransfer(PRIOR.rest_of(source), PRIOR.rest_of(target), reference, **options)


def test_the_network_keeps_its_corrections_small_whatever_it_sees() -> None:
    for scale in (0.1, 10.0, 1e6):
        inputs = scale * np.random.default_rng(0).normal(size=(2, *SOURCE.shape))
        assert np.abs(placement()(inputs)).max() < 0.2


def test_brows_go_as_far_as_the_heads() -> None:
    """What the network corrects of them is where they lie at rest, not how far they go."""
    transfer, way = transfer_of(SOURCE, TARGET, FRAME), np.array([0.0, -0.05 * FRAME.resolution])
    shape = straight(transfer.source.rest)
    raised = shape.copy()
    raised[BROWS] += way
    seen = [FRAME.to_grid(one).apply(one) for one in (shape, raised)]
    gone = transfer.apply(raised, STRAIGHT) - transfer.apply(shape, STRAIGHT)
    assert_allclose(gone[BROWS], (seen[1] - seen[0])[BROWS], atol=1e-3 * FRAME.resolution)


def test_who_gets_their_own_face_is_hardly_corrected() -> None:
    transfer = transfer_of(SOURCE, SOURCE, FRAME)
    away = carried(transfer, posed(SOURCE)) - FRAME.align(SOURCE)
    assert np.linalg.norm(away, axis=1).mean() < 0.01 * FRAME.resolution


def test_a_neutral_face_becomes_the_targets_face_at_rest() -> None:
    """But for what is expression of the two neutral faces."""
    transfer = transfer_of(SOURCE, TARGET, FRAME, learned=False)
    made = transfer.apply(straight(transfer.source.rest), STRAIGHT)
    assert_allclose(made, straight(transfer.solid), atol=0.02 * FRAME.resolution)


def test_who_is_enrolled_turned_and_elsewhere_lies_on_the_head_as_it_is() -> None:
    turned = FRAME.points + 6 * FRAME.pitch_mode - 4 * FRAME.yaw_mode
    own, other = (PRIOR.rest_of(shape).rest for shape in (FRAME.points, posed(turned)))
    away = np.linalg.norm(straight(laid_over(other, own)) - straight(own), axis=1).mean()
    assert away < 0.012 * FRAME.resolution
    assert away < 0.5 * np.linalg.norm(FRAME.align(turned) - FRAME.points, axis=1).mean()


def turned(degrees: float) -> HeadPose:
    """The pose of a head that is turned to the right of the picture."""
    turn = np.radians(degrees)
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    return HeadPose(rotation, 160.0, np.zeros(2))


def test_how_two_faces_differ_in_depth_shows_when_they_turn() -> None:
    """A longer nose sticks out of a turned head, and hardly shows from the front."""
    transfer = transfer_of(SOURCE, SOURCE, FRAME, learned=False)
    transfer.solid[NOSE_TIP, 2] -= 0.05
    for pose, expected in ((STRAIGHT, 0.0), (turned(40), 0.05 * np.sin(np.radians(40)))):
        shape = pose.apply(transfer.source.rest)
        made = transfer.apply(shape, pose) - FRAME.align(shape)
        scale = FRAME.align(shape)[:, 0].std() / shape[:, 0].std()
        assert made[NOSE_TIP, 0] / (pose.scale * scale) == pytest.approx(expected, abs=1e-3)
        assert_allclose(np.delete(made, [NOSE_TIP, *BROWS_AND_EYES], axis=0), 0, atol=1e-5)


@pytest.mark.parametrize("degrees", [-40, 25, 40])
def test_no_brow_sticks_out_of_a_turned_head(degrees: float) -> None:
    pose = turned(degrees)
    transfer = transfer_of(SOURCE, SOURCE, FRAME, learned=False)
    transfer.solid[BROWS, 2] -= 0.1  # nearer to the viewer, so that it shows from the side
    shape = pose.apply(transfer.source.rest)
    beyond, _ = beyond_hull(transfer.apply(shape, pose)[BROWS], FRAME.align(shape))
    assert beyond.max() < -0.003 * FRAME.resolution


def test_features_keep_their_own_proportions_within_the_heads_outline() -> None:
    narrow = FRAME.points.copy()
    narrow[JAW] += 0.1 * (narrow[JAW].mean(0) - narrow[JAW]) * [1, 0]
    long_nosed = FRAME.points.copy()
    long_nosed[NOSE[4:]] += (0, 0.04 * FRAME.resolution)
    transfer = transfer_of(narrow, long_nosed, FRAME)
    assert_allclose(transfer.solid[OUTLINE], transfer.source.rest[OUTLINE], atol=1e-6)
    own, there = (np.ptp(solid[NOSE][:, 1]) for solid in (PRIOR.rest_of(FRAME.points).rest, transfer.solid))
    assert there > 1.04 * own


def test_a_face_that_is_to_lie_farther_apart_differs_more_within_the_same_outline() -> None:
    near, far = (transfer_of(SOURCE, TARGET, FRAME, apart=apart, learned=False) for apart in (0.0, 0.9))
    own, more = near.solid - near.source.rest, far.solid - near.solid
    assert_allclose(more[NOSE], 0.9 * own[NOSE], atol=1e-9)
    for part in (np.r_[RIGHT_BROW, RIGHT_EYE], np.r_[LEFT_BROW, LEFT_EYE], LIPS):  # as wholes
        assert_allclose(more[part], np.tile(0.9 * own[part].mean(0), (len(part), 1)), atol=1e-9)
    assert_allclose(far.solid[OUTLINE], near.solid[OUTLINE], atol=1e-6)


def test_it_opens_eyes_and_lips_as_far_as_without_that() -> None:
    wide, small = with_eyes(1.5), with_eyes(0.6)  # 1.9 times that difference would turn lids inside out
    near, far = (carried(transfer_of(wide, small, FRAME, apart=apart), posed(wide)) for apart in (0.0, 0.9))
    for upper, lower in ((UPPER_LIDS, LOWER_LIDS), (UPPER_INNER_LIP, LOWER_INNER_LIP)):
        assert_allclose((far[lower] - far[upper])[:, 1], (near[lower] - near[upper])[:, 1], atol=0.3)


def test_movements_keep_their_size() -> None:
    moved = SOURCE.copy()
    moved[BROWS] -= (0, 2)
    moved[RIGHT_MOUTH_CORNER] -= (1.5, 0.5)
    transfer = transfer_of(SOURCE, TARGET, FRAME, learned=False)
    pose = transfer.source.pose
    made = transfer.apply(moved, pose) - transfer.apply(SOURCE, pose)
    own = FRAME.align(moved) - SOURCE
    assert_allclose(made[BROWS], own[BROWS], atol=1e-5)
    assert_allclose(made[RIGHT_MOUTH_CORNER], own[RIGHT_MOUTH_CORNER], atol=1e-5)


@pytest.mark.parametrize(("own", "other"), [(0.6, 1.5), (1.0, 1.0), (1.5, 0.6)])
def test_shut_lids_stay_shut_whatever_the_two_eye_sizes(own: float, other: float) -> None:
    made = carried(transfer_of(with_eyes(own), with_eyes(other), FRAME), posed(with_eyes(0.0)))
    assert_allclose(made[UPPER_LIDS], made[LOWER_LIDS], atol=1e-5)


def test_lids_open_by_the_share_of_the_sources_up_to_a_limit() -> None:
    transfer = transfer_of(with_eyes(0.7), with_eyes(1.2), FRAME)
    pose = transfer.source.pose
    half, whole, wide, wider = (
        _lid_gaps(transfer.apply(with_eyes(opening), pose)) for opening in (0.35, 0.7, 3.0, 6.0)
    )
    assert_allclose(half, whole / 2, rtol=1e-6)
    assert_allclose(wide, wider, rtol=1e-6)
    assert (wide < MAX_LID_RATIO * 1.6 * whole).all()


def _lid_gaps(shape: F64) -> F64:
    return np.asarray((shape[LOWER_LIDS] - shape[UPPER_LIDS])[:, 1])


def test_lips_that_touch_touch() -> None:
    transfer = transfer_of(SOURCE, TARGET, FRAME)
    shut = SOURCE.copy()
    shut[LOWER_INNER_LIP] = shut[UPPER_INNER_LIP]
    made = carried(transfer, posed(shut))
    assert_allclose(made[UPPER_INNER_LIP], made[LOWER_INNER_LIP], atol=1e-5)


def test_an_open_mouth_opens_as_far_and_farther_by_the_difference_of_the_two() -> None:
    transfer = transfer_of(SOURCE, TARGET, FRAME)
    pose, gaps = transfer.source.pose, []
    for opening in (8, 12):
        wide = SOURCE.copy()
        wide[LOWER_INNER_LIP] = wide[UPPER_INNER_LIP] + (0, opening)
        made = transfer.apply(wide, pose)
        gaps.append(made[LOWER_INNER_LIP] - made[UPPER_INNER_LIP])
    assert_allclose(gaps[1] - gaps[0], np.tile([0, 4], (3, 1)), atol=0.2)


OUTLINE_FRAME = ReferenceFrame.canonical(160)
OUTLINE_HEAD = OUTLINE_FRAME.points + np.array([120.0, 60.0])


def _wider_jaw() -> F64:
    mesh = OUTLINE_HEAD.copy()
    mesh[JAW] += 0.1 * (OUTLINE_HEAD[JAW] - OUTLINE_HEAD[JAW].mean(0)) * [1, 0]
    return mesh


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_jaw_at_rest_goes_a_share_of_the_way_and_ears_stay(share: float) -> None:
    other = _wider_jaw()[JAW]
    moves = jaw_moves(OUTLINE_HEAD[JAW], other, share)
    assert np.abs(moves[[0, -1]]).max() == 0
    assert np.linalg.norm(moves, axis=1).max() <= LIMITS.max_jaw_move * OUTLINE_FRAME.resolution
    if share == 0:
        assert not moves.any()
    else:
        assert moves[4, 0] < -0.5 * share * (OUTLINE_HEAD[JAW][4, 0] - other[4, 0])


def test_by_default_the_outline_is_the_heads_own() -> None:
    target = OUTLINE_FRAME.align(_wider_jaw())
    plain, led = (
        transfer_of(OUTLINE_FRAME.points, target, OUTLINE_FRAME, outline=share) for share in (0.0, 1.0)
    )
    np.testing.assert_allclose(plain.solid[JAW], plain.source.rest[JAW], atol=1e-9)
    width = np.ptp(plain.solid[JAW, 0])
    assert np.abs(led.solid - plain.solid)[JAW].max() > 0.01 * width


def test_brows_and_eyes_stay_within_the_turned_head() -> None:
    transfer = transfer_of(OUTLINE_FRAME.points, OUTLINE_FRAME.points, OUTLINE_FRAME)
    transfer.solid[BROWS, 2] -= 0.15  # a forehead that bulges
    pose = turned_head(50)
    shape = pose.apply(transfer.source.rest)
    made = transfer.apply(shape, pose)
    hull = OUTLINE_FRAME.align(shape)
    assert made[BROWS_AND_EYES, 0].max() <= hull[:, 0].max() + 0.3
    assert transfer.apply(turned_head(0).apply(transfer.source.rest), turned_head(0))[BROWS] == pytest.approx(
        OUTLINE_FRAME.align(turned_head(0).apply(transfer.source.rest))[BROWS], abs=0.5
    )
