"""The sheet of pictures that a person reads beside NAME.tracks.json: a card for each track.  RGB uint8 (h, w, 3).

It shows faces of the input, and says so: it is for the one who reviews, not to be shared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.report.report import clock
from guise.app.deidentify.tracks import Track
from guise.app.media.pictures import PAPER, Picture

WIDTH, HEIGHT = 1020, 124  # pixels of a card
GAP = 10  # between cards, and inside of them
THUMB = HEIGHT - 2 * GAP
THUMBS = 6
CURVE = 34  # pixels, height of the curve of confidence
TALLEST = 16  # cards in a column, until there are WIDEST columns
WIDEST = 3
MOST = 240  # cards; beyond, the tracks that are seen longest
CARD, RULE, DIM, INK = (38,) * 3, (70,) * 3, (165,) * 3, (240,) * 3
COLOURS = {"swap": (86, 180, 233), "cover": (230, 159, 0), "leave": (230, 110, 170)}
WORDS = {"swap": "swap", "cover": "cover", "leave": "leave as it is"}
NOTE = "Faces of the input, for your review only: do not share this picture."


def contact_sheet(
    thumbnails: Mapping[int, Sequence[Picture]], tracks: Sequence[Track], seconds: NDArray[np.float64]
) -> Picture:
    """A card for each track: number, person, time, what is proposed and why, confidence over time, pictures.

    thumbnails : of each track, in the order of time.   seconds : (frames,) time of each frame.
    At most about 3100 x 11,000 pixels.
    """
    shown = sorted(sorted(tracks, key=lambda t: -t.seen)[:MOST], key=lambda t: t.number)
    cards = [_card(track, thumbnails.get(track.number, ()), seconds) for track in shown]
    columns = min(WIDEST, -(-len(cards) // TALLEST)) or 1
    rows = -(-len(cards) // columns)
    height, width = rows * (HEIGHT + GAP) + 5 * GAP, columns * (WIDTH + GAP) + GAP
    paper = np.full((height, width, 3), PAPER, np.uint8)
    _write(paper, _title(len(tracks), len(shown)), (GAP, 28), 17, INK)
    for place, card in enumerate(cards):
        column, row = divmod(place, rows)
        x, y = GAP + column * (WIDTH + GAP), 4 * GAP + row * (HEIGHT + GAP)
        paper[y : y + HEIGHT, x : x + WIDTH] = card
    return paper


def _title(tracks: int, shown: int) -> str:
    count = f"{tracks} track{'' if tracks == 1 else 's'}"
    return f"{count}{f', the {shown} seen longest' if shown < tracks else ''}.  {NOTE}"


def _card(track: Track, thumbnails: Sequence[Picture], seconds: NDArray[np.float64]) -> Picture:
    card = np.full((HEIGHT, WIDTH, 3), CARD, np.uint8)
    colour = COLOURS[track.action]
    card[:, :6] = colour
    words = WIDTH - THUMBS * (THUMB + GAP) - 3 * GAP
    text = card[:, : GAP + words]
    end = _write(text, f"Track {track.number}", (2 * GAP, 28), 20, INK, weight=600)
    end = _write(
        text, f"person {track.person}" + (f", {track.name}" if track.name else ""), (end + 12, 28), 15, DIM
    )
    end = _write(text, WORDS[track.action], (2 * GAP, 49), 15, colour, weight=600)
    _write(text, track.reason, (end + 8, 49), 13, INK)
    _write(text, _when(track, seconds), (2 * GAP, 68), 13, DIM)
    _curve(card[-GAP - CURVE : -GAP, 2 * GAP : GAP + words], track.confidence, colour)
    for place, picture in enumerate(thumbnails[:THUMBS]):
        x = 2 * GAP + words + place * (THUMB + GAP)
        card[GAP : GAP + THUMB, x : x + THUMB] = _square(picture)
    return card


def _when(track: Track, seconds: NDArray[np.float64]) -> str:
    first, last = (clock(float(seconds[frame])) for frame in (track.first, track.last))
    return f"{first} to {last}, {track.seen} frames, {track.width:.0f} pixels wide"


def _curve(area: Picture, confidence: Sequence[float], colour: tuple[int, int, int]) -> None:
    """Draw values in [0, 1] over the width of a view (h, w, 3)."""
    area[:] = PAPER
    h, w = area.shape[:2]
    values = np.asarray(confidence)[np.arange(w) * len(confidence) // w]
    filled = np.arange(h)[::-1, None] < np.round(values * h)[None]
    area[filled] = np.array(colour) // 2
    area[h // 2] = RULE
    tops = np.clip(h - np.round(values * h), 0, h - 1).astype(int)
    line = np.column_stack([np.arange(w), tops]).astype(np.int32)
    cv2.polylines(area, [line], False, colour, 1, cv2.LINE_AA)


def _square(picture: Picture) -> Picture:
    """A picture fitted into a square of THUMB pixels, on paper."""
    scale = THUMB / max(picture.shape[:2])
    h, w = (max(1, round(side * scale)) for side in picture.shape[:2])
    square = np.full((THUMB, THUMB, 3), PAPER, np.uint8)
    y, x = (THUMB - h) // 2, (THUMB - w) // 2
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    square[y : y + h, x : x + w] = cv2.resize(picture, (w, h), interpolation=how)
    return square


def _write(
    area: Picture, text: str, at: tuple[int, int], size: int, ink: tuple[int, ...], weight: int = 400
) -> int:
    """Write on a view (h, w, 3), cut off at its right edge; returns where it ends."""
    font = cv2.FontFace("sans")
    room, line = area.shape[1] - at[0], (1 << 15, 2 * size)
    while text and cv2.getTextSize(line, text, (0, 0), font, size, weight)[2] > room:
        text = text.rstrip("…")[:-1] + "…" if len(text) > 1 else ""
    strip = np.ascontiguousarray(area)
    end, _ = cv2.putText(strip, text, at, ink, font, size, weight)
    area[:] = strip
    return int(end[0])
