"""What makes a drawn face look filmed by the same camera: as sharp as the picture around it, with its grain and pores.

Of the frame's own skin only the finest structure is taken: no folds, and nothing on eyes.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from drawing import drawn_on, pass_time

from guise.aam.landmarks.schemes import (
    LEFT_EYE,
    LEFT_MOUTH_CORNER,
    LEFT_TEMPLE,
    RIGHT_MOUTH_CORNER,
    RIGHT_TEMPLE,
)
from guise.aam.reference import ReferenceFrame
from guise.aam.relief import Relief
from guise.app.drawing.face import FaceInFrame, Seen
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.surface import LIMITS, Finish, OwnSkin, PoreFinish, grain_energy
from guise.common.arrays import F32, F64, U8
from guise.common.decay import FRAME_SECONDS

REFERENCE = ReferenceFrame.canonical(96)


def face(contrast: float) -> U8:
    """A picture of the reference frame's size with blotches of so many grey levels on grey."""
    noise = np.random.default_rng(3).standard_normal(REFERENCE.size).astype(np.float32)
    blotches = cv2.GaussianBlur(noise, (0, 0), 1.5)
    luma = 128 + contrast * blotches / blotches.std()
    picture = np.full((*REFERENCE.size, 3), 128, np.uint8)
    picture[..., 0] = np.clip(luma.round(), 0, 255)
    return picture


class Shown:
    """A surface with what it remembers, of a face that is laid over skin of its own size frame after frame."""

    def __init__(self, surface: type[Finish] = Finish) -> None:
        self.surface, self.memory, self.number = surface(REFERENCE, REFERENCE.mask), Memory(), 0

    def face(self, drawn: U8, roi: U8 | None = None, points: F64 | None = None) -> FaceInFrame:
        face = drawn_on(drawn if roi is None else roi, REFERENCE.points if points is None else points, drawn)
        face.frame.index = self.number
        return face

    def sharpened(self, drawn: U8) -> U8:
        face = self.face(drawn)
        self.surface.sharpen(face, self.memory)
        return face.canvas.picture

    def grained(self, drawn: U8, number: int) -> U8:
        self.number = number
        face = self.face(drawn.copy())
        self.surface.add_grain(face, self.memory)
        return face.canvas.picture

    def show(
        self,
        own: U8,
        drawn: U8,
        seconds: float = FRAME_SECONDS,
        points: F64 | None = None,
        *,
        found: bool = True,
    ) -> U8:
        """The next frame (h, w, 3) with the face (h, w, 3) over all of it."""
        pass_time(self.memory, seconds)
        face = self.face(drawn, own, points)
        if found:
            some = np.ones((1, 3), np.float32)
            face.seen = Seen(some[:, :2], some, some)
        self.surface.sharpen(face, self.memory)
        face.canvas.picture = face.canvas.picture.copy()
        self.surface.add_grain(face, self.memory)
        self.surface.look(face, self.memory)
        face.canvas.roi = face.canvas.picture
        self.surface.compare(face, self.memory)
        self.number += 1
        return face.canvas.picture

    @property
    def gain(self) -> float:
        return self.memory.surface.gain

    @property
    def own_share(self) -> float:
        return self.memory.surface.own_share

    @property
    def deviation(self) -> float:
        return float(np.sqrt(self.memory.surface.variance))


def settled(own: U8, drawn: U8, frames: int = 60, surface: type[Finish] = Finish) -> Shown:
    """After many frames in which a texture is laid over skin of its own size."""
    shown = Shown(surface)
    for _ in range(frames):
        shown.show(own, drawn)
    return shown


@pytest.mark.parametrize("contrast", [12.0, 20.0])
def test_a_harsher_donor_becomes_about_as_sharp_as_the_picture(contrast: float) -> None:
    gain = settled(face(8.0), face(contrast)).gain
    assert gain == pytest.approx(8.0 / contrast, rel=0.3)
    assert gain < 1


def test_a_face_as_sharp_as_the_picture_is_left_as_it_is() -> None:
    drawn = face(8.0)
    shown = settled(face(8.0), drawn)
    assert shown.gain == 1.0
    assert np.array_equal(shown.sharpened(drawn), drawn)


def test_a_blurred_donor_is_sharpened_no_more_than_the_limit() -> None:
    assert settled(face(20.0), face(4.0)).gain == LIMITS.gain[1]


