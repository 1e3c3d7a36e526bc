"""Figures of privacy and utility on made-up embeddings and landmarks, where the right answers are known."""

import math

import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks.schemes import (
    LEFT_BROW,
    LEFT_EYE_OUTER,
    LEFT_MOUTH_CORNER,
    LEFT_UPPER_LID,
    LOWER_INNER_LIP,
    NOSE,
    RIGHT_BROW,
    RIGHT_EYE_OUTER,
    RIGHT_UPPER_LID,
)
from guise.app.measure.curves import (
    ANGLES,
    CURVES,
    SKULL,
    SKULL_3D,
    angle_between,
    correlation,
    expression,
    jitter,
    point_errors,
    pose,
)
from guise.app.measure.faces import FaceTrack
from guise.app.measure.figures import Utility, mean_of, plain, weighted_mean
from guise.app.measure.people import Gallery, Subject, group_people, impostor_scores
from guise.app.measure.privacy import (
    BINS,
    Scores,
    accepted,
    equal_error_rate,
    rank,
    rank_one,
    template,
    threshold,
)


def unit(*rows: list[float]) -> np.ndarray:
    vectors = np.array(rows, np.float32)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def face() -> np.ndarray:
    """Landmarks (60, 81, 2) of a talking sample person."""
    return np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][60:120].astype(np.float64)


def turned(points: np.ndarray, degrees: float, scale: float = 1.0, shift: float = 0.0) -> np.ndarray:
    angle = np.radians(degrees)
    matrix = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return points @ matrix.T + shift


# -- re-identification --------------------------------------------------------------------------------------


def test_rank_one_is_the_share_of_faces_whose_best_match_is_their_own_person() -> None:
    scores = np.array([[0.9, 0.1, 0.0], [0.2, 0.1, 0.5], [0.3, 0.2, 0.8], [0.0, 0.4, 0.1]])
    assert rank_one(scores, [0, 1, 2, 1]) == 0.75
    assert rank_one(scores, [1, 2, 0, 0]) == 0.25


def test_a_tie_counts_by_its_chance() -> None:
    assert rank_one(np.full((10, 4), 0.3), np.zeros(10, int)) == pytest.approx(0.25)


def test_rank_one_of_random_faces_is_chance() -> None:
    rng = np.random.default_rng(0)
    faces, people = rng.normal(size=(20000, 32)), rng.normal(size=(50, 32))
    assert rank_one(faces @ people.T, rng.integers(50, size=20000)) == pytest.approx(1 / 50, abs=0.005)


def test_rank_counts_from_one_and_ties_come_before() -> None:
    assert [rank(np.array([0.3, 0.9, 0.5]), own) for own in range(3)] == [3, 1, 2]
    assert rank(np.full(5, 0.1), 2) == 5


def test_figures_of_nothing_are_unknown() -> None:
    assert math.isnan(rank_one(np.zeros((0, 3)), []))
    assert math.isnan(equal_error_rate(np.zeros(0), np.ones(3)))
    assert math.isnan(accepted(np.zeros(0), threshold(np.ones(3))))
    assert Scores.of(np.zeros(0)) is None


@pytest.mark.parametrize(("rate", "above"), [(0.001, 10), (0.01, 100), (0.5, 5000), (1e-5, 0)])
def test_the_threshold_lets_exactly_the_rate_of_impostors_in(rate: float, above: int) -> None:
    impostors = np.random.default_rng(1).permutation(np.arange(10000) / 10000)
    limit = threshold(impostors, rate)
    assert int((impostors > limit.score).sum()) == above
    assert accepted(impostors, limit) == pytest.approx(above / 10000)
    assert limit.enough == (above > 0)


def test_the_threshold_is_the_quantile_of_a_normal_distribution() -> None:
    limit = threshold(np.random.default_rng(2).normal(size=400_000), 1e-3)
    assert limit.score == pytest.approx(3.0902, abs=0.06)  # quantile of the standard normal at 0.999


def test_equal_error_rate_of_two_normal_distributions() -> None:
    rng = np.random.default_rng(3)
    genuine, impostors = rng.normal(2, 1, 100_000), rng.normal(0, 1, 100_000)
    assert equal_error_rate(genuine, impostors) == pytest.approx(0.15866, abs=0.003)  # Phi(-1), at the middle
    assert equal_error_rate(impostors, genuine) == pytest.approx(1 - 0.15866, abs=0.003)
    assert equal_error_rate(genuine, genuine) == pytest.approx(0.5, abs=0.001)


def test_equal_error_rate_weighs_both_sides_alike() -> None:
    rng = np.random.default_rng(4)
    assert equal_error_rate(rng.normal(2, 1, 300), rng.normal(0, 1, 200_000)) == pytest.approx(
        0.159, abs=0.05
    )


def test_a_template_is_the_direction_of_the_mean() -> None:
    assert np.allclose(template(unit([1, 0], [0, 1])), [math.sqrt(0.5)] * 2)
    assert np.isfinite(template(unit([1, 0], [-1, 0]))).all()


