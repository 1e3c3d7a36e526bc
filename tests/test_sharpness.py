"""A drawn face as sharp as the picture around it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from guise.aam.reference import ReferenceFrame
from guise.app.swapping.finish import FIRST_DRAWS, Finish
from guise.app.swapping.sharpness import LIMITS, Sharpness
from guise.common.arrays import U8

REFERENCE = ReferenceFrame.canonical(96)


def face(contrast: float) -> U8:
    """A picture of the reference frame's size with blotches of so many grey levels on grey."""
    noise = np.random.default_rng(3).standard_normal(REFERENCE.size).astype(np.float32)
    blotches = cv2.GaussianBlur(noise, (0, 0), 1.5)
    luma = 128 + contrast * blotches / blotches.std()
    picture = np.full((*REFERENCE.size, 3), 128, np.uint8)
    picture[..., 0] = np.clip(luma.round(), 0, 255)
    return picture


def settled(own: U8, drawn: U8, frames: int = 60) -> Sharpness:
    """Sharpness after many frames in which a texture is laid over skin of its own size."""
    sharpness = Sharpness(REFERENCE, REFERENCE.mask)
    for _ in range(frames):
        shown = sharpness.apply(drawn)
        seen = sharpness.seen(own)
        if seen is not None:
            sharpness.update(seen, shown, REFERENCE.points)
    return sharpness


@pytest.mark.parametrize("contrast", [12.0, 20.0])
def test_a_harsher_donor_becomes_about_as_sharp_as_the_picture(contrast: float) -> None:
    gain = settled(face(8.0), face(contrast)).gain
    assert gain == pytest.approx(8.0 / contrast, rel=0.3)
    assert gain < 1


def test_a_face_as_sharp_as_the_picture_is_left_as_it_is() -> None:
    drawn = face(8.0)
    sharpness = settled(face(8.0), drawn)
    assert sharpness.gain == 1.0
    assert np.array_equal(sharpness.apply(drawn), drawn)


def test_a_blurred_donor_is_sharpened_no_more_than_the_limit() -> None:
    assert settled(face(20.0), face(4.0)).gain == LIMITS.gain[1]


def test_the_frames_own_skin_is_shown_only_where_sharpening_is_not_enough() -> None:
    assert settled(face(8.0), face(20.0)).own_share == 0
    assert settled(face(8.0), face(8.0)).own_share == 0
    blurred = settled(face(20.0), face(4.0))
    assert blurred.own_share == 1
    blurred.reset()
    assert blurred.own_share == 0


def test_the_mean_colour_stays() -> None:
    drawn = face(20.0)
    flatter = settled(face(5.0), drawn).apply(drawn)
    skin = REFERENCE.mask
    assert np.abs(flatter[skin].mean(0) - drawn[skin].mean(0)).max() < 1.0
    assert flatter[skin][:, 0].std() < 0.75 * drawn[skin][:, 0].std()


def test_the_next_face_starts_as_its_texture_is() -> None:
    sharpness = settled(face(5.0), face(20.0))
    sharpness.reset()
    assert sharpness.gain == 1.0


def test_a_faces_first_frame_is_drawn_until_it_is_about_as_sharp() -> None:
    own, drawn, finish = face(8.0), face(16.0), Finish(REFERENCE, REFERENCE.mask)
    assert settled(own, drawn, FIRST_DRAWS).gain == pytest.approx(settled(own, drawn).gain, rel=0.15)
    assert finish.draws == FIRST_DRAWS
    finish.before(own, drawn.copy(), 0)
    assert finish.draws == 1
    finish.reset()
    assert finish.draws == FIRST_DRAWS
