"""Covering a face: a region that hides it, drawn in the frame's own planes.

The region is the head's (`guise.aam.landmarks.heads`) with rounded corners.  "solid" leaves nothing of it; "mosaic" and
"blur" leave the mean colours of a few cells, too few to show a face; a picture lies on "solid".  Pixels as shown.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from guise.app.media import Frame
from guise.app.media.images import read_deep
from guise.common.arrays import F64, U8
from guise.common.tuned import derived, tuned

CoverStyle = Literal["solid", "mosaic", "blur"]
STYLES: tuple[CoverStyle, ...] = ("solid", "mosaic", "blur")

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
EMOJI, IMAGE_PREFIX = "emoji", "image:"
STRENGTHS = range(1, COVER.cells)  # each leaves one cell fewer, down to two


@dataclass(frozen=True, eq=False)
class Covering:
    """How faces are covered.

    Parameters
    ----------
    style : what all of the region shows.   cells : across it, of "mosaic" and "blur".
    picture : (h, w, 4) RGBA uint8, shown in the middle, as large as fits; or None.
    """

    style: CoverStyle = "solid"
    cells: int = COVER.cells
    picture: U8 | None = None

    @classmethod
    def of(cls, name: str, strength: int = 1) -> Covering:
        """A covering that a user names: a style, "emoji", or "image:FILE".

        strength : one of STRENGTHS.   Raises ValueError for another name, MediaError for a file that can't be read.
        """
        for style in STYLES:
            if name == style:
                return cls(style, COVER.cells + 1 - strength)
        if name == EMOJI:
            return cls(picture=smiley())
        if not name.startswith(IMAGE_PREFIX) or name == IMAGE_PREFIX:
            raise ValueError(f"it must be one of {', '.join(STYLES)}, {EMOJI} and {IMAGE_PREFIX}FILE")
        image = read_deep(Path(name.removeprefix(IMAGE_PREFIX)))
        rgb = image.rgb8()
        alpha = np.full(rgb.shape[:2], OPAQUE, np.uint8)
        if image.alpha is not None:
            alpha = np.asarray(image.alpha >> 8 if image.alpha.dtype == np.uint16 else image.alpha, np.uint8)
        return cls(picture=np.dstack([rgb, alpha]))


def smiley() -> U8:
    """A drawing (h, w, 4) of a smiling face, RGBA; the same for everybody."""
    side = 512
    picture = np.zeros((side, side, 4), np.uint8)
    face, ink = (255, 205, 60, OPAQUE), (60, 40, 20, OPAQUE)
    at = side // 16
    cv2.circle(picture, (8 * at, 8 * at), 7 * at, face, -1, cv2.LINE_AA)
    for x in (6, 10):
        cv2.ellipse(picture, (x * at, 6 * at), (at // 2, at), 0, 0, 360, ink, -1, cv2.LINE_AA)
    cv2.ellipse(picture, (8 * at, 8 * at), (4 * at, 4 * at), 0, 20, 160, ink, at // 2, cv2.LINE_AA)
    return picture


def cover(
    frame: Frame, rectangle: F64, covering: CoverStyle | Covering, opacity: float = 1.0
) -> tuple[int, int, int, int] | None:
    """Cover a region in place; returns the rectangle changed, x0 y0 x1 y1, or None when none is in the picture.

    opacity : in [0, 1]; less than 1 lets the region show through.
    """
    x0, y0, w, h = frame.align_roi(*(rectangle[:2] - 1), *(rectangle[2:] + 2))
    if w < 2 or h < 2:
        return None
    roi = frame.read_roi(x0, y0, w, h)
    covering = covering if isinstance(covering, Covering) else Covering(covering)
    hidden = _filling(frame, roi, covering)
    if covering.picture is not None:
        hidden = _with_picture(frame, hidden, covering.picture, rectangle - (x0, y0, x0, y0))
    shape = _coverage(rectangle - (x0, y0, x0, y0), (h, w))
    if opacity < 1:
        shape = np.round(shape * opacity).astype(np.uint8)
    rim = np.flatnonzero((shape > 0) & (shape < OPAQUE))
    before, after = (picture.reshape(-1, 3)[rim].astype(np.float32) for picture in (roi, hidden))
    alpha = shape.ravel()[rim, None].astype(np.float32) / np.float32(OPAQUE)
    cv2.copyTo(hidden, shape, roi)  # wherever it covers at all, as most of it is opaque
    roi.reshape(-1, 3)[rim] = np.round(before + alpha * (after - before))
    frame.write_roi(x0, y0, roi, shape)
    return x0, y0, x0 + w, y0 + h


def cover_all(frame: Frame, style: CoverStyle) -> None:
    """Cover the whole picture in place."""
    roi = frame.read_roi(0, 0, frame.width, frame.height)
    frame.write_roi(
        0, 0, np.ascontiguousarray(_filling(frame, roi, Covering(style))), np.ones(roi.shape[:2], np.uint8)
    )


def _filling(frame: Frame, roi: U8, covering: Covering) -> U8:
    """What is shown instead (h, w, 3), in stored components."""
    if covering.style == "solid":
        matrix = frame.colour.from_rgb
        grey = matrix[:, :3].sum(1) * COVER.grey_level + matrix[:, 3]
        row = np.tile(np.round(grey).astype(np.uint8), (1, roi.shape[1], 1))
        return np.repeat(row, roi.shape[0], axis=0)  # whole rows are copied many times faster than pixels
    h, w = roi.shape[:2]
    cells = [max(1, round(covering.cells * side / max(w, h))) for side in (w, h)]
    few = cv2.resize(roi, cells, interpolation=cv2.INTER_AREA)
    how = cv2.INTER_NEAREST if covering.style == "mosaic" else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(few, (w, h), interpolation=how), np.uint8)


def _with_picture(frame: Frame, filling: U8, picture: U8, rectangle: F64) -> U8:
    """A filling (h, w, 3) with a picture (.., .., 4) in the middle of a rectangle (4,), as large as fits."""
    height, width = picture.shape[:2]
    scale = float(((rectangle[2:] - rectangle[:2]) / (width, height)).min())
    corner = (rectangle[:2] + rectangle[2:] - scale * np.array([width, height])) / 2
    size = [max(1, round(scale * side)) for side in (width, height)]
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    place = np.array([[1, 0, corner[0]], [0, 1, corner[1]]])
    shown = cv2.warpAffine(small, place, filling.shape[1::-1], flags=cv2.INTER_LINEAR).astype(np.float32)
    matrix, alpha = frame.colour.from_rgb, shown[..., 3:] / np.float32(OPAQUE)
    stored = shown[..., :3] @ matrix[:, :3].T + matrix[:, 3]
    return np.asarray(np.clip(np.round(filling + alpha * (stored - filling)), 0, OPAQUE), np.uint8)


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
