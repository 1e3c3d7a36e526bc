"""The covers of a reviewed video that belong to no track, and boxes that the user draws: what is there, as they say."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from guise.app.deidentify.report.report import clock
from guise.app.studio.deidentify_jobs import DeidentifyChoices, cover_picture
from guise.app.studio.site import Studio
from guise.app.studio.store import StudioError
from guise.app.studio.videos import title

COVERS_PER_PAGE = 24
VIEWS = {"cover": "Keep covered", "leave": "Not a face", "swap": "A face: swap it"}
DONE = {"cover": "Covered", "leave": "Left as it is", "swap": "Swapped, if it can be"}
SIDES = ("Left", "Top", "Right", "Bottom")


class CoverEditor:
    """Covers and boxes.

    covers : of the file TRACKS, without those of tracks.   size : (width, height) of the video, pixels.
    last : its last frame.   frame : the one that is shown.   saved : called after each change.

    choices : may be replaced.
    """

    def __init__(
        self, studio: Studio, folder: Path, covers: Sequence[dict[str, Any]], choices: DeidentifyChoices, *,
        size: tuple[int, int], last: int, frame: Callable[[], int], saved: Callable[[], Awaitable[None]],
    ) -> None:  # fmt: skip
        self._studio, self._folder, self.covers, self.choices = studio, folder, covers, choices
        self._size, self._last, self._frame, self._saved = size, last, frame, saved
        self._page = 1

    def build_covers(self) -> None:
        """The covers, each with a picture, why and when, and what the user says of it."""
        if not self.covers:
            return
        title("Covers without a track").classes("mt-4")
        ui.label(
            "Each of these may be a face that could not be tracked, so it is covered. Say which of them are not faces."
        )
        self._cards()
        pages = -(-len(self.covers) // COVERS_PER_PAGE)
        if pages > 1:
            ui.pagination(1, pages, direction_links=True, on_change=lambda event: self._turn(event.value))

    def _turn(self, page: int) -> None:
        self._page = page
        self._cards.refresh()

    @ui.refreshable_method
    def _cards(self) -> None:
        with ui.element("div").classes("w-full grid gap-2"):
            for cover in self.covers[(self._page - 1) * COVERS_PER_PAGE : self._page * COVERS_PER_PAGE]:
                with ui.card().classes("w-full"):
                    self._card(cover)

    def _card(self, cover: dict[str, Any]) -> None:
        number = str(cover["number"])
        with ui.row().classes("w-full items-start no-wrap"):
            picture_of_cover(self._studio, self._folder, cover)
            with ui.column().classes("grow gap-1 min-w-0"):
                title(f"Cover {number}", 3)
                ui.label(about(cover)).classes("opacity-70")
                toggle = ui.toggle(VIEWS, value=self.choices.covers.get(number, cover["action"]))
                toggle.on_value_change(partial(self._choose, number))
                toggle.props(f'no-caps role="group" aria-label="What cover {number} hides"')

    async def _choose(self, number: str, event: Any) -> None:
        self.choices.covers[number] = event.value
        await self._saved()

    def build_boxes(self) -> None:
        """What the user draws, and what was drawn."""
        with ui.expansion("Add a box", icon="add_box").classes("w-full") as self._panel:
            ui.label(
                "Draw a box on the frame, from brows to chin, or type its sides in pixels. Guise follows what is in it "
                "from the frame shown, and covers its place in all frames that you give."
            )
            with ui.row().classes("items-center"):
                self._sides = [_number(side, self._size[n % 2]) for n, side in enumerate(SIDES)]
            with ui.row().classes("items-center"):
                self._first, self._end = (_number(words, self._last) for words in ("From frame", "To frame"))
            with ui.row():
                for action, words in {
                    "cover": "Cover it",
                    "swap": "A face: swap it",
                    "leave": "Not a face",
                }.items():
                    ui.button(words, on_click=partial(self._add, action)).props("outline")
        self._drawn()

    def drawn(self, shares: list[float]) -> None:
        """The user has drawn a box over the frame, in shares of its sides."""
        self._panel.open()
        for n, (field, share) in enumerate(zip(self._sides, shares, strict=True)):
            field.value = round(share * self._size[n % 2])
        self._first.value, self._end.value = self._frame(), self._last

    async def _add(self, action: str) -> None:
        values = [field.value for field in (*self._sides, self._first, self._end)]
        if any(value is None for value in values):
            raise StudioError("draw a box, or fill in its sides and frames")
        *box, first, last = map(int, values)
        at = min(max(self._frame(), first), last)
        if not (box[0] < box[2] and box[1] < box[3] and first <= last):
            raise StudioError("the box must go from left to right and down, and end after it begins")
        await self.say({"first": first, "last": last, "at": at, "box": box, "action": action})

    async def say(self, box: dict[str, Any]) -> None:
        """Add a box, as the file TRACKS has it."""
        self.choices.boxes.append(box)
        self._drawn.refresh()
        await self._saved()

    @ui.refreshable_method
    def _drawn(self) -> None:
        for n, box in enumerate(self.choices.boxes):
            with ui.row().classes("items-center"):
                place = ", ".join(map(str, box["box"]))
                ui.label(f"{DONE[box['action']]}: frames {box['first']} to {box['last']}, box {place}.")
                remove = ui.button(icon="delete", color=None, on_click=partial(self._remove, n))
                remove.props("flat round dense").props["aria-label"] = f"Remove box {n + 1}"

    async def _remove(self, place: int) -> None:
        del self.choices.boxes[place]
        self._drawn.refresh()
        await self._saved()


def picture_of_cover(studio: Studio, folder: Path, cover: dict[str, Any]) -> None:
    """What a cover hides; nothing where there are too many of them for pictures."""
    path = folder / cover_picture(cover["number"])
    if path.exists():
        picture = ui.image(studio.url(path)).classes("w-20 h-20 rounded shrink-0")
        picture.props["alt"] = f"What cover {cover['number']} hides"


def about(cover: dict[str, Any]) -> str:
    """Why and when something is covered."""
    first, last = map(clock, cover["seconds"])
    return f"{cover['reason'].capitalize()}, {first} to {last}"


def _number(label: str, most: int) -> ui.number:
    return ui.number(label, min=0, max=most, precision=0).props("dense outlined").classes("w-24")
