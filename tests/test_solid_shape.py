"""A head's turn is read off its points, whoever it is, wherever it is and whatever the face does."""

import numpy as np
import pytest

from guise.aam.landmarks.schemes import JAW, LIPS, LOWER_INNER_LIP, LOWER_LIP, MIRROR, UPPER_INNER_LIP
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.solid_shape import HeadPose, SolidPrior, SolidTracker, facing, pulled
from guise.common.arrays import F64

PRIOR = SolidPrior.shipped()


def turned(yaw: float, pitch: float, roll: float) -> F64:
    """Rotation (3, 3): roll after yaw after pitch, degrees; x right, y down, z away."""
    y, p, r = np.radians([yaw, -pitch, roll])
    about_x = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
    about_y = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def seen(solid: F64, yaw: float, pitch: float, roll: float) -> F64:
    """Points (81, 2) pixels of a head turned by degrees."""
    return HeadPose(turned(yaw, pitch, roll), 150.0, np.array([320.0, 240.0])).apply(solid)


def somebody(seed: int) -> F64:
    """A random person (81, 3) with a random expression."""
    rng = np.random.default_rng(seed)
    own, moved = (rng.normal(0, 0.7, len(modes)) for modes in (PRIOR.identity, PRIOR.movement))
    return np.asarray(PRIOR.at_rest(own) + np.tensordot(moved, PRIOR.movement, 1))


@pytest.mark.parametrize("angles", [(0, 0, 0), (20, 10, -5), (-45, -15, 12), (60, 8, 0), (-60, 20, 25)])
def test_angles_are_recovered(angles: tuple[float, float, float]) -> None:
    assert HeadPose(turned(*angles), 1.0, np.zeros(2)).angles == pytest.approx(angles, abs=1e-6)
    for seed in range(4):
        fit = PRIOR.fit(seen(somebody(seed), *angles))
        assert fit.pose.angles == pytest.approx(angles, abs=4.0)
        assert np.abs(fit.points - seen(somebody(seed), *angles)).max() < 3.0
        rough = PRIOR.rough_pose(seen(somebody(seed), *angles))
        assert rough.angles[:2] == pytest.approx(angles[:2], abs=10.0)


def test_signs_are_those_of_the_picture() -> None:
    """Yaw moves the nose to the picture's right, pitch moves it up, roll turns the head clockwise."""
    frame = ReferenceFrame.canonical()
    straight = PRIOR.fit(frame.points)
    right = PRIOR.fit(frame.points + 15 * frame.yaw_mode)
    up = PRIOR.fit(frame.points + 10 * frame.pitch_mode)
    clockwise = PRIOR.fit(frame.points @ turned(0, 0, 10)[:2, :2].T)
    moved = np.array([fit.pose.angles for fit in (right, up, clockwise)]) - straight.pose.angles
    assert (np.diag(moved) > 5).all()


def test_a_mirrored_face_looks_the_other_way() -> None:
    points = seen(somebody(5), 30, 5, 8)
    flipped = points[list(MIRROR)] * [-1, 1]
    yaw, pitch, roll = PRIOR.fit(points).pose.angles
    assert PRIOR.fit(flipped).pose.angles == pytest.approx((-yaw, pitch, -roll), abs=0.5)


def test_a_few_points_far_off_hardly_matter() -> None:
    points = seen(somebody(2), 25, 0, 0)
    wrong = points.copy()
    wrong[LIPS[:6]] += (30, -20)
    assert PRIOR.fit(wrong).pose.angles == pytest.approx(PRIOR.fit(points).pose.angles, abs=3.0)


def test_the_identity_learnt_from_many_frames_steadies_the_pose() -> None:
    rng, person, tracker = np.random.default_rng(0), somebody(7), SolidTracker()
    alone, tracked = [], []
    for _ in range(80):
        points = seen(person, 15, 0, 0) + rng.normal(0, 1.0, (POINTS, 2))
        alone.append(PRIOR.fit(points).pose.angles)
        tracked.append(tracker.update(points).pose.angles)
    assert (np.std(tracked[40:], axis=0)[:2] < np.std(alone[40:], axis=0)[:2]).all()


