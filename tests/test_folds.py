"""Textures are smoothed where a turned head squeezes them, and nowhere else."""

from __future__ import annotations

import cv2
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


@pytest.mark.parametrize("way", [-1, 1])
def test_the_edge_of_a_turned_nose_is_softened_where_the_cheek_is_behind_it(folds: Folds, way: int) -> None:
    mesh = turned(way * 40)
    mesh = mesh - mesh.min(0) + 10
    fold = folds.at(mesh, 1.0)
    assert fold is not None
    assert len(fold.edges) > 5
    w, h = np.ceil(mesh.max(0)).astype(int) + 10
    before = np.random.default_rng(0).integers(0, 256, (h, w, 3), np.uint8)
    after = before.copy()
    fold.soften_edges(after, (0, 0))
    ys, xs = np.nonzero((after != before).any(2))
    ends = fold.edges.reshape(-1, 2)
    to_edges = np.linalg.norm(np.stack([xs, ys], 1)[:, None] - ends, axis=2).min(1)
    longest = np.linalg.norm(fold.edges[:, 0] - fold.edges[:, 1], axis=1).max()
    assert to_edges.max() < longest / 2 + 4
    x, y = fold.edges.mean(1).round().astype(int).T
    across = np.abs(np.diff(after[..., 0].astype(float), axis=1))[y, x].mean()
    assert across < 0.6 * np.abs(np.diff(before[..., 0].astype(float), axis=1))[y, x].mean()


@pytest.mark.parametrize("degrees", [-60, -40, -25, 25, 40, 60])
def test_nothing_is_blurred_where_a_turned_head_ends(folds: Folds, degrees: float) -> None:
    """Behind those edges is the picture, which must stay as it is."""
    mesh = 2 * turned(degrees)
    mesh = mesh - mesh.min(0) + 20
    fold = folds.at(mesh, 2.0)
    assert fold is not None
    w, h = np.ceil(mesh.max(0)).astype(int) + 20
    drawn = np.zeros((h, w), np.uint8)
    for triangle in np.round(mesh[RELIEF.triangles]).astype(np.int32):
        cv2.fillConvexPoly(drawn, triangle, 255)
    changed = np.repeat(drawn[..., None], 3, axis=2)
    fold.soften_edges(changed, (0, 0))
    assert (changed[..., 0] != drawn).mean() < 1e-3


def test_edges_are_softened_within_the_part_of_a_frame(folds: Folds) -> None:
    fold = folds.at(turned(40), 1.0)
    assert fold is not None
    part = np.zeros((20, 20, 3), np.uint8)
    fold.soften_edges(part, (10_000, 0))
    x, y = fold.edges[0, 0].astype(int)
    fold.soften_edges(part, (x, y))
    assert (part == 0).all()
