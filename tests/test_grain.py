"""A drawn face gets the grain of the frame, no more."""

import numpy as np
import pytest

from guise.aam.reference import ReferenceFrame
from guise.app.swapping.grain import LIMITS, Grain, grain_energy

FRAME = ReferenceFrame.canonical(96)
SMOOTH = np.full((*FRAME.size, 3), 120, np.uint8)


def noisy(deviation: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, deviation, FRAME.size)
    return np.clip(SMOOTH + noise[..., None], 0, 255).round().astype(np.uint8)


def grained(grain: Grain, number: int) -> np.ndarray:
    """A smooth texture with the grain of a frame."""
    picture = SMOOTH.copy()
    grain.add(picture, number)
    return picture


def drawn_after(grain: Grain, deviation: float, frames: int = 30) -> np.ndarray:
    """The last of some frames with noise, on which a smooth face is drawn pixel by pixel."""
    for number in range(frames):
        picture = grained(grain, number)
        seen = grain.seen(noisy(deviation, number))
        if seen is not None:
            grain.update(seen, picture, FRAME.points)
    return grained(grain, frames)


@pytest.mark.parametrize("deviation", [1.0, 2.5])
def test_a_smooth_face_gets_the_noise_of_the_frame(deviation: float) -> None:
    drawn = drawn_after(Grain(FRAME, FRAME.mask), deviation)
    expected = np.median(grain_energy(noisy(deviation, 99)))
    assert np.median(grain_energy(drawn)) == pytest.approx(expected, rel=0.3)


def test_a_clean_frame_and_a_noisier_face_get_none() -> None:
    clean = Grain(FRAME, FRAME.mask)
    np.testing.assert_array_equal(drawn_after(clean, 0.0), SMOOTH)
    seen = clean.seen(noisy(1.0, 1))
    while seen is None:
        seen = clean.seen(noisy(1.0, 1))
    clean.update(seen, noisy(3.0, 2), FRAME.points)
    assert clean.deviation == 0


def test_the_grain_of_a_frame_is_always_the_same_and_that_of_the_next_another() -> None:
    one, other = Grain(FRAME, FRAME.mask), Grain(FRAME, FRAME.mask)
    np.testing.assert_array_equal(drawn_after(one, 2.0), drawn_after(other, 2.0))
    first, second = (grained(one, number)[..., 0].astype(float).ravel() for number in (5, 6))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.1


def test_grain_is_bounded_and_forgotten_with_the_face() -> None:
    grain = Grain(FRAME, FRAME.mask)
    drawn_after(grain, 60.0, 60)
    assert grain.deviation == LIMITS.max_grey_levels
    grain.reset()
    assert grain.deviation == 0


def test_a_face_outside_the_picture_is_not_measured() -> None:
    grain = Grain(FRAME, FRAME.mask)
    seen = grain.seen(noisy(3.0, 1))
    assert seen is not None
    grain.update(seen, SMOOTH, FRAME.points + 1000)
    assert grain.deviation == 0
