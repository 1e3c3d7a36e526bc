"""A donor's glasses are taken out of their neutral face, and nothing of who wears none."""

from dataclasses import replace

import numpy as np
import pytest
from models import model_file
from worn_glasses import with_glasses

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.detail import FINE
from guise.aam.landmarks.schemes import LEFT_BROW, LEFT_EYE, LIPS, RIGHT_BROW, RIGHT_EYE
from guise.aam.mask import soft_parts
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
