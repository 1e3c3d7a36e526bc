"""A person's irises, places in an eye, and whites that take the colour of the light, not that of another skin."""

import numpy as np
import pytest
from made_up import FRAME
from models import model_file
from numpy.testing import assert_allclose

from guise.aam.irises import LIMITS, Irises, Whites, in_eye, nose_length, width_to_nose
from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32

EYES = soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.5
SKIN = np.flatnonzero(skin_mask(FRAME)[FRAME.mask])
FAIR, DARK = np.array([210, 165, 140], np.float32), np.array([95, 60, 40], np.float32)
SHAPE = ReferenceFrame.canonical(96).points
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


def test_places_in_an_eye_do_not_depend_on_where_it_is() -> None:
    outline = np.array([[10, 20], [12, 24], [14, 26], [16, 28], [0, 0], [0, 0]], float)
    places = in_eye([[10, 20], [16, 28], [13, 24], [9, 27]], outline)
    assert places == pytest.approx(np.array([[-0.5, 0], [0.5, 0], [0, 0], [0, 0.5]]), abs=1e-6)


def test_an_iris_of_a_turned_head_stays_round() -> None:
    turned = SHAPE * (0.6, 1.0)
    middle = turned[RIGHT_EYE][[0, 3]].mean(0)
    radius = 0.2 * float(np.linalg.norm(np.diff(SHAPE[RIGHT_EYE][[0, 3]], axis=0)))
    rim = middle + radius * np.array([[0.6, 0.0], [0.0, 1.0]])
    places = in_eye(rim, turned[RIGHT_EYE], width_to_nose(RIGHT_EYE, SHAPE) * nose_length(turned))
    assert np.hypot(*places.T) == pytest.approx(0.2, rel=0.05)


def test_a_persons_irises_are_known_from_the_model() -> None:
    face = Identity.load(model_file("p01")).appearance
    known = Irises.at_rest(face.reference, face.neutral_shape, face.neutral_texture)
    assert LIMITS.radii[0] <= known.radius <= LIMITS.radii[1] + 1e-6
    assert np.abs(known.places).max() < 0.15
    assert known.colour.min() > 0
    assert known.colour.max() < 1.0
    inner, rim = known.at(np.array([0.4, 0.7], np.float32)).T  # the grid is too coarse for the pupil
    assert inner.mean() < rim.mean()


@pytest.mark.parametrize(
    ("seen", "unlike"),
    [
        ((0.34, 0.27, 0.35), "purple"),
        ((0.6, 0.2, 0.2), "red"),
        ((0.3, 0.4, 0.8), "of the sky"),
        ((0.9, 0.9, 0.9), "white"),
    ],
)
def test_an_iris_has_a_colour_that_irises_have(seen: tuple[float, float, float], unlike: str) -> None:
    rings = np.where((np.arange(LIMITS.rings)[:, None] + 0.5) * LIMITS.reach / LIMITS.rings < 1, seen, 1)
    red, green, blue = Irises(0.2, rings.astype(np.float32), np.zeros((2, 2))).in_human_range().colour
    assert red <= 1.85 * green, unlike
    assert blue <= 1.25 * green, unlike
    assert red >= blue or green > 0.35, unlike  # dark ones are brown
    assert green <= 0.75, unlike


@pytest.mark.parametrize("seen", [(0.34, 0.22, 0.15), (0.42, 0.46, 0.4), (0.5, 0.55, 0.6)])
def test_the_colour_of_a_usual_iris_stays(seen: tuple[float, float, float]) -> None:
    irises = Irises(0.2, np.tile(np.float32(seen), (LIMITS.rings, 1)), np.zeros((2, 2)))
    np.testing.assert_allclose(irises.in_human_range().colour, seen, rtol=0.02)
