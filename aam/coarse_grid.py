"""Weighted Gaussian means of scattered texels on a coarse grid over the reference frame.

Values known at a few thousand texels are summed into the cells around them, bilinearly, and smoothed; smoothed sums
over smoothed weights are the means around each cell (normalised convolution, Knutsson and Westin 1993).  Places in
cells, x right, y down; the middle of the first cell lies on the first grid pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, Floating, Int
from guise.common.kernels import kernel


@dataclass(frozen=True)
class KernelLimits:
    """The foot of a Gaussian kernel, from which places without texels nearby take their mean."""

    foot_share: float = 0.01  # of the peak
    foot_widening: float = 4.0  # of the standard deviation
    floor_share: float = 1e-4  # of the peak, everywhere


KERNEL = KernelLimits()
LEAST = 1e-9  # sum of weights by which is divided
FOLDED_COLUMNS = 256  # of places, as cv2.remap takes at most 32767


class CoarseGrid:
    """Cells over the reference frame.

    Parameters
    ----------
    reference : ReferenceFrame.
    cell_face_widths : side of a cell.

    Attributes
    ----------
    size : (height, width) in cells.
    """

    def __init__(self, reference: ReferenceFrame, cell_face_widths: float) -> None:
        self._reference = reference
        self._cell_face_widths = cell_face_widths
        self.cell = cell_face_widths * reference.resolution  # grid pixels
        height, width = reference.size
        self.size = int(np.ceil(height / self.cell)) + 1, int(np.ceil(width / self.cell)) + 1

    def places(self, texels: Int | None = None) -> F32:
        """(t, 2) places of texels, given as indices into the reference frame's mask pixels; of all by default."""
        pixels = self._reference.pixels if texels is None else self._reference.pixels[texels]
        ys, xs = np.divmod(pixels, self._reference.size[1])
        return (np.column_stack([xs, ys]) / self.cell).astype(np.float32)

    def smoother(self, sigma_face_widths: float) -> Smoother:
        """Gaussian smoothing of cells."""
        return Smoother(self.size, sigma_face_widths / self._cell_face_widths)


class Smoother:
    """Gaussian smoothing as two matrix products, whose cost doesn't depend on the width; beyond the grid are zeros.

    Parameters
    ----------
    size : (height, width) of the grid.
    sigma : standard deviation, cells.
    """

    def __init__(self, size: tuple[int, int], sigma: float) -> None:
        self._rows, self._columns = (gaussian_kernel(length, sigma) for length in size)

    def __call__(self, cells: F32) -> F32:
        """Smoothed planes (c, h, w)."""
        return np.asarray(self._rows @ cells @ self._columns)

    def means(self, sums: F32) -> F32:
        """Means (c, h, w) around each cell of planes (c + 1, h, w): weighted sums, then the sum of weights."""
        smooth = self(sums)
        return np.asarray(smooth[:-1] / np.maximum(smooth[-1], LEAST))


def gaussian_kernel(
    length: int, sigma: float, foot_share: float = KERNEL.foot_share, floor_share: float = KERNEL.floor_share
) -> F32:
    """(n, n) symmetric matrix of a Gaussian with a wide foot; sigma in cells."""
    square = np.subtract.outer(np.arange(length), np.arange(length)) ** 2 / (2 * sigma**2)
    foot = foot_share * np.exp(-square / KERNEL.foot_widening**2)
    return np.asarray(np.exp(-square) + foot + floor_share, np.float32)


class TexelSums:
    """Sums values of texels into the cells around them, bilinearly.

    Parameters
    ----------
    size : (height, width) of the grid.
    places : (t, 2) of the texels.

    Attributes
    ----------
    corners, shares : (4, t) flat indices of the cells around each texel, and its share in each.
    """

    def __init__(self, size: tuple[int, int], places: F32) -> None:
        self._size = size
        corner = np.floor(places).astype(np.intp)
        x, y = (places - corner).T
        first = corner[:, 1] * size[1] + corner[:, 0]
        self.corners = np.stack([first, first + 1, first + size[1], first + size[1] + 1])
        self.shares = np.stack([(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x]).astype(np.float64)

    def __call__(self, values: Floating, seen: Floating, chosen: Int, weights: Floating) -> F32:
        """Planes (c + d + 1, h, w), see `texel_sums`."""
        sums = np.empty((values.shape[1] + seen.shape[1] + 1, *self._size), np.float32)
        texel_sums(self.corners, self.shares, values, seen, chosen, weights, sums)
        return sums


@kernel
def texel_sums(
    corners: Int, shares: F64, values: Floating, seen: Floating, chosen: Int, weights: Floating, sums: F32
) -> None:
    """Planes (c + d + 1, h, w): weighted sums of values (t, c), of those chosen (t,) of others (n, d), and of weights.

    corners, shares : (4, t) flat indices of the cells around each texel, and its share in each.
    weights : (n,) of the others.
    """
    weighted = shares * weights[chosen]
    for plane, column in zip(sums.reshape(len(sums), -1), [*values.T, *seen[chosen].T, 1], strict=True):
        plane[:] = np.bincount(corners.ravel(), (weighted * column).ravel(), plane.size)


class CellReader:
    """Bilinear values of cells at fixed places (n, 2)."""

    def __init__(self, places: F32) -> None:
        self._count = len(places)
        rows = -(-self._count // FOLDED_COLUMNS)
        folded = np.zeros((rows * FOLDED_COLUMNS, 2), np.float32)
        folded[: self._count] = places
        self._map = folded.reshape(rows, FOLDED_COLUMNS, 2)

    def __call__(self, cells: F32) -> F32:
        """Planes (c, n) of planes (c, h, w)."""
        found = np.empty((len(cells), *self._map.shape[:2]), np.float32)
        for plane, out in zip(cells, found, strict=True):
            cv2.remap(plane, self._map, None, cv2.INTER_LINEAR, dst=out, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        return found.reshape(len(cells), -1)[:, : self._count]
