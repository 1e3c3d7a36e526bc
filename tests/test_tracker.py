"""The cascade tracker: accuracy on another clip, lost and found again, what must not matter, training."""

import dataclasses
import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.landmarks import LbpDetector
from guise.aam.landmarks.schemes import NOSE_TIP, interocular
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.texture_match import normalised
from guise.aam.tracker import (
    FEATURE_RESOLUTION,
    Crop,
    Fit,
    Quality,
    ShapeSpace,
    Tracker,
    cut,
)
from guise.aam.tracker_training import SOLVED_BLOCK, TrackerOptions, _solved, train_tracker

Talk = tuple[list[np.ndarray], np.ndarray]
FRAME = ReferenceFrame.canonical(FEATURE_RESOLUTION)


@pytest.fixture(scope="module")
def tracker(p01: Identity) -> Tracker:
    return p01.tracker


def error(shape: np.ndarray, truth: np.ndarray) -> float:
    """Mean landmark error in inter-ocular distances."""
    return float(np.linalg.norm(shape - truth, axis=1).mean() / interocular(truth))


def fitted(answer: Fit | Failed) -> Fit:
    assert isinstance(answer, Fit), answer
    return answer


def test_another_clip_is_tracked_within_two_percent_and_never_lost(tracker: Tracker, talk2: Talk) -> None:
    person_tracker = PersonTracker(tracker, LbpDetector())
    errors = [
        error(fitted(person_tracker.update(luma)).shape, truth) for luma, truth in zip(*talk2, strict=True)
    ]
    assert np.mean(errors) <= 0.02
    assert np.max(errors) <= 0.05


def test_the_models_own_error_estimate_is_of_the_right_size(tracker: Tracker, talk2: Talk) -> None:
    """Held-out error of the enrolment clip against the error on a clip in other light."""
    errors = [
        error(fitted(tracker.fit(luma, truth)).shape, truth)
        for luma, truth in zip(talk2[0][::6], talk2[1][::6], strict=True)
    ]
    assert np.mean(errors) / 5 < tracker.quality.error < np.mean(errors) * 2


@pytest.mark.parametrize("shift", [(0.08, 0), (-0.08, 0), (0, 0.08), (0, -0.08)])
def test_starts_that_are_off_are_corrected(tracker: Tracker, talk2: Talk, shift: tuple[float, float]) -> None:
    luma, truth = talk2[0][10], talk2[1][10]
    start = truth + np.array(shift) * np.ptp(truth[:, 0])
    assert error(start, truth) > 0.07
    assert error(fitted(tracker.fit(luma, start)).shape, truth) < 0.03


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_starts_of_another_size_are_corrected(tracker: Tracker, talk2: Talk, scale: float) -> None:
    luma, truth = talk2[0][10], talk2[1][10]
    start = (truth - truth.mean(0)) * scale + truth.mean(0)
    assert error(fitted(tracker.fit(luma, start)).shape, truth) < 0.03


def test_a_second_fit_moves_far_less_than_the_first(tracker: Tracker, talk2: Talk) -> None:
    first_moves, second_moves = [], []
    for luma, truth in zip(talk2[0][::6], talk2[1][::6], strict=True):
        start = truth + 4
        first = fitted(tracker.fit(luma, start))
        second = fitted(tracker.fit(luma, first.shape))
        first_moves.append(error(first.shape, start))
        second_moves.append(error(second.shape, first.shape))
    assert np.mean(second_moves) < 0.25 * np.mean(first_moves)


@pytest.mark.parametrize("what", ["noise", "grey", "elsewhere", "upside down"])
def test_no_face_is_lost_not_invented(tracker: Tracker, talk2: Talk, what: str) -> None:
    luma, truth = talk2[0][0].copy(), talk2[1][0]
    x0, y0 = np.floor(truth.min(0) - 20).astype(int)
    x1, y1 = np.ceil(truth.max(0) + 20).astype(int)
    noise = np.random.default_rng(0).integers(0, 256, luma.shape, np.uint8)
    start = truth
    if what == "noise":
        luma[y0:y1, x0:x1] = noise[y0:y1, x0:x1]
    elif what == "grey":
        luma[y0:y1, x0:x1] = 128
    elif what == "upside down":
        luma[y0:y1, x0:x1] = luma[y0:y1, x0:x1][::-1]
    else:
        start = truth - truth.mean(0) + 60  # the wall
    answer = tracker.fit(luma, start)
    assert isinstance(answer, Failed)
    assert answer.reason.startswith("the face is not recognised (residual ")


