"""The visible label: a small text in the lower left corner that says that the faces are synthetic.

Pixels, x right, y down; it is blended into the frame's stored components, so that nothing outside it changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.media import Frame

LABEL_TEXT = "Synthetic faces (Guise)"
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_CAPITAL_PIXELS = 22  # height of the font's capitals at scale 1


@dataclass(frozen=True)
class LabelStyle:
    """How the label looks."""

    letter_share: float = 1 / 30  # height of the letters, of the picture's shorter side
    min_letter_pixels: float = 8  # below which no text can be read
    background_opacity: float = 0.6


STYLE = LabelStyle()


class Label:
    """The text for pictures of one size, made once.   width, height : of the pictures as shown, pixels."""

    def __init__(self, width: int, height: int) -> None:
        ink = _ink(max(min(width, height) * STYLE.letter_share, STYLE.min_letter_pixels), width)
        self._grey = 255 * ink
        self._cover = np.maximum(ink, STYLE.background_opacity)
        tall, wide = ink.shape
        margin = min(tall // 3, max(0, width - wide), max(0, height - tall))
        self._corner = (margin, max(0, height - tall - margin))

    def draw(self, frame: Frame) -> None:
        """Blend the text into a frame, in place."""
        (left, top), (tall, wide) = self._corner, self._cover.shape
        x0, y0, w, h = frame.align_roi(left, top, left + wide, top + tall)
        spot = np.s_[top - y0 : top - y0 + tall, left - x0 : left - x0 + wide]
        stored = frame.read_roi(x0, y0, w, h)
        here = stored[spot]
        cover, grey = (part[: here.shape[0], : here.shape[1], None] for part in (self._cover, self._grey))
        text = np.asarray(cv2.transform(np.repeat(grey, 3, axis=2), frame.colour.from_rgb))
        here[:] = np.rint(here * (1 - cover) + text * cover).clip(0, 255)
        frame.write_roi(x0, y0, stored)


def _ink(letters: float, widest: int) -> NDArray[np.float32]:
    """The text with a border, (h, w) in [0, 1].   letters : their height, pixels, less where `widest` needs it."""
    (wide, _), _ = cv2.getTextSize(LABEL_TEXT, _FONT, 1.0, 1)
    scale = min(letters / _CAPITAL_PIXELS, widest / (wide + 2 * _CAPITAL_PIXELS))
    weight = max(1, round(scale * 2))
    (wide, high), under = cv2.getTextSize(LABEL_TEXT, _FONT, scale, weight)
    border = max(2, round(letters / 2))
    ink = np.zeros((high + under + 2 * border, wide + 2 * border), np.uint8)
    cv2.putText(ink, LABEL_TEXT, (border, border + high), _FONT, scale, 255, weight, cv2.LINE_AA)
    return np.asarray(ink[:, :widest] / np.float32(255), np.float32)
