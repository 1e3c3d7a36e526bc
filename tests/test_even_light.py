"""The light of a donor's clip is taken out of their texture; what is their own stays."""

import numpy as np
import pytest
from made_up import FRAME
from test_turned_texture import enrolled, halves

from guise.aam import even_light
from guise.aam.even_light import (
    _usual,
    evenly_lit,
    shading,
    symmetric,
    without_glints,
)
from guise.aam.landmarks.schemes import CHIN, NOSE_TIP
from guise.aam.mask import skin_mask
from guise.aam.skin_tone import with_even_forehead
from guise.common.arrays import F32

SKIN = skin_mask(FRAME)


def lit(luma: F32) -> F32:
    """The texture (h, w, 3) of a person shaded as people are, but for factors (h, w)."""
    mean, _ = _usual(FRAME.resolution)
    return np.asarray(120 * (np.exp(mean[..., 0]) * luma)[..., None] * np.ones(3, np.float32), np.float32)


def spot(point: int, factor: float) -> F32:
    """Factors (h, w), of one in the middle of a spot around a point of the face and 1 far from it."""
    ys, xs = np.mgrid[: FRAME.size[0], : FRAME.size[1]]
    x, y = FRAME.points[point]
    near = np.exp(-((xs - x) ** 2 + (ys - y) ** 2) / (2 * (0.07 * FRAME.resolution) ** 2))
    return np.asarray(factor**near, np.float32)


def evened(texture: F32) -> F32:
    """The texture (h, w, 3) of somebody enrolled with another."""
    person = evenly_lit(enrolled(0, texture[FRAME.mask]))
    return FRAME.scatter(person.appearance.neutral_texture)


def around(texture: F32, point: int) -> float:
    """Mean of a texture near a point, over its mean on skin."""
    near = (spot(point, np.e) > np.exp(0.7)) & SKIN
    return float(texture[near].mean() / texture[SKIN].mean())


def test_both_halves_get_the_same_light() -> None:
    texture = FRAME.scatter(halves(60, 180))
    before, after = (shading(t, FRAME)[0][SKIN][:, 0].std() for t in (texture, symmetric(texture, FRAME)))
    assert before > 0.4
    assert after < 0.3 * before


def test_a_face_in_even_light_stays_as_it_is() -> None:
    texture = lit(np.ones(FRAME.size, np.float32))
    assert np.quantile(np.abs(evened(texture) / texture - 1)[SKIN], 0.99) < 0.03


def test_a_gleaming_nose_is_dulled() -> None:
    texture = lit(spot(NOSE_TIP, 1.8))
    before, after, usual = (around(t, NOSE_TIP) for t in (texture, evened(texture), lit(spot(NOSE_TIP, 1))))
    assert before > 1.25 * usual
    assert after - usual < 0.7 * (before - usual)


@pytest.mark.parametrize("bearded", [True, False])
def test_a_dark_chin_stays_under_a_beard(bearded: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    texture, share = lit(spot(CHIN, 0.5)), np.full(FRAME.size, float(bearded), np.float32)
    monkeypatch.setattr(even_light, "beard", lambda *_: (share, False))
    change = around(evened(texture), CHIN) / around(texture, CHIN)
    assert (change < 1.03) == bearded


def gleam(texture: F32) -> float:
    """What is left of a nose that gleams in a texture (h, w, 3)."""
    nose = lit(spot(NOSE_TIP, 1.8)) / lit(spot(NOSE_TIP, 1))
    return around(evened(texture * nose), NOSE_TIP) - around(evened(texture), NOSE_TIP)


def test_in_a_hard_light_more_of_the_shading_is_taken_for_light() -> None:
    even, side = lit(np.ones(FRAME.size, np.float32)), FRAME.scatter(halves(0.6, 1.5))
    assert gleam(even * side) < 0.7 * gleam(even)


def test_small_glints_and_red_nostrils_are_dulled_and_moles_stay() -> None:
    y, x = np.round(FRAME.points[NOSE_TIP]).astype(int)[::-1]
    factors = {"glint": (1.4, 1.4, 1.4), "red": (0.5, 0.3, 0.3), "mole": (0.6, 0.6, 0.6)}
    ratio = {}
    for name, factor in factors.items():
        texture = lit(np.ones(FRAME.size, np.float32))
        texture[y, x] *= np.float32(factor)
        after = without_glints(texture, FRAME)[y, x]
        ratio[name] = after / texture[y, x]
    assert (ratio["glint"] < 0.85).all()
    assert ratio["red"][0] < 0.95 < 1.02 < ratio["red"][1]
    assert np.abs(ratio["mole"] - 1).max() < 0.02


def test_a_gleaming_forehead_becomes_as_bright_at_the_temples_and_the_chin_stays() -> None:
    rows, columns = np.mgrid[: FRAME.size[0], : FRAME.size[1]]
    aside = np.abs(columns - FRAME.size[1] / 2) / FRAME.resolution
    glossy = np.asarray(120 * (1 + 0.4 * np.exp(-20 * aside**2))[..., None] * np.ones(3), np.float32)
    made = with_even_forehead(glossy, FRAME)
    top, chin = (SKIN & part for part in (rows < 0.15 * FRAME.size[0], rows > 0.8 * FRAME.size[0]))
    assert made[top].std() < 0.4 * glossy[top].std()
    np.testing.assert_allclose(made[chin], glossy[chin], rtol=1e-3)
