"""Benchmarks of landmarkers: their measures measure, on made-up points, boxes, curves and confidences."""

import sys
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks.landmarks import annotated, false_faces, metrics, rendered, small_faces
from benchmarks.landmarks import jitter as jitter_benchmark
from benchmarks.landmarks.peers import FACE81, face81
from benchmarks.landmarks.stills import at_faces, own_faces
from guise.aam.landmarks import Face
from guise.aam.landmarks.schemes import CHIN, IBUG68, JAW, LEFT_EYE_OUTER, RIGHT_EYE_OUTER, mean_geometry

MEAN = np.stack([mean_geometry().mean.real, mean_geometry().mean.imag], axis=-1)


def faces(count: int, seed: int = 0) -> np.ndarray:
    """Faces (count, 68, 2) of different place, size and roll."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        angle, size = rng.uniform(-0.5, 0.5), rng.uniform(40, 200)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        made.append(size * MEAN[IBUG68] @ turn + rng.uniform(0, 500, 2))
    return np.array(made)


def carried(truth: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Faces (n, 68, 2) whose points are off by (68, 2) in the frame of the eyes."""
    eyes = truth[:, LEFT_EYE_OUTER] - truth[:, RIGHT_EYE_OUTER]
    moved = (offset[:, 0] + 1j * offset[:, 1]) * (eyes[:, 0] + 1j * eyes[:, 1])[:, None]
    return truth + np.stack([moved.real, moved.imag], axis=-1)


def test_error_is_in_percent_of_the_eye_distance() -> None:
    truth = faces(3)
    eyes = np.linalg.norm(truth[:, LEFT_EYE_OUTER] - truth[:, RIGHT_EYE_OUTER], axis=1)
    found = truth.copy()
    found[:, CHIN, 0] += 0.2 * eyes
    errors = metrics.percent_errors(found, truth)
    assert errors[:, CHIN] == pytest.approx(20)
    assert metrics.accuracy(found, truth).raw == pytest.approx(20 / 68)
    assert metrics.accuracy(found, truth).inner == pytest.approx(0)


def test_an_offset_that_turns_with_the_head_is_removed() -> None:
    truth = faces(12)
    offset = np.random.default_rng(1).normal(0, 0.05, (68, 2))
    measured = metrics.accuracy(carried(truth, offset), truth)
    assert measured.raw == pytest.approx(100 * np.linalg.norm(offset, axis=1).mean())
    assert measured.removed == pytest.approx(0, abs=1e-6)


def test_an_offset_is_learned_from_the_other_half_only() -> None:
    truth = faces(12)
    offset = np.full((68, 2), [0.03, 0.04])
    found = truth.copy()
    found[6:] = carried(truth[6:], offset)
    errors = metrics.offset_removed_errors(found, truth)
    assert errors == pytest.approx(5)  # each half has what the other lacks


def test_faces_not_found_are_failures_but_not_errors() -> None:
    truth = faces(6)
    found = carried(truth, np.full((68, 2), [0.03, 0.04]))
    found[1] = np.nan
    found[4] += 1000
    measured = metrics.accuracy(found, truth)
    assert (measured.faces, measured.missing, measured.failed, measured.failures) == (6, 1, 1, 2)
    found[4] = np.nan
    assert metrics.accuracy(found, truth).raw == pytest.approx(5)


def test_points_that_a_scheme_lacks_do_not_count() -> None:
    truth = faces(8)
    found = truth + np.array([3, 0])
    found[:, JAW] += 500
    truth[:, JAW] = np.nan
    measured = metrics.accuracy(found, truth)
    assert measured.raw == pytest.approx(measured.inner)
    assert measured.removed < measured.raw < 10


def test_each_box_is_matched_once_and_the_best_first() -> None:
    wanted = np.array([[0, 0, 10, 10], [20, 0, 30, 10], [4, 0, 14, 10]], float)
    found = np.array([[20, 0, 30, 12], [1, 0, 11, 10]], float)
    assert metrics.matches(found, wanted) == [1, 0, None]
    assert metrics.matches(np.zeros((0, 4)), wanted) == [None] * 3


def test_motion_of_a_shaken_point() -> None:
    points, eyes = np.zeros((10, 4, 2)), np.full(10, 50.0)
    points[::2, :, 0] = 1.0
    assert metrics.motion(points, eyes, 1)[1:] == pytest.approx(2)
    assert metrics.motion(points, eyes, 2)[1:-1] == pytest.approx(4)
    assert np.isnan(metrics.motion(points, eyes, 2)[[0, -1]]).all()


def test_steady_motion_has_no_second_difference() -> None:
    points = np.arange(10.0)[:, None, None] * np.ones((1, 4, 2))
    assert metrics.motion(points, np.full(10, 50.0), 2)[1:-1] == pytest.approx(0)


def blinks(t: np.ndarray) -> np.ndarray:
    return 0.1 - 0.08 * sum(np.exp(-(((t - centre) / 2.5) ** 2)) for centre in (30, 80, 140))


