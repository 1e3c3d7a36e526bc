"""A face whose skin takes a tone far from its own keeps fewer of its tints; at its border it is the person's skin."""

import numpy as np
import pytest
from made_up import FRAME
from numpy.testing import assert_allclose
from test_turned_texture import enrolled

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel
from guise.aam.landmarks.schemes import CHIN, LEFT_BROW, LEFT_EYE, LIPS, NOSE_TIP, RIGHT_BROW, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.aam.skin_tone import (
    LIMITS,
    distance_inside,
    hair_in_light_of,
    in_contrast_of,
    in_shades_of,
    toned,
    with_rim_of,
)
from guise.common.arrays import F32

SKIN = skin_mask(FRAME)[FRAME.mask]
EYE = soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.5
LIP = soft_parts(FRAME, (LIPS,), 0.0)[FRAME.mask] > 0.9
SPOTS = SKIN & (FRAME.pixels % 8 < 2)
FAIR, DARK = (210, 165, 140), (80, 52, 40)
PINK, MAUVE = (200, 110, 110), (62, 44, 42)


def person(skin: tuple[int, int, int], lips: tuple[int, int, int], redness: float = 1.0) -> AppearanceModel:
    """Somebody with black eyes and spots so much redder than their skin."""
    texture = np.tile(np.array(skin, np.float32), (len(FRAME.pixels), 1))
    texture[SPOTS] *= (redness, 1, 1)
    texture[LIP] = lips
    texture[EYE] = np.float32(skin) / 5
    return enrolled(0, texture).appearance


def texture_of(appearance: AppearanceModel) -> F32:
    return np.asarray(appearance.neutral_texture)


def redness(texture: F32) -> float:
    """Logarithm of the spots' red over green, over that of the other skin."""
    red, other = (np.log(texture[part, 0] / texture[part, 1]).mean() for part in (SPOTS, SKIN & ~SPOTS))
    return float(red - other)


def test_a_face_of_the_same_tone_is_left_alone() -> None:
    donor = person(FAIR, PINK, 1.3)
    same = toned(donor, person((200, 160, 140), MAUVE, 1.3))
    assert_allclose(texture_of(same), texture_of(donor), atol=2)


def test_tints_are_eased_and_brightness_stays() -> None:
    donor = person(DARK, MAUVE, 1.3)
    before, after = texture_of(donor), texture_of(toned(donor, person(FAIR, PINK)))
    assert 0 < redness(after) < 0.5 * redness(before)
    assert np.abs((after @ LUMA / (before @ LUMA))[SKIN] - 1).max() < 0.02


def test_the_farther_the_tones_the_less_of_the_tints() -> None:
    donor = person(DARK, MAUVE, 1.3)
    left = [redness(texture_of(toned(donor, person(skin, PINK)))) for skin in ((110, 75, 60), FAIR)]
    assert left[0] > left[1]


def test_tints_of_strong_colours_fade_on_a_pale_face_lids_included() -> None:
    orange, pale = (200, 120, 70), (155, 138, 130)
    assert abs(np.log((np.array(orange) @ LUMA) / (np.array(pale) @ LUMA))) < 0.1
    donor = person(orange, PINK, 1.3)
    lids = soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.02)[FRAME.mask] > 0.5
    lids &= soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] < 0.1
    donor.neutral[SHAPE_ENTRIES:].reshape(-1, 3)[lids] *= (1, 1, 1.5)
    before, after = texture_of(donor), texture_of(toned(donor, person(pale, PINK)))
    assert 0 < redness(after) < 0.5 * redness(before)
    blue = [np.log(t[lids, 2] / t[lids, 1]).mean() - np.log(70 / 120) for t in (before, after)]
    assert 0 < blue[1] < 0.7 * blue[0]
    assert np.abs((after @ LUMA / (before @ LUMA))[SKIN] - 1).max() < 0.02
    same = toned(person(pale, PINK, 1.3), person(orange, PINK))
    assert redness(texture_of(same)) > 0.9 * redness(before)


def test_at_its_border_a_face_is_the_persons_and_inside_its_own() -> None:
    frame = ReferenceFrame.canonical(96)
    skin, inside = skin_mask(frame), distance_inside(frame)
    face = np.full((*frame.size, 3), FAIR, np.float32)
    beard = np.arange(frame.size[0])[:, None] > frame.points[CHIN, 1] - 0.3 * frame.resolution
    other = np.where((skin & beard)[..., None], np.float32(0.7) * face, face)
    made, shaven = (
        with_rim_of(face, other, bare, frame) / face
        for bare in (np.ones(frame.size, np.float32), np.asarray(~beard & skin, np.float32))
    )
    jaw = skin & beard & (np.abs(np.arange(frame.size[1]) - frame.points[CHIN, 0]) < 0.2 * frame.resolution)
    np.testing.assert_allclose(shaven[jaw], 1, atol=1e-3)
    assert made[jaw & (inside < 0.08)].mean() < 0.95 * made[jaw & (inside > 0.12)].mean()
    np.testing.assert_allclose(made[skin & (inside > LIMITS.rim_face_widths)], 1, atol=1e-3)


