"""Signatures: the same for one person under other light, different for others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from models import SMALL as OPTIONS
from models import model_file

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.landmarks import open_landmarker
from guise.aam.mask import core_mask
from guise.aam.model import Identity
from guise.aam.recognition import (
    MIN_SAME_PERSON_SIMILARITY,
    SIGNATURE_LENGTH,
    cosine_similarity,
    features,
    same_person,
    signature,
    signature_of,
)
from guise.aam.reference import ReferenceFrame
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.swapping.donors import gallery, open_donor

SAMPLES = Path(__file__).parents[1] / "sample_videos"
SMALL = ReferenceFrame.canonical(32)


def lit(identity: Identity, change) -> Identity:
    """The same model with another mean texture (n, 3)."""
    parts = identity.appearance.components
    mean = parts.mean.copy()
    mean[SHAPE_ENTRIES:] = change(mean[SHAPE_ENTRIES:].reshape(-1, 3)).ravel()
    return replace(identity, appearance=replace(identity.appearance, components=replace(parts, mean=mean)))


def test_a_signature_has_length_one() -> None:
    found = signature(open_donor("p01"))
    assert found.shape == (SIGNATURE_LENGTH,)
    assert found.dtype == np.float32
    assert float(found @ found) == pytest.approx(1, abs=1e-5)
    assert cosine_similarity(found, found) == pytest.approx(1, abs=1e-5)


def test_stronger_light_changes_almost_nothing() -> None:
    person = open_donor("p06")
    assert cosine_similarity(signature(person), signature(lit(person, lambda rgb: 0.8 * rgb))) > 0.98


def test_light_from_one_side_changes_little() -> None:
    person = open_donor("p06")
    across = (person.reference.pixels % person.reference.size[1]) / person.reference.size[1]
    changed = lit(person, lambda rgb: rgb * (0.6 + 0.4 * across[:, None]))
    assert same_person(signature(person), signature(changed))


def test_hair_and_outline_do_not_count() -> None:
    texture = np.random.default_rng(0).uniform(40, 200, (len(SMALL.pixels), 3)).astype(np.float32)
    other = texture.copy()
    other[~core_mask(SMALL)[SMALL.mask]] = 0
    np.testing.assert_array_equal(signature_of(texture), signature_of(other))


def test_features_hold_no_plane() -> None:
    texture = np.random.default_rng(0).uniform(40, 200, (2, len(SMALL.pixels), 3)).astype(np.float32)
    found = features(texture)
    places = np.column_stack(np.divmod(SMALL.pixels, SMALL.size[1]))[core_mask(SMALL)[SMALL.mask]]
    np.testing.assert_allclose(found.mean(-1), 0, atol=1e-5)
    np.testing.assert_allclose(found @ (places - places.mean(0)), 0, atol=1e-2)


@pytest.mark.parametrize("person", ["p01", "p02", "p06"])
@pytest.mark.slow
def test_a_person_is_the_same_in_another_clip(person: str) -> None:
    second = enrol(
        [SAMPLES / person / "talk2.mp4"], LandmarkSource(), name="second",
        options=OPTIONS,
    )  # fmt: skip
    assert same_person(signature(Identity.load(model_file(person))), signature(second))


def test_the_donors_are_all_different() -> None:
    found = np.stack([signature(open_donor(name)) for name in gallery()])
    similarities = (found @ found.T)[~np.eye(len(found), dtype=bool)]
    assert similarities.max() < MIN_SAME_PERSON_SIMILARITY


@pytest.mark.slow
def test_the_resolution_of_a_model_does_not_matter() -> None:
    found = LandmarkSource(landmarker=open_landmarker("builtin"))
    small = enrol([SAMPLES / "p01" / "talk2.mp4"], found, name="small", options=OPTIONS)
    assert small.reference.resolution < open_donor("p01").reference.resolution
    assert same_person(signature(small), signature(open_donor("p01")))
