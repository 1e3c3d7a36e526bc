"""A face that is shown is cleaned once, and what is known of it holds beside everybody."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from models import model_file
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.model import Identity
from guise.aam.skin_tone import toned
from guise.app.drawing.donor import Donor


@pytest.fixture(scope="module")
def identity() -> Identity:
    return Identity.load(model_file("p02"))


def test_a_model_is_cleaned_once(identity: Identity) -> None:
    first = Donor.of(identity)
    assert Donor.of(identity) is first
    assert Donor.of(replace(identity)) is not first  # another object may hold another face


def test_no_more_than_a_few_are_kept(identity: Identity) -> None:
    kept = weakref.ref(Donor.of(replace(identity)))
    for _ in range(4):
        assert Donor.of(replace(identity)) is not kept()
    gc.collect()
    assert kept() is None


def test_the_model_itself_stays_as_it_is(identity: Identity) -> None:
    before = identity.appearance.neutral.copy()
    made = Donor.of(identity)
    assert made.enrolled is identity
    assert_array_equal(identity.appearance.neutral, before)
    assert (made.clean.appearance.neutral != before).any()


def test_beside_a_person_a_face_has_a_tone_fit_for_theirs_and_its_own_shape(identity: Identity) -> None:
    donor, person = Donor.of(identity), Identity.load(model_file("p06")).appearance
    before = donor.clean.appearance.neutral.copy()
    shown = toned(donor.clean.appearance, person)
    assert (shown.neutral != before).any()
    assert_array_equal(donor.clean.appearance.neutral, before)
    assert_array_equal(shown.neutral_shape, donor.at_rest)


def test_its_texture_shows_depths_as_its_shape_at_rest_does(identity: Identity) -> None:
    donor, reference = Donor.of(identity), identity.reference
    known = np.column_stack([donor.solid.rest, np.ones(len(donor.at_rest))])
    seen = np.linalg.lstsq(known, reference.align(donor.at_rest), rcond=None)[0]
    assert_allclose(donor.across, seen[2], atol=0.01 * reference.resolution)
    assert np.linalg.norm(donor.across) > 0.02 * reference.resolution
    assert donor.moving.shape == reference.size
    assert 0 <= donor.moving.min() < donor.moving.max() <= 1
