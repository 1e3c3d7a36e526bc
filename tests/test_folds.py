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


def noise() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (*RELIEF.reference.size, 3), np.uint8)


def smoothed(folds: Folds, mesh: np.ndarray, zoom: float = 1.0) -> np.ndarray:
    picture, fold = noise(), folds.at(mesh, zoom)
    if fold is not None:
        fold.smooth(picture)
    return picture


def fineness(picture: np.ndarray) -> np.ndarray:
    """(w,) mean difference of luma between a pixel and the one below it, in each column."""
    return np.abs(np.diff(picture[..., 0].astype(float), axis=0)).mean(0)


def test_a_face_from_the_front_stays_as_it_is(folds: Folds) -> None:
    assert (smoothed(folds, RELIEF.seen(RELIEF.reference.points, STRAIGHT)) == noise()).all()


def test_shut_eyes_are_no_fold(folds: Folds) -> None:
    """Lids close over the eye, which is not seen then; their rims stay sharp."""
    shut = RELIEF.reference.points.copy()
    shut[UPPER_LIDS] = shut[LOWER_LIDS] - (0, 0.2)
    assert (smoothed(folds, RELIEF.seen(shut, STRAIGHT)) == noise()).all()


def halves(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Those of the left and of the right half of a face, but for its edges."""
    width = len(columns)
    return columns[width // 10 : width // 2], columns[width // 2 : -(width // 10)]


@pytest.mark.parametrize("way", [-1, 1])
def test_the_far_side_of_the_nose_is_smoothed_and_the_near_cheek_is_not(folds: Folds, way: int) -> None:
    ratio = fineness(smoothed(folds, turned(way * 40))) / fineness(noise())
    far, near = halves(ratio)[::way]
    assert near.mean() > 0.97
    assert far.mean() < 0.8


def test_no_detail_is_added_where_a_face_is_smoothed(folds: Folds) -> None:
    h, w = RELIEF.reference.size
    fold, detail = folds.at(turned(40), 1.0), np.ones((2 * h, 2 * w), np.float32)
    assert fold is not None
    left = fold.without(detail)
    assert (detail == 1).all()
    far, near = halves(left.mean(0))
    assert near.mean() > 0.97
    assert far.mean() < 0.8
    assert left.min() >= 0


def test_a_larger_face_is_squeezed_alike(folds: Folds) -> None:
    small, large = (smoothed(folds, zoom * turned(40), zoom) != noise() for zoom in (0.5, 2.0))
    assert large.any()
    assert small.mean() >= large.mean()