def test_a_face_half_hidden_by_noise_is_lost(tracker: Tracker, talk2: Talk) -> None:
    luma, truth = talk2[0][0].copy(), talk2[1][0]
    hidden = np.s_[int(truth[:, 1].min()) - 20 : int(truth[NOSE_TIP, 1]) + 40, :]
    luma[hidden] = np.random.default_rng(0).integers(0, 256, luma[hidden].shape, np.uint8)
    assert isinstance(tracker.fit(luma, truth), Failed)


@pytest.mark.parametrize(
    ("move", "reason"),
    [
        ((5000, 0), "the face has left the picture"),
        ((0, -3000), "the face has left the picture"),
    ],
)
def test_starts_outside_the_picture_fail(
    tracker: Tracker, talk2: Talk, move: tuple[int, int], reason: str
) -> None:
    answer = tracker.fit(talk2[0][0], talk2[1][0] + move)
    assert isinstance(answer, Failed)
    assert answer.reason == reason


def test_a_start_larger_than_the_picture_fails(tracker: Tracker, talk2: Talk) -> None:
    answer = tracker.fit(talk2[0][0], talk2[1][0] * 100)
    assert isinstance(answer, Failed)
    assert answer.reason == "the face is larger than the picture"


def test_a_lost_face_is_found_again_where_it_comes_back(tracker: Tracker, talk2: Talk) -> None:
    """Gone for some frames, then back elsewhere in the picture: found by the box detector."""
    (first, *_), truth = talk2
    empty = np.full_like(first, 120)
    moved = np.roll(first, (30, -120), axis=(0, 1))
    person_tracker = PersonTracker(tracker, LbpDetector())
    assert isinstance(person_tracker.update(first), Fit)
    assert [isinstance(person_tracker.update(empty), Failed) for _ in range(3)] == [True] * 3
    assert person_tracker.lost_frames == 3
    back = fitted(person_tracker.update(moved))
    assert error(back.shape, truth[0] + (-120, 30)) < 0.03
    assert person_tracker.lost_frames == 0


def test_without_a_box_detector_a_lost_face_stays_lost(tracker: Tracker, talk2: Talk) -> None:
    (first, *_), truth = talk2
    person_tracker = PersonTracker(tracker, None, truth[0])
    assert isinstance(person_tracker.update(first), Fit)
    assert isinstance(person_tracker.update(np.full_like(first, 120)), Failed)
    assert isinstance(person_tracker.update(np.roll(first, -200, axis=1)), Failed)
    assert isinstance(person_tracker.update(first), Fit)  # the old place is still tried


class Counting:
    """A box detector that finds nothing and counts how often it is asked."""

    def __init__(self) -> None:
        self.asked = 0

    def detect(self, image: np.ndarray) -> np.ndarray:
        self.asked += 1
        return np.zeros((0, 4), np.float32)


def test_after_a_long_loss_the_search_is_less_frequent_but_goes_on(tracker: Tracker) -> None:
    boxes = Counting()
    person_tracker = PersonTracker(tracker, boxes)
    asked = []
    for _ in range(40):
        assert person_tracker.update(np.zeros((120, 160), np.uint8)).reason == "no face found yet"
        asked.append(boxes.asked)
    assert asked[9] == 10
    assert 5 <= asked[-1] - asked[19] <= 10


@pytest.mark.parametrize("shift", [(8, 16), (-24, 40)])
def test_a_face_elsewhere_in_the_picture_is_fitted_alike(
    tracker: Tracker, talk2: Talk, shift: tuple[int, int]
) -> None:
    luma, truth = talk2[0][5], talk2[1][5]
    start = truth + 3.0
    here = fitted(tracker.fit(luma, start))
    there = fitted(tracker.fit(np.roll(luma, shift[::-1], axis=(0, 1)), start + shift))
    assert error(there.shape - shift, here.shape) < 2e-3


@pytest.mark.parametrize("scale", [0.5, 1.5, 2.5])
def test_a_face_of_another_size_is_fitted_alike(tracker: Tracker, talk2: Talk, scale: float) -> None:
    luma, truth = talk2[0][5], talk2[1][5]
    height, width = (round(side * scale) for side in luma.shape)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    zoomed = cv2.resize(luma, (width, height), interpolation=how)
    factor = np.array([width, height]) / luma.shape[::-1]
    there = fitted(tracker.fit(zoomed, (truth + 3.5) * factor - 0.5))
    here = fitted(tracker.fit(luma, truth + 3.0))
    assert error((there.shape + 0.5) / factor - 0.5, here.shape) < 0.01


