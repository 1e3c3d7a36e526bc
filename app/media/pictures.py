"""Captions and contact sheets.  RGB uint8 (h, w, 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from guise.app.media.images import encode_image
from guise.common.arrays import U8
from guise.common.files import write_whole

Picture = U8


@dataclass(frozen=True)
class SheetStyle:
    """How captions and contact sheets look."""

    gap_pixels: int = 6  # between pictures
    background: int = 24  # grey level
    text_colour: tuple[int, int, int] = (235, 235, 235)
    caption_pixels: int = 22  # height


SHEET = SheetStyle()


def labelled(picture: Picture, text: str) -> Picture:
    """The picture with a caption under it."""
    strip = np.full((SHEET.caption_pixels, picture.shape[1], 3), SHEET.background, np.uint8)
    scale = 0.45
    width = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)[0][0]
    scale *= min(1.0, (picture.shape[1] - 4) / max(width, 1))
    cv2.putText(
        strip,
        text,
        (2, SHEET.caption_pixels - 7),
        cv2.FONT_HERSHEY_SIMPLEX,
        scale,
        SHEET.text_colour,
        1,
        cv2.LINE_AA,
    )
    return np.concatenate([picture, strip])


def sheet(rows: Sequence[Sequence[Picture]]) -> Picture:
    """A contact sheet of rows of pictures; those of a row have the same height."""
    strips = [_row(row) for row in rows]
    width = max(strip.shape[1] for strip in strips)
    padded = [_padded(strip, strip.shape[0] + SHEET.gap_pixels, width) for strip in strips]
    return np.concatenate(padded)


def save_picture(path: Path, picture: Picture) -> None:
    """Write an image file; it appears only when it is complete."""
    data = encode_image(picture, None, path.suffix, {})
    write_whole(path, data)


def _row(pictures: Sequence[Picture]) -> Picture:
    return np.concatenate([_padded(p, p.shape[0], p.shape[1] + SHEET.gap_pixels) for p in pictures], axis=1)


def _padded(picture: Picture, height: int, width: int) -> Picture:
    canvas = np.full((height, width, 3), SHEET.background, np.uint8)
    canvas[: picture.shape[0], : picture.shape[1]] = picture
    return canvas
