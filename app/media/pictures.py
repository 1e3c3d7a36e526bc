"""Pictures made smaller, fitted into frames, with captions, and on contact sheets.  RGB uint8 (h, w, 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from guise.app.media.image_writing import encode_image
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


def shrunk(picture: Picture, scale: float) -> Picture:
    """A copy of a picture at a scale, which is best not above 1."""
    size = [max(1, round(side * scale)) for side in picture.shape[1::-1]]
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def letterboxed(rgb: Picture, width: int, height: int, background: int = 0) -> Picture:
    """A picture as (height, width, 3) with its aspect ratio kept: whole, as large as possible, on a grey level.

    >>> letterboxed(np.full((10, 10, 3), 255, np.uint8), 20, 10)[0, :, 0].tolist() == [0] * 5 + [255] * 10 + [0] * 5
    True
    """
    h, w = rgb.shape[:2]
    if (w, h) == (width, height):
        return rgb
    scale = min(width / w, height / h)
    size = max(round(w * scale), 1), max(round(h * scale), 1)
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    whole = np.full((height, width, 3), background, np.uint8)
    whole[top : top + size[1], left : left + size[0]] = cv2.resize(rgb, size, interpolation=method)
    return whole


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
