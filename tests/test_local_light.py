"""The local light: gain and tint are matched, shadows keep their place, hidden texels don't count, noise stays low."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA, grid_places
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.swapping import local_light
from guise.app.swapping.coarse_grid import CellReader, CoarseGrid, TexelSums
from guise.app.swapping.local_light import LocalLight
from guise.common.arrays import F32

FRAME = ReferenceFrame.canonical(80)
TEXELS = np.arange(0, len(FRAME.pixels), 2)
PLACES = grid_places(FRAME)
SKIN = skin_mask(FRAME)[FRAME.mask]
RGB, ZERO = np.eye(3), np.zeros(3)


def face() -> F32:
    """A texture (n, 3) with shading and some detail."""
    rng = np.random.default_rng(0)
    shade = 1 + 0.2 * PLACES[:, :1] - 0.1 * PLACES[:, 1:]
    return np.asarray([170, 125, 105] * shade + rng.normal(0, 4, (len(PLACES), 1)), np.float32)


def lit(light: LocalLight, texture: F32) -> F32:
    return np.asarray(light.apply(texture, RGB, ZERO).T)


def light_fitted(own: F32, seen: F32, visible: F32 | None = None, *, disguise: bool = False) -> LocalLight:
    light = LocalLight(FRAME, TEXELS, FRAME.mask, disguise=disguise)
    light.update(own[TEXELS], seen[TEXELS], None if visible is None else visible[TEXELS])
    return light


@pytest.mark.parametrize("gain", [(0.7, 0.6, 0.5), (1.1, 1.0, 0.9), (0.3, 0.25, 0.2), (1.4, 1.4, 1.3)])
def test_a_face_under_one_gain_and_tint_is_matched(gain: tuple[float, float, float]) -> None:
    seen = face() * np.float32(gain)
    assert np.abs(lit(light_fitted(face(), seen), face()) - seen)[SKIN].mean() < 2.5


def test_a_hard_shadow_keeps_its_place() -> None:
    shadow = np.where(PLACES[:, :1] > 0.1, 0.4, 1.0)
    made = lit(light_fitted(face(), np.float32(face() * shadow)), face())
    ratio = made.mean(1) / face().mean(1)
    for edge in (-0.05, 0.05):
        side = SKIN & (np.abs(PLACES[:, 0] - 0.1 - edge) < 0.01)
        assert (ratio[side].mean() < 0.7) == (edge > 0)
    assert_allclose(ratio[SKIN & (PLACES[:, 0] > 0.25)].mean(), 0.4, atol=0.08)
    assert_allclose(ratio[SKIN & (PLACES[:, 0] < -0.05)].mean(), 1.0, atol=0.05)


def test_a_disguise_takes_over_the_level_of_the_light_and_less_of_what_is_narrow() -> None:
    nose = np.exp(-(((PLACES[:, :1] - PLACES[SKIN, 0].mean()) / 0.06) ** 2))
    seen = np.float32(face() * 0.6 * (1 + 0.4 * nose))
    kept = []
    for disguise in (False, True):
        ratio = lit(light_fitted(face(), seen, disguise=disguise), face()).mean(1) / face().mean(1)
        assert_allclose(ratio[SKIN].mean(), 0.68, atol=0.1)
        kept.append(float(np.cov(ratio[SKIN], nose[SKIN, 0])[0, 1]))
    assert 0 < kept[1] < 0.5 * kept[0]


def test_what_is_hidden_does_not_change_the_light_elsewhere() -> None:
    hidden = PLACES[:, 1] > 0.15
    seen = np.where(hidden[:, None], np.float32([20, 40, 220]), face() * np.float32(0.8))
    with_hand = lit(light_fitted(face(), seen, 1 - hidden.astype(np.float32)), face())
    without = lit(light_fitted(face(), face() * np.float32(0.8)), face())
    assert_allclose(with_hand[SKIN & ~hidden], without[SKIN & ~hidden], atol=4)
    assert np.abs(lit(light_fitted(face(), seen), face()) - without)[SKIN & ~hidden].max() > 20


def test_noise_is_not_amplified_beyond_the_detail_gain() -> None:
    light = light_fitted(face(), np.minimum(face() * np.float32(3.5), 255))
    noise = np.random.default_rng(1).normal(0, 3, (len(PLACES), 1)).astype(np.float32)
    grown = (lit(light, face() + noise) - lit(light, face())) @ LUMA
    low, high = local_light.LIMITS.detail_gain
    assert (np.abs(grown[SKIN]) <= 1.05 * high * np.abs(noise[SKIN, 0]) + 1e-2).all()
    assert low <= light.contrast <= high


def test_a_change_of_light_is_followed_over_a_few_frames_and_at_once_after_a_reset() -> None:
    light = light_fitted(face(), face())
    seen = face() * np.float32(0.5)
    light.update(face()[TEXELS], seen[TEXELS], None)
    assert np.abs(lit(light, face()) - seen)[SKIN].mean() > 15
    for _ in range(8):
        light.update(face()[TEXELS], seen[TEXELS], None)
    assert np.abs(lit(light, face()) - seen)[SKIN].mean() < 3
    light.reset()
    light.update(face()[TEXELS], face()[TEXELS], None)
    assert np.abs(lit(light, face()) - face())[SKIN].mean() < 1


def test_the_stored_components_are_those_of_the_matrix() -> None:
    light = light_fitted(face(), face() * np.float32(0.8))
    matrix, offset = (
        np.array([[0.3, 0.6, 0.1], [-0.2, -0.3, 0.5], [0.5, -0.4, -0.1]]),
        np.array([16.0, 128, 128]),
    )
    assert_allclose(light.apply(face(), matrix, offset).T, lit(light, face()) @ matrix.T + offset, atol=1e-2)


def test_means_of_a_constant_are_that_constant_whatever_the_weights() -> None:
    grid = CoarseGrid(FRAME, 0.03)
    places = grid.places(TEXELS)
    weights = np.random.default_rng(2).uniform(0, 1, len(TEXELS))
    means = grid.smoother(0.05).means(TexelSums(grid.size, places)(np.full((len(TEXELS), 2), 7.0), weights))
    assert means.shape == (2, *grid.size)
    assert_allclose(means, 7, rtol=1e-5)


def test_sums_are_read_where_they_were_put() -> None:
    grid = CoarseGrid(FRAME, 0.03)
    places = grid.places(TEXELS)
    ramp = np.stack(np.meshgrid(*(np.arange(n, dtype=np.float32) for n in grid.size[::-1])))
    assert_allclose(CellReader(places)(ramp).T, places, atol=1 / 16)  # cv2.remap reads in steps of 1/32
    sums = TexelSums(grid.size, places)(places, np.ones(len(places)))
    assert_allclose(sums[:2].sum((1, 2)), places.sum(0), rtol=1e-4)
    assert_allclose((sums[2] * ramp).sum((1, 2)), places.sum(0), rtol=1e-4)


def test_the_eyes_of_a_dark_face_stay_white_on_a_fair_head() -> None:
    eyes = soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.9
    fair, dark = (np.tile(np.float32(skin), (len(PLACES), 1)) for skin in ((210, 165, 140), (95, 60, 40)))
    for texture in (fair, dark):
        texture[soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.4] = 150
    seen = []
    for enrolled in ((fair, dark), None):
        light = LocalLight(FRAME, TEXELS, FRAME.mask, enrolled)
        light.update(dark[TEXELS], fair[TEXELS], None)
        seen.append(lit(light, dark))
        assert_allclose(seen[-1][SKIN].mean(0), (210, 165, 140), rtol=0.05)
    assert np.ptp(seen[0][eyes].mean(0)) < 6
    assert np.ptp(seen[1][eyes].mean(0)) > 30
