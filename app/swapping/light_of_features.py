"""The light of a face without what it takes from the features: brows that rise are no shadow, lids and lips no gleam.

A light that follows dark skin takes the source's raised brows for it, and would draw them above those of another face.
And where the source's lids, lips or shaven upper lip are brighter than the other's, which lie deeper, are made up or
have a beard, it would draw a bright patch there, whose edge ends beside the feature.  So where brows rise to, a darker
light is interpolated from that of the skin beside, and around eyes and lips a brighter one; nor do brows and eyes tint
it.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, LEFT_EYE, LIPS, RIGHT_BROW, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.coarse_grid import TexelSums, gaussian_kernel
from guise.common.arrays import F32, Bool

FLOOR = 1e-4  # of the weight of a mean


@dataclass(frozen=True)
class LightOfFeaturesLimits:
    """Lengths in face widths."""

    raised: float = 0.035  # by which what may be hidden lies above the brows,
    growth: float = 0.045  # and by which it is larger
    around: float = 0.06  # by which what may be too bright is larger than eyes and lips
    tinted: float = 0.03  # by which what may tint the light is larger than brows and eyes
    beside: float = 0.04  # standard deviation of the weights of what lies beside
    darkness: tuple[float, float] = (0.08, 0.2)  # logs, of which none and all is taken for a brow
    gleam: tuple[float, float] = (0.12, 0.3)  # the same for what is brighter around eyes and lips


LIMITS = LightOfFeaturesLimits()


class LightOfFeatures:
    """Where features lie, and where brows rise to, on a grid of cells.

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
        tinted = soft_parts(reference, (RIGHT_BROW, LEFT_BROW, RIGHT_EYE, LEFT_EYE), LIMITS.tinted)
        around = soft_parts(reference, (RIGHT_EYE, LEFT_EYE, LIPS), LIMITS.around)
        pixels = np.column_stack([plane[reference.mask] for plane in (raised, around, tinted, bare)])
        *sums, every = TexelSums(grid, places)(pixels, np.ones(len(pixels), np.float32))
        self._raised, self._around, self._tinted, self._bare = (
            one / np.maximum(every, FLOOR) for one in sums
        )
        self._reach = np.ones((2 * round(1.5 * LIMITS.beside / cell) + 1,) * 2, np.uint8)
        self._rows, self._columns = (gaussian_kernel(length, LIMITS.beside / cell) for length in grid)

    def without(self, light: F32, seen: F32, skin: F32) -> F32:
        """A map (6, h, w), gain and offset of each cell, without what raised brows, lids and lips add to it.

        seen : (h, w) share of each cell that is seen.   skin : (3,) RGB on which lights are compared.
        """
        beside = self._beside(light, seen * self._bare * (1 - np.maximum(self._raised, self._around)))
        now, then = brightness(light, skin), brightness(beside, skin)
        brightest = cv2.dilate(then, self._reach)  # so that the edge of a shadow stays
        share = np.maximum(
            self._raised * _beyond(np.log(then / now), LIMITS.darkness),
            self._around * _beyond(np.log(now / brightest), LIMITS.gleam),
        )
        light = light + share * (beside - light)
        tints = [colours / brightness_of(colours) for colours in (lit(light, skin), lit(beside, skin))]
        return np.asarray(light * np.tile((tints[1] / tints[0]) ** self._tinted, (2, 1, 1)), np.float32)

    def _beside(self, light: F32, known: F32) -> F32:
        """(6, h, w) means of a map by weights (h, w) of what is known of it."""
        rows, columns = self._rows, self._columns
        return np.asarray(
            (rows @ (light * known) @ columns.T) / np.maximum(rows @ known @ columns.T, FLOOR), np.float32
        )


def _beyond(values: F32, limits: tuple[float, float]) -> F32:
    """Share in [0, 1] of values that go from the first limit to the last."""
    return np.asarray(np.clip((values - limits[0]) / (limits[1] - limits[0]), 0, 1), np.float32)


def lit(light: F32, colour: F32) -> F32:
    """(3, h, w) a colour (3,) in the light of a map (6, h, w), at least 1."""
    return np.asarray(np.maximum(light[:3] * colour[:, None, None] + light[3:], 1), np.float32)


def brightness_of(colours: F32) -> F32:
    """(h, w) of colours (3, h, w)."""
    return np.asarray(np.tensordot(LUMA, colours, 1))


def brightness(light: F32, colour: F32) -> F32:
    """(h, w) brightness of a colour (3,) in the light of a map (6, h, w), at least 1."""
    return brightness_of(lit(light, colour))
