"""The identity's iris colour on the source's eyeballs."""

import numpy as np
import pytest

from guise.app.swapping.iris import IrisFinder, IrisTint, of_one_colour
from guise.common.arrays import F32

HEIGHT, WIDTH = 40, 76
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
LIDS = ((((COLUMNS - 38) / 26) ** 2 + ((ROWS - 20) / 13) ** 2) < 1).astype(np.float32)
BROWN, GREEN, CYAN, WHITE, SKIN = (
    np.float32(c) for c in ((60, 40, 36), (80, 95, 70), (125, 165, 165), (200, 195, 190), (190, 140, 120))
)


def eye(iris: F32, x: float = 38, light: float = 1.0) -> F32:
    """An eye that looks at a column, with a pupil and a catch-light."""
    away = np.hypot(COLUMNS - x, ROWS - 20)[..., None]
    picture = np.where(away < 13, iris, WHITE)
    picture = np.where(away < 4, np.float32(15), picture)
    picture = np.where(np.hypot(COLUMNS - x - 5, ROWS - 16)[..., None] < 1.5, np.float32(250), picture)
    return np.asarray(light * np.where(LIDS[..., None] > 0, picture, SKIN), np.float32)


@pytest.mark.parametrize("iris", [BROWN, GREEN, CYAN])
@pytest.mark.parametrize("x", [31, 38, 45])
def test_an_iris_is_found_wherever_it_looks(iris: F32, x: int) -> None:
    centre = IrisFinder(LIDS).centre(eye(iris, x).mean(2))
    assert centre is not None
    assert centre[1] == pytest.approx(x, abs=3)


@pytest.mark.parametrize("light", [0.4, 1.0])
@pytest.mark.parametrize(("own", "other"), [(BROWN, GREEN), (GREEN, BROWN), (CYAN, BROWN)])
def test_an_iris_takes_the_other_colour_in_its_own_light(own: F32, other: F32, light: float) -> None:
    tint = IrisTint(LIDS, eye(own), eye(other))
    made = tint.apply(eye(own, 42, light))
    ring = (np.hypot(COLUMNS - 42, ROWS - 20) > 6) & (np.hypot(COLUMNS - 42, ROWS - 20) < 9) & (ROWS > 20)
    before, after = (np.abs(p[ring].mean(0) - light * other).max() for p in (eye(own, 42, light), made))
    assert after < 0.35 * before


def test_white_and_pupil_stay() -> None:
    source = eye(CYAN, 34)
    made = IrisTint(LIDS, eye(CYAN), eye(BROWN)).apply(source)
    beside = (np.hypot(COLUMNS - 34, ROWS - 20) > 17) & (LIDS > 0)
    assert np.abs(made - source)[beside].max() < 4
    assert made[20, 34].max() < 20


def test_the_same_colours_change_nothing() -> None:
    source = eye(GREEN, 41)
    assert np.abs(IrisTint(LIDS, eye(GREEN), eye(GREEN)).apply(source) - source).max() < 1e-3


def test_an_eye_without_a_white_stays() -> None:
    lids = (np.hypot(COLUMNS - 38, ROWS - 20) < 3).astype(np.float32)
    source = eye(BROWN)
    assert np.array_equal(IrisTint(lids, source, eye(GREEN)).apply(source), source)


def test_a_shut_eye_keeps_its_colours() -> None:
    source = eye(GREEN, 41)
    assert np.array_equal(IrisTint(LIDS, eye(GREEN), eye(BROWN)).apply(source, 0.0), source)


def test_both_eyes_change_alike() -> None:
    tints = [IrisTint(LIDS, eye(GREEN), eye(other)) for other in (BROWN, CYAN)]
    of_one_colour(tints)
    assert tints[0].gain is not None
    assert np.array_equal(tints[0].gain, tints[1].gain)
    assert tints[0].gain[2] == pytest.approx(np.sqrt(40 / 74 * 169 / 74), rel=0.15)