@pytest.mark.parametrize(("gain", "offset"), [(0.6, 10), (1.0, 40), (0.8, -20)])
def test_brightness_and_contrast_do_not_matter(
    tracker: Tracker, talk2: Talk, gain: float, offset: float
) -> None:
    luma, truth = talk2[0][5], talk2[1][5]
    lit = np.clip(luma * gain + offset, 0, 255).astype(np.uint8)
    assert error(fitted(tracker.fit(lit, truth + 3)).shape, truth) < 0.03


def test_a_portrait_cropped_by_the_picture_is_still_fitted(tracker: Tracker, talk2: Talk) -> None:
    luma, truth = talk2[0][5], talk2[1][5]
    cropped = np.ascontiguousarray(luma[:, int(truth[:, 0].min()) + 6 :])
    start = truth - (int(truth[:, 0].min()) + 6, 0)
    assert error(fitted(tracker.fit(cropped, start + 3)).shape, start) < 0.06


def test_acquiring_from_a_box_needs_no_start(tracker: Tracker, talk2: Talk) -> None:
    luma, truth = talk2[0][30], talk2[1][30]
    boxes = LbpDetector().detect(luma)
    assert len(boxes)
    assert error(fitted(tracker.acquire(luma, boxes)).shape, truth) < 0.03
    assert tracker.acquire(luma, np.zeros((0, 4))) == Failed("no face box")
    assert not tracker.acquire(luma, np.array([[0, 0, 60, 60.0]]))


def test_the_right_box_wins_over_wrong_ones_before_it(tracker: Tracker, talk2: Talk) -> None:
    luma, truth = talk2[0][30], talk2[1][30]
    boxes = np.vstack([[[0, 0, 200, 200], [400, 250, 600, 450]], LbpDetector().detect(luma)])
    assert error(fitted(tracker.acquire(luma, boxes)).shape, truth) < 0.03


def test_confidence_falls_with_the_residual_and_is_even_at_the_threshold() -> None:
    quality = Quality(0.01, 0.2, 0.8)
    values = [quality.confidence(r) for r in (0.0, 0.1, 0.2, 0.4, 0.8, 10.0)]
    assert values == sorted(values, reverse=True)
    assert all(0 <= v <= 1 for v in values)
    assert quality.confidence(quality.threshold) == pytest.approx(0.5)
    assert quality.confidence(0.2) > 0.9
    assert quality.confidence(0.8) < 0.2


def test_every_fit_is_more_likely_right_than_not(tracker: Tracker, talk2: Talk) -> None:
    for luma, truth in zip(talk2[0][::10], talk2[1][::10], strict=True):
        fit = fitted(tracker.fit(luma, truth))
        assert fit.residual < tracker.quality.threshold
        assert 0.5 < fit.confidence <= 1


def test_normalised_features_have_no_mean_and_unit_spread() -> None:
    features = np.random.default_rng(0).uniform(0, 255, 500).astype(np.float32)
    once = normalised(features)
    assert once.mean() == pytest.approx(0, abs=1e-5)
    assert once.std() == pytest.approx(1, abs=1e-3)
    assert_allclose(normalised(features * 0.4 + 30), once, atol=1e-3)
    assert np.isfinite(normalised(np.full(9, 7, np.float32))).all()


