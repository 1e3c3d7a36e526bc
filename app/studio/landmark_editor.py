"""The desk of the page Landmarks: a frame with its points, what moves them, and what keeps them."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import events, ui
from numpy.typing import NDArray

from guise.aam.landmarks import COUNT, LandmarkError, open_landmarker
from guise.app.studio.correction import CARRIED, CORRECTED, FOUND, Correction, carried, save_correction
from guise.app.studio.landmark_frames import Frames, Points, address, thumbnail
from guise.app.studio.landmark_view import SCREEN, View, name_of
from guise.app.studio.people import learn_again
from guise.app.studio.questions import agreed
from guise.app.studio.site import Studio, show_job
from guise.app.studio.store import JobRow, Person

EVEN, WORST = 20, 20  # thumbnails over the clip, and of its most doubtful frames
STEP, FINE = 1.0, 0.2  # frame pixels that an arrow key moves a point, and with shift
ZOOM = 1.5  # by which a step of the zoom enlarges
STILL = 1.0  # screen units below which a pressed pointer has not moved
EVERY = 0.03  # seconds between two looks at a moving pointer

ORIGINS = {FOUND: "as found", CARRIED: "carried here", CORRECTED: "corrected"}
MARKS = {
    "doubtful": ("priority_high", "orange"),
    "carried here": ("east", "blue"),
    "corrected": ("check", "green"),
}
HELP = {
    "arrows": f"move the point by {STEP:g} pixel, with shift by {FINE:g}",
    "n, p": "next point, point before",
    "page up, down": "frame before, next frame",
    "d": "next doubtful frame",
    "+, -, 0": "larger, smaller, the whole face",
    "u, r": "undo, do again; also ctrl z, ctrl y",
    "m": "mirror the correction of this side",
    "f": "fit from here",
    "s": "save",
}
_ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, -1), "ArrowDown": (0, 1)}


class Editor:
    """One visitor's work on one clip.

    What is drawn and said follows from `row`, `point`, `view` and the correction.
    """

    def __init__(
        self, studio: Studio, person: Person, file: Path, correction: Correction, frames: Frames
    ) -> None:
        self.studio, self.person, self.file = studio, person, file
        self.correction, self.frames = correction, frames
        self.row, self.point = 0, 0
        self._stamp = self.file.stat().st_mtime_ns
        self._unsaved = False
        self._faces: dict[int, str] = {}
        self._cells: dict[int, ui.button] = {}
        self._grip: _Grip | None = None
        self._stop = threading.Event()
        self.share = 0.0  # of the frames to which points are being carried

    async def build(self) -> None:
        """Show everything, beginning with the first frame that should be looked at."""
        first = [*np.flatnonzero(self.correction.doubtful & self._there()), *np.flatnonzero(self._there()), 0]
        self.row = int(first[0])
        self.rgb = await asyncio.to_thread(self.frames.rgb, self.row)
        self.view = View.whole(self.rgb.shape[1], self.rgb.shape[0])
        self._strip_row()
        self._pace()
        with ui.element("div").classes("w-full flex flex-wrap gap-4"):
            self._desk()
            with ui.column().classes("grow basis-64"):
                self._tools()
        ui.context.client.on_delete(self._stop.set)
        self.whole_face()
        self._changed()
        ui.timer(0, self._fill_strip, once=True)

    # -- what there is on the page

    def _strip_row(self) -> None:
        self._scroll = ui.scroll_area().classes("w-full h-28").props('aria-label="Frames"')
        with self._scroll, ui.row().classes("no-wrap gap-1"):
            self._strip()

    @ui.refreshable_method
    def _strip(self) -> None:
        self._cells = {}
        for row in sorted(self._faces):
            with ui.button(on_click=partial(self.go, row)).props("flat padding=0") as cell:
                cell.classes("shrink-0 border-4 rounded-none")
                ui.image(self._faces[row]).classes("w-16 h-16").props["alt"] = ""
                ui.icon("").classes("absolute top-0 right-0 rounded-full bg-white")
            self._cells[row] = cell
            self._mark(row)

    def _pace(self) -> None:
        """Which frame."""
        with ui.row().classes("w-full no-wrap items-center gap-1"):
            _icon("chevron_left", "Frame before", partial(self.step, -1))
            self._slider = ui.slider(min=1, max=max(len(self.correction), 2), value=self.row + 1)
            self._slider.classes("grow").props('aria-label="Frame"')
            self._slider.on("update:model-value", self._slid, throttle=0.2, leading_events=False)
            _icon("chevron_right", "Next frame", partial(self.step, 1))
            self._doubtful = _icon("priority_high", "Next doubtful frame", self.next_doubtful)

    def _desk(self) -> None:
        """The picture, which takes pointers and keys."""
        told = "Landmarks. Arrow keys move the chosen point, n and p choose another one."
        with ui.element("div").props(f'tabindex=0 role=application aria-label="{told}"') as desk:
            desk.classes("w-full max-w-[720px]").style(
                "touch-action: none; user-select: none; cursor: crosshair"
            )
            everywhere = f'<rect width="{SCREEN}" height="{SCREEN}" fill="none" pointer-events="all"/>'
            self._image = ui.interactive_image(size=(SCREEN, SCREEN), content=everywhere, sanitize=False)
            self._image.classes("w-full")
            self._drawing = self._image.add_layer()
        self._image.on("svg:pointerdown", self._press)
        self._image.on("svg:pointermove", self._drag, throttle=EVERY)
        self._image.on("svg:pointerup", self._release)
        self._image.on("svg:pointerleave", self._release)
        self._image.on("svg:pointercancel", self._drop)
        keys = ["key", "shiftKey", "ctrlKey", "metaKey"]
        desk.on("keydown.up.down.left.right.page-up.page-down.prevent", self._moved_by_key, keys)
        desk.on("keydown", self._pressed_key, keys)

    def _tools(self) -> None:
        self._said = ui.label().props('role="status"').classes("min-h-12")
        with ui.row().classes("gap-1"):
            self._undo = _icon("undo", "Undo", self.undo)
            self._redo = _icon("redo", "Do again", self.redo)
            _icon("zoom_in", "Larger", partial(self.zoom, ZOOM))
            _icon("zoom_out", "Smaller", partial(self.zoom, 1 / ZOOM))
            _icon("center_focus_strong", "The whole face", self.whole_face)
        with ui.row().classes("gap-1"):
            _tool(
                "flip",
                "Mirror",
                "Give the other side of the face the correction of the chosen point's",
                self.mirror,
            )
            _tool("restart_alt", "As found", "Put this frame back to what was found", self.reset)
            self._left_out = _tool("block", "Leave out", "No model learns from this frame", self.leave_out)
            self._borrowed = _tool("content_copy", "Copy points", "Those of the nearest frame", self.borrow)
        told = "Carry this frame's correction to the following ones, until a corrected one or until the face is lost"
        self._fit = _tool("east", "Fit from here", told, self.carry)
        with ui.row().classes("w-full no-wrap items-center") as self._carrying:
            ui.linear_progress(show_value=False).props('aria-label="Progress" rounded').bind_value_from(
                self, "share"
            )
            _icon("close", "Stop", self._stop.set)
        self._carrying.visible = False
        with ui.row().classes("gap-1"):
            self._save = ui.button("Save", icon="save", on_click=self.save)
            self._learn = ui.button("Save and learn anew", icon="school", on_click=self.learn).props(
                "outline"
            )
        self._job = ui.column().classes("w-full")
        keys = ui.expansion("Keys", icon="keyboard").classes("w-full")
        with keys, ui.element("dl").classes("grid grid-cols-[7rem_1fr] gap-x-4 gap-y-1"):
            for key, told in HELP.items():
                with ui.element("dt"):
                    ui.label(key).classes("font-mono")
                with ui.element("dd"):
                    ui.label(told)

    # -- which frame and which part of it

    async def go(self, row: int) -> None:
        """Show another frame; the view goes with the face."""
        before, self.row = self.row, min(max(row, 0), len(self.correction) - 1)
        self._slider.value = self.row + 1
        wanted = self.row
        rgb = await asyncio.to_thread(self.frames.rgb, wanted)
        if wanted != self.row:  # another one was asked for meanwhile
            return
        self.rgb, self._grip = rgb, None
        if self.correction.has_face(before) and self.correction.has_face(wanted):
            way = self._points().mean(0) - self.correction.points[before].mean(0)
            self.view = self.view.moved(-way * self.view.scale)
        self._mark(before)
        self._scroll_strip()
        self._show()
        self._changed()

    async def step(self, by: int) -> None:
        """Go on by some frames."""
        await self.go(self.row + by)

    async def next_doubtful(self) -> None:
        """Go to the next doubtful frame, and from the last one to the first."""
        rows = np.flatnonzero(self.correction.doubtful)
        if not len(rows):
            raise LandmarkError("no frame is doubtful any more")
        later = rows[rows > self.row]
        await self.go(int(later[0] if len(later) else rows[0]))

    async def _slid(self, event: events.GenericEventArguments) -> None:
        await self.go(int(event.args) - 1)

    def zoom(self, factor: float) -> None:
        """Enlarge about the chosen point, or the middle of the view."""
        middle = self.view.to_frame((SCREEN / 2, SCREEN / 2))
        there = self.correction.has_face(self.row)
        self.view = self.view.zoomed(factor, self._points()[self.point] if there else middle)
        self._show()

    def whole_face(self) -> None:
        """Show the face, or the whole frame where there is none."""
        view = View.whole(self.rgb.shape[1], self.rgb.shape[0])
        self.view = view.around(self._points()) if self.correction.has_face(self.row) else view
        self._show()

    # -- changes

    def choose(self, point: int) -> None:
        """Make a point the one that keys move."""
        self.point = point % COUNT
        self._draw()
        self._tell()

    def nudge(self, x: float, y: float) -> None:
        """Move the chosen point by pixels."""
        self.correction.nudge(self.row, self.point, (x, y))
        self._changed()

    def mirror(self) -> None:
        """Copy the correction of the chosen point's side to the other."""
        self.correction.mirror(self.row, self.point)
        self._changed()

    def reset(self) -> None:
        """Put the frame back to what was found."""
        self.correction.reset(self.row)
        self._changed()

    def leave_out(self) -> None:
        """Take the frame's points away."""
        self.correction.clear(self.row)
        self._changed()

    def borrow(self) -> None:
        """Give the frame the points of the nearest one."""
        self.correction.borrow(self.row)
        self._changed()

    async def undo(self) -> None:
        """Take the last change back, and show where it was."""
        await self._show_change(self.correction.undo())

    async def redo(self) -> None:
        """Do again what was undone last, and show where it is."""
        await self._show_change(self.correction.redo())

    async def _show_change(self, row: int | None) -> None:
        if row is None:
            return
        for cell in self._cells:
            self._mark(cell)
        await self.go(row)

    async def carry(self) -> None:
        """Carry the points of this frame to those that follow."""
        row, until = self.row, self.correction.carried_until(self.row)
        if not self.correction.has_face(row):
            raise LandmarkError("this frame has no points that could be carried on")
        if until == row + 1:
            raise LandmarkError(
                "there is no frame to carry to: the next one is corrected, or this is the last"
            )
        self._stop.clear()
        self.share, self._carrying.visible, self._fit.enabled = 0.0, True, False
        try:
            found = await asyncio.to_thread(self._carried, row, until)
        finally:
            self._carrying.visible, self._fit.enabled = False, True
        found = found[: self.correction.carried_until(row) - row - 1]
        self.correction.carry(row + 1, found)
        for cell in self._cells:
            self._mark(cell)
        self._changed()
        lost = len(found) < until - row - 1 and not self._stop.is_set()
        ui.notify(
            f"Carried to {len(found)} frames"
            + (f"; the face is lost in frame {row + len(found) + 2}." if lost else ".")
        )

    def _carried(self, row: int, until: int) -> Points:
        """Points (k, 81, 2) of the frames after `row`."""
        pictures = (frame.rgb() for frame in self.frames.between(row, until))
        found = []
        for points in carried(open_landmarker("builtin"), pictures, self.correction.points[row].copy()):
            found.append(points)
            self.share = len(found) / (until - row - 1)
            if self._stop.is_set():
                break
        return np.array(found, np.float32).reshape(-1, COUNT, 2)

    # -- keeping

    async def save(self) -> bool:
        """Write the landmarks; asks when another window has, and says whether it was done."""
        if self.file.stat().st_mtime_ns != self._stamp and not await agreed(
            "These landmarks were saved in another window meanwhile. Replace those by yours?",
            "Replace",
            "Cancel",
        ):
            return False
        await asyncio.to_thread(save_correction, self.file, self.correction)
        self._stamp = self.file.stat().st_mtime_ns
        self._changed()
        ui.notify("Saved.")
        return True

    async def learn(self) -> None:
        """Save, and learn the person anew."""
        if self.correction.unsaved and not await self.save():
            return
        id = learn_again(self.studio, self.person)
        self._learn.enabled = False
        with self._job:
            show_job(self.studio, id, self._learned)

    def _learned(self, job: JobRow) -> None:
        self._job.clear()
        self._learn.enabled = True
        with self._job:
            if job.state == "done":
                error = job.result["held_out_error"]
                ui.label(
                    f"Learned anew: {error:.2f} % of the distance of the eyes on frames not learned from."
                )
            else:
                ui.label(job.sentence or "Cancelled.")

    # -- pointer and keys

    def _press(self, event: events.GenericEventArguments) -> None:
        place = _place(event)
        point = self.view.nearest(self._points(), place)
        start = None if point is None else self._points()[point]
        self._grip = _Grip(place, self.view, point, start)
        if point is not None:
            self.choose(point)

    def _drag(self, event: events.GenericEventArguments) -> None:
        grip = self._grip
        if grip is None:
            return
        grip.by = _place(event) - grip.place
        if grip.point is None:
            self.view = grip.view.moved(grip.by)
            self._show()
        elif grip.has_moved:
            points = self._points().copy()
            points[grip.point] = grip.target
            self._drawing.content = self.view.drawing(points, grip.point)

    def _release(self, event: events.GenericEventArguments) -> None:
        grip = self._grip
        if grip is None:
            return
        self._drag(event)
        self._grip = None
        if grip.point is not None and grip.has_moved:
            self.correction.move(self.row, grip.point, grip.target)
            self._changed()

    def _drop(self) -> None:
        self._grip = None
        self._draw()

    async def _moved_by_key(self, event: events.GenericEventArguments) -> None:
        key = event.args["key"]
        if key in _ARROWS:
            length = FINE if event.args["shiftKey"] else STEP
            self.nudge(*(length * way for way in _ARROWS[key]))
        else:
            await self.step(1 if key == "PageDown" else -1)

    async def _pressed_key(self, event: events.GenericEventArguments) -> None:
        commands: dict[str, Callable[[], Any]] = {
            "n": lambda: self.choose(self.point + 1), "p": lambda: self.choose(self.point - 1),
            "d": self.next_doubtful, "+": partial(self.zoom, ZOOM), "=": partial(self.zoom, ZOOM),
            "-": partial(self.zoom, 1 / ZOOM), "0": self.whole_face, "m": self.mirror, "f": self.carry, "s": self.save,
            "u": self.undo, "r": self.redo, "ctrl z": self.undo, "ctrl y": self.redo,
        }  # fmt: skip
        held = "ctrl " if event.args["ctrlKey"] or event.args["metaKey"] else ""
        command = commands.get(held + event.args["key"].lower())
        done = command() if command else None
        if done is not None:
            await done

    # -- showing it

    def _points(self) -> Points:
        return np.asarray(self.correction.points[self.row])

    def _there(self) -> NDArray[np.bool_]:
        return np.asarray(np.isfinite(self.correction.points).all((1, 2)))

    def _show(self) -> None:
        """Picture and drawing, which follow from the view."""
        self._image.set_source(address(self.view.picture(self.rgb)))
        self._draw()

    def _draw(self) -> None:
        self._drawing.content = self.view.drawing(self._points(), self.point)

    def _changed(self) -> None:
        """Everything that follows from a change of points."""
        self._draw()
        self._tell()
        there = self.correction.has_face(self.row)
        self._undo.enabled, self._redo.enabled = self.correction.can_undo, self.correction.can_redo
        self._left_out.visible, self._borrowed.visible = there, not there
        self._doubtful.enabled = bool(self.correction.doubtful.any())
        self._note_unsaved()
        if self.row in self._cells:
            self._mark(self.row)
        elif self._cells and self.correction.origin[self.row] == CORRECTED:
            self._faces[self.row] = thumbnail(self.rgb, self._points())
            self._strip.refresh()

    def _note_unsaved(self) -> None:
        """The browser asks before it leaves with something unsaved."""
        self._save.enabled = self.correction.unsaved
        if self.correction.unsaved != self._unsaved:
            self._unsaved = self.correction.unsaved
            ui.run_javascript(f"window.onbeforeunload = {'() => true' if self._unsaved else 'null'}")

    def _tell(self) -> None:
        x, y = self._points()[self.point]
        what = (
            f"{name_of(self.point)}, at {x:.1f}, {y:.1f}"
            if self.correction.has_face(self.row)
            else "no points"
        )
        self._said.text = f"Frame {self.row + 1} of {len(self.correction)}, {self._state(self.row)}: {what}"

    def _state(self, row: int) -> str:
        return "doubtful" if self.correction.doubtful[row] else ORIGINS[int(self.correction.origin[row])]

    def _mark(self, row: int) -> None:
        """Show in the strip what is known about a row."""
        if (cell := self._cells.get(row)) is None:
            return
        state, here = self._state(row), row == self.row
        sign, colour = MARKS.get(state, ("", ""))
        cell.props(f'aria-label="Frame {row + 1}, {state}" aria-current={str(here).lower()}')
        cell.classes(
            replace="shrink-0 border-4 rounded-none " + ("border-primary" if here else "border-transparent")
        )
        icon = cell.default_slot.children[1]
        icon.props(f'name="{sign}" color="{colour}"').set_visibility(bool(sign))

    def _scroll_strip(self) -> None:
        """Bring the frame that is shown into the strip's sight, if it is there."""
        if self.row in self._faces:
            place = sorted(self._faces).index(self.row) / max(len(self._faces) - 1, 1)
            self._scroll.scroll_to(percent=place, axis="horizontal")

    async def _fill_strip(self) -> None:
        rows = _shown_rows(self.correction) | {self.row}
        self._faces = await asyncio.to_thread(self.frames.faces, rows, self.correction.points.copy())
        self._strip.refresh()
        self._scroll_strip()


