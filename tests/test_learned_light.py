"""The learned light: gain and tint are matched, shadows keep their place, hidden texels don't count, brows stay."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW
from guise.aam.light import grid_places
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.onnx_model import ShippedNetwork
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.learned_light import GRID, LIMITS, LearnedLight
from guise.common.arrays import F32

FRAME = ReferenceFrame.canonical(80)
TEXELS = np.arange(0, len(FRAME.pixels), 2)
PLACES = grid_places(FRAME)
SKIN = skin_mask(FRAME)[FRAME.mask]
BROWS = soft_parts(FRAME, (RIGHT_BROW, LEFT_BROW), 0.01)[FRAME.mask] > 0.5
RGB, ZERO = np.eye(3), np.zeros(3)


def face() -> F32:
    """A texture (n, 3) with shading, brows and some detail."""
    rng = np.random.default_rng(0)
    shade = 1 + 0.2 * PLACES[:, :1] - 0.1 * PLACES[:, 1:]
    skin = [170, 125, 105] * shade + rng.normal(0, 4, (len(PLACES), 1))
    return np.asarray(np.where(BROWS[:, None], skin * 0.4, skin), np.float32)


def lit(light: LearnedLight, texture: F32) -> F32:
    return np.asarray(light.apply(texture, RGB, ZERO).T)


def light_fitted(own: F32, seen: F32, visible: F32 | None = None, person: F32 | None = None) -> LearnedLight:
    light = LearnedLight(FRAME, TEXELS, FRAME.mask, (own if person is None else person, own))
    light.update(own[TEXELS], seen[TEXELS], None if visible is None else visible[TEXELS])
    return light


@pytest.mark.parametrize("gain", [(0.7, 0.6, 0.5), (1.1, 1.0, 0.9), (0.4, 0.35, 0.3), (1.3, 1.3, 1.2)])
def test_a_face_under_one_gain_and_tint_is_matched(gain: tuple[float, float, float]) -> None:
    seen = face() * np.float32(gain)
    before = np.abs(face() - seen)[SKIN].mean()
    assert np.abs(lit(light_fitted(face(), seen), face()) - seen)[SKIN].mean() < max(6, 0.15 * before)


def test_a_hard_shadow_keeps_its_place() -> None:
    shadow = np.where(PLACES[:, :1] > 0.1, 0.4, 1.0)
    made = lit(light_fitted(face(), np.float32(face() * shadow)), face())
    ratio = made.mean(1) / face().mean(1)
    assert_allclose(np.median(ratio[SKIN & (PLACES[:, 0] > 0.25)]), 0.4, atol=0.12)
    assert_allclose(np.median(ratio[SKIN & (PLACES[:, 0] < -0.05)]), 1.0, atol=0.12)


def test_what_is_hidden_does_not_change_the_light() -> None:
    hidden = PLACES[:, 1] > 0.15
    visible = 1 - hidden.astype(np.float32)
    made = [
        lit(light_fitted(face(), np.where(hidden[:, None], np.float32(colour), face()), visible), face())
        for colour in ([20, 40, 220], [240, 240, 240])
    ]
    assert_allclose(made[0], made[1], atol=1e-2)


def test_brows_stay_where_the_source_has_none() -> None:
    bare = np.where(BROWS[:, None], face() / np.float32(0.4), face())
    made = lit(light_fitted(face(), bare, person=bare), face())
    assert made[BROWS].mean() < 0.55 * bare[BROWS].mean()


def test_brows_take_most_of_their_hue_from_the_skin() -> None:
    green = face()
    green[BROWS] *= np.float32([0.6, 1.3, 0.7])
    made = lit(light_fitted(face(), face()), green)
    excess = (made[BROWS, 1] / made[BROWS, 0]).mean() - (face()[BROWS, 1] / face()[BROWS, 0]).mean()
    assert excess < 0.5 * (
        (green[BROWS, 1] / green[BROWS, 0]).mean() - (face()[BROWS, 1] / face()[BROWS, 0]).mean()
    )


def test_a_change_of_light_is_followed_over_a_few_frames_and_at_once_after_a_reset() -> None:
    light, seen = light_fitted(face(), face()), face() * np.float32(0.5)
    at_once = lit(light_fitted(face(), seen), face())
    light.update(face()[TEXELS], seen[TEXELS], None)
    assert np.abs(lit(light, face()) - at_once)[SKIN].mean() > 15
    for _ in range(8):
        light.update(face()[TEXELS], seen[TEXELS], None)
    assert np.abs(lit(light, face()) - at_once)[SKIN].mean() < 1
    light.reset()
    light.update(face()[TEXELS], seen[TEXELS], None)
    assert_allclose(lit(light, face()), at_once, atol=1e-2)


def test_colours_out_of_range_leave_it_finite() -> None:
    dark = face()
    dark[SKIN] = -20  # a synthesised face may leave 0..255
    assert np.isfinite(lit(light_fitted(dark, face()), dark)).all()
    nothing = np.zeros(len(PLACES), np.float32)
    assert np.isfinite(lit(light_fitted(face(), face(), nothing), face())).all()


def test_the_stored_components_are_those_of_the_matrix() -> None:
    light = light_fitted(face(), face() * np.float32(0.8))
    matrix = np.array([[0.3, 0.6, 0.1], [-0.2, -0.3, 0.5], [0.5, -0.4, -0.1]])
    offset = np.array([16.0, 128, 128])
    assert_allclose(light.apply(face(), matrix, offset).T, lit(light, face()) @ matrix.T + offset, atol=1e-2)
    assert 0.3 < light.contrast < 1.5


def test_a_light_that_changes_as_a_whole_is_followed_at_once() -> None:
    light = light_fitted(face(), face())
    for _ in range(LIMITS.frames_per_check):
        light.update(face()[TEXELS], np.float32(0.5) * face()[TEXELS], None)
    at_once = light_fitted(face(), np.float32(0.5) * face())
    away = (lit(light, face()) / lit(at_once, face()))[SKIN]
    assert np.median(away) == pytest.approx(1, abs=0.03)


class OneSided:
    """A network that finds more light on one side, whatever it sees."""

    def run(self, _outputs: None, _inputs: dict[str, F32]) -> tuple[F32, F32]:
        change = np.zeros((1, 6, *GRID), np.float32)
        change[:, :3] = np.linspace(0.5, 1.5, GRID[1])
        return change, np.ones((1, 2, 3), np.float32)


def test_what_the_network_finds_more_on_one_side_is_evened_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("guise.app.swapping.learned_light.session", OneSided)
    texture = np.full_like(face(), 100)
    light = light_fitted(texture, texture)
    for _ in range(2 * LIMITS.frames_per_check):
        assert_allclose(lit(light, texture)[SKIN], 100, atol=1)
        light.update(texture[TEXELS], texture[TEXELS], None)


@pytest.mark.parametrize(("gain", "looks"), [(1.01, 1), (1.1, 2)])
def test_the_network_looks_again_only_at_what_has_changed(
    gain: float, looks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, runs = face(), []
    run = ShippedNetwork.run
    monkeypatch.setattr(ShippedNetwork, "run", lambda *given: runs.append(1) or run(*given))
    light = light_fitted(face(), seen)
    for _ in range(4 * LIMITS.frames_per_check):
        light.update(face()[TEXELS], np.float32(gain) * seen[TEXELS], None)
    assert len(runs) == looks + 1  # the first also at the mirror image
    for _ in range((LIMITS.still_checks + 1) * LIMITS.frames_per_check):
        light.update(face()[TEXELS], np.float32(gain) * seen[TEXELS], None)
    assert len(runs) > looks + 1  # a small change counts in the end


def test_skin_that_comes_out_of_hiding_is_looked_at() -> None:
    half = (PLACES[:, 0] > 0).astype(np.float32)
    light = light_fitted(face(), face(), half)
    seen = np.where(half[:, None] > 0, face(), np.float32(0.6) * face())
    for _ in range(8):
        light.update(face()[TEXELS], seen[TEXELS], None)
    at_once = lit(light_fitted(face(), seen), face())
    assert np.abs(lit(light, face()) - at_once)[SKIN].mean() < 2