def test_coincident_points_give_finite_angles() -> None:
    assert np.isfinite(PRIOR.fit(np.full((POINTS, 2), 7.0)).pose.angles).all()


# -- at rest ------------------------------------------------------------------------------------------------

FRAME = ReferenceFrame.canonical()
AVERAGE = PRIOR.rest_of(FRAME.points).rest


def distance(a: F64, b: F64) -> float:
    """Mean, seen from the front, face widths."""
    return float(np.linalg.norm((a - b)[:, :2], axis=1).mean())


def gap(solid: F64) -> float:
    """Between the inner lips, face widths."""
    return float((solid[LOWER_INNER_LIP] - solid[UPPER_INNER_LIP])[:, 1].mean())


@pytest.mark.parametrize("angles", [(25, 0, 0), (-40, 5, 10), (0, 12, 0), (10, -12, -8)])
def test_a_turned_face_comes_back(angles: tuple[float, float, float]) -> None:
    turned_back = PRIOR.rest_of(seen(AVERAGE, *angles)).rest
    away = turned_back - AVERAGE
    assert distance(away - away.mean(0), np.zeros_like(away)) < 0.02


def test_an_open_mouth_shuts() -> None:
    opened = FRAME.points.copy()
    opened[np.union1d(LOWER_LIP, JAW[4:-4])] += (0, 0.09 * FRAME.resolution)
    assert gap(PRIOR.rest_of(opened).rest) < gap(AVERAGE) + 0.03


def test_a_long_face_stays_long() -> None:
    middle = FRAME.points.mean(0)
    for factor in (0.93, 1.07):
        long = PRIOR.rest_of(middle + (FRAME.points - middle) * [1, factor]).rest
        kept = np.ptp(long[:, 1]) / np.ptp(long[:, 0]) / (np.ptp(AVERAGE[:, 1]) / np.ptp(AVERAGE[:, 0]))
        assert 0.5 < (kept - 1) / (factor - 1) < 1.4


# -- one person --------------------------------------------------------------------------------------------


def test_points_pulled_to_the_known_face_lie_nearer_to_the_truth() -> None:
    rng, rest = np.random.default_rng(3), PRIOR.rest_of(seen(AVERAGE, 3, 2, 0))
    tracker, before, after = SolidTracker(rest), [], []
    for yaw in np.linspace(30, 55, 30):
        truth = seen(rest.rest, float(yaw), 4, 0)
        found = truth + rng.normal(0, 2.0, truth.shape)
        before.append(np.linalg.norm(found - truth, axis=1).mean())
        after.append(np.linalg.norm(pulled(found, tracker.update(found)) - truth, axis=1).mean())
    assert np.mean(after) < 0.8 * np.mean(before)


def test_points_of_a_straight_face_are_as_they_are_tracked() -> None:
    rest = PRIOR.rest_of(seen(AVERAGE, 3, 2, 0))
    points = seen(rest.rest, 4, 0, 20) + np.random.default_rng(1).normal(0, 2, (POINTS, 2))
    np.testing.assert_array_equal(pulled(points, SolidTracker(rest).update(points)), points)


def test_pulled_points_of_the_known_face_stay() -> None:
    rest = PRIOR.rest_of(seen(AVERAGE, 3, 2, 0))
    for yaw in (0, 40):
        points = seen(rest.rest, yaw, 0, 10)
        np.testing.assert_allclose(pulled(points, SolidTracker(rest).update(points)), points, atol=0.3)


# -- facing -------------------------------------------------------------------------------------------------


def test_all_points_face_the_front_and_the_far_cheek_turns_away() -> None:
    assert (facing(PRIOR.mean, np.eye(3)) > 0.1).all()
    right = facing(PRIOR.mean, turned(50, 0, 0))
    assert (right[JAW[-5:-1]] < 0.2).all()
    assert (right[JAW[1:5]] > 0.6).all()
    left = facing(PRIOR.mean, turned(-50, 0, 0))
    np.testing.assert_allclose(left[list(MIRROR)], right, atol=0.1)
