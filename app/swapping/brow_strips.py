"""Brows as thick as they are: a mesh stretches them when lids close or brows rise.

The points of a brow lie along its upper edge, and its hair in the triangles between them and the lid, so that a brow
would grow with its distance from the lid, by a third in a blink.  So the strip of the texture below a brow's points is
read at the scale of the face, and the skin from there to the lid takes up the rest.  Pixels of the reference grid,
x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    LEFT_BROW,
    LEFT_EYE_INNER,
    LEFT_EYE_OUTER,
    LEFT_UPPER_LID,
    RIGHT_BROW,
    RIGHT_EYE_INNER,
    RIGHT_EYE_OUTER,
    RIGHT_UPPER_LID,
    Group,
)
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, U8
from guise.common.interpolation import interpolation


@dataclass(frozen=True)
class BrowStripLimits:
    """Lengths in face widths, heights in distances from brow to lid."""

    thickness: float = 0.05  # of a brow, below its points
    lowest: float = 0.8  # height at which a brow ends at most
    fade: float = 0.05  # beyond either end of a brow, over which the strip ends
    stretch: tuple[float, float] = (0.6, 1.8)  # of the distance, more counts as this
    unchanged: float = 0.02  # of a stretch, that isn't seen
    least: float = 1.0  # grid pixels from brow to lid


LIMITS = BrowStripLimits()


class BrowStrips:
    """Keeps the thickness of both brows of a texture.

    Parameters
    ----------
    reference : ReferenceFrame.
    factor : pixels of the texture per grid pixel, along each axis.
    """

    def __init__(self, reference: ReferenceFrame, factor: int) -> None:
        self._brows = [
            _Brow(reference, RIGHT_BROW, np.r_[RIGHT_EYE_OUTER, RIGHT_UPPER_LID, RIGHT_EYE_INNER], factor),
            _Brow(reference, LEFT_BROW, np.r_[LEFT_EYE_INNER, LEFT_UPPER_LID, LEFT_EYE_OUTER], factor),
        ]

    def stretch(self, drawn: F64, at_rest: F64) -> F64:
        """(2, 5) by which distances from brows to lids grow, of a face at rest (81, 2) that is drawn otherwise (81, 2).

        Both on the grid, seen from the same side.
        """
        return np.array([brow.distances(drawn) / brow.distances(at_rest) for brow in self._brows])

    def keep(self, picture: U8, stretch: F64) -> None:
        """Change a texture (h, w, 3) in place, for a `stretch`."""
        for brow, share in zip(self._brows, stretch, strict=True):
            brow.keep(picture, share)


class _Brow:
    """One of them, with the points of the lid below it from left to right."""

    def __init__(self, reference: ReferenceFrame, brow: Group, lid: Group, factor: int) -> None:
        points, width = reference.points, reference.resolution
        self._brow, self._lid, self._factor = brow, lid, factor
        self._below = interpolation(points[brow, 0], points[lid, 0])
        fade = LIMITS.fade * width
        left, right = points[brow, 0].min() - fade, points[brow, 0].max() + fade
        top, bottom = points[brow, 1].min(), points[lid, 1].max()
        self._place = np.s_[
            int(top) * factor : int(bottom + 1) * factor, int(left) * factor : int(right + 1) * factor
        ]
        ys, xs = (((pixels + 0.5) / factor - 0.5).astype(np.float32) for pixels in np.mgrid[self._place])
        x = xs[0].astype(np.float64)
        self._near = interpolation(x, points[brow, 0])
        beyond = np.maximum(points[brow, 0].min() - x, x - points[brow, 0].max())
        self._shown = 1 - np.clip(beyond / fade, 0, 1)
        self._line = np.asarray(self._near @ points[brow, 1], np.float32)
        self._gap = np.asarray(interpolation(x, points[lid, 0]) @ points[lid, 1], np.float32) - self._line
        self._end = np.minimum(LIMITS.thickness * width / self._gap, LIMITS.lowest)
        self._heights = (ys - self._line) / self._gap
        self._columns = (xs + np.float32(0.5)) * factor - np.float32(0.5)

    def distances(self, shape: F64) -> F64:
        """(5,) from the brow's points of a shape (81, 2) down to the lid."""
        down = (self._below @ shape[self._lid] - shape[self._brow])[:, 1]
        return np.maximum(down, LIMITS.least)

    def keep(self, picture: U8, stretch: F64) -> None:
        stretch = np.clip(stretch, *LIMITS.stretch)
        if np.abs(stretch - 1).max() < LIMITS.unchanged:
            return
        rows = (self._line + self._gap * self._read_at(stretch) + np.float32(0.5)) * self._factor
        picture[self._place] = cv2.remap(
            picture, self._columns, rows - np.float32(0.5), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )

    def _read_at(self, stretch: F64) -> F32:
        """(h, w) heights at which the texture is read, 0 at the brow's points and 1 at the lid."""
        drawn_end = self._end / (1 + self._shown * (self._near @ stretch - 1))
        drawn_end = np.minimum(drawn_end, LIMITS.lowest).astype(np.float32)
        end = self._end.astype(np.float32)
        below = end + (self._heights - drawn_end) * ((1 - end) / (1 - drawn_end))
        read = np.where(self._heights < drawn_end, self._heights * (end / drawn_end), below)
        inside = (self._heights > 0) & (self._heights < 1)
        return np.asarray(np.where(inside, read, self._heights), np.float32)
