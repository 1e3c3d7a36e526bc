"""Brows that rise are no shadow: the light of a face without the darkness that they add to the forehead.

A light that follows dark skin takes the source's raised brows for it, and would draw them above those of another face.
So where brows rise to, a darker light is interpolated from that of the skin beside.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.coarse_grid import TexelSums, gaussian_kernel
from guise.common.arrays import F32, Bool

FLOOR = 1e-4  # of the weight of a mean


@dataclass(frozen=True)
class BrowShadowLimits:
    """Lengths in face widths."""

    raised: float = 0.035  # by which what may be hidden lies above the brows,
    growth: float = 0.045  # and by which it is larger
    beside: float = 0.04  # standard deviation of the weights of what lies beside
    darkness: tuple[float, float] = (0.08, 0.2)  # logs, of which none and all is taken for a brow's


LIMITS = BrowShadowLimits()


class BrowShadow:
    """Where brows rise to on a grid of cells.

    Parameters
    ----------
    reference : ReferenceFrame.
    mask : (h, w) bool, where the face is shown.
    grid : height and width in cells.
    places : (n, 2) of the mask pixels of the reference frame, in cells.
    cell : side of a cell, face widths.
    """

    def __init__(
        self, reference: ReferenceFrame, mask: Bool, grid: tuple[int, int], places: F32, cell: float
    ) -> None:
        brows = soft_parts(reference, (RIGHT_BROW, LEFT_BROW), LIMITS.growth)
        raised = np.roll(brows, -round(LIMITS.raised * reference.resolution), axis=0)
        bare = np.asarray(skin_mask(reference) & mask, np.float32)
        pixels = np.column_stack([plane[reference.mask] for plane in (raised, bare)])
        *sums, every = TexelSums(grid, places)(pixels, np.ones(len(pixels), np.float32))
        self._share, self._bare = (one / np.maximum(every, FLOOR) for one in sums)
        self._rows, self._columns = (gaussian_kernel(length, LIMITS.beside / cell) for length in grid)

    def without(self, light: F32, seen: F32, skin: F32) -> F32:
        """A map (6, h, w), gain and offset of each cell, without what raised brows add to it.

        seen : (h, w) share of each cell that is seen.   skin : (3,) RGB on which lights are compared.
        """
        known = seen * self._bare * (1 - self._share)
        beside = (self._rows @ (light * known) @ self._columns.T) / np.maximum(
            self._rows @ known @ self._columns.T, FLOOR
        )
        darker = np.log(brightness(beside, skin) / brightness(light, skin))
        first, last = LIMITS.darkness
        share = self._share * np.clip((darker - first) / (last - first), 0, 1)
        return np.asarray(light + share * (beside - light), np.float32)


def brightness(light: F32, colour: F32) -> F32:
    """(h, w) brightness of a colour (3,) in the light of a map (6, h, w), at least 1."""
    return np.maximum(np.tensordot(LUMA, light[:3] * colour[:, None, None] + light[3:], 1), 1)
