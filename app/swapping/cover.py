"""Covering a face: a region that hides it, drawn in the frame's own planes.

The region is a rounded rectangle around the box of the 68 iBUG points that includes forehead, ears and chin of a face
at any roll.  "solid"
leaves nothing of it; "mosaic" and "blur" leave the mean colours of a few cells, too few to show a face.  Pixels as
shown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from guise.aam.landmarks.rolls import upward
from guise.app.media import Frame
from guise.common.arrays import F64, U8, Floating

CoverStyle = Literal["solid", "mosaic", "blur"]

OPAQUE = 255
_OUTWARD = np.array([[-1, 0], [0, -1], [1, 0], [0, 1]])


@dataclass(frozen=True)
class CoverShape:
    """Size, form and filling of the covered region."""

    side_box_widths: float = 0.30  # by which the region is larger than the box on either side
    above_box_heights: float = 0.60
    below_box_heights: float = 0.25
    superellipse_power: float = 4.0
    corners: int = 64  # of the polygon that is drawn
    cells: int = 6  # across the region, of "mosaic" and "blur"
    grey_level: float = 112.0  # of "solid"


COVER = CoverShape()


def region(box: Floating, growth: float = 1.0, turn: float = 0.0) -> F64:
    """The rectangle (4,) x0 y0 x1 y1 that is covered for a face's box (4,).

    turn : radians, by which the face is rolled clockwise.

    >>> region(np.array([0, 0, 100, 100])).round(0).tolist()
    [-30.0, -60.0, 130.0, 125.0]
    >>> region(np.array([0, 0, 100, 100]), turn=np.pi).round(0).tolist()
    [-30.0, -25.0, 130.0, 160.0]
    """
    x0, y0, x1, y1 = (float(v) for v in box)
    along, across = np.cos(turn) ** 2, np.sin(turn) ** 2
    width, height = (x1 - x0) * along + (y1 - y0) * across, (x1 - x0) * across + (y1 - y0) * along
    rises = _OUTWARD @ upward(turn)  # of the left, upper, right and lower edge, towards the forehead
    beyond = np.where(rises > 0, COVER.above_box_heights, COVER.below_box_heights) * height
    margins = rises**2 * beyond + (1 - rises**2) * COVER.side_box_widths * width
    grown = np.array([x0, y0, x1, y1]) + margins * (-1, -1, 1, 1)
    centre, half = (grown[:2] + grown[2:]) / 2, growth * (grown[2:] - grown[:2]) / 2
    return np.concatenate([centre - half, centre + half])


def cover(frame: Frame, rectangle: F64, style: CoverStyle) -> tuple[int, int, int, int] | None:
    """Cover a region in place; returns the rectangle changed, x0 y0 x1 y1, or None when none is in the picture."""
    x0, y0, w, h = frame.align_roi(*(rectangle[:2] - 1), *(rectangle[2:] + 2))
    if w < 2 or h < 2:
        return None
    roi = frame.read_roi(x0, y0, w, h)
    hidden = _filling(frame, roi, style)
    shape = _coverage(rectangle - (x0, y0, x0, y0), (h, w))
    rim = (shape > 0) & (shape < OPAQUE)
    alpha = shape[rim][:, None].astype(np.float32) / np.float32(OPAQUE)
    softened = np.round(roi[rim] + alpha * (hidden[rim].astype(np.float32) - roi[rim]))
    cv2.copyTo(hidden, shape, roi)  # wherever it covers at all, as most of it is opaque
    roi[rim] = softened
    frame.write_roi(x0, y0, roi)
    return x0, y0, x0 + w, y0 + h


def cover_all(frame: Frame, style: CoverStyle) -> None:
    """Cover the whole picture in place."""
    roi = frame.read_roi(0, 0, frame.width, frame.height)
    frame.write_roi(0, 0, np.ascontiguousarray(_filling(frame, roi, style)))


def _filling(frame: Frame, roi: U8, style: CoverStyle) -> U8:
    """What is shown instead (h, w, 3), in stored components."""
    if style == "solid":
        matrix = frame.colour.from_rgb
        grey = matrix[:, :3].sum(1) * COVER.grey_level + matrix[:, 3]
        return np.broadcast_to(np.round(grey).astype(np.uint8), roi.shape)
    h, w = roi.shape[:2]
    cells = [max(1, round(COVER.cells * side / max(w, h))) for side in (w, h)]
    few = cv2.resize(roi, cells, interpolation=cv2.INTER_AREA)
    how = cv2.INTER_NEAREST if style == "mosaic" else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(few, (w, h), interpolation=how), np.uint8)


def _coverage(rectangle: F64, size: tuple[int, int]) -> U8:
    """Coverage (h, w) up to OPAQUE of the superellipse in a rectangle, in its pixels."""
    turn = np.linspace(0, 2 * np.pi, COVER.corners, endpoint=False)
    unit = np.column_stack([np.cos(turn), np.sin(turn)])
    unit = np.sign(unit) * np.abs(unit) ** (2 / COVER.superellipse_power)
    centre, half = (rectangle[:2] + rectangle[2:]) / 2, (rectangle[2:] - rectangle[:2]) / 2
    points = np.round((centre + half * unit) * 16).astype(np.int32)
    alpha = np.zeros(size, np.uint8)
    cv2.fillPoly(alpha, [points], OPAQUE, lineType=cv2.LINE_AA, shift=4)
    return alpha
