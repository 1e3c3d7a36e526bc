"""Brows keep the darkness of their hair under another skin tone."""

import numpy as np
import pytest

from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW
from guise.aam.mask import soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.brow_hair import BrowHair
from guise.common.arrays import F32

FRAME = ReferenceFrame.canonical(96)
SHARE = soft_parts(FRAME, (RIGHT_BROW, LEFT_BROW), 0.0)[FRAME.mask]
CORE, FAR = SHARE > 0.9, soft_parts(FRAME, (RIGHT_BROW, LEFT_BROW), 0.08)[FRAME.mask] == 0


def face(skin: float, hair: float) -> F32:
    """(n, 3) grey skin with brows."""
    return np.repeat(skin + SHARE[:, None] * np.float32(hair - skin), 3, axis=1).astype(np.float32)


def lit(texture: F32, gain: float, offset: float, light: float, tone: float = 0.3) -> tuple[F32, F32]:
    """A texture (n, 3) under an affine light, without and with the brows' hair (3, n)."""
    hair, gains, offsets = (
        BrowHair(FRAME, tone),
        np.full_like(texture.T, gain),
        np.full_like(texture.T, offset),
    )
    plain = gains * texture.T + offsets
    made = plain.copy()
    hair.adjust(made, texture.T, hair.lit_skin(texture.T, gains, offsets), light)
    return plain, made


def test_black_brows_of_a_dark_face_are_black_on_light_skin() -> None:
    plain, made = lit(face(60, 15), 1.5, 90, light=1.0)
    assert plain[:, CORE].mean() > 105
    assert made[:, CORE].mean() < 60
    assert np.array_equal(made[:, FAR], plain[:, FAR])


def test_brown_brows_of_a_light_face_are_not_black_on_dark_skin() -> None:
    plain, made = lit(face(180, 90), 0.4, 0, light=1.0, tone=2.0)
    assert plain[:, CORE].mean() < 40
    assert 50 < made[:, CORE].mean() < made[:, FAR].mean()
    assert np.array_equal(made[:, FAR], plain[:, FAR])


def test_brows_get_no_lighter_where_the_eyes_say_that_it_is_the_light() -> None:
    plain, made = lit(face(180, 90), 0.4, 0, light=0.4, tone=2.0)
    assert made[:, CORE].mean() == pytest.approx(plain[:, CORE].mean(), rel=0.1)


@pytest.mark.parametrize(("gain", "offset", "light"), [(1.0, 0.0, 1.0), (0.5, 0.0, 1.0), (0.5, 0.0, 0.5)])
def test_brows_of_a_darker_face_never_get_lighter_and_the_same_light_keeps_them(
    gain: float, offset: float, light: float
) -> None:
    plain, made = lit(face(180, 40), gain, offset, light)
    assert (made <= plain + 1e-3).all()
    assert made[:, CORE].mean() == pytest.approx(plain[:, CORE].mean(), rel=0.03)


def test_fair_brows_stay_fair() -> None:
    plain, made = lit(face(180, 165), 1.0, 10, light=1.0)
    assert made[:, CORE].mean() > 0.9 * plain[:, CORE].mean()


def test_brows_of_a_face_as_light_as_the_person_keep_their_contrast() -> None:
    """Whatever the eyes seem to say of the light."""
    plain, made = lit(face(180, 120), 1.0, 0, light=0.5, tone=1.0)
    assert made[:, CORE].mean() > 0.97 * plain[:, CORE].mean()


def test_each_brow_is_measured_against_the_skin_beside_it() -> None:
    """A face half in shadow is no brow."""
    shade = np.where(FRAME.pixels % FRAME.size[1] < FRAME.size[1] / 2, 1.0, 0.5)[:, None]
    texture = (face(180, 120) * shade).astype(np.float32)
    plain, made = lit(texture, 1.0, 0, light=1.0)
    assert made.mean() > 0.99 * plain.mean()