def test_impostor_scores_compare_each_face_with_every_other_person_only() -> None:
    people = [
        Subject("a", unit([1, 0, 0], [1, 0, 0])),
        Subject("b", unit([0, 1, 0])),
        Subject("c", unit([1, 1, 0])),
    ]
    half = math.sqrt(0.5)
    assert sorted(impostor_scores(people)) == pytest.approx(sorted([0, half, 0, half, 0, half, half, half]))


def test_a_gallery_of_one_has_no_threshold() -> None:
    gallery = Gallery.of([Subject("a", unit([1, 0]))])
    assert gallery.limit is gallery.usable_limit is None
    assert gallery.without(unit([1, 0])[0], pytest.fail) is gallery


def test_somebody_of_the_gallery_who_is_in_the_original_is_left_out() -> None:
    told: list[str] = []
    people = [Subject(name, unit(row)) for name, row in zip("abc", np.eye(3).tolist(), strict=True)]
    crowd = np.zeros(1000)
    rest = Gallery(tuple(people), crowd, threshold(crowd)).without(unit([-0.1, 1, -0.1])[0], told.append)
    assert [one.name for one in rest.people] == ["a", "c"]
    assert told == ["b of the gallery looks like a person of the original and is left out"]


def test_tracks_of_one_person_are_joined_but_never_two_faces_of_a_frame() -> None:
    def seen(*frames: int) -> FaceTrack:
        return FaceTrack(np.array(frames, np.int32), np.zeros((len(frames), 81, 2), np.float32))

    limit = threshold(np.array([0.1, 0.5]), 0.5)
    same, other = unit([1, 0], [1, 0]), unit([0, 1], [0, 1])
    faces = [seen(0, 1), seen(2, 3), seen(4, 5), seen(3, 9)]
    assert group_people(faces, [same, same, other, same], limit) == [[0, 1], [2], [3]]
    assert group_people(faces, [same, same, other, same], None) == [[0], [1], [2], [3]]


def test_scores_in_short() -> None:
    values = np.linspace(-0.2, 0.8, 1001)
    short = Scores.of(values)
    assert short is not None
    assert (short.count, short.mean, short.p99, short.largest) == pytest.approx((1001, 0.3, 0.79, 0.8))
    assert len(short.histogram) == len(BINS) - 1
    assert sum(short.histogram) == 1001


# -- expression ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CURVES)
def test_curves_do_not_depend_on_where_the_face_is(face: np.ndarray, name: str) -> None:
    assert np.allclose(expression(face)[name], expression(turned(face, 25, 0.6, 40))[name], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "points", "away"),
    [
        ("mouth opening", list(LOWER_INNER_LIP), (0, 5)),
        ("mouth width", [LEFT_MOUTH_CORNER], (5, 0)),
        ("right lids", list(RIGHT_UPPER_LID), (0, -3)),
        ("left lids", list(LEFT_UPPER_LID), (0, -3)),
        ("right brow", list(RIGHT_BROW), (0, -5)),
        ("left brow", list(LEFT_BROW), (0, -5)),
    ],
)
def test_each_curve_rises_with_its_own_movement_alone(
    face: np.ndarray, name: str, points: list[int], away: tuple[float, float]
) -> None:
    still = np.repeat(face[:1], 2, axis=0)
    still[1, points] += away
    rises = {key: float(np.diff(curve)[0]) for key, curve in expression(still).items()}
    assert rises.pop(name) > 0.02
    assert max(map(abs, rises.values())) < 1e-9


def test_equal_curves_correlate_and_noise_does_not() -> None:
    rng = np.random.default_rng(5)
    curve = rng.normal(size=2000)
    assert correlation(curve, curve) == pytest.approx(1)
    assert correlation(curve, 3 - 2 * curve) == pytest.approx(-1)
    assert correlation(curve, rng.normal(size=2000)) == pytest.approx(0, abs=0.08)
    assert correlation(curve, curve + rng.normal(size=2000)) == pytest.approx(math.sqrt(0.5), abs=0.03)


def test_correlation_is_unknown_of_a_still_face_and_zero_of_a_stilled_one() -> None:
    moving = np.sin(np.arange(50))
    assert math.isnan(correlation(np.full(50, 0.3), moving))
    assert math.isnan(correlation(moving[:5], moving[:5]))
    assert correlation(moving, np.full(50, 0.3)) == 0


def about(axis: int, degrees: float) -> np.ndarray:
    """A rotation about x (down is positive y, away positive z), y or z, from the next axis to the one after it."""
    angle, turn = np.radians(degrees), np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    return turn


@pytest.mark.parametrize(
    ("axis", "sign", "angle"),
    [(1, -1, "yaw"), (0, -1, "pitch"), (2, 1, "roll")],
    ids=["yaw", "pitch", "roll"],
)
@pytest.mark.parametrize("degrees", [-40, -5, 0, 5, 40])
def test_the_pose_of_the_mean_head_is_exact(axis: int, sign: int, angle: str, degrees: float) -> None:
    points = np.zeros((1, 81, 2))
    points[0, list(SKULL)] = 90 * (SKULL_3D @ about(axis, sign * degrees).T)[:, :2] + (320, 200)
    expected = [degrees if name == angle else 0 for name in ANGLES]
    assert np.allclose(pose(points)[0], expected, atol=1e-6)


