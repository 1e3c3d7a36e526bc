"""Light without a network.

By wide means: gain and tint are matched, what is narrow is no light, hidden texels don't count, noise stays low, whites
stay white.  By the papers' similarity: contrast and colours are the frame's, light is a smooth field, teeth don't glow.
"""

import numpy as np
import pytest
from drawing import RGB, pass_time, textured
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA, grid_places
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Scale
from guise.app.drawing.memory import Memory, WideLightMemory
from guise.app.drawing.passes.plain_light import LIMITS, WIDE, PaperLight, WideLight
from guise.app.media import ColourMatrix
from guise.common.arrays import F32
from guise.common.decay import FRAME_SECONDS

FRAME = ReferenceFrame.canonical(80)
TEXELS = np.arange(0, len(FRAME.pixels), 2)
PLACES = grid_places(FRAME)
SKIN = skin_mask(FRAME)[FRAME.mask]


def face() -> F32:
    """A texture (n, 3) with shading and some detail."""
    rng = np.random.default_rng(0)
    shade = 1 + 0.2 * PLACES[:, :1] - 0.1 * PLACES[:, 1:]
    return np.asarray([170, 125, 105] * shade + rng.normal(0, 4, (len(PLACES), 1)), np.float32)


class Lit:
    """A light with what it remembers."""

    def __init__(self, light: WideLight | PaperLight) -> None:
        self.light, self.memory = light, Memory()

    def show(self, own: F32, seen: F32, visible: F32 | None = None, seconds: float = FRAME_SECONDS) -> None:
        """Show the next frame."""
        pass_time(self.memory, seconds)
        hidden = None if visible is None else visible[TEXELS]
        self.light.measure(textured(own, seen[TEXELS], hidden), self.memory)

    def __call__(self, texture: F32, colour: ColourMatrix = RGB) -> F32:
        """(n, 3) a texture in the light, as it is stored."""
        face = textured(texture, colour=colour)
        self.light.apply(face, self.memory)
        self.contrast = face.canvas.contrast
        return np.asarray(face.canvas.planes.T)


def lit(light: Lit, texture: F32) -> F32:
    return light(texture)


def light_fitted(
    own: F32, seen: F32, visible: F32 | None = None, enrolled: tuple[F32, F32] | None = None
) -> Lit:
    light = Lit(WideLight(FRAME, TEXELS, FRAME.mask, enrolled or (own, own)))
    light.show(own, seen, visible)
    return light


@pytest.mark.parametrize("gain", [(0.7, 0.6, 0.5), (1.1, 1.0, 0.9), (0.3, 0.25, 0.2), (1.4, 1.4, 1.3)])
def test_a_face_under_one_gain_and_tint_is_matched(gain: tuple[float, float, float]) -> None:
    seen = face() * np.float32(gain)
    assert np.abs(lit(light_fitted(face(), seen), face()) - seen)[SKIN].mean() < 2.5


def test_half_of_a_face_in_shadow_is_darker() -> None:
    shadow = np.where(PLACES[:, :1] > 0, 0.4, 1.0)
    ratio = lit(light_fitted(face(), np.float32(face() * shadow)), face()).mean(1) / face().mean(1)
    dark, bright = (ratio[SKIN & (side * PLACES[:, 0] > 0.25)].mean() for side in (1, -1))
    assert dark < 0.75 < 0.9 < 1.4 * bright
    assert dark < 0.8 * bright


def test_the_level_of_the_light_is_taken_over_and_little_of_what_is_narrow() -> None:
    """That could be the person's own nose."""
    nose = np.exp(-(((PLACES[:, :1] - PLACES[SKIN, 0].mean()) / 0.06) ** 2))
    seen = np.float32(face() * 0.6 * (1 + 0.4 * nose))
    ratio = lit(light_fitted(face(), seen), face()).mean(1) / face().mean(1)
    assert_allclose(ratio[SKIN].mean(), 0.68, atol=0.1)
    shown, kept = (np.cov(each[SKIN], nose[SKIN, 0])[0, 1] for each in (0.6 * (1 + 0.4 * nose[:, 0]), ratio))
    assert 0 < kept < 0.5 * shown


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
    low, high = WIDE.detail_gain
    assert (np.abs(grown[SKIN]) <= 1.05 * high * np.abs(noise[SKIN, 0]) + 1e-2).all()
    assert low <= light.contrast <= high


def test_a_change_of_light_is_followed_over_a_few_frames_and_at_once_by_a_new_face() -> None:
    light = light_fitted(face(), face())
    seen = face() * np.float32(0.5)
    light.show(face(), seen)
    assert np.abs(lit(light, face()) - seen)[SKIN].mean() > 15
    for _ in range(8):
        light.show(face(), seen)
    assert np.abs(lit(light, face()) - seen)[SKIN].mean() < 3
    light.memory.wide_light = WideLightMemory()
    light.show(face(), face())
    assert np.abs(lit(light, face()) - face())[SKIN].mean() < 1