class _Grip:
    """A pointer that is pressed on the picture.

    place : where it was pressed, screen units.   view : what was seen then.
    point, start : the point that it holds and where that was, frame pixels; None for the picture itself.
    """

    def __init__(
        self, place: NDArray[np.float64], view: View, point: int | None, start: Points | None
    ) -> None:
        self.place, self.view, self.point, self.start = place, view, point, start
        self.by = np.zeros(2)

    @property
    def has_moved(self) -> bool:
        """Whether it is more than a click."""
        return bool(np.hypot(*self.by) >= STILL)

    @property
    def target(self) -> NDArray[np.float64]:
        """Where the point goes, frame pixels (2,)."""
        assert self.start is not None
        return np.asarray(self.start + self.by / self.view.scale)


def _shown_rows(correction: Correction) -> set[int]:
    """The rows of the strip: evenly over the clip, the most doubtful ones, the corrected ones."""
    even = np.linspace(0, len(correction) - 1, EVEN).round().astype(int)
    worst = np.flatnonzero(correction.doubtful)
    worst = worst[np.argsort(-np.nan_to_num(correction.residual[worst], nan=np.inf))][:WORST]
    return {*even.tolist(), *worst.tolist(), *np.flatnonzero(correction.origin == CORRECTED).tolist()}


def _place(event: events.GenericEventArguments) -> NDArray[np.float64]:
    return np.array([event.args["image_x"], event.args["image_y"]], np.float64)


def _icon(name: str, told: str, command: Callable[[], Any]) -> ui.button:
    button = ui.button(icon=name, on_click=command, color=None).props("flat round").tooltip(told)
    button.props["aria-label"] = told
    return button


def _tool(name: str, label: str, told: str, command: Callable[[], Any]) -> ui.button:
    button = ui.button(label, icon=name, on_click=command, color=None)
    return button.props("outline dense").classes("px-2").tooltip(told)