def test_the_roll_of_a_turned_picture(face: np.ndarray) -> None:
    change = angle_between(pose(turned(face, 20)), pose(face))
    assert np.allclose(change[:, ANGLES.index("roll")], 20, atol=1.5)


def test_a_nose_that_points_right_is_a_yaw_to_the_right_and_up_a_pitch(face: np.ndarray) -> None:
    nose = list(NOSE[2:])
    right, up = face.copy(), face.copy()
    right[:, nose, 0] += 8
    up[:, nose, 1] -= 8
    before = pose(face)
    assert (angle_between(pose(right), before)[:, 0] > 1).all()
    assert (angle_between(pose(up), before)[:, 1] > 1).all()


def test_pose_follows_that_of_rendered_heads() -> None:
    """The truth is in the clip's file; the mean head of seven people is not the person's, so a constant is off."""
    truth = np.load(SAMPLES / "p02" / "talk.npz")
    away = angle_between(pose(truth["landmarks"]), truth["yaw_pitch_roll_deg"].astype(float))
    assert (np.abs(away - away.mean(0)).mean(0) < 2).all()


def test_angles_wrap() -> None:
    assert angle_between(np.array([179.0]), np.array([-179.0])) == pytest.approx([-2])


def test_point_errors_are_in_percent_of_the_eye_distance(face: np.ndarray) -> None:
    eyes = np.linalg.norm(face[:, LEFT_EYE_OUTER] - face[:, RIGHT_EYE_OUTER], axis=1)
    moved = face + np.stack([0.03 * eyes, 0.04 * eyes], axis=1)[:, None]
    whole, motion = point_errors(face, moved)
    assert np.allclose(whole, 5)
    assert motion.mean() < 0.6  # what is left of a constant in the eyes' frame is the head's roll
    assert np.allclose(point_errors(face, face)[0], 0)


def test_another_face_that_moves_alike_has_no_error_of_motion(face: np.ndarray) -> None:
    still = np.repeat(face[:1], 20, axis=0)
    other = still + np.random.default_rng(6).normal(size=(81, 2))
    whole, motion = point_errors(still, other)
    assert whole.min() > 0.5
    assert np.allclose(motion, 0, atol=1e-9)


def test_jitter_grows_with_noise_and_not_with_the_heads_motion(face: np.ndarray) -> None:
    rng, frames = np.random.default_rng(7), np.arange(40)
    still = np.repeat(face[:1], 40, axis=0)
    moving = np.stack([turned(p, 0.3 * i * i, 1 + 0.01 * i, 0.1 * i * i) for i, p in enumerate(still)])
    noise = rng.normal(size=still.shape)
    assert jitter(moving, frames) < 1e-9
    assert jitter(still + 2 * noise, frames) == pytest.approx(2 * jitter(still + noise, frames), rel=0.05)
    assert math.isnan(jitter(face[:2], np.arange(2)))
    assert math.isnan(jitter(face[:20], 2 * np.arange(20)))


def test_a_face_that_is_kept_has_the_best_figures(face: np.ndarray) -> None:
    kept = Utility.of(face, face, np.arange(len(face)), len(face))
    assert kept.found == 1
    assert kept.expression == pytest.approx(1)
    assert kept.landmark_error == pytest.approx(0, abs=1e-9)
    assert kept.motion_error == pytest.approx(0, abs=1e-9)
    assert max(kept.pose_error.values()) == pytest.approx(0, abs=1e-9)
    assert kept.jitter_ratio == pytest.approx(1)


def test_a_face_that_is_never_found_has_unknown_figures() -> None:
    nothing = np.zeros((0, 81, 2))
    figures = Utility.of(nothing, nothing, np.zeros(0, int), 40)
    assert figures.found == 0
    assert math.isnan(figures.expression)
    assert plain(figures.correlation) == dict.fromkeys(CURVES)


def test_people_count_by_their_frames(face: np.ndarray) -> None:
    whole = Utility.of(face, face, np.arange(60), 60)
    half = Utility.of(face[:30], face[:30], np.arange(30), 60)
    assert weighted_mean([whole, half], [60, 180]).found == pytest.approx(0.25 * 1 + 0.75 * 0.5)


def test_means_leave_out_what_is_unknown() -> None:
    assert mean_of([1.0, math.nan, 3.0]) == 2
    assert mean_of([1.0, math.nan, 3.0], [1, 5, 3]) == 2.5
    assert math.isnan(mean_of([math.nan]))


def test_json_holds_no_number_that_json_cannot_hold() -> None:
    value = {"a": math.nan, "b": (math.inf, 1.23456789), "c": None, "d": "x", "e": 3}
    assert plain(value) == {"a": None, "b": [None, 1.234568], "c": None, "d": "x", "e": 3}