def test_a_shadow_is_taken_over_and_a_mole_is_not() -> None:
    frame = ReferenceFrame.canonical(96)
    skin, middle = skin_mask(frame), frame.points[CHIN, 0]
    left = skin & (np.arange(frame.size[1]) < middle - 0.15 * frame.resolution)
    face = np.full((*frame.size, 3), FAIR, np.float32)
    shady = np.where(left[..., None], np.float32(0.7) * face, face)
    y, x = np.argwhere(left & (distance_inside(frame) > 0.1))[0]
    marked = face.copy()
    marked[y, x] *= 0.3
    made, none = (
        in_shades_of(face, other, np.ones(frame.size, np.float32), frame) for other in (shady, face)
    )
    np.testing.assert_allclose(none[skin], face[skin], rtol=1e-3)
    assert np.median(made[left]) < 0.85 * np.median(made[skin & ~left])
    seen = in_shades_of(face, marked, np.ones(frame.size, np.float32), frame)
    np.testing.assert_allclose(seen[y, x], face[y, x], rtol=0.05)


def test_pallor_and_flush_are_taken_over_without_brightness() -> None:
    frame = ReferenceFrame.canonical(96)
    skin = skin_mask(frame)
    face = np.full((*frame.size, 3), FAIR, np.float32)
    cheeks = skin & (np.abs(np.arange(frame.size[0]) - frame.points[NOSE_TIP, 1]) < 20)[:, None]
    other = np.where(cheeks[..., None], face * np.float32([1.1, 0.9, 0.9]), face)
    made = in_shades_of(face, other, np.ones(frame.size, np.float32), frame, bright=False)
    red = made[..., 0] / made[..., 1]
    assert red[cheeks].mean() > 1.05 * red[skin & ~cheeks].mean()
    assert_allclose((made @ LUMA)[skin], FAIR @ LUMA, rtol=0.03)


def eyed(skin: float, black: float, haze: float = 0.0) -> F32:
    """Somebody with black eyes, seen through haze."""
    texture = np.full((len(FRAME.pixels), 3), skin + haze, np.float32)
    texture[EYE] = black + haze
    return FRAME.scatter(texture)


def darkness(face: F32) -> float:
    """Luma of the eyes over that of the skin."""
    luma = face[FRAME.mask] @ LUMA
    return float(luma[EYE].mean() / luma[SKIN].mean())


def contrasty(face: F32, other: F32) -> F32:
    return in_contrast_of(face, other, FRAME)


def test_haze_is_taken_off_on_a_clear_picture_and_added_on_a_hazy_one() -> None:
    clear, hazy, hardly = eyed(150, 30), eyed(150, 30, haze=25), eyed(150, 30, haze=10)
    assert_allclose(darkness(contrasty(hazy, clear)), 0.2, atol=0.01)
    assert_allclose(darkness(contrasty(clear, hardly)), 40 / 160, atol=0.01)


def test_skin_of_another_tone_is_no_haze() -> None:
    dark, hazy = eyed(75, 25), eyed(75, 25, haze=25)
    for face in (dark, hazy):
        assert_allclose(contrasty(face, eyed(160, 25))[FRAME.mask], dark[FRAME.mask], atol=1)


def test_faces_of_the_same_contrast_are_left_alone() -> None:
    face = eyed(120, 30)
    assert_allclose(contrasty(face, eyed(160, 40)), face, atol=1e-3)


@pytest.mark.parametrize(("face", "other"), [(140.0, 5.0), (5.0, 140.0)])
def test_contrast_changes_within_limits(face: float, other: float) -> None:
    before = eyed(150, face)
    after = contrasty(before, eyed(150, other))
    stretch = (1 - darkness(after)) / (1 - darkness(before))
    assert_allclose(stretch, LIMITS.stretch[1 if face > other else 0], rtol=0.01)


def test_taking_off_grey_makes_lips_no_redder() -> None:
    hazy = FRAME.scatter(texture_of(person(FAIR, PINK)) + 25)
    lips = hazy[FRAME.mask][LIP].mean(0)
    after = contrasty(hazy, eyed(150, 15))[FRAME.mask][LIP].mean(0)
    assert after @ LUMA < lips @ LUMA - 5
    assert_allclose(after[0] / after[1], lips[0] / lips[1], rtol=1e-3)


def hair_beside(skin: tuple[int, int, int], hair: tuple[int, int, int], light: float = 1.0) -> F32:
    """Colour of brows on yellow skin, in the light in which another has this skin and whites so much bluer."""
    brows = soft_parts(FRAME, (RIGHT_BROW, LEFT_BROW), 0.0)[FRAME.mask] > 0.9
    face, other = texture_of(person((210, 165, 90), PINK)), texture_of(person(skin, PINK))
    face[brows], other[EYE] = hair, np.array((200, 200, 200 * light))
    shown = hair_in_light_of(FRAME.scatter(face), FRAME.scatter(other), FRAME)
    tones = [np.exp(np.log(one[SKIN] + 4).mean(0)) for one in (face, other)]
    return np.asarray((shown[FRAME.mask][brows].mean(0) + 4) * tones[1] / tones[0])


def test_black_hair_is_black_beside_skin_of_another_colour_and_brown_hair_stays() -> None:
    red, green, blue = hair_beside(FAIR, (50, 50, 50))
    assert red >= green - 0.5
    assert_allclose(blue, green, rtol=0.02)
    in_blue_light = hair_beside(FAIR, (50, 50, 50), light=1.3)
    assert in_blue_light[2] > 1.2 * in_blue_light[1]
    same = hair_beside((210, 165, 90), (70, 50, 35))
    assert_allclose(same, (74, 54, 39), atol=0.5)
