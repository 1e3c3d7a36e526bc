"""Small pictures for people: labels, contact sheets.  RGB uint8 (h, w, 3)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.media.images import encode_image
from guise.common.files import write_whole

Picture = NDArray[np.uint8]

GAP = 6  # pixels between pictures
PAPER = 24  # grey of the background
INK = (235, 235, 235)
LABEL = 22  # pixels, height of a caption


def labelled(picture: Picture, text: str) -> Picture:
    """The picture with a caption under it."""
    strip = np.full((LABEL, picture.shape[1], 3), PAPER, np.uint8)
    scale = 0.45
    width = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)[0][0]
    scale *= min(1.0, (picture.shape[1] - 4) / max(width, 1))
    cv2.putText(strip, text, (2, LABEL - 7), cv2.FONT_HERSHEY_SIMPLEX, scale, INK, 1, cv2.LINE_AA)
    return np.concatenate([picture, strip])


def sheet(rows: Sequence[Sequence[Picture]]) -> Picture:
    """Rows of pictures on dark paper; each row's pictures have one height."""
    strips = [_row(row) for row in rows]
    width = max(strip.shape[1] for strip in strips)
    padded = [_on_paper(strip, strip.shape[0] + GAP, width) for strip in strips]
    return np.concatenate(padded)


def save_picture(path: Path, picture: Picture) -> None:
    """Write an image file; it appears only when it is complete."""
    data = encode_image(picture, None, path.suffix, {})
    write_whole(path, data)


def _row(pictures: Sequence[Picture]) -> Picture:
    return np.concatenate([_on_paper(p, p.shape[0], p.shape[1] + GAP) for p in pictures], axis=1)


def _on_paper(picture: Picture, height: int, width: int) -> Picture:
    paper = np.full((height, width, 3), PAPER, np.uint8)
    paper[: picture.shape[0], : picture.shape[1]] = picture
    return paper