@given(st.integers(0, 10_000), st.floats(0.3, 4))
@settings(max_examples=30)
def test_crops_map_there_and_back(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    shape = FRAME.points * scale * 2 + rng.uniform(0, 200, 2)
    crop = cut(rng.integers(0, 256, (500, 640), np.uint8), shape, FRAME)
    assert isinstance(crop, Crop)
    assert_allclose(crop.to_frame(crop.to_crop(shape)), shape, atol=1e-9)


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_corrections_lead_from_any_state_to_the_true_one(p01: Identity, seed: int) -> None:
    rng, space = np.random.default_rng(seed), ShapeSpace(p01.tracker.shapes, FRAME)
    shapes = FRAME.points + rng.normal(size=(2, 81, 2)) + rng.uniform(-5, 5, (2, 1, 2))
    true, start = (space.encode(s * f) for s, f in zip(shapes, rng.uniform(1.5, 3, 2), strict=True))
    moved = space.corrected(*start, space.correction(*start, true))
    assert_allclose(space.decode(*moved), space.decode(*true), atol=1e-6)


def test_pose_and_parameters_describe_the_persons_shapes(p01: Identity, talk2: Talk) -> None:
    space = ShapeSpace(p01.tracker.shapes, FRAME)
    for truth in talk2[1][::10]:
        pose, parameters = space.encode(truth)
        assert error(space.decode(pose, parameters), truth) < 0.015
        assert error(space.decode(pose, 0 * parameters), truth) > 0.015


@pytest.fixture(scope="module")
def crops(talk2: Talk) -> tuple[list[Crop], list[np.ndarray]]:
    cuts = [cut(luma, truth, FRAME) for luma, truth in zip(talk2[0][::4], talk2[1][::4], strict=True)]
    assert all(isinstance(c, Crop) for c in cuts)
    return [c for c in cuts if isinstance(c, Crop)], list(talk2[1][::4])


def small(crops: tuple[list[Crop], list[np.ndarray]], seed: int, **options: object) -> Tracker:
    """A tracker that looks at every fourth pixel only: bad, but trained in no time."""
    face = np.arange(len(FRAME.pixels)) % 4 == 0
    return train_tracker(
        *crops, face=face, options=TrackerOptions(stages=2, copies=4, folds=2, seed=seed, **options)
    )


@pytest.mark.slow
def test_training_is_repeatable(crops: tuple[list[Crop], list[np.ndarray]]) -> None:
    first, again, other = small(crops, 0), small(crops, 0), small(crops, 1)
    for a, b, c in zip(first.stages, again.stages, other.stages, strict=True):
        assert_array_equal(a, b)
        assert not np.allclose(a, c)
    assert dataclasses.astuple(first.quality) == dataclasses.astuple(again.quality)


def test_training_reports_progress_and_obeys_the_options(crops: tuple[list[Crop], list[np.ndarray]]) -> None:
    shares: list[float] = []
    face = np.arange(len(FRAME.pixels)) % 8 == 0
    options = TrackerOptions(stages=3, copies=3, folds=2, max_modes=3)
    trained = train_tracker(*crops, face=face, options=options, progress=shares.append)
    assert shares == [pytest.approx(k / 3) for k in (1, 2, 3)]
    assert trained.shapes.modes == 3
    assert [stage.shape for stage in trained.stages] == [(1 + face.sum(), 4 + 3)] * 3
    assert_array_equal(trained.pixels, np.flatnonzero(face))
    assert 0 < trained.quality.good < trained.quality.threshold
    assert math.isfinite(trained.quality.bad)


@pytest.mark.slow
def test_every_stage_brings_the_shape_nearer(crops: tuple[list[Crop], list[np.ndarray]], talk2: Talk) -> None:
    """On average over frames between those that it was trained on, and over starts in four directions."""
    trained = dataclasses.replace(small(crops, 0), quality=Quality(0.1, 5.0, 5.0))
    errors = np.zeros(3)
    for luma, truth in zip(talk2[0][2::8], talk2[1][2::8], strict=True):
        for shift in ([8, 0], [-8, 0], [0, 8], [0, -8]):
            start = truth + np.array(shift)
            stages = [dataclasses.replace(trained, stages=trained.stages[:k]) for k in (0, 1, 2)]
            errors += [error(fitted(tracker.fit(luma, start)).shape, truth) for tracker in stages]
    assert errors[1] < 0.8 * errors[0]
    assert errors[2] < 0.85 * errors[1]


@pytest.mark.parametrize("size", [1, SOLVED_BLOCK, SOLVED_BLOCK + 1, 3 * SOLVED_BLOCK - 7])
def test_equations_are_solved_by_blocks_as_by_the_general_solver(size: int) -> None:
    rng = np.random.default_rng(size)
    samples, right = rng.normal(size=(size, 200)).astype(np.float32), rng.normal(size=(size, 5))
    matrix = samples @ samples.T + 20 * np.eye(size, dtype=np.float32)
    found = _solved(matrix.copy(), right.astype(np.float32))
    assert found.dtype == np.float32
    assert_allclose(found, np.linalg.solve(matrix.astype(np.float64), right), atol=1e-5)
