"""Landmarks through time: noise goes, blinks, speech and the head's motion stay, at any size and frame rate."""

from __future__ import annotations

import numpy as np
import pytest
from made_up import SAMPLES
from numpy.testing import assert_allclose

from guise.aam.landmarks import LandmarkFilter, interocular
from guise.aam.landmarks.schemes import (
    BROWS,
    EYE_CORNERS,
    LEFT_EYE_OUTER,
    LOWER_LIDS,
    LOWER_LIP_BOTTOM,
    LOWER_LIP_INNER,
    NOSE_BRIDGE,
    UPPER_LIDS,
    UPPER_LIP_INNER,
)
from guise.aam.reference import ReferenceFrame

FACE = ReferenceFrame.canonical(160).points
SIZE = float(interocular(FACE))
NOISE = 0.002 * SIZE


def smoothed(points: np.ndarray, rate: float = 30.0, confidence: np.ndarray | None = None) -> np.ndarray:
    landmark_filter = LandmarkFilter()
    return np.stack([landmark_filter.update(p, confidence, i / rate) for i, p in enumerate(points)]).astype(
        float
    )


def jitter(points: np.ndarray) -> float:
    """Root mean square second difference of points (t, 81, 2)."""
    return float(np.sqrt(((points[:-2] - 2 * points[1:-1] + points[2:]) ** 2).sum(2).mean()))


def noise(frames: int, sd: float = NOISE, seed: int = 0) -> np.ndarray:
    """Noise (frames, 81, 2) of which half is common to all points, as a network's is."""
    rng = np.random.default_rng(seed)
    return sd * (rng.normal(size=(frames, 81, 2)) + rng.normal(size=(frames, 1, 2))) / np.sqrt(2)


def lids(points: np.ndarray) -> np.ndarray:
    """(t,) opening of both eyes, inter-ocular distances."""
    return np.linalg.norm(points[:, UPPER_LIDS] - points[:, LOWER_LIDS], axis=2).mean(1) / interocular(points)


def mouth(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, UPPER_LIP_INNER] - points[:, LOWER_LIP_INNER], axis=1) / interocular(
        points
    )


def lag(late: np.ndarray, signal: np.ndarray) -> float:
    """Frames by which the first follows the second, to a twentieth."""
    times, tries = np.arange(len(signal)), np.arange(-1, 3, 0.05)
    misses = [float(((late - np.interp(times - t, times, signal))[5:-5] ** 2).sum()) for t in tries]
    return round(float(tries[int(np.argmin(misses))]), 2)


@pytest.fixture(scope="module", params=["p01", "p02", "p06"])
def talk(request: pytest.FixtureRequest) -> tuple[np.ndarray, np.ndarray]:
    """True landmarks of a sample clip, and the same as a landmarker might see them."""
    truth = np.load(SAMPLES / request.param / "talk.npz")["landmarks"].astype(float)
    return truth, truth + noise(len(truth), 0.002 * float(interocular(truth[0])))


@pytest.mark.parametrize("rate", [24.0, 30.0, 60.0])
def test_noise_on_a_still_face_is_taken_out(rate: float) -> None:
    seen = FACE + noise(200)
    filtered = smoothed(seen, rate)[20:]
    assert jitter(filtered) < 0.25 * jitter(seen)
    assert np.abs(filtered.mean(0) - FACE).max() < NOISE


def test_blinks_and_speech_of_a_clip_are_not_delayed_and_not_flattened(
    talk: tuple[np.ndarray, np.ndarray],
) -> None:
    truth, seen = talk
    filtered = smoothed(seen)
    assert lag(lids(filtered), lids(truth)) <= 0.3
    assert lag(mouth(filtered), mouth(truth)) <= 0.35
    shut = lids(truth) < 0.5 * np.median(lids(truth))
    assert shut.any()
    depth = np.median(lids(truth)) - lids(truth)[shut]
    assert (np.median(lids(truth)) - lids(filtered)[shut]).mean() > 0.93 * depth.mean()


def test_a_talking_moving_head_jitters_less_and_is_not_delayed(
    talk: tuple[np.ndarray, np.ndarray],
) -> None:
    truth, seen = talk
    filtered = smoothed(seen)
    assert jitter(filtered - truth) < 0.96 * jitter(seen - truth)
    rigid = [*NOSE_BRIDGE, *EYE_CORNERS]
    assert lag(filtered[:, rigid, 0].mean(1), truth[:, rigid, 0].mean(1)) <= 0.9


