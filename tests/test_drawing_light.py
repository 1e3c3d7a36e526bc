"""The light of the person's own face: gain and tint are matched, shadows keep their place, hidden texels don't count.

What the two people differ in is no light: no mark of the person passes, and those of the face that is shown stay.
"""

import numpy as np
import pytest
from drawing import RGB, pass_time, textured
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import LEFT_BROW, LEFT_EYE, RIGHT_BROW, RIGHT_EYE
from guise.aam.light import grid_places
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.light import QuotientLight
from guise.app.media import ColourMatrix
from guise.common.arrays import F32
from guise.common.decay import FRAME_SECONDS

FRAME = ReferenceFrame.canonical(80)
TEXELS = np.arange(0, len(FRAME.pixels), 2)
PLACES = grid_places(FRAME)
SKIN = skin_mask(FRAME)[FRAME.mask]
BROWS = soft_parts(FRAME, (RIGHT_BROW, LEFT_BROW), 0.01)[FRAME.mask] > 0.5
MARK = SKIN & (np.hypot(PLACES[:, 0] - 0.3, PLACES[:, 1] - 0.1) < 0.12)  # on a cheek


def face() -> F32:
    """A texture (n, 3) with shading, brows and some detail."""
    rng = np.random.default_rng(0)
    shade = 1 + 0.2 * PLACES[:, :1] - 0.1 * PLACES[:, 1:]
    skin = [170, 125, 105] * shade + rng.normal(0, 4, (len(PLACES), 1))
    return np.asarray(np.where(BROWS[:, None], skin * 0.4, skin), np.float32)


class Lit:
    """A light with what it remembers."""

    def __init__(self, own: F32, person: F32 | None = None) -> None:
        self.light = QuotientLight(FRAME, TEXELS, FRAME.mask, (own if person is None else person, own))
        self.memory = Memory()

    def show(self, own: F32, seen: F32, visible: F32 | None = None, seconds: float = FRAME_SECONDS) -> None:
        """Show the next frame."""
        pass_time(self.memory, seconds)
        self.light.measure(
            textured(own, seen[TEXELS], None if visible is None else visible[TEXELS]), self.memory
        )

    def __call__(self, texture: F32, colour: ColourMatrix = RGB) -> F32:
        """(n, 3) a texture in the light, as it is stored."""
        face = textured(texture, colour=colour)
        self.light.apply(face, self.memory)
        self.contrast = face.canvas.contrast
        return np.asarray(face.canvas.planes.T)

    def reset(self) -> None:
        self.memory.light = None


def lit(light: Lit, texture: F32) -> F32:
    return light(texture)


def light_fitted(own: F32, seen: F32, visible: F32 | None = None, person: F32 | None = None) -> Lit:
    light = Lit(own, person)
    light.show(own, seen, visible)
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


def marked(texture: F32) -> F32:
    """The same with a dark mark."""
    return np.where(MARK[:, None], np.float32(0.5) * texture, texture)


def test_a_mark_of_the_person_does_not_pass_and_one_of_the_face_stays() -> None:
    person = np.float32(0.7) * marked(face())
    made = lit(light_fitted(face(), person, person=marked(face())), face())
    assert_allclose((made / face())[MARK], 0.7, rtol=0.12)
    made = lit(light_fitted(marked(face()), np.float32(0.7) * face(), person=face()), marked(face()))
    assert_allclose(
        (made / marked(face()))[MARK & SKIN].mean(),
        made[SKIN].mean() / marked(face())[SKIN].mean(),
        rtol=0.05,
    )


def test_the_face_takes_the_tone_of_the_persons_skin() -> None:
    dark = np.float32([0.5, 0.45, 0.4]) * face()
    made = lit(light_fitted(dark, np.float32(0.8) * face(), person=face()), dark)
    assert_allclose(np.median(made[SKIN] / face()[SKIN], axis=0), 0.8, rtol=0.08)


def test_skin_that_is_clipped_to_white_has_the_colour_of_the_frame() -> None:
    dark = np.float32([0.5, 0.45, 0.4]) * marked(face())
    seen = np.minimum(np.float32(2.6) * face(), 255)
    made = lit(light_fitted(dark, seen, person=face()), dark)
    assert np.median(made[MARK], axis=0).min() > 225
    assert_allclose(np.median(made[SKIN], axis=0), np.median(seen[SKIN], axis=0), atol=6)
    assert made[BROWS].mean() < 0.7 * made[SKIN].mean()