@pytest.mark.parametrize("delay", [-1.4, 0.0, 0.3, 2.0])
def test_lag_is_found_between_frames(delay: float) -> None:
    t = np.arange(200.0)
    assert metrics.lag(blinks(t - delay), blinks(t)) == pytest.approx(delay, abs=0.05)


def test_lag_of_a_curve_with_gaps_and_of_a_flat_one() -> None:
    t = np.arange(200.0)
    late = blinks(t - 1)
    late[60:65] = np.nan
    assert metrics.lag(late, blinks(t)) == pytest.approx(1, abs=0.05)
    assert np.isnan(metrics.lag(np.ones(200), blinks(t)))


def test_depth_halves_when_blinks_do() -> None:
    curve = blinks(np.arange(200.0))
    shallow = np.median(curve) + (curve - np.median(curve)) / 2
    assert metrics.depth(shallow) / metrics.depth(curve) == pytest.approx(0.5)


def test_mesh_points_are_all_different() -> None:
    mesh = np.arange(478.0)[:, None] * np.ones(2)
    assert len(set(FACE81)) == 81
    assert face81(mesh)[RIGHT_EYE_OUTER].tolist() == [33.0, 33.0]


def test_imm_points_keep_the_order_of_a_face() -> None:
    indices = list(annotated.IBUG_OF_IMM.values())
    assert len(set(indices)) == len(indices)
    assert {36, 45} <= set(indices)
    text = "# c\n2\n#\n0 0 0.25 0.5 0 1 1 0 0 0\n0 0 0.75 0.1 1 0 0 0 0 0\nname.jpg\n"
    assert annotated.asf_shares(text).tolist() == [[0.25, 0.5], [0.75, 0.1]]


class Known:
    """A landmarker that tells given faces."""

    def __init__(self, *told: Face) -> None:
        self._told = list(told)

    def detect(self, rgb: np.ndarray) -> list[Face]:
        return self._told


def test_unsure_faces_are_not_found_but_counted() -> None:
    places = [100 * MEAN + [200 * k, 150] for k in (1, 2, 3)]
    points = np.array(places)[:, IBUG68]
    still = annotated.Still(Path(), points, metrics_boxes(points))
    find, unsure = own_faces(Known(Face.around(places[0], 0.9), Face.around(places[1], 0.2)))
    found = find(np.zeros((9, 9, 3), np.uint8), still)
    assert np.isfinite(found).all((1, 2)).tolist() == [True, False, False]
    assert unsure == [1]


def metrics_boxes(points: np.ndarray) -> np.ndarray:
    return np.concatenate([points.min(1), points.max(1)], axis=1)


def test_found_faces_are_put_to_their_places() -> None:
    points = np.array([100 * MEAN[IBUG68], 100 * MEAN[IBUG68] + 300])
    still = annotated.Still(Path(), points, metrics_boxes(points))
    assert at_faces(points[::-1] + 1, still) == pytest.approx(points + 1)


def test_crowd_counts_what_the_other_has_not() -> None:
    crowd = small_faces.Crowd()
    theirs = np.array([[0, 0, 10, 10], [50, 0, 60, 10]], float)
    crowd.add(np.array([[0, 0, 10, 9], [90, 0, 99, 9], [70, 0, 79, 9]], float), theirs)
    assert (crowd.theirs, crowd.hit, crowd.ours, crowd.new, crowd.share) == (2, 1, 3, 2, 50)


def test_groups_divide_the_people() -> None:
    attributes = np.array([[0.1, 0.2, 0.7, 0.2, 0.1], [0.9, 0.5, 0.1, 0.8, 0.1], [0.6, 0.9, 0.1, 0.2, 0.7]])
    made = rendered.groups(attributes, ("male", "age", "caucasian", "african", "asian"))
    for names in (("female", "male"), ("younger third", "middle third", "older third")):
        assert np.sum([made[name] for name in names], axis=0).tolist() == [1, 1, 1]
    assert made["mostly african"].tolist() == [False, True, False]


def test_picture_motion_sees_a_shift_and_not_a_still() -> None:
    rng = np.random.default_rng(0)
    size = jitter_benchmark.FLOW_SIZE
    big = cv2.resize(rng.uniform(0, 255, (20, 20)), (2 * size, 2 * size), interpolation=cv2.INTER_CUBIC)
    big = np.clip(big, 0, 255).astype(np.uint8)
    still = jitter_benchmark.picture_motion(iter([big[:size, :size].copy()] * 9))
    moving = jitter_benchmark.picture_motion(iter([big[:size, k : k + size].copy() for k in range(9)]))
    assert len(still) == len(moving) == 9
    assert np.nanmax(still) < 0.1
    assert np.nanmin(moving) > 3  # six pixels between the ends of the span


def test_face_free_pictures_follow_from_their_numbers() -> None:
    first, again = (list(false_faces.faceless(Path("nowhere"), 20)) for _ in range(2))
    assert all((a[1] == b[1]).all() for a, b in zip(first, again, strict=True))
    assert {kind for kind, _ in first} == {"photographs", "made up"}
    assert all((a[1] != b[1]).any() for a, b in pairwise(first))
    assert {p.shape for _, p in first} == {(false_faces.HEIGHT, false_faces.WIDTH, 3)}
