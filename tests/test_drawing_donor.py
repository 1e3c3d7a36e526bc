"""A face that is shown is cleaned once, and forgotten with its model."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from models import model_file

from guise.aam.model import Identity
from guise.app.drawing import donor
from guise.app.drawing.donor import Donor


@pytest.fixture
def identity() -> Identity:
    return Identity.load(model_file("p02"))


def test_a_model_is_cleaned_once(identity: Identity, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    real = donor.evenly_lit
    monkeypatch.setattr(donor, "evenly_lit", lambda given: calls.append(given) or real(given))
    first = Donor.cleaned(identity)
    assert Donor.cleaned(identity) is first
    assert len(calls) == 1
    assert Donor.cleaned(replace(identity)) is not first  # another object may hold another face
    assert len(calls) == 2


def test_what_was_cleaned_goes_with_its_model() -> None:
    identity = Identity.load(model_file("p02"))
    kept = weakref.ref(Donor.cleaned(identity))
    gone = weakref.ref(identity)
    assert kept() is not None
    del identity
    gc.collect()
    assert gone() is None
    assert kept() is None


def test_the_model_itself_stays_as_it_is(identity: Identity) -> None:
    before = identity.appearance.neutral.copy()
    made = Donor.cleaned(identity)
    np.testing.assert_array_equal(identity.appearance.neutral, before)
    assert (made.identity.appearance.neutral != before).any()


def test_beside_a_person_a_face_has_a_tone_fit_for_theirs_and_the_cleaned_one_stays(
    identity: Identity,
) -> None:
    person, clean = Identity.load(model_file("p06")), Donor.cleaned(identity)
    before = clean.texture.copy()
    beside = clean.beside(person, own_lips=True)
    assert (beside.texture != before).any()
    np.testing.assert_array_equal(clean.texture, before)
    assert beside.moving is clean.moving
    np.testing.assert_array_equal(beside.at_rest, clean.at_rest)
