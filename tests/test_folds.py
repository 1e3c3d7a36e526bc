"""Textures are smoothed where a turned head squeezes them, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from guise.aam.landmarks.schemes import LOWER_LIDS, UPPER_LIDS
from guise.aam.reference import ReferenceFrame
from guise.aam.relief import STRAIGHT, Relief
from guise.aam.solid_shape import SolidPrior
from guise.app.swapping.folds import Folds

RELIEF = Relief.shipped(ReferenceFrame.canonical())


@pytest.fixture(scope="module")
def folds() -> Folds:
    return Folds(RELIEF)


def turned(degrees: float) -> np.ndarray:
    """(81 + k, 2) the mean head, turned, seen from the front."""
    turn = np.radians(degrees)
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    return RELIEF.reference.resolution * (RELIEF.solid(SolidPrior.shipped().mean) @ rotation)[:, :2]


def noise(factor: int = 1) -> np.ndarray:
    h, w = RELIEF.reference.size
    return np.random.default_rng(0).integers(0, 256, (factor * h, factor * w, 3), np.uint8)


def smoothed(folds: Folds, picture: np.ndarray, mesh: np.ndarray, zoom: float = 1.0) -> np.ndarray:
    folds.smooth(picture, mesh, zoom)
    return picture


def fineness(picture: np.ndarray) -> np.ndarray:
    """(w,) mean difference between a pixel and the one below it, in each column."""
    return np.abs(np.diff(picture.astype(float), axis=0)).mean((0, 2))


def test_a_face_from_the_front_stays_as_it_is(folds: Folds) -> None:
    assert (smoothed(folds, noise(), RELIEF.seen(RELIEF.reference.points, STRAIGHT)) == noise()).all()


def test_shut_eyes_are_no_fold(folds: Folds) -> None:
    """Lids close over the eye, which is not seen then; their rims stay sharp."""
    shut = RELIEF.reference.points.copy()
    shut[UPPER_LIDS] = shut[LOWER_LIDS] - (0, 0.2)
    assert (smoothed(folds, noise(), RELIEF.seen(shut, STRAIGHT)) == noise()).all()


@pytest.mark.parametrize("factor", [1, 2])
@pytest.mark.parametrize("way", [-1, 1])
def test_the_far_side_of_the_nose_is_smoothed_and_the_near_cheek_is_not(
    folds: Folds, way: int, factor: int
) -> None:
    ratio = fineness(smoothed(folds, noise(factor), turned(way * 40))) / fineness(noise(factor))
    width = len(ratio)
    halves = ratio[width // 10 : width // 2], ratio[width // 2 : -(width // 10)]
    far, near = halves[::way]
    assert near.mean() > 0.97
    assert far.mean() < 0.8


def test_a_larger_face_is_squeezed_alike(folds: Folds) -> None:
    small, large = (smoothed(folds, noise(), zoom * turned(40), zoom) != noise() for zoom in (0.5, 2.0))
    assert large.any()
    assert small.mean() >= large.mean()
