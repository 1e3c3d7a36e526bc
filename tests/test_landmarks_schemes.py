"""Landmark schemes: groups, mirror permutation, completion of the forehead."""

from pathlib import Path

import numpy as np
import pytest

from guise.aam import landmarks as lm
from guise.aam.landmarks.schemes import IBUG68, LEFT_EYE_OUTER, Geometry, fit_geometry, mean_geometry

SAMPLES = Path(__file__).parents[1] / "sample_videos"
PEOPLE = ("p01", "p02", "p06")


def truth(person: str) -> np.ndarray:
    clips = [np.load(SAMPLES / person / f"{clip}.npz")["landmarks"][::5] for clip in ("talk", "talk2")]
    return np.concatenate(clips).astype(float)


def error_percent(found: np.ndarray, points: np.ndarray) -> float:
    distance = np.linalg.norm(found - points[:, lm.FOREHEAD], axis=-1).mean(axis=1)
    return float((distance / lm.interocular(points)).mean() * 100)


def test_groups_name_every_point_once() -> None:
    named = [index for group in lm.GROUPS.values() for index in group]
    assert sorted(named) == list(range(lm.COUNT))


def test_mirror_permutation_is_an_involution() -> None:
    permutation = np.array(lm.MIRROR)
    np.testing.assert_array_equal(permutation[permutation], np.arange(lm.COUNT))


def test_mirror_swaps_the_sides() -> None:
    permutation = np.array(lm.MIRROR)
    for right, left in (("right_eye", "left_eye"), ("right_brow", "left_brow")):
        assert set(permutation[list(lm.GROUPS[right])]) == set(lm.GROUPS[left])
    for own in ("jaw", "nose", "outer_lips", "inner_lips", "forehead"):
        assert set(permutation[list(lm.GROUPS[own])]) == set(lm.GROUPS[own])


@pytest.mark.parametrize("person", PEOPLE)
def test_mirrored_face_stays_near_the_face(person: str) -> None:
    """A wrong permutation would put left points right: far more than a turned head's asymmetry."""
    points = truth(person).mean(axis=0)
    flipped = lm.mirror(points, 640)
    flipped += points.mean(axis=0) - flipped.mean(axis=0)
    assert np.linalg.norm(flipped - points, axis=1).max() < 0.4 * lm.interocular(points)


def test_mirror_twice_is_the_identity() -> None:
    points = np.random.default_rng(0).random((5, 81, 2))
    np.testing.assert_allclose(lm.mirror(lm.mirror(points, 320), 320), points, atol=1e-12)


def test_interocular_of_a_batch() -> None:
    points = np.zeros((3, 4, 81, 2))
    points[..., LEFT_EYE_OUTER, :] = 3, 4
    np.testing.assert_array_equal(lm.interocular(points), np.full((3, 4), 5.0))


@pytest.mark.parametrize("seed", range(5))
def test_completion_is_equivariant_under_similarities(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = truth(PEOPLE[seed % 3])[rng.integers(50)]
    points = points + rng.normal(0, 2, points.shape)
    angle, scale, shift = rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 5), rng.uniform(-300, 300, 2)
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    before = lm.to_face81(points[IBUG68], "ibug68") @ turn.T + shift
    after = lm.to_face81(points[IBUG68] @ turn.T + shift, "ibug68")
    np.testing.assert_allclose(after, before, atol=2e-3)


def test_completion_is_equivariant_under_mirroring() -> None:
    points = truth("p02")[7]
    mirrored = lm.to_face81(lm.mirror(points, 640)[IBUG68], "ibug68")
    np.testing.assert_allclose(mirrored, lm.mirror(lm.to_face81(points[IBUG68], "ibug68"), 640), atol=2e-3)


def test_completion_keeps_the_points_it_was_given() -> None:
    points = truth("p01")[3:9, IBUG68].astype(np.float32)
    np.testing.assert_array_equal(lm.to_face81(points, "ibug68")[:, IBUG68], points)


def test_completion_of_missing_frames_is_missing() -> None:
    points = truth("p01")[:3, IBUG68]
    points[1] = np.nan
    completed = lm.to_face81(points, "ibug68")
    assert np.isnan(completed[1]).all()
    assert np.isfinite(completed[[0, 2]]).all()


@pytest.mark.parametrize("left_out", PEOPLE)
def test_completion_of_a_person_not_seen_is_close(left_out: str) -> None:
    geometry = fit_geometry([truth(person) for person in PEOPLE if person != left_out])
    points = truth(left_out)
    assert error_percent(geometry.forehead(points[:, IBUG68]), points) < 4.5


def test_stored_geometry_is_what_the_sample_clips_give() -> None:
    geometry = fit_geometry([truth(person) for person in PEOPLE])
    np.testing.assert_allclose(mean_geometry().mean, geometry.mean, atol=2e-6)
    np.testing.assert_allclose(mean_geometry().turn, geometry.turn, atol=2e-6)


def test_turn_term_helps_on_turned_heads() -> None:
    geometry = mean_geometry()
    still = Geometry(geometry.mean, np.zeros_like(geometry.turn))
    points = np.concatenate([truth(person) for person in PEOPLE])
    own = error_percent(geometry.forehead(points[:, IBUG68]), points)
    assert own < 0.8 * error_percent(still.forehead(points[:, IBUG68]), points)


@pytest.mark.parametrize(
    ("points", "scheme", "message"),
    [
        (np.zeros((81, 2)), "ibug68", r"shape \(..., 68, 2\), got \(81, 2\)"),
        (np.zeros(81), "face81", r"shape \(..., 81, 2\), got \(81,\)"),
        (np.zeros((81, 2)), "wflw", r"one of face81, ibug68.*, got 'wflw'"),
    ],
)
def test_completion_refuses_wrong_points(points: np.ndarray, scheme: str, message: str) -> None:
    with pytest.raises(lm.LandmarkError, match=message):
        lm.to_face81(points, scheme)


def test_scheme_can_be_added_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from guise.aam.landmarks import schemes

    monkeypatch.setattr(schemes, "_SCHEMES", dict(schemes._SCHEMES))
    double = lm.Scheme("double", 162, lambda p: p[..., : lm.COUNT, :], tuple(range(lm.COUNT)))
    lm.register_scheme(double)
    assert lm.to_face81(np.zeros((162, 2)), "double").shape == (81, 2)
    with pytest.raises(ValueError, match="registered already"):
        lm.register_scheme(double)


def test_face_is_read_only_and_checked() -> None:
    points = np.random.default_rng(0).random((81, 2))
    face = lm.Face.around(points, 0.5)
    points[:] = 0
    assert face.points.max() > 0
    with pytest.raises(ValueError, match="read-only"):
        face.points[0] = 0
    with pytest.raises(ValueError, match=r"points must have shape \(81, 2\), got \(68, 2\)"):
        lm.Face.around(np.zeros((68, 2)), 0.5)
    with pytest.raises(ValueError, match=r"confidence must be in \[0, 1\], got 1.5"):
        lm.Face.around(np.zeros((81, 2)), 1.5)
