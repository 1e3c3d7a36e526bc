"""Means of texels on a coarse grid, and what is read from its cells."""

import numpy as np
from numpy.testing import assert_allclose

from guise.aam.coarse_grid import CellReader, CoarseGrid, TexelSums
from guise.aam.reference import ReferenceFrame

FRAME = ReferenceFrame.canonical(80)
TEXELS = np.arange(0, len(FRAME.pixels), 2)


def test_means_of_a_constant_are_that_constant_whatever_the_weights() -> None:
    grid = CoarseGrid(FRAME, 0.03)
    places = grid.places(TEXELS)
    weights, seven, all_ = (
        np.random.default_rng(2).uniform(0, 1, len(TEXELS)),
        np.full((len(TEXELS), 1), 7.0),
        np.arange(len(TEXELS)),
    )
    smooth = grid.smoother(0.05)(TexelSums(grid.size, places)(seven, seven, all_, weights))
    means = smooth[:2] / smooth[2]
    assert_allclose(means, 7, rtol=1e-5)


def test_sums_are_read_where_they_were_put() -> None:
    grid = CoarseGrid(FRAME, 0.03)
    places = grid.places(TEXELS)
    ramp = np.stack(np.meshgrid(*(np.arange(n, dtype=np.float32) for n in grid.size[::-1])))
    assert_allclose(CellReader(places)(ramp).T, places, atol=1 / 16)  # cv2.remap reads in steps of 1/32
    sums = TexelSums(grid.size, places)(places, places[:, :0], np.arange(len(places)), np.ones(len(places)))
    assert_allclose(sums[:2].sum((1, 2)), places.sum(0), rtol=1e-4)
    assert_allclose((sums[2] * ramp).sum((1, 2)), places.sum(0), rtol=1e-4)