def test_a_moving_head_does_not_hold_its_features_back() -> None:
    turns = [np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in np.linspace(0, 0.5, 60)]
    seen = np.stack([FACE @ turn + (0.05 * SIZE * i, 0) for i, turn in enumerate(turns)])
    late = np.linalg.norm(smoothed(seen)[10:] - seen[10:], axis=2).max()
    assert late < 0.25 * 0.05 * SIZE


def test_the_size_of_a_face_does_not_matter() -> None:
    seen = FACE + noise(40)
    assert_allclose(smoothed(7 * seen + 100), 7 * smoothed(seen) + 100, atol=1e-3 * 7)


def test_the_frame_rate_does_not_matter() -> None:
    """A step towards the same place is as far after the same time."""
    moved = FACE + 0.004 * SIZE
    slow = smoothed(np.concatenate([FACE[None], np.repeat(moved[None], 6, 0)]), 30)[-1]
    fast = smoothed(np.concatenate([FACE[None], np.repeat(moved[None], 12, 0)]), 60)[-1]
    assert 0.3 < ((slow - FACE) / (moved - FACE)).mean() < 0.98
    assert_allclose(slow, fast, atol=0.1 * 0.004 * SIZE)


def test_a_point_of_low_confidence_stays_with_the_head() -> None:
    confidence = np.ones(81)
    confidence[LOWER_LIP_BOTTOM] = 0.0
    steps = np.arange(30)[:, None, None]
    seen = FACE + steps * np.array([0.02 * SIZE, 0.0])
    seen[10:, LOWER_LIP_BOTTOM, 1] += 0.1 * SIZE
    off = (smoothed(seen, confidence=confidence) - seen)[-1, LOWER_LIP_BOTTOM]
    assert abs(off[0]) < 0.02 * SIZE
    assert off[1] < -0.07 * SIZE
    assert abs((smoothed(seen) - seen)[-1, LOWER_LIP_BOTTOM, 1]) < 0.01 * SIZE


def test_one_rigid_point_that_jumps_does_not_take_the_head_along() -> None:
    seen = np.repeat(FACE[None], 12, 0)
    seen[6:, LEFT_EYE_OUTER] += 0.3 * SIZE
    others = [i for i in range(81) if i != LEFT_EYE_OUTER]
    assert np.abs(smoothed(seen)[-1, others] - FACE[others]).max() < 0.01 * SIZE


@pytest.mark.parametrize("gap", ["missing", "reset", "pause", "backwards"])
def test_the_past_is_forgotten(gap: str) -> None:
    landmark_filter = LandmarkFilter()
    landmark_filter.update(FACE, None, 0.0)
    if gap == "missing":
        assert np.isnan(landmark_filter.update(np.full((81, 2), np.nan), None, 0.03)).all()
    if gap == "reset":
        landmark_filter.reset()
    seconds = {"pause": 1.0, "backwards": -0.1}.get(gap, 0.06)
    assert_allclose(
        landmark_filter.update(FACE + 0.004 * SIZE, None, seconds), FACE + 0.004 * SIZE, atol=1e-4
    )


def test_arrays_of_a_wrong_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"points must have shape \(81, 2\), got \(68, 2\)"):
        LandmarkFilter().update(np.zeros((68, 2)), None, 0.0)
    landmark_filter = LandmarkFilter()
    landmark_filter.update(FACE, None, 0.0)
    with pytest.raises(ValueError, match=r"point_confidence must have shape \(81,\), got \(80,\)"):
        landmark_filter.update(FACE, np.ones(80), 0.03)


def test_coincident_points_come_back_as_they_are() -> None:
    assert_allclose(LandmarkFilter().update(np.zeros((81, 2)), None, 0.0), np.zeros((81, 2)))


def test_brows_that_rise_a_little_are_seen_to_rise() -> None:
    """By a hundredth of the inter-ocular distance, over a fifth of a second and back."""
    rise = 0.01 * SIZE * np.sin(np.linspace(0, np.pi, 12))
    seen = FACE + noise(40, 0.0005 * SIZE)
    seen[14:26, BROWS, 1] -= rise[:, None]
    found = (FACE[BROWS, 1] - smoothed(seen)[:, BROWS, 1]).mean(1)
    assert found.max() > 0.7 * rise.max()
