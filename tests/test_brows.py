"""Brows whose points lie elsewhere are found again: by their hair, as the parsing shows it, and by their looks."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from made_up import FRAME, SAMPLES, appearance
from numpy.testing import assert_allclose

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel
from guise.aam.brows import BROW_PAIR, LIMITS, BrowFollower, BrowLift
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import BROWS, LEFT_BROW, RIGHT_BROW
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.aam.reference import ReferenceFrame
from guise.app.media import open_input
from guise.common.arrays import F64, U8

REFERENCE = ReferenceFrame.canonical()
SCALE = 2.0
WIDTH = SCALE * FRAME.resolution


@pytest.fixture(scope="module")
def seen() -> tuple[FaceParsing, F64]:
    """A parsed frame of the first sample person, and the points that the landmarker finds."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    points = open_landmarker("builtin").detect(rgb)[0].points.astype(np.float64)
    return FaceParser().parse(rgb, points), points


def down(points: F64, face_widths: float) -> F64:
    return np.asarray(face_widths * REFERENCE.resolution * REFERENCE.to_shape(points).linear[1])


def lifted(parsing: FaceParsing, points: F64) -> F64:
    lift = BrowLift()
    lift.see(parsing, points)
    return lift(points)


def test_brows_that_lie_on_their_hair_stay(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    moved = lifted(parsing, points) - points
    assert np.linalg.norm(moved[BROWS], axis=1).max() < np.linalg.norm(down(points, 0.02))
    others = np.setdiff1d(np.arange(len(points)), BROWS)
    assert (moved[others] == 0).all()


@pytest.mark.parametrize("away", [-0.03, 0.02, 0.04])
def test_brows_that_were_left_behind_follow_most_of_the_way(
    seen: tuple[FaceParsing, F64], away: float
) -> None:
    parsing, points = seen
    behind = points.copy()
    behind[BROWS] += down(points, away)
    expected = lifted(parsing, points) + (1 - LIMITS.strength) * (behind - points)
    assert np.abs(lifted(parsing, behind) - expected)[BROWS].max() < np.linalg.norm(down(points, 0.01))


def test_a_brow_that_is_hidden_keeps_its_points(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    shares = parsing.shares.copy()
    middle = parsing.to_cells[:, :2] @ points.mean(0) + parsing.to_cells[:, 2]
    hidden = np.arange(shares.shape[2]) < middle[0]  # the person's right side
    shares[FaceClass.HAIR][:, hidden] += shares[FaceClass.BROWS][:, hidden]
    shares[FaceClass.BROWS][:, hidden] = 0
    behind = points.copy()
    behind[BROWS] += down(points, 0.03)
    moved = lifted(FaceParsing(shares, parsing.to_picture, parsing.irises), behind) - behind
    assert_allclose(moved[RIGHT_BROW], 0, atol=1e-9)
    assert (moved[LEFT_BROW] @ down(points, 1) < 0).all()


def test_shifts_are_steady_and_forgotten_at_a_reset(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    behind = points.copy()
    behind[BROWS] += down(points, 0.04)
    lift = BrowLift()
    assert (lift(points) == points).all()
    lift.see(parsing, points)
    lift.see(parsing, behind)
    at_once = lifted(parsing, behind) - behind
    assert np.linalg.norm((lift(behind) - behind)[BROWS]) < 0.6 * np.linalg.norm(at_once[BROWS])
    lift.reset()
    assert not lift.has_seen
    assert (lift(points) == points).all()


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


def corrected(follower: BrowFollower, luma: U8, shape: F64) -> F64:
    return follower.moved(shape, follower.shifts(luma, shape, None))


def risen(luma: U8) -> F64:
    """By how much each brow's points are raised, face widths."""
    shape = SCALE * FRAME.points
    moved = shape - corrected(BrowFollower(person()), luma, shape)
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
    at_rest = follower.shifts(drawn(), shape, None)
    after_jitter = follower.shifts(drawn((0.002, 0.002)), shape, at_rest)
    after_rise = follower.shifts(drawn((0.04, 0.04)), shape, after_jitter)
    assert (at_rest - after_jitter < 0.8 * 0.002).all()
    assert (at_rest - after_rise > 0.85 * 0.04).all()
