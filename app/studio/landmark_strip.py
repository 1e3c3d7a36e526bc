"""The frames of a clip on the page Landmarks, and the strip with small ones and what is known of their points."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from nicegui import ui
from numpy.typing import NDArray

from guise.aam.landmarks import LandmarkError
from guise.app.media import Frame, frames_at
from guise.app.media.segments import read_frames, scan
from guise.app.studio.landmark_correction import CORRECTED, DETECTED, PROPAGATED, Correction
from guise.app.studio.landmark_view import FrameView
from guise.app.studio.pictures import data_url
from guise.common.arrays import F32, U8


@dataclass(frozen=True)
class StripSettings:
    """How many frames the strip shows."""

    spread: int = 20  # evenly over the clip
    doubtful: int = 20  # of the most doubtful frames


SETTINGS = StripSettings()

THUMBNAIL_PIXELS = 72  # on each side
NEIGHBOUR_FRAMES = 4  # kept in memory on either side of the current frame
ORIGINS = {DETECTED: "as found", PROPAGATED: "carried forward", CORRECTED: "corrected"}
MARKS = {
    "doubtful": ("priority_high", "orange"),
    "carried forward": ("east", "blue"),
    "corrected": ("check", "green"),
}


def state_of(correction: Correction, row: int) -> str:
    """What is known of a frame's points, in words."""
    return "doubtful" if correction.doubtful[row] else ORIGINS[int(correction.origin[row])]


class ClipFrames:
    """The frames of a clip by row.

    pts : (t,) time stamps of the rows.
    """

    def __init__(self, path: Path, pts: NDArray[np.int64]) -> None:
        self._path, self._scan = path, scan(path)
        self._index = np.searchsorted(self._scan.pts, pts)
        self._near: dict[int, U8] = {}
        self._lock = threading.Lock()

    def rgb(self, row: int) -> U8:
        """The picture (h, w, 3) of a row."""
        with self._lock:
            if row not in self._near:
                first = max(row - NEIGHBOUR_FRAMES, 0)
                pictures = self.between(first, min(row + NEIGHBOUR_FRAMES + 1, len(self._index)))
                self._near = {first + i: frame.rgb().copy() for i, frame in enumerate(pictures)}
            if row not in self._near:
                raise LandmarkError(f"frame {row + 1} of the clip cannot be read: choose another one")
            return self._near[row]

    def between(self, first: int, last: int) -> Iterator[Frame]:
        """The frames of the rows [first, last)."""
        return read_frames(self._path, self._scan, int(self._index[first]), int(self._index[last - 1]) + 1)

    def faces(self, rows: set[int], points: F32) -> dict[int, str]:
        """Thumbnails of rows, as data URLs; points : (t, 81, 2) of all rows."""
        frames = frames_at(self._path, rows)
        return {frame.index: thumbnail(frame.rgb(), points[frame.index]) for frame in frames}


def thumbnail(rgb: U8, points: F32) -> str:
    """A small picture of the face at points (81, 2), or of the whole frame, as a data URL."""
    view = FrameView.whole(rgb.shape[1], rgb.shape[0])
    view = view.around(points) if np.isfinite(points).all() else view
    return data_url(view.picture(rgb, THUMBNAIL_PIXELS))


class LandmarkStrip:
    """Some frames of a clip as buttons.

    choose : called with the row of a frame that is clicked.
    """

    def __init__(
        self, frames: ClipFrames, correction: Correction, choose: Callable[[int], Awaitable[None]]
    ) -> None:
        self._frames, self._correction, self._choose = frames, correction, choose
        self._row = 0
        self._faces: dict[int, str] = {}
        self._cells: dict[int, ui.button] = {}

    def build(self, row: int) -> None:
        """Show an empty strip, which `fill` fills, at a row."""
        self._row = row
        self._scroll = ui.scroll_area().classes("w-full h-28").props('aria-label="Frames"')
        with self._scroll, ui.row().classes("no-wrap gap-1"):
            self._buttons()

    async def fill(self) -> None:
        """Show the frames."""
        rows = _shown_rows(self._correction) | {self._row}
        self._faces = await asyncio.to_thread(self._frames.faces, rows, self._correction.points.copy())
        self._buttons.refresh()
        self._scroll_to_row()

    def go(self, row: int) -> None:
        """Another frame is shown in the editor."""
        before, self._row = self._row, row
        for one in (before, row):
            self._mark(one)
        self._scroll_to_row()

    def mark_all(self) -> None:
        """Show the states of all frames."""
        for row in self._cells:
            self._mark(row)

    def update(self, rgb: U8) -> None:
        """The points of the shown frame (h, w, 3) may have changed: show its state, and itself once it is corrected."""
        if self._row in self._cells:
            self._mark(self._row)
        elif self._cells and self._correction.origin[self._row] == CORRECTED:
            self._faces[self._row] = thumbnail(rgb, np.asarray(self._correction.points[self._row]))
            self._buttons.refresh()

    @ui.refreshable_method
    def _buttons(self) -> None:
        self._cells = {}
        for row in sorted(self._faces):
            with ui.button(on_click=partial(self._choose, row)).props("flat padding=0") as cell:
                cell.classes("shrink-0 border-4 rounded-none")
                face = ui.element("img").classes("w-16 h-16").props('alt=""')
                face.props["src"] = self._faces[row]
                ui.icon("").classes("absolute top-0 right-0 rounded-full bg-white")
            self._cells[row] = cell
            self._mark(row)

    def _mark(self, row: int) -> None:
        if (cell := self._cells.get(row)) is None:
            return
        state, here = state_of(self._correction, row), row == self._row
        symbol, colour = MARKS.get(state, ("", ""))
        cell.props(f'aria-label="Frame {row + 1}, {state}" aria-current={str(here).lower()}')
        cell.classes(
            replace="shrink-0 border-4 rounded-none " + ("border-primary" if here else "border-transparent")
        )
        icon = cell.default_slot.children[1]
        icon.props(f'name="{symbol}" color="{colour}"').set_visibility(bool(symbol))

    def _scroll_to_row(self) -> None:
        """Scroll to the shown frame, if it is in the strip."""
        if self._row in self._faces:
            place = sorted(self._faces).index(self._row) / max(len(self._faces) - 1, 1)
            self._scroll.scroll_to(percent=place, axis="horizontal")


def _shown_rows(correction: Correction) -> set[int]:
    """Rows: evenly spread over the clip, the most doubtful ones, the corrected ones."""
    spread = np.linspace(0, len(correction) - 1, SETTINGS.spread).round().astype(int)
    doubtful = np.flatnonzero(correction.doubtful)
    order = np.argsort(-np.nan_to_num(correction.residual[doubtful], nan=np.inf))
    worst = doubtful[order][: SETTINGS.doubtful]
    return {*spread.tolist(), *worst.tolist(), *np.flatnonzero(correction.origin == CORRECTED).tolist()}
