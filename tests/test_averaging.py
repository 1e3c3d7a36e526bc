"""Averages of people: axioms of a mean, over appearance, ways to move and what is kept beside them."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import FRAME, appearance

from guise.aam.appearance import AppearanceModel, Components
from guise.aam.averaging import average, average_components
from guise.aam.extrapolation import Extrapolator, ReferenceMismatchError
from guise.aam.model import Identity, RestFrame
from guise.aam.reference import ReferenceFrame
from guise.aam.tracker import Quality, Tracker


def person(seed: int, modes: int = 6, reference: ReferenceFrame = FRAME) -> Identity:
    """A made-up person with a tracker of shapes alone."""
    rng = np.random.default_rng(seed)
    look = appearance(seed, modes, reference)
    look = replace(look, mask=reference.mask & (rng.random(reference.size) < 0.5))
    shapes = Components(
        rng.normal(size=162).astype(np.float32),
        np.linalg.qr(rng.normal(size=(162, 4)))[0].astype(np.float32),
        np.float32([4, 3, 2, 1]),
        31.0,
    )
    nothing = Components(np.zeros(0, np.float32), np.zeros((0, 0), np.float32), np.zeros(0, np.float32), 0.0)
    tracker = Tracker(shapes, (), nothing, np.zeros(0, np.intp), Quality(0.01, 0.2, 0.9), rng.normal(size=3))
    detail = rng.normal(size=(2 * reference.size[0], 2 * reference.size[1])).astype(np.float32)
    still = RestFrame(rng.integers(0, 255, (60, 60, 3), np.uint8), reference.points)
    return Identity(f"made up {seed}", look, tracker, detail, still)


def covariance(components: Components) -> np.ndarray:
    scaled = components.basis.astype(np.float64) * components.deviations
    return scaled @ scaled.T


def test_the_average_of_one_looks_and_moves_as_that_one() -> None:
    one = person(1)
    mean = average([one], "mean")
    look, own = mean.appearance, one.appearance
    np.testing.assert_array_equal(look.neutral, own.neutral)
    np.testing.assert_array_equal(look.mask, own.mask)
    np.testing.assert_array_equal(mean.detail, one.detail)
    np.testing.assert_allclose(look.components.mean, own.components.mean)
    np.testing.assert_allclose(look.components.deviations, own.components.deviations, rtol=1e-4)
    np.testing.assert_allclose(
        np.abs(np.sum(look.components.basis * own.components.basis, axis=0)), 1, atol=1e-3
    )


def test_the_order_does_not_matter() -> None:
    people = [person(seed) for seed in (1, 2, 3)]
    one, other = average(people, "mean").appearance, average(people[::-1], "mean").appearance
    np.testing.assert_allclose(one.neutral, other.neutral, rtol=1e-6)
    np.testing.assert_array_equal(one.mask, other.mask)
    np.testing.assert_allclose(one.components.deviations, other.components.deviations, rtol=1e-4)
    np.testing.assert_allclose(
        np.abs(np.sum(one.components.basis * other.components.basis, axis=0)), 1, atol=1e-3
    )


def test_neutral_mean_and_detail_are_the_means() -> None:
    people = [person(seed) for seed in (1, 2, 3)]
    mean = average(people, "mean")
    np.testing.assert_allclose(
        mean.appearance.neutral_texture, np.mean([p.appearance.neutral_texture for p in people], 0), rtol=1e-5
    )
    np.testing.assert_allclose(
        mean.appearance.components.mean, np.mean([p.appearance.components.mean for p in people], 0), rtol=1e-5
    )
    np.testing.assert_allclose(mean.detail, np.mean([p.detail for p in people], 0), atol=1e-5)


def test_a_pixel_is_face_when_it_is_in_half_of_the_people() -> None:
    people = [person(seed) for seed in (1, 2, 3)]
    votes = np.sum([p.appearance.mask for p in people], axis=0)
    np.testing.assert_array_equal(average(people, "mean").appearance.mask, votes >= 2)


def test_the_covariance_is_the_mean_covariance_as_far_as_the_modes_reach() -> None:
    several = [person(seed).tracker.shapes for seed in (1, 2)]
    expected = np.mean([covariance(c) for c in several], axis=0)
    found = average_components(several)
    values, vectors = np.linalg.eigh(expected)
    best = (vectors[:, -4:] * values[-4:]) @ vectors[:, -4:].T
    assert found.modes == 4
    np.testing.assert_allclose(covariance(found), best, atol=1e-4 * values[-1])


def test_modes_that_all_share_are_kept_whole() -> None:
    one = person(1).tracker.shapes
    doubled = replace(one, deviations=one.deviations * 2)
    found = average_components([one, doubled])
    np.testing.assert_allclose(found.deviations, one.deviations * np.sqrt(2.5), rtol=1e-4)


def test_an_average_shows_nobodys_picture_and_tracks_nobody() -> None:
    people = [person(1), person(2)]
    mean = average(people, "mean")
    assert mean.tracker.stages == ()
    assert mean.tracker.pixels.size == 0
    face = mean.appearance.picture(mean.appearance.neutral)
    np.testing.assert_array_equal(mean.rest_frame.picture[FRAME.mask], face[FRAME.mask])


def test_an_average_can_be_saved_and_can_be_a_donor(tmp_path) -> None:
    mean = average([person(1), person(2)], "mean")
    mean.save(tmp_path / "mean.guise")
    again = Identity.load(tmp_path / "mean.guise")
    np.testing.assert_allclose(again.appearance.neutral, mean.appearance.neutral)
    assert again.facts["average_of"] == ["made up 1", "made up 2"]
    source: AppearanceModel = person(3).appearance
    shown = Extrapolator(source, again.appearance, 0.6).apply(source.neutral_parameters)
    np.testing.assert_allclose(
        again.appearance.texture_of(shown), again.appearance.neutral_texture, atol=1e-3
    )


def test_different_reference_frames_are_refused() -> None:
    with pytest.raises(
        ReferenceMismatchError, match=r"made up 1 and made up 2 cannot be averaged.*32 and 40"
    ):
        average([person(1), person(2, reference=ReferenceFrame.canonical(40))], "mean")
