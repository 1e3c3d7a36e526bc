"""The contact sheet beside NAME.tracks.json, for the reviewer: a card for each track, and each cover of what has none.

RGB uint8 (h, w, 3).

It shows faces of the input, and says so: it is for the reviewer and must not be shared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.covers import CoverSpan
from guise.app.deidentify.report.report import clock
from guise.app.deidentify.tracks import Track
from guise.app.media.pictures import SHEET, Picture, letterboxed


@dataclass(frozen=True)
class SheetLayout:
    """Sizes, in pixels, and numbers of cards."""

    card_width: int = 1020
    card_height: int = 124
    gap: int = 10  # between cards, and inside them
    curve_height: int = 34  # of the confidence
    thumbnails: int = 6  # of a card
    column_cards: int = 16  # of a column, until there are so many columns:
    max_columns: int = 3
    max_cards: int = 240  # those of the tracks that are seen longest

    @property
    def thumbnail(self) -> int:
        """Side of a thumbnail."""
        return self.card_height - 2 * self.gap


LAYOUT = SheetLayout()
ACTION_COLOURS = {"swap": (86, 180, 233), "cover": (230, 159, 0), "leave": (230, 110, 170)}
_CARD, _RULE, _DIM, _INK = (38,) * 3, (70,) * 3, (165,) * 3, (240,) * 3
_ACTION_LABELS = {"swap": "swap", "cover": "cover", "leave": "leave as it is"}
_NOTE = "Faces of the input, for your review only: do not share this picture."


def contact_sheet(
    thumbnails: Mapping[int, Sequence[Picture]], tracks: Sequence[Track], seconds: NDArray[np.float64],
    covers: Mapping[CoverSpan, Picture] = MappingProxyType({}),
) -> Picture:  # fmt: skip
    """A card for each track: number, person, time, proposed action and reason, confidence over time, pictures.

    thumbnails : of each track, in the order of time.   seconds : (frames,) time of each frame.
    covers : of faces without a track, with a picture of each; as many as there is room for.
    At most about 3100 x 11,000 pixels.
    """
    shown = sorted(sorted(tracks, key=lambda t: -t.seen)[: LAYOUT.max_cards], key=lambda t: t.number)
    cards = [_card(track, thumbnails.get(track.number, ()), seconds) for track in shown]
    cards += [_cover_card(cover, picture, seconds) for cover, picture in covers.items()]
    cards = cards[: LAYOUT.max_cards]
    columns = min(LAYOUT.max_columns, -(-len(cards) // LAYOUT.column_cards)) or 1
    rows = -(-len(cards) // columns)
    height, width = (
        rows * (LAYOUT.card_height + LAYOUT.gap) + 5 * LAYOUT.gap,
        columns * (LAYOUT.card_width + LAYOUT.gap) + LAYOUT.gap,
    )
    paper = np.full((height, width, 3), SHEET.background, np.uint8)
    _write(paper, _title(len(tracks), len(shown)), (LAYOUT.gap, 28), 17, _INK)
    for place, card in enumerate(cards):
        column, row = divmod(place, rows)
        x, y = (
            LAYOUT.gap + column * (LAYOUT.card_width + LAYOUT.gap),
            4 * LAYOUT.gap + row * (LAYOUT.card_height + LAYOUT.gap),
        )
        paper[y : y + LAYOUT.card_height, x : x + LAYOUT.card_width] = card
    return paper


def _title(tracks: int, shown: int) -> str:
    count = f"{tracks} track{'' if tracks == 1 else 's'}"
    return f"{count}{f', the {shown} seen longest' if shown < tracks else ''}.  {_NOTE}"


def _card(track: Track, thumbnails: Sequence[Picture], seconds: NDArray[np.float64]) -> Picture:
    card = np.full((LAYOUT.card_height, LAYOUT.card_width, 3), _CARD, np.uint8)
    colour = ACTION_COLOURS[track.action]
    card[:, :6] = colour
    words = LAYOUT.card_width - LAYOUT.thumbnails * (LAYOUT.thumbnail + LAYOUT.gap) - 3 * LAYOUT.gap
    text = card[:, : LAYOUT.gap + words]
    end = _write(text, f"Track {track.number}", (2 * LAYOUT.gap, 28), 20, _INK, weight=600)
    end = _write(
        text, f"person {track.person}" + (f", {track.name}" if track.name else ""), (end + 12, 28), 15, _DIM
    )
    end = _write(text, _ACTION_LABELS[track.action], (2 * LAYOUT.gap, 49), 15, colour, weight=600)
    _write(text, track.reason, (end + 8, 49), 13, _INK)
    _write(text, _when(track, seconds), (2 * LAYOUT.gap, 68), 13, _DIM)
    _curve(
        card[-LAYOUT.gap - LAYOUT.curve_height : -LAYOUT.gap, 2 * LAYOUT.gap : LAYOUT.gap + words],
        track.confidence,
        colour,
    )
    top, side = LAYOUT.gap, LAYOUT.thumbnail
    for place, picture in enumerate(thumbnails[: LAYOUT.thumbnails]):
        x = 2 * LAYOUT.gap + words + place * (side + LAYOUT.gap)
        card[top : top + side, x : x + side] = letterboxed(picture, side, side, SHEET.background)
    return card


def _cover_card(cover: CoverSpan, picture: Picture, seconds: NDArray[np.float64]) -> Picture:
    card = np.full((LAYOUT.card_height, LAYOUT.card_width, 3), _CARD, np.uint8)
    card[:, :6] = colour = ACTION_COLOURS["cover"]
    side = LAYOUT.thumbnail
    text = card[:, : -side - 2 * LAYOUT.gap]
    _write(text, f"Cover {cover.number}", (2 * LAYOUT.gap, 28), 20, _INK, weight=600)
    end = _write(text, _ACTION_LABELS["cover"], (2 * LAYOUT.gap, 49), 15, colour, weight=600)
    _write(text, cover.reason, (end + 8, 49), 13, _INK)
    first, last = (clock(float(seconds[frame])) for frame in (cover.first, cover.last))
    _write(text, f"{first} to {last}", (2 * LAYOUT.gap, 68), 13, _DIM)
    card[LAYOUT.gap : LAYOUT.gap + side, -LAYOUT.gap - side : -LAYOUT.gap] = letterboxed(
        picture, side, side, SHEET.background
    )
    return card


def _when(track: Track, seconds: NDArray[np.float64]) -> str:
    first, last = (clock(float(seconds[frame])) for frame in (track.first, track.last))
    return f"{first} to {last}, {track.seen} frames, {track.width:.0f} pixels wide"


def _curve(area: Picture, confidence: Sequence[float], colour: tuple[int, int, int]) -> None:
    """Draw values in [0, 1] over the width of a view (h, w, 3)."""
    area[:] = SHEET.background
    h, w = area.shape[:2]
    values = np.asarray(confidence)[np.arange(w) * len(confidence) // w]
    filled = np.arange(h)[::-1, None] < np.round(values * h)[None]
    area[filled] = np.array(colour) // 2
    area[h // 2] = _RULE
    tops = np.clip(h - np.round(values * h), 0, h - 1).astype(int)
    line = np.column_stack([np.arange(w), tops]).astype(np.int32)
    cv2.polylines(area, [line], False, colour, 1, cv2.LINE_AA)


def _write(
    area: Picture, text: str, at: tuple[int, int], size: int, ink: tuple[int, ...], weight: int = 400
) -> int:
    """Write on a view (h, w, 3), cut off at its right edge; returns the x where it ends."""
    font = cv2.FontFace("sans")
    room, line = area.shape[1] - at[0], (1 << 15, 2 * size)
    while text and cv2.getTextSize(line, text, (0, 0), font, size, weight)[2] > room:
        text = text.rstrip("…")[:-1] + "…" if len(text) > 1 else ""
    strip = np.ascontiguousarray(area)
    end, _ = cv2.putText(strip, text, at, ink, font, size, weight)
    area[:] = strip
    return int(end[0])