def test_brows_keep_their_darkness_in_more_light() -> None:
    dim, brow = np.float32(0.4) * face(), BROWS & ~SKIN
    made = lit(light_fitted(dim, face(), person=face()), dim)
    assert_allclose(np.median(made[brow] / face()[brow]), 1.0, atol=0.1)
    assert_allclose(np.median(made[SKIN] / face()[SKIN]), 1.0, atol=0.06)


def test_what_the_face_expresses_does_not_shade_its_skin_twice() -> None:
    light = light_fitted(face(), face())
    shaded = np.where(MARK[:, None], np.float32(0.7) * face(), face())
    assert (light(shaded) / face())[MARK].mean() > 0.9


def test_what_is_hidden_does_not_change_the_light() -> None:
    hidden = PLACES[:, 1] > 0.15
    visible = 1 - hidden.astype(np.float32)
    made = [
        lit(light_fitted(face(), np.where(hidden[:, None], np.float32(colour), face()), visible), face())
        for colour in ([20, 40, 220], [240, 240, 240])
    ]
    assert_allclose(made[0], made[1], atol=1e-2)


def test_a_change_of_light_is_followed_over_a_few_frames_and_at_once_after_a_reset() -> None:
    light, seen = light_fitted(face(), face()), np.where(PLACES[:, :1] > 0, np.float32(0.5), 1) * face()
    at_once = lit(light_fitted(face(), seen), face())
    light.show(face(), seen)
    assert np.abs(light(face()) - at_once)[SKIN].mean() > 5
    for _ in range(8):
        light.show(face(), seen)
    assert np.abs(light(face()) - at_once)[SKIN].mean() < 1
    light.reset()
    light.show(face(), seen)
    assert_allclose(light(face()), at_once, atol=1e-2)


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
    stored = ColourMatrix(RGB.to_rgb.copy(), np.column_stack([matrix, offset]).astype(np.float32))
    assert_allclose(light(face(), stored), light(face()) @ matrix.T + offset, atol=1e-2)
    assert 0.3 < light.contrast < 1.5


def test_a_light_that_changes_as_a_whole_is_followed_at_once() -> None:
    light = light_fitted(face(), face())
    for _ in range(8):
        light.show(face(), np.float32(0.5) * face())
    at_once = light_fitted(face(), np.float32(0.5) * face())
    away = (light(face()) / lit(at_once, face()))[SKIN]
    assert np.median(away) == pytest.approx(1, abs=0.03)


def test_skin_that_comes_out_of_hiding_is_looked_at() -> None:
    half = (PLACES[:, 0] > 0).astype(np.float32)
    light = light_fitted(face(), face(), half)
    seen = np.where(half[:, None] > 0, face(), np.float32(0.6) * face())
    for _ in range(8):
        light.show(face(), seen)
    at_once = lit(light_fitted(face(), seen), face())
    assert np.abs(light(face()) - at_once)[SKIN].mean() < 2


def test_light_changes_as_fast_at_any_frame_rate() -> None:
    """A fifth of a second after a shadow fell on a half."""
    after, shadow = [], np.where(PLACES[:, :1] > 0, np.float32(0.8), 1) * face()
    for rate in (25, 30, 60):
        light = light_fitted(face(), face())
        for _ in range(rate // 5):
            light.show(face(), shadow, seconds=1 / rate)
        after.append(lit(light, face()))
    assert np.abs(after[1] - shadow)[SKIN].mean() > 0.3  # it is on its way
    for other in (after[0], after[2]):
        assert np.abs(other - after[1])[SKIN].mean() < 0.05


def test_a_face_that_is_held_is_not_measured() -> None:
    light = light_fitted(face(), face())
    before = light(face())
    pass_time(light.memory)
    light.light.measure(textured(face() * np.float32(0.3)), light.memory)
    assert_allclose(light(face()), before)


def test_the_eyes_of_a_dark_face_stay_white_on_a_fair_head() -> None:
    eyes = soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.9
    fair, dark = (np.tile(np.float32(skin), (len(PLACES), 1)) for skin in ((210, 165, 140), (95, 60, 40)))
    for texture in (fair, dark):
        texture[soft_parts(FRAME, (RIGHT_EYE, LEFT_EYE), 0.0)[FRAME.mask] > 0.4] = 150
    light = light_fitted(dark, fair, person=fair)
    made = light(dark)
    assert_allclose(made[SKIN].mean(0), (210, 165, 140), rtol=0.05)
    assert np.ptp(made[eyes].mean(0)) < 12  # in the light on skin it would be 30
