"""Points are corrected by what the landmarker usually lacks, alike for every place, size, roll and mirror image."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.correction import PointCorrection, features, made_upright, shipped, turn_of
from guise.aam.landmarks.schemes import JAW, LEFT_EYE, MIRROR, RIGHT_EYE
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.common.arrays import F64, U8

PRIOR = SolidPrior.shipped()


def turned(yaw: float, amounts: F64 | None = None) -> F64:
    """The mean face, or another, turned by degrees."""
    y = np.radians(yaw)
    rotation = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    solid = PRIOR.mean if amounts is None else PRIOR.at_rest(amounts)
    return HeadPose(rotation, 150.0, np.full(2, 200.0)).apply(solid)


def rolled(points: F64, degrees: float) -> F64:
    a = np.radians(degrees)
    return points @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])


@pytest.mark.parametrize("yaw", [0.0, 30, -45])
def test_place_size_and_roll_change_nothing(yaw: float) -> None:
    points, correct = turned(yaw), shipped()
    moved = lambda p: rolled(1.7 * p, 40) + np.array([30, -12])  # noqa: E731
    assert_allclose(correct(moved(points)), moved(correct(points)), atol=1e-2)


@pytest.mark.parametrize("yaw", [0.0, 30, 50])
def test_a_mirrored_face_is_corrected_as_its_mirror_image(yaw: float) -> None:
    points, correct, order = turned(yaw), shipped(), list(MIRROR)
    mirrored = points[order] * (-1, 1)
    width = np.ptp(turned(0)[:, 0])
    assert_allclose(correct(mirrored), correct(points)[order] * (-1, 1), atol=0.003 * width)


def test_from_the_front_nothing_moves_and_the_more_the_farther_a_head_is_turned() -> None:
    moved = [np.abs(shipped()(turned(yaw)) - turned(yaw)).mean() for yaw in (0.5, 6, 12, 25)]
    assert moved == sorted(moved)
    assert moved[0] < 0.05 * moved[-1]


def test_what_no_face_looks_like_is_not_thrown_about() -> None:
    points = turned(0) + np.random.default_rng(0).normal(0, 30, (81, 2))
    assert np.abs(shipped()(points) - points).max() < 0.3 * np.ptp(points[:, 0])


def test_the_landmarker_corrects_unless_it_is_told_not_to(talk2: tuple[list[U8], F64]) -> None:
    picture = np.repeat(talk2[0][0][..., None], 3, axis=2)
    face, plain = (BuiltinLandmarker(corrected=corrected).detect(picture)[0] for corrected in (True, False))
    assert plain.confidence == face.confidence
    assert_allclose(face.points, shipped()(plain.points.astype(np.float64)), atol=0.1)
    assert not np.array_equal(face.points, plain.points)


def test_an_error_that_grows_with_the_turn_is_learnt(tmp_path: Path) -> None:
    from training.point_correction import learn

    rng = np.random.default_rng(0)
    yaws = rng.uniform(-50, 50, 600)
    exact = np.array([turned(yaw, rng.normal(0, 1, len(PRIOR.identity))) for yaw in yaws])
    drift = np.zeros((81, 2))
    drift[JAW] = 1, 0  # at 12 degrees or more all of it is taken back
    found = exact + (0.2 * yaws)[:, None, None] * drift
    np.savez(tmp_path / "points.npz", **learn(found[:500], exact[:500]))
    correct = PointCorrection(tmp_path / "points.npz")
    some = 500 + np.flatnonzero(np.abs(yaws[500:]) > 15)
    left = np.array([correct(one) for one in found[some]]) - exact[some]
    assert np.abs(left).mean() < 0.15 * np.abs(found[some] - exact[some]).mean()


def test_features_of_upright_points() -> None:
    points = np.array([turned(yaw) for yaw in (-40, 0, 40)])
    upright, back = made_upright(points)
    assert_allclose(upright.reshape(3, 81, 2) @ back, points - points.mean(1, keepdims=True), atol=1e-3)
    turns = turn_of(upright)
    assert turns[0] * turns[2] < 0
    assert abs(turns[1]) < 0.1 * abs(turns[0])
    axes = np.zeros((162, 4), np.float32)
    assert features(upright, upright[1], axes, np.ones(3, np.float32)).shape == (3, 1 + 3 * 4 + 3)


def test_the_opening_of_an_eye_is_not_corrected() -> None:
    points = turned(45)
    change = shipped()(points) - points
    for eye in (LEFT_EYE, RIGHT_EYE):
        assert_allclose(change[eye], np.tile(change[eye].mean(0), (len(eye), 1)), atol=1e-3)
    assert np.abs(change[LEFT_EYE]).max() > 0.05


def test_the_places_nearest_on_a_line() -> None:
    from training.point_correction import on_line

    line = np.array([[0.0, 0], [10, 0], [10, 10]])
    places = on_line(np.array([[4.0, 3], [12, 5], [-2, -1]]), line)
    assert_allclose(places, [[4, 0], [10, 5], [0, 0]])


def test_corrected_jaws_are_to_lie_on_the_true_line() -> None:
    from training.point_correction import on_line, redefined

    exact = np.stack([turned(yaw) for yaw in (0, 0, 20, 40)])
    found = exact.copy()
    found[:, JAW] += (0, 5)
    for wanted, true in zip(redefined(found, exact), exact, strict=True):
        assert_allclose(wanted[JAW], on_line(wanted[JAW], true[JAW]), atol=1e-9)
