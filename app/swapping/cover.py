"""Covering a face: a region that hides it, drawn in the frame's own planes.

The region is the head's (`guise.aam.landmarks.heads`) with rounded corners.  "solid" leaves nothing of it; "mosaic" and
"blur" leave the mean colours of a few cells, too few to show a face.  Pixels as shown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from guise.app.media import Frame
from guise.common.arrays import F64, U8
from guise.common.tuned import derived, tuned

CoverStyle = Literal["solid", "mosaic", "blur"]

OPAQUE = derived(255, "levels", "the most that a byte holds")


@dataclass(frozen=True)
class CoverShape:
    """Form and filling of the covered region."""

    superellipse_power: float = tuned(4.0, "", "deidentify.leaks")
    # of the polygon that is drawn
    corners: int = derived(64, "", "its sides leave the curve by 0.06 % of the region's size")
    cells: int = tuned(6, "", "deidentify.identity")  # across the region, of "mosaic" and "blur"
    grey_level: float = derived(112.0, "levels of luma", "a choice: a plain grey")  # of "solid"


COVER = CoverShape()


def cover(
    frame: Frame, rectangle: F64, style: CoverStyle, opacity: float = 1.0
) -> tuple[int, int, int, int] | None:
    """Cover a region in place; returns the rectangle changed, x0 y0 x1 y1, or None when none is in the picture.

    opacity : in [0, 1]; less than 1 lets the region show through.
    """
    x0, y0, w, h = frame.align_roi(*(rectangle[:2] - 1), *(rectangle[2:] + 2))
    if w < 2 or h < 2:
        return None
    roi = frame.read_roi(x0, y0, w, h)
    hidden = _filling(frame, roi, style)
    shape = _coverage(rectangle - (x0, y0, x0, y0), (h, w))
    if opacity < 1:
        shape = np.round(shape * opacity).astype(np.uint8)
    rim = (shape > 0) & (shape < OPAQUE)
    alpha = shape[rim][:, None].astype(np.float32) / np.float32(OPAQUE)
    softened = np.round(roi[rim] + alpha * (hidden[rim].astype(np.float32) - roi[rim]))
    cv2.copyTo(hidden, shape, roi)  # wherever it covers at all, as most of it is opaque
    roi[rim] = softened
    frame.write_roi(x0, y0, roi, shape)
    return x0, y0, x0 + w, y0 + h


def cover_all(frame: Frame, style: CoverStyle) -> None:
    """Cover the whole picture in place."""
    roi = frame.read_roi(0, 0, frame.width, frame.height)
    frame.write_roi(0, 0, np.ascontiguousarray(_filling(frame, roi, style)), np.ones(roi.shape[:2], np.uint8))


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
