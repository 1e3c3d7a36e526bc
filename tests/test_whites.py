"""Eyes and teeth take the colour of the light, not that of another skin."""

import numpy as np
from made_up import FRAME
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.app.swapping.whites import Whites
from guise.common.arrays import F32

EYES = soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.5
SKIN = np.flatnonzero(skin_mask(FRAME)[FRAME.mask])
FAIR, DARK = np.array([210, 165, 140], np.float32), np.array([95, 60, 40], np.float32)
WARM = np.array([1.1, 1, 0.8], np.float32)


def person(skin: F32, light: F32 | float = 1.0) -> F32:
    """A texture (n, 3) of somebody with white eyes and dark irises, in a light."""
    texture = np.tile(skin, (len(FRAME.pixels), 1))
    texture[EYES] = 190
    texture[np.flatnonzero(EYES)[::3]] = 40
    return np.asarray(texture * light, np.float32)


def shown(own: F32, other: F32, skin: F32) -> F32:
    """Tint of white of the other's eyes as drawn."""
    return Whites(FRAME, (own, other), SKIN).tint(skin)


def test_white_stays_white_whatever_the_skins() -> None:
    for own, other in ((FAIR, DARK), (DARK, FAIR)):
        assert_allclose(shown(person(own), person(other), 0.7 * own), 1, atol=1e-3)


def test_white_takes_the_colour_of_the_scene() -> None:
    warm = WARM / (WARM @ LUMA)
    assert_allclose(shown(person(FAIR), person(DARK), FAIR * WARM), warm, atol=1e-3)
    assert_allclose(shown(person(FAIR, WARM), person(DARK), FAIR * WARM), warm, atol=1e-3)


def test_the_light_of_the_faces_own_clip_goes() -> None:
    drawn = shown(person(FAIR), person(DARK, WARM), FAIR) * WARM
    assert_allclose(drawn / drawn[0], 1, atol=1e-3)


def test_a_person_of_whom_no_skin_is_seen_is_no_error() -> None:
    assert np.isfinite(shown(person(FAIR), person(DARK), 0 * FAIR)).all()
