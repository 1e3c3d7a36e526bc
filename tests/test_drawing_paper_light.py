"""Light by the papers' similarity: contrast and colours are the frame's, light is a smooth field, teeth don't glow."""

import numpy as np
import pytest
from drawing import RGB, pass_time, textured
from numpy.testing import assert_allclose

from guise.aam.light import LUMA, grid_places
from guise.aam.mask import skin_mask
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Scale
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.paper_light import LIMITS, PaperLight
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

    def __init__(self, scale: Scale = "symmetric") -> None:
        self.light, self.memory = PaperLight(FRAME, TEXELS, FRAME.mask, scale), Memory()

    def show(self, own: F32, seen: F32, seconds: float = FRAME_SECONDS) -> None:
        """Show the next frame."""
        pass_time(self.memory, seconds)
        self.light.measure(textured(own, seen[TEXELS]), self.memory)

    def __call__(self, texture: F32, colour: ColourMatrix = RGB) -> F32:
        """(n, 3) a texture in the light, as it is stored."""
        face = textured(texture, colour=colour)
        self.light.apply(face, self.memory)
        self.contrast = face.canvas.contrast
        return np.asarray(face.canvas.planes.T)


def lit(light: Lit, texture: F32) -> F32:
    return light(texture)


# Brightness comes first, as in most videos, of which highlights are bent.
STORED = np.array([[1 / 3, 1 / 3, 1 / 3], [1, 0, 0], [0, 0, 1]])
GREY = ColourMatrix(RGB.to_rgb.copy(), np.pad(STORED, ((0, 0), (0, 1))).astype(np.float32))


def paper_fitted(own: F32, seen: F32, scale: Scale = "symmetric") -> Lit:
    light = Lit(scale)
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


def test_by_the_papers_light_changes_as_fast_at_any_frame_rate() -> None:
    """A fifth of a second after half of the light went."""
    after = []
    for rate in (25, 30, 60):
        light = paper_fitted(face(), face())
        for _ in range(rate // 5):
            light.show(face(), face() * np.float32(0.8), seconds=1 / rate)
        after.append(lit(light, face()))
    assert np.abs(after[1] - 0.8 * face())[SKIN].mean() > 0.3  # it is on its way
    for other in (after[0], after[2]):
        assert np.abs(other - after[1])[SKIN].mean() < 4