def test_only_the_finest_band_is_raised_and_that_of_brows_too() -> None:
    """What is coarser is blotches on skin."""
    shown = settled(face(20.0), face(4.0))
    for period, expected in ((3, LIMITS.gain[1]), (40, 1.0)):
        wave = np.full((*REFERENCE.size, 3), 128, np.uint8)
        wave[..., 0] = np.round(128 + 20 * np.sin(2 * np.pi * np.arange(wave.shape[1]) / period))
        ratio = shown.sharpened(wave)[..., 0].std(axis=1) / wave[..., 0].std(axis=1)
        assert ratio == pytest.approx(expected, abs=0.1)  # in every row


def test_the_frames_own_skin_is_shown_only_where_sharpening_is_not_enough() -> None:
    assert settled(face(8.0), face(20.0)).own_share == 0
    assert settled(face(8.0), face(8.0)).own_share == 0
    assert settled(face(20.0), face(4.0)).own_share == 1


def test_the_mean_colour_stays() -> None:
    drawn = face(20.0)
    flatter = settled(face(5.0), drawn).sharpened(drawn)
    skin = REFERENCE.mask
    assert np.abs(flatter[skin].mean(0) - drawn[skin].mean(0)).max() < 1.0
    assert flatter[skin][:, 0].std() < 0.75 * drawn[skin][:, 0].std()


def test_a_face_starts_as_its_texture_is() -> None:
    drawn = face(20.0)
    assert np.array_equal(Shown().sharpened(drawn), drawn)


def test_what_one_frame_tells_of_sharpness_is_made_up_for_at_once() -> None:
    """So a face is about as sharp as the picture in the frame that comes after a rehearsal."""
    own, drawn = face(8.0), face(16.0)
    assert settled(own, drawn, 1).gain == pytest.approx(settled(own, drawn).gain, rel=0.15)


def test_a_face_that_is_held_is_not_measured() -> None:
    """What the frame shows where it was is not the person."""
    shown = settled(face(8.0), face(16.0))
    gain, deviation = shown.gain, shown.deviation
    for _ in range(20):
        shown.show(face(1.0), face(16.0), found=False)
    assert (shown.gain, shown.deviation) == (gain, deviation)


@pytest.mark.parametrize("rate", [25, 60])
def test_a_face_becomes_as_sharp_as_fast_at_any_frame_rate(rate: int) -> None:
    """In a second, after the picture has gone out of focus."""
    gains = []
    for each in (30, rate):
        shown = settled(face(16.0), face(16.0))
        for _ in range(each):
            shown.show(face(8.0), face(16.0), 1 / each)
        gains.append(shown.gain)
    assert gains[0] < 0.7
    assert gains[1] == pytest.approx(gains[0], rel=0.1)


@pytest.mark.parametrize("rate", [25, 60])
def test_frames_are_measured_as_often_at_any_frame_rate(rate: int) -> None:
    counts = []
    for each in (30, rate):
        shown, times = settled(face(16.0), face(16.0)), set()
        for _ in range(2 * each):
            shown.show(face(16.0), face(16.0), 1 / each)
            times.add(shown.memory.surface.grain_seen)
        counts.append(len(times))
    assert counts[1] == pytest.approx(counts[0], abs=4)


SMOOTH = np.full((*REFERENCE.size, 3), 120, np.uint8)


def noisy(deviation: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, deviation, REFERENCE.size)
    return np.clip(SMOOTH + noise[..., None], 0, 255).round().astype(np.uint8)


def drawn_after(shown: Shown, deviation: float, frames: int = 30) -> U8:
    """The last of some frames with noise, on which a smooth face is drawn pixel by pixel."""
    for number in range(frames):
        shown.show(noisy(deviation, number), SMOOTH.copy())
    return shown.grained(SMOOTH, frames)


@pytest.mark.parametrize("deviation", [1.0, 2.5, 8.0])
def test_a_smooth_face_gets_the_noise_of_the_frame(deviation: float) -> None:
    drawn = drawn_after(Shown(), deviation)
    expected = np.median(grain_energy(noisy(deviation, 99)))
    assert np.median(grain_energy(drawn)) == pytest.approx(expected, rel=0.3)


def test_a_clean_frame_and_a_noisier_face_get_none() -> None:
    clean = Shown()
    np.testing.assert_array_equal(drawn_after(clean, 0.0), SMOOTH)
    for number in range(8):
        clean.show(noisy(1.0, number), noisy(3.0, number))
    assert clean.deviation == 0


def test_the_grain_of_a_frame_is_always_the_same_and_that_of_the_next_another() -> None:
    one, other = Shown(), Shown()
    np.testing.assert_array_equal(drawn_after(one, 2.0), drawn_after(other, 2.0))
    first, second = (one.grained(SMOOTH, number)[..., 0].astype(float).ravel() for number in (5, 6))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.1


