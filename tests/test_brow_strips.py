"""Brows keep their thickness when the distance from brow to lid changes."""

import numpy as np
import pytest

from guise.aam.landmarks.schemes import BROWS, LEFT_BROW, RIGHT_BROW, UPPER_LIDS
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.app.swapping.brow_strips import BrowStrips
from guise.common.arrays import F64, U8

FRAME = ReferenceFrame.canonical(160)


def painted(factor: int) -> U8:
    """A texture with brows: bright skin, and dark strips as thick as brows below their points."""
    h, w = FRAME.size
    ys, xs = (np.mgrid[: factor * h, : factor * w] + 0.5) / factor - 0.5
    picture = np.full((factor * h, factor * w, 3), 200, np.uint8)
    for brow in (RIGHT_BROW, LEFT_BROW):
        x, y = FRAME.points[brow].T
        below = ys - np.interp(xs, x, y)
        picture[(xs >= x[0]) & (xs <= x[-1]) & (below > 0) & (below < 0.035 * FRAME.resolution)] = 40
    return picture


def thickness(picture: U8, brow: np.ndarray) -> float:
    """Of the dark strip in the middle of a brow, share of what it was."""
    column = round(FRAME.points[brow, 0].mean() * picture.shape[1] / FRAME.size[1])
    rows = slice(0, round(FRAME.points[UPPER_LIDS, 1].max() * picture.shape[0] / FRAME.size[0]))
    return float((200.0 - picture[rows, column, 0]).sum())


def farther(share: float) -> F64:
    """The face with brows farther above the lids, by a share of the distance."""
    points = FRAME.points.copy()
    points[BROWS, 1] += share * (points[BROWS, 1] - points[UPPER_LIDS, 1].mean())
    return points


@pytest.mark.parametrize("factor", [1, 2])
@pytest.mark.parametrize("share", [-0.15, 0.3, 0.6])
def test_the_texture_of_a_brow_shrinks_as_its_triangles_grow(factor: int, share: float) -> None:
    strips, before = BrowStrips(FRAME, factor), painted(factor)
    after = before.copy()
    strips.keep(after, farther(share), FRAME.points)
    for brow in (RIGHT_BROW, LEFT_BROW):
        drawn = thickness(after, brow) * (1 + share) / thickness(before, brow)
        assert drawn == pytest.approx(1, abs=0.12)


def test_a_brow_is_drawn_as_thick_as_at_rest_all_along() -> None:
    """Where triangles meet, too."""
    drawn, before, factor = FRAME.points.copy(), painted(2), 2
    drawn[UPPER_LIDS, 1] += 0.5 * (drawn[UPPER_LIDS, 1].mean() - drawn[BROWS, 1].mean())
    after = before.copy()
    BrowStrips(FRAME, factor).keep(after, drawn, FRAME.points)
    ys, xs = (np.mgrid[: len(after), : after.shape[1]] + 0.5) / factor - 0.5
    places = MeshSampler.build(FRAME, np.column_stack([xs.ravel(), ys.ravel()])).positions(drawn)
    tall = factor * np.gradient(places[:, 1].reshape(xs.shape), axis=0)
    above = ys < FRAME.points[UPPER_LIDS, 1].max()
    for brow in (RIGHT_BROW, LEFT_BROW):
        first, *_, last = FRAME.points[brow, 0]
        columns = (xs[0] > first + 6) & (xs[0] < last - 6)
        dark, dark_before = ((above * (200.0 - p[..., 0]))[:, columns] for p in (after, before))
        share = (dark * tall[:, columns]).sum(0) / dark_before.sum(0)
        assert np.abs(share - 1).max() < 0.1


def test_a_face_at_rest_stays_as_it_is() -> None:
    strips, picture = BrowStrips(FRAME, 1), painted(1)
    strips.keep(picture, FRAME.points, FRAME.points)
    assert (picture == painted(1)).all()


def test_nothing_but_the_skin_from_brow_to_lid_changes() -> None:
    rng = np.random.default_rng(5)
    before = rng.integers(0, 255, (*FRAME.size, 3), dtype=np.uint8)
    after, strips = before.copy(), BrowStrips(FRAME, 1)
    strips.keep(after, farther(0.5), FRAME.points)
    rows = np.flatnonzero((before != after).any((1, 2)))
    assert rows.min() >= np.floor(FRAME.points[BROWS, 1].min())
    assert rows.max() <= np.ceil(FRAME.points[UPPER_LIDS, 1].max()) + 8  # the corners of the eyes lie lower


def test_lids_above_brows_do_no_harm() -> None:
    strips, picture = BrowStrips(FRAME, 1), painted(1)
    strips.keep(picture, farther(-3), farther(-2))
    assert picture.shape == painted(1).shape
