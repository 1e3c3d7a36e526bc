"""The learned light: gain and tint are matched, shadows keep their place, hidden texels don't count, brows stay.

Raised brows, and what gleams around eyes and lips, are taken out of it; brows keep the darkness of their hair under
another skin tone.
"""

import numpy as np
import pytest
from drawing import RGB, pass_time, textured
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import (
    BROW_TOPS,
    CHIN,
    HAIRLINE,
    LEFT_BROW,
    LEFT_EYE,
    LIPS,
    NOSE_TIP,
    RIGHT_BROW,
    RIGHT_EYE,
)
from guise.aam.light import grid_places
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.onnx_model import ShippedNetwork
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.memory import LightMemory, Memory
from guise.app.drawing.passes.light import (
    CELL_FACE_WIDTHS,
    GRID,
    LIMITS,
    BrowHair,
    LearnedLight,
    LightOfFeatures,
    places,
)
from guise.app.media import ColourMatrix
from guise.common.arrays import F32
from guise.common.decay import FRAME_SECONDS

FRAME = ReferenceFrame.canonical(80)
TEXELS = np.arange(0, len(FRAME.pixels), 2)
PLACES = grid_places(FRAME)
SKIN = skin_mask(FRAME)[FRAME.mask]
BROWS = soft_parts(FRAME, (RIGHT_BROW, LEFT_BROW), 0.01)[FRAME.mask] > 0.5
CHECK_FRAMES, STILL_FRAMES = (round(s / FRAME_SECONDS) for s in (LIMITS.check_seconds, LIMITS.still_seconds))
FEATURE_FRAME = ReferenceFrame.canonical(96)
FEATURES = LightOfFeatures(FEATURE_FRAME, FEATURE_FRAME.mask, GRID, places(FEATURE_FRAME), CELL_FACE_WIDTHS)
SEEN = np.ones(GRID, np.float32)
CHEEK = 3  # on the jaw line, far from eyes and lips
COLOUR = np.array([180, 140, 120], np.float32)
SHARE = soft_parts(FEATURE_FRAME, (RIGHT_BROW, LEFT_BROW), 0.0)[FEATURE_FRAME.mask]
CORE, FAR = SHARE > 0.9, soft_parts(FEATURE_FRAME, (RIGHT_BROW, LEFT_BROW), 0.08)[FEATURE_FRAME.mask] == 0


def face() -> F32:
    """A texture (n, 3) with shading, brows and some detail."""
    rng = np.random.default_rng(0)
    shade = 1 + 0.2 * PLACES[:, :1] - 0.1 * PLACES[:, 1:]
    skin = [170, 125, 105] * shade + rng.normal(0, 4, (len(PLACES), 1))
    return np.asarray(np.where(BROWS[:, None], skin * 0.4, skin), np.float32)


class Lit:
    """A light with what it remembers."""

    def __init__(self, own: F32, person: F32 | None = None) -> None:
        self.light = LearnedLight(FRAME, TEXELS, FRAME.mask, (own if person is None else person, own))
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
        self.memory.light = LightMemory()


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
    light.show(face(), seen)
    assert np.abs(light(face()) - at_once)[SKIN].mean() > 15
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
    for _ in range(CHECK_FRAMES):
        light.show(face(), np.float32(0.5) * face())
    at_once = light_fitted(face(), np.float32(0.5) * face())
    away = (light(face()) / lit(at_once, face()))[SKIN]
    assert np.median(away) == pytest.approx(1, abs=0.03)


class OneSided:
    """A network that finds more light on one side, whatever it sees."""

    def run(self, _outputs: None, _inputs: dict[str, F32]) -> tuple[F32, F32]:
        change = np.zeros((1, 6, *GRID), np.float32)
        change[:, :3] = np.linspace(0.5, 1.5, GRID[1])
        return change, np.ones((1, 2, 3), np.float32)