def test_a_face_outside_the_picture_is_not_measured() -> None:
    grain = Shown()
    for number in range(8):
        grain.show(noisy(3.0, number), SMOOTH, points=REFERENCE.points + 1000)
    assert grain.deviation == 0
    assert grain.gain == 1


RELIEF = Relief.shipped(REFERENCE)
OWN = OwnSkin(RELIEF)
ZOOM = 2.0
MESH = (RELIEF.points + 0.5) * ZOOM - 0.5


def picture(luma: F32) -> U8:
    return np.repeat(luma[..., None].round().clip(0, 255), 3, axis=2).astype(np.uint8)


def laid(frame: F32, share: float = 1.0, factor: int = 2) -> F32:
    """What is added to a grey texture with so many pixels per grid pixel, of a frame (2 h, 2 w)."""
    h, w = REFERENCE.size
    texture = np.full((factor * h, factor * w, 3), 100, np.uint8)
    OWN.lay(texture, picture(frame), MESH, ZOOM, share)
    assert (texture[..., 1:] == 100).all()
    return texture[..., 0].astype(np.float32) - 100


def pores() -> F32:
    h, w = REFERENCE.size
    noise = np.random.default_rng(1).standard_normal((2 * h, 2 * w)).astype(np.float32)
    return 100 + 6 * cv2.GaussianBlur(noise, (0, 0), 1)


def cheek(plane: F32, right: bool = True) -> F32:
    """A square of a plane (2 h, 2 w) on a cheek."""
    corners = (RIGHT_TEMPLE, RIGHT_MOUTH_CORNER) if right else (LEFT_TEMPLE, LEFT_MOUTH_CORNER)
    x, y = np.round(2 * REFERENCE.points[list(corners)].mean(0)).astype(int)
    return plane[y - 8 : y + 9, x - 8 : x + 9]


def test_pores_lie_where_they_are_in_the_frame() -> None:
    frame = pores()
    for right in (True, False):
        found, there = cheek(laid(frame), right), cheek(frame, right)
        assert np.corrcoef(found.ravel(), there.ravel())[0, 1] > 0.8
        assert found.std() > 0.3 * there.std()


def test_a_share_of_them_is_as_much_weaker() -> None:
    whole, half = (cheek(laid(pores(), share)).std() for share in (1.0, 0.5))
    assert 0.35 * whole < half < 0.65 * whole


def test_folds_stay_out() -> None:
    frame = pores()
    x, y = np.round(2 * REFERENCE.points[[RIGHT_TEMPLE, RIGHT_MOUTH_CORNER]].mean(0)).astype(int)
    frame[:, x - 1 : x + 2] -= 40
    assert np.abs(laid(frame)[y - 8 : y + 9, x - 1 : x + 2]).max() < 3


def test_light_and_eyes_stay_out() -> None:
    frame = pores() + np.linspace(-60, 60, 2 * REFERENCE.size[1], dtype=np.float32)
    added = laid(frame)
    assert abs(cheek(added).mean()) < 0.5
    x, y = np.round(2 * REFERENCE.points[LEFT_EYE].mean(0)).astype(int)
    assert np.abs(added[y - 3 : y + 4, x - 3 : x + 4]).max() <= 1


def test_a_texture_as_coarse_as_the_grid_gets_them_too() -> None:
    assert laid(pores(), factor=1).std() > 0.2


def test_own_skin_is_added_only_where_the_faces_own_sharpness_is_not_enough() -> None:
    frame, memory = picture(pores()), Memory()
    for share in (0.0, 0.6):
        face = drawn_on(frame, MESH, np.full_like(frame, 100), zoom=ZOOM)
        face.canvas.mesh, memory.surface.own_share = MESH, share
        OWN.add(face, memory)
        assert (face.canvas.picture != 100).any() == (share > 0)


def test_pores_of_a_disguise_are_never_stronger_than_the_pictures_whatever_its_folds() -> None:
    folds = np.float32(30) * np.sin(np.arange(REFERENCE.size[1], dtype=np.float32) / 5)
    skin = face(4.0)
    folded = np.clip(skin + np.stack([folds, 0 * folds, 0 * folds], 1), 0, 255).astype(np.uint8)
    assert settled(folded, face(4.0), surface=PoreFinish).gain <= 1 < settled(folded, face(4.0)).gain
    for own in (skin, folded):
        assert settled(own, face(12.0), surface=PoreFinish).gain < 0.6