@pytest.mark.parametrize("kind", [WideLight, PaperLight])
def test_light_changes_as_fast_at_any_frame_rate(kind: type[WideLight | PaperLight]) -> None:
    """A fifth of a second after half of the light went."""
    after = []
    for rate in (25, 30, 60):
        light = Lit(kind(FRAME, TEXELS, FRAME.mask, (face(), face())) if kind is WideLight else paper())
        light.show(face(), face())
        for _ in range(rate // 5):
            light.show(face(), face() * np.float32(0.8), seconds=1 / rate)
        after.append(lit(light, face()))
    assert np.abs(after[1] - 0.8 * face())[SKIN].mean() > 0.3  # it is on its way
    for other in (after[0], after[2]):
        assert np.abs(other - after[1])[SKIN].mean() < (0.05 if kind is WideLight else 4)


def test_a_face_that_is_held_is_not_measured() -> None:
    light = light_fitted(face(), face())
    before = lit(light, face())
    pass_time(light.memory)
    light.light.measure(textured(face() * np.float32(0.3)), light.memory)
    assert_allclose(lit(light, face()), before)


def test_the_stored_components_are_those_of_the_matrix() -> None:
    light = light_fitted(face(), face() * np.float32(0.8))
    matrix, offset = (
        np.array([[0.3, 0.6, 0.1], [-0.2, -0.3, 0.5], [0.5, -0.4, -0.1]]),
        np.array([16.0, 128, 128]),
    )
    stored = ColourMatrix(RGB.to_rgb.copy(), np.column_stack([matrix, offset]).astype(np.float32))
    assert_allclose(light(face(), stored), light(face()) @ matrix.T + offset, atol=1e-2)


def test_the_eyes_of_a_dark_face_stay_white_on_a_fair_head() -> None:
    eyes = soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.9
    fair, dark = (np.tile(np.float32(skin), (len(PLACES), 1)) for skin in ((210, 165, 140), (95, 60, 40)))
    for texture in (fair, dark):
        texture[soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.4] = 150
    seen = []
    for enrolled in ((fair, dark), (dark, dark)):  # rightly, and as if the person were as dark
        light = light_fitted(dark, fair, enrolled=enrolled)
        seen.append(lit(light, dark))
        assert_allclose(seen[-1][SKIN].mean(0), (210, 165, 140), rtol=0.05)
    assert np.ptp(seen[0][eyes].mean(0)) < 6
    assert np.ptp(seen[1][eyes].mean(0)) > 30


# Brightness comes first, as in most videos, of which highlights are bent.
STORED = np.array([[1 / 3, 1 / 3, 1 / 3], [1, 0, 0], [0, 0, 1]])
GREY = ColourMatrix(RGB.to_rgb.copy(), np.pad(STORED, ((0, 0), (0, 1))).astype(np.float32))


def paper(scale: Scale = "symmetric") -> PaperLight:
    return PaperLight(FRAME, TEXELS, FRAME.mask, scale)


def paper_fitted(own: F32, seen: F32, scale: Scale = "symmetric") -> Lit:
    light = Lit(paper(scale))
    light.show(own, seen)
    return light


@pytest.mark.parametrize("scale", ["symmetric", "least-squares"])
@pytest.mark.parametrize("gain", [0.6, 1.0, 1.2])
def test_by_the_papers_a_face_under_one_gain_is_matched(gain: float, scale: Scale) -> None:
    seen = face() * np.float32(gain)
    made = paper_fitted(face(), seen, scale)(face(), GREY)
    assert np.abs(made - seen @ STORED.T)[SKIN].mean() < 3


def test_by_the_papers_smooth_light_is_taken_over() -> None:
    slope = np.float32(1 + 0.5 * PLACES[:, :1])
    made = lit(paper_fitted(face(), face() * slope), face()).mean(1) / face().mean(1)
    assert np.corrcoef(made[SKIN], slope[SKIN, 0])[0, 1] > 0.95


def test_by_the_papers_the_contrast_of_a_face_stays_within_limits() -> None:
    rng = np.random.default_rng(3)
    flat = face() + np.float32(20) * rng.normal(0, 1, (len(PLACES), 1)).astype(np.float32)
    light = paper_fitted(flat, face())
    assert light.memory.paper_light.linear.sum() / 3 >= 0.9 * LIMITS.contrast[0]
    made, own = (each[SKIN] @ LUMA for each in (lit(light, flat), flat))
    assert made.std() < own.std()


def test_by_the_papers_nothing_is_brighter_than_skin_by_all_that_it_was() -> None:
    light, teeth = paper_fitted(face(), face()), face()
    teeth[100] = 255
    plain, shining = (light(texture, GREY)[100, 0] for texture in (face(), teeth))
    assert plain < light.memory.paper_light.bright < shining < 0.9 * 255


def test_by_the_papers_the_stored_components_are_those_of_the_matrix() -> None:
    light = paper_fitted(face(), face() * np.float32(0.8))
    light.memory.paper_light.bright = 300.0  # so that the first component is bent by no highlight
    matrix = np.array([[0.3, 0.6, 0.1], [-0.2, -0.3, 0.5], [0.5, -0.4, -0.1]])
    offset = np.array([16.0, 128, 128])
    stored = ColourMatrix(RGB.to_rgb.copy(), np.column_stack([matrix, offset]).astype(np.float32))
    assert_allclose(light(face(), stored), light(face()) @ matrix.T + offset, atol=0.1)


def test_by_the_papers_a_small_change_is_followed_slowly_and_a_large_one_at_once() -> None:
    for gain, at_once in ((0.97, False), (0.5, True)):
        light, seen = paper_fitted(face(), face()), face() * np.float32(gain)
        before = lit(light, face())
        for _ in range(round(LIMITS.update_seconds / FRAME_SECONDS)):
            light.show(face(), seen)
        made = lit(light, face())
        followed = (made - before)[SKIN].mean() / (seen - face())[SKIN].mean()
        assert (followed > 0.9) == at_once