def test_what_the_network_finds_more_on_one_side_is_evened_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("guise.app.drawing.passes.light.session", OneSided)
    texture = np.full_like(face(), 100)
    light = light_fitted(texture, texture)
    for _ in range(2 * CHECK_FRAMES):
        assert_allclose(light(texture)[SKIN], 100, atol=1)
        light.show(texture, texture)


@pytest.mark.parametrize(("gain", "looks"), [(1.01, 1), (1.1, 2)])
def test_the_network_looks_again_only_at_what_has_changed(
    gain: float, looks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen, runs = face(), []
    run = ShippedNetwork.run
    monkeypatch.setattr(ShippedNetwork, "run", lambda *given: runs.append(1) or run(*given))
    light = light_fitted(face(), seen)
    for _ in range(4 * CHECK_FRAMES):
        light.show(face(), np.float32(gain) * seen)
    assert len(runs) == looks + 1  # the first also at the mirror image
    for _ in range(STILL_FRAMES + CHECK_FRAMES):
        light.show(face(), np.float32(gain) * seen)
    assert len(runs) > looks + 1  # a small change counts in the end


def test_skin_that_comes_out_of_hiding_is_looked_at() -> None:
    half = (PLACES[:, 0] > 0).astype(np.float32)
    light = light_fitted(face(), face(), half)
    seen = np.where(half[:, None] > 0, face(), np.float32(0.6) * face())
    for _ in range(8):
        light.show(face(), seen)
    at_once = lit(light_fitted(face(), seen), face())
    assert np.abs(light(face()) - at_once)[SKIN].mean() < 2


def cell(point: int, up: float = 0.0) -> tuple[int, int]:
    """Row and column of the cell at a landmark, or some face widths above it."""
    x, y = (FEATURE_FRAME.points[point] - FEATURE_FRAME.points.min(0)) / (
        CELL_FACE_WIDTHS * FEATURE_FRAME.resolution
    ) + 1
    return round(y - up / CELL_FACE_WIDTHS), round(x)


def even(gain: float = 1.0) -> F32:
    return np.concatenate([np.full((3, *GRID), gain, np.float32), np.zeros((3, *GRID), np.float32)])


def test_the_darkness_of_a_raised_brow_goes() -> None:
    light = even()
    for brow in BROW_TOPS:
        y, x = cell(brow, 0.04)
        light[:3, y - 1 : y + 2, x - 4 : x + 5] = 0.6
    without = FEATURES.without(light, SEEN, COLOUR)
    for brow in BROW_TOPS:
        assert_allclose(without[:, *cell(brow, 0.04)], [1, 1, 1, 0, 0, 0], atol=0.1)


def test_what_gleams_around_eyes_and_lips_goes() -> None:
    light = even()
    for part in (RIGHT_EYE, LEFT_EYE, LIPS):
        ys, xs = zip(*(cell(point) for point in np.arange(81)[part]), strict=True)
        light[:3, min(ys) : max(ys) + 1, min(xs) : max(xs) + 1] = 1.5
    assert_allclose(FEATURES.without(light, SEEN, COLOUR), even(), atol=0.15)


def test_brows_and_eyes_do_not_tint_the_light() -> None:
    light = even()
    for part in (RIGHT_BROW, LEFT_BROW, RIGHT_EYE, LEFT_EYE):
        ys, xs = zip(*(cell(point) for point in np.arange(81)[part]), strict=True)
        light[0, min(ys) : max(ys) + 1, min(xs) : max(xs) + 1] = 1.2
    x = cell(CHEEK)
    light[0, x[0], x[1]] = 1.2
    without = FEATURES.without(light, SEEN, COLOUR)
    for point in (*BROW_TOPS, 37, 44):
        gain = without[:3, *cell(point)]
        assert gain[0] / gain[2] < 1.08
    assert without[0, *x] / without[2, *x] > 1.15


def test_what_is_dark_elsewhere_or_bright_stays() -> None:
    light = even()
    for point, gain in ((CHIN, 0.5), (NOSE_TIP, 0.6), (HAIRLINE, 0.7), (CHEEK, 1.5)):
        y, x = cell(point)
        light[:3, y - 1 : y + 2, x - 1 : x + 2] = gain
    assert_allclose(FEATURES.without(light, SEEN, COLOUR), light, atol=1e-5)


def test_a_shadow_over_half_of_the_face_stays() -> None:
    light = even()
    light[:3, :, : GRID[1] // 2] = 0.5
    assert_allclose(FEATURES.without(light, SEEN, COLOUR)[:3], light[:3], atol=0.12)


def test_a_face_of_which_nothing_is_seen_keeps_its_light() -> None:
    assert np.isfinite(FEATURES.without(even(0.7), 0 * SEEN, COLOUR)).all()


def browed(skin: float, hair: float) -> F32:
    """(n, 3) grey skin with brows."""
    return np.repeat(skin + SHARE[:, None] * np.float32(hair - skin), 3, axis=1).astype(np.float32)


def haired(texture: F32, gain: float, offset: float, light: float, tone: float = 0.3) -> tuple[F32, F32]:
    """A texture (n, 3) under an affine light, without and with the brows' hair (3, n)."""
    hair, gains, offsets = (
        BrowHair(FEATURE_FRAME, tone),
        np.full_like(texture.T, gain),
        np.full_like(texture.T, offset),
    )
    plain = gains * texture.T + offsets
    made = plain.copy()
    hair.adjust(made, texture.T, hair.under(texture.T, gains, offsets), light)
    return plain, made


def test_black_brows_of_a_dark_face_are_black_on_light_skin() -> None:
    plain, made = haired(browed(60, 15), 1.5, 90, light=1.0)
    assert plain[:, CORE].mean() > 105
    assert made[:, CORE].mean() < 60
    assert np.array_equal(made[:, FAR], plain[:, FAR])


def test_brown_brows_of_a_light_face_are_not_black_on_dark_skin() -> None:
    plain, made = haired(browed(180, 90), 0.4, 0, light=1.0, tone=2.0)
    assert plain[:, CORE].mean() < 40
    assert 50 < made[:, CORE].mean() < made[:, FAR].mean()
    assert np.array_equal(made[:, FAR], plain[:, FAR])


def test_brows_get_no_lighter_where_the_eyes_say_that_it_is_the_light() -> None:
    plain, made = haired(browed(180, 90), 0.4, 0, light=0.4, tone=2.0)
    assert made[:, CORE].mean() == pytest.approx(plain[:, CORE].mean(), rel=0.1)


@pytest.mark.parametrize(("gain", "offset", "light"), [(1.0, 0.0, 1.0), (0.5, 0.0, 1.0), (0.5, 0.0, 0.5)])
def test_brows_of_a_darker_face_never_get_lighter_and_the_same_light_keeps_them(
    gain: float, offset: float, light: float
) -> None:
    plain, made = haired(browed(180, 40), gain, offset, light)
    assert (made <= plain + 1e-3).all()
    assert made[:, CORE].mean() == pytest.approx(plain[:, CORE].mean(), rel=0.03)


def test_fair_brows_stay_fair() -> None:
    plain, made = haired(browed(180, 165), 1.0, 10, light=1.0)
    assert made[:, CORE].mean() > 0.9 * plain[:, CORE].mean()


def test_brows_of_a_face_as_light_as_the_person_keep_their_contrast() -> None:
    """Whatever the eyes seem to say of the light."""
    plain, made = haired(browed(180, 120), 1.0, 0, light=0.5, tone=1.0)
    assert made[:, CORE].mean() > 0.97 * plain[:, CORE].mean()


def test_each_brow_is_measured_against_the_skin_beside_it() -> None:
    """A face half in shadow is no brow."""
    shade = np.where(FEATURE_FRAME.pixels % FEATURE_FRAME.size[1] < FEATURE_FRAME.size[1] / 2, 1.0, 0.5)[
        :, None
    ]
    texture = (browed(180, 120) * shade).astype(np.float32)
    plain, made = haired(texture, 1.0, 0, light=1.0)
    assert made.mean() > 0.99 * plain.mean()
