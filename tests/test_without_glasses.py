"""A donor's glasses are taken out of their neutral face, and nothing of who wears none."""

from dataclasses import replace

import numpy as np
import pytest
from models import model_file
from numpy.testing import assert_allclose
from worn_glasses import with_glasses

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.detail import FINE
from guise.aam.landmarks.schemes import LEFT_BROW, LEFT_EYE, LIPS, RIGHT_BROW, RIGHT_EYE, Group
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.mirror import mirror_image
from guise.aam.model import Identity
from guise.aam.without_glasses import without_glasses
from guise.common.arrays import F32


@pytest.fixture(scope="module")
def bare() -> Identity:
    return Identity.load(model_file("p01"))


@pytest.fixture(scope="module")
def worn(bare: Identity) -> Identity:
    """The same person, enrolled with glasses: in the picture at rest and in the neutral face."""
    rest, reference = bare.rest_frame, bare.reference
    face = with_glasses(texture(bare).astype(np.uint8), reference.points).astype(np.float32)
    neutral = bare.appearance.neutral.copy()
    neutral[SHAPE_ENTRIES:] = face[reference.mask].ravel()
    picture = with_glasses(rest.picture, rest.shape)
    return replace(
        bare,
        appearance=replace(bare.appearance, neutral=neutral),
        rest_frame=replace(rest, picture=picture),
    )


def texture(person: Identity) -> F32:
    return person.reference.scatter(person.appearance.neutral_texture)


def test_rims_are_filled_with_the_skin_around_them(bare: Identity, worn: Identity) -> None:
    rims = np.abs(texture(worn) - texture(bare)).max(2) > 60
    skin = soft_parts(bare.reference, (RIGHT_EYE, LEFT_EYE, RIGHT_BROW, LEFT_BROW), 0.02) < 0.1
    before, after = (
        np.abs(texture(p) - texture(bare))[rims & skin].mean() for p in (worn, without_glasses(worn))
    )
    assert after < 0.25 * before


def test_eyes_and_mouth_stay_and_no_detail_is_left_of_the_rims(worn: Identity) -> None:
    clear = without_glasses(worn)
    change = np.abs(texture(clear) - texture(worn)).max(2)
    kept = soft_parts(worn.reference, (RIGHT_EYE, LEFT_EYE, LIPS), 0.0) > 0.9
    assert change[kept].max() < 1
    filled = np.kron(change > 100, np.ones((FINE, FINE), bool))
    assert np.abs(clear.detail)[filled].mean() < 0.2 * np.abs(worn.detail)[filled].mean()


def test_who_wears_none_stays_as_they_are(bare: Identity) -> None:
    assert without_glasses(bare) is bare


def with_reflection(person: Identity, eyes: tuple[Group, ...]) -> Identity:
    """The same person with a white reflection before eyes."""
    face, neutral = texture(person), person.appearance.neutral.copy()
    face[soft_parts(person.reference, eyes, 0.04) > 0.5] = 250
    neutral[SHAPE_ENTRIES:] = face[person.reference.mask].ravel()
    return replace(person, appearance=replace(person.appearance, neutral=neutral))


def test_an_eye_behind_a_reflection_is_the_mirror_image_of_the_other(bare: Identity, worn: Identity) -> None:
    eye = soft_parts(bare.reference, (RIGHT_EYE,), 0.0) > 0.5
    clear = texture(without_glasses(with_reflection(worn, (RIGHT_EYE,))))
    assert_allclose(clear[eye], mirror_image(texture(bare), bare.reference, 1)[eye], atol=5)


def test_behind_two_reflections_is_skin(bare: Identity, worn: Identity) -> None:
    eye = soft_parts(bare.reference, (RIGHT_EYE, LEFT_EYE), 0.03) > 0.5
    clear = texture(without_glasses(with_reflection(worn, (RIGHT_EYE, LEFT_EYE))))
    skin = np.median(texture(bare)[skin_mask(bare.reference)], axis=0)
    assert clear[eye].max() < 1.3 * skin.max()
