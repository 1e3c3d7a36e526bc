"""Brows as thick as they are: a mesh stretches them when lids close or brows rise.

The points of a brow lie along its upper edge, and its hair in the triangles between them and the lid, so that a brow
would grow with its distance from the lid, by a third in a blink, and its lower edge break where triangles meet.  So
each place of the texture below a brow's points is read as far below as it is drawn, and the skin from the brow's end to
the lid takes up the rest.  Pixels of the reference grid, x right, y down.
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
from guise.aam.reference import MeshSampler, ReferenceFrame
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

    def keep(self, picture: U8, drawn: F64, at_rest: F64) -> None:
        """Change a texture (h, w, 3) in place, of a face at rest (81, 2) that is drawn otherwise (81, 2).

        Both on the grid, seen from the same side.
        """
        for brow in self._brows:
            brow.keep(picture, drawn, at_rest)


class _Brow:
    """One of them, with the points of the lid below it from left to right."""

    def __init__(self, reference: ReferenceFrame, brow: Group, lid: Group, factor: int) -> None:
        points, width = reference.points, reference.resolution
        fade = LIMITS.fade * width
        left, right = int(points[brow, 0].min() - fade), int(points[brow, 0].max() + fade + 1)
        top, bottom = int(points[brow, 1].min()), int(points[lid, 1].max() + 1)
        self._factor = factor
        self._place = np.s_[top * factor : bottom * factor, left * factor : right * factor]
        ys, xs = np.mgrid[top:bottom, left:right]
        x = xs[0].astype(np.float64)
        beyond = np.maximum(points[brow, 0].min() - x, x - points[brow, 0].max())
        self._shown = np.asarray(1 - np.clip(beyond / fade, 0, 1), np.float32)
        line, lids = (interpolation(x, points[group, 0]) @ points[group, 1] for group in (brow, lid))
        self._line, self._gap = (np.asarray(values, np.float32) for values in (line, lids - line))
        self._end = np.minimum(LIMITS.thickness * width / self._gap, LIMITS.lowest)
        self._heights = np.asarray((ys - self._line) / self._gap, np.float32)
        places = [np.column_stack([xs.ravel(), ys.ravel()]), *(np.column_stack([x, y]) for y in (line, lids))]
        self._samplers = [MeshSampler.build(reference, np.asarray(each, np.float64)) for each in places]
        self._columns = np.mgrid[self._place][1].astype(np.float32)

    def keep(self, picture: U8, drawn: F64, at_rest: F64) -> None:
        moved, on_line, on_lid = (s.positions(drawn - at_rest)[:, 1] for s in self._samplers)
        gap = (self._samplers[2].positions(at_rest) - self._samplers[1].positions(at_rest))[:, 1]
        gap = np.maximum(gap, np.float32(LIMITS.least))
        stretch = (on_lid - on_line) / gap
        if np.abs(stretch).max() < LIMITS.unchanged:
            return
        limited = np.clip(stretch, LIMITS.stretch[0] - 1, LIMITS.stretch[1] - 1)
        share = self._shown * limited / np.where(stretch == 0, 1, stretch)
        lower = (moved.reshape(self._heights.shape) - on_line) / gap * share  # than on the face at rest
        read = self._read_at(self._heights + lower, 1 + self._shown * limited)
        rows = (self._line + self._gap * read + np.float32(0.5)) * self._factor - np.float32(0.5)
        if self._factor > 1:
            rows = np.asarray(cv2.resize(rows, self._columns.shape[::-1]), np.float32)
        picture[self._place] = cv2.remap(
            picture, self._columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )

    def _read_at(self, heights: F32, lid: F32) -> F32:
        """(h, w) heights at which the texture is read: 0 at the brow's points and 1 at the lid.

        heights : (h, w) at which they are drawn, by the distance at rest.   lid : (w,) likewise, of the lid.
        """
        end = np.minimum(self._end, LIMITS.lowest * lid)
        below = self._end + (heights - end) * ((1 - self._end) / (lid - end))
        read = np.where(heights < end, heights * (self._end / end), below)
        inside = (self._heights > 0) & (self._heights < 1)
        return np.asarray(np.where(inside, read, self._heights), np.float32)
