"""The editor of the page Landmarks: a frame with its points, the tools that move them, and saving."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import events, ui

from guise.aam.landmarks import COUNT, LandmarkError, open_landmarker
from guise.app.studio.dialogs import confirm
from guise.app.studio.landmark_correction import (
    Correction,
    propagated,
    save_correction,
)
from guise.app.studio.landmark_strip import ClipFrames, LandmarkStrip, state_of
from guise.app.studio.landmark_view import SCREEN, FrameView, name_of
from guise.app.studio.people import retrain
from guise.app.studio.pictures import data_url
from guise.app.studio.progress_row import ProgressRow
from guise.app.studio.site import JOB_POLL_SECONDS, Studio, sentence, show_job
from guise.app.studio.store import JobRow, Person
from guise.common.arrays import F32, F64, Bool


@dataclass(frozen=True)
class EditorSettings:
    """Sizes and rates of the landmark editor."""

    nudge_pixels: float = 1.0  # of the frame, by an arrow key
    fine_nudge_pixels: float = 0.2  # with shift
    zoom_factor: float = 1.5  # of one click
    click_units: float = 1.0  # screen units that a pointer may move in a click
    drag_seconds: float = 0.03  # between two updates while dragging


SETTINGS = EditorSettings()

FITTING_WIDTH = f"clamp(18rem, 100dvh - 23rem, {SCREEN}px)"  # of the square below what chooses the frame
HELP = {
    "arrows": f"move the point by {SETTINGS.nudge_pixels:g} pixel, with shift by {SETTINGS.fine_nudge_pixels:g}",
    "n, p": "next point, previous point",
    "page up, down": "previous frame, next frame",
    "d": "next doubtful frame",
    "+, -, 0": "zoom in, zoom out, whole face",
    "u, r": "undo, redo; also ctrl z, ctrl y",
    "m": "mirror the correction of this side",
    "f": "carry forward",
    "s": "save",
}
_ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, -1), "ArrowDown": (0, 1)}


class LandmarkEditor:
    """One visitor's work on one clip.

    What is shown follows from `row`, `point`, `view` and the correction.
    """

    def __init__(
        self, studio: Studio, person: Person, file: Path, correction: Correction, frames: ClipFrames
    ) -> None:
        self.studio, self.person, self.file = studio, person, file
        self.correction, self.frames = correction, frames
        self.row, self.point = 0, 0
        self._file_time = self.file.stat().st_mtime_ns
        self._unsaved = False
        self._strip = LandmarkStrip(frames, correction, self.go)
        self._pointer: _PointerDrag | None = None
        self._stop = threading.Event()
        self.share = 0.0  # of the frames to which points are being propagated

    async def build(self) -> None:
        """Show everything, starting with the first frame that should be checked."""
        first = [*np.flatnonzero(self.correction.doubtful & self._there()), *np.flatnonzero(self._there()), 0]
        self.row = int(first[0])
        self.rgb = await asyncio.to_thread(self.frames.rgb, self.row)
        self.view = FrameView.whole(self.rgb.shape[1], self.rgb.shape[0])
        self._strip.build(self.row)
        self._navigation()
        with ui.element("div").classes("w-full flex flex-wrap gap-4"):
            self._canvas()
            with ui.column().classes("grow basis-64"):
                self._tools()
        ui.context.client.on_delete(self._stop.set)
        self.whole_face()
        self._changed()
        ui.timer(0, self._strip.fill, once=True)

    # -- layout

    def _navigation(self) -> None:
        """The controls that choose the frame."""
        with ui.row().classes("w-full no-wrap items-center gap-1"):
            _icon("chevron_left", "Previous frame", partial(self.go_by, -1))
            self._slider = ui.slider(min=1, max=max(len(self.correction), 2), value=self.row + 1)
            self._slider.classes("grow").props('aria-label="Frame"')
            self._slider.on("update:model-value", self._slid, throttle=0.2, leading_events=False)
            _icon("chevron_right", "Next frame", partial(self.go_by, 1))
            self._doubtful = _icon("priority_high", "Next doubtful frame", self.next_doubtful)

    def _canvas(self) -> None:
        """The picture, which takes pointers and keys."""
        label = "Landmarks. Arrow keys move the chosen point, n and p choose another one."
        with ui.element("div").props(f'tabindex=0 role=application aria-label="{label}"') as canvas:
            canvas.classes("w-full").style(
                f"max-width: {FITTING_WIDTH}; touch-action: none; user-select: none; cursor: crosshair"
            )
            everywhere = f'<rect width="{SCREEN}" height="{SCREEN}" fill="none" pointer-events="all"/>'
            self._image = ui.interactive_image(size=(SCREEN, SCREEN), content=everywhere, sanitize=False)
            self._image.classes("w-full").props('aria-hidden="true"')  # the place around it says what it is
            self._drawing = self._image.add_layer()
        self._image.on("svg:pointerdown", self._press)
        self._image.on("svg:pointermove", self._drag, throttle=SETTINGS.drag_seconds)
        self._image.on("svg:pointerup", self._release)
        self._image.on("svg:pointerleave", self._release)
        self._image.on("svg:pointercancel", self._drop)
        keys = ["key", "shiftKey", "ctrlKey", "metaKey"]
        canvas.on("keydown.up.down.left.right.page-up.page-down.prevent", self._moved_by_key, keys)
        canvas.on("keydown", self._pressed_key, keys)

    def _tools(self) -> None:
        edit, own = self.edit, self.correction
        self._status = ui.label().props('role="status"').classes("min-h-12")
        with ui.row().classes("gap-1"):
            self._undo = _icon("undo", "Undo", self.undo)
            self._redo = _icon("redo", "Redo", self.redo)
            _icon("zoom_in", "Zoom in", partial(self.zoom, SETTINGS.zoom_factor))
            _icon("zoom_out", "Zoom out", partial(self.zoom, 1 / SETTINGS.zoom_factor))
            _icon("center_focus_strong", "Whole face", self.whole_face)
        with ui.row().classes("gap-1"):
            _tool(
                "flip",
                "Mirror",
                "Copy the correction of the chosen point's side to the other side of the face",
                self.mirror,
            )
            _tool(
                "restart_alt",
                "Reset",
                "Restore the points that were found in this frame",
                partial(edit, own.reset),
            )
            self._left_out = _tool(
                "block", "Leave out", "Don't train on this frame", partial(edit, own.clear)
            )
            self._borrowed = _tool(
                "content_copy", "Copy points", "Copy those of the nearest frame", partial(edit, own.borrow)
            )
        hint = "Apply this frame's correction to the following ones, up to a corrected one or until the face is lost"
        self._forward = _tool("east", "Carry forward", hint, self.propagate)
        self._progress = ProgressRow(self._stop.set, "Stop")
        self._timer = ui.timer(JOB_POLL_SECONDS, self._show_progress, active=False)
        self._carrying(False)
        with ui.row().classes("gap-1"):
            self._save = ui.button("Save", icon="save", on_click=self.save)
            self._retrain = ui.button("Save and retrain", icon="school", on_click=self.retrain)
            self._retrain.props("outline")
        self._job = ui.column().classes("w-full")
        keys = ui.expansion("Keys", icon="keyboard").classes("w-full")
        with keys, ui.element("dl").classes("grid grid-cols-[7rem_1fr] gap-x-4 gap-y-1"):
            for key, effect in HELP.items():
                with ui.element("dt"):
                    ui.label(key).classes("font-mono")
                with ui.element("dd"):
                    ui.label(effect)

    # -- which frame, and which part of it

    async def go(self, row: int) -> None:
        """Show another frame; the view follows the face."""
        before, self.row = self.row, min(max(row, 0), len(self.correction) - 1)
        self._slider.value = self.row + 1
        wanted = self.row
        rgb = await asyncio.to_thread(self.frames.rgb, wanted)
        if wanted != self.row:  # another one was requested meanwhile
            return
        self.rgb, self._pointer = rgb, None
        if self.correction.has_face(before) and self.correction.has_face(wanted):
            motion = self._points().mean(0) - self.correction.points[before].mean(0)
            self.view = self.view.moved(-motion * self.view.scale)
        self._strip.go(wanted)
        self._show()
        self._changed()

    async def go_by(self, by: int) -> None:
        """Move on by some frames."""
        await self.go(self.row + by)

    async def next_doubtful(self) -> None:
        """Go to the next doubtful frame, and from the last one to the first."""
        rows = np.flatnonzero(self.correction.doubtful)
        if not len(rows):
            raise LandmarkError("no doubtful frames are left")
        later = rows[rows > self.row]
        await self.go(int(later[0] if len(later) else rows[0]))

    async def _slid(self, event: events.GenericEventArguments) -> None:
        await self.go(int(event.args) - 1)

    def zoom(self, factor: float) -> None:
        """Zoom around the chosen point, or the middle of the view."""
        middle = self.view.to_frame((SCREEN / 2, SCREEN / 2))
        there = self.correction.has_face(self.row)
        self.view = self.view.zoomed(factor, self._points()[self.point] if there else middle)
        self._show()

    def whole_face(self) -> None:
        """Show the face, or the whole frame where there is none."""
        view = FrameView.whole(self.rgb.shape[1], self.rgb.shape[0])
        self.view = view.around(self._points()) if self.correction.has_face(self.row) else view
        self._show()

    # -- changes

    def choose(self, point: int) -> None:
        """Choose the point that keys move."""
        self.point = point % COUNT
        self._draw()
        self._update_status()

    def edit(self, change: Callable[..., None], *details: Any) -> None:
        """Change the points of this frame by a method of the correction."""
        change(self.row, *details)
        self._changed()

    def mirror(self) -> None:
        """Copy the correction of the chosen point's side to the other."""
        self.edit(self.correction.mirror, self.point)

    async def undo(self) -> None:
        """Undo the last change and show where it was."""
        await self._show_change(self.correction.undo())

    async def redo(self) -> None:
        """Redo what was undone last and show where it is."""
        await self._show_change(self.correction.redo())

    async def _show_change(self, row: int | None) -> None:
        if row is None:
            return
        self._strip.mark_all()
        await self.go(row)

    async def propagate(self) -> None:
        """Propagate the points of this frame to those that follow."""
        row, until = self.row, self.correction.propagation_end(self.row)
        if not self.correction.has_face(row):
            raise LandmarkError("this frame has no points to carry forward")
        if until == row + 1:
            raise LandmarkError(
                "there is no frame to carry forward to: the next one is corrected, or this is the last"
            )
        self._stop.clear()
        self.share = 0.0
        self._carrying(True)
        try:
            found = await asyncio.to_thread(self._propagated, row, until)
        finally:
            self._carrying(False)
        found = found[: self.correction.propagation_end(row) - row - 1]
        self.correction.propagate(row + 1, found)
        self._strip.mark_all()
        self._changed()
        lost = len(found) < until - row - 1 and not self._stop.is_set()
        ui.notify(
            f"Carried forward to {len(found)} frames"
            + (f"; the face is lost in frame {row + len(found) + 2}." if lost else ".")
        )

    def _carrying(self, on: bool) -> None:
        """Show, or no longer, how far the points are carried."""
        self._show_progress()
        self._progress.row.visible = self._timer.active = on
        self._forward.enabled = not on

    def _show_progress(self) -> None:
        self._progress.show("Carrying forward", self.share)

    def _propagated(self, row: int, until: int) -> F32:
        """Points (k, 81, 2) of the frames after `row`."""
        pictures = (frame.rgb() for frame in self.frames.between(row, until))
        found = []
        for points in propagated(open_landmarker("builtin"), pictures, self.correction.points[row].copy()):
            found.append(points)
            self.share = len(found) / (until - row - 1)
            if self._stop.is_set():
                break
        return np.array(found, np.float32).reshape(-1, COUNT, 2)

    # -- saving

    async def save(self) -> bool:
        """Write the landmarks and return whether that was done; asks when another window has written them."""
        if self.file.stat().st_mtime_ns != self._file_time and not await confirm(
            "These landmarks were saved in another window in the meantime. Replace them with yours?",
            "Replace",
            "Cancel",
        ):
            return False
        await asyncio.to_thread(save_correction, self.file, self.correction)
        self._file_time = self.file.stat().st_mtime_ns
        self._changed()
        ui.notify("Saved.")
        return True

    async def retrain(self) -> None:
        """Save and retrain the person's model."""
        if self.correction.unsaved and not await self.save():
            return
        id = retrain(self.studio, self.person)
        self._retrain.enabled = False
        with self._job:
            show_job(self.studio, id, self._retrained)

    def _retrained(self, job: JobRow) -> None:
        self._job.clear()
        self._retrain.enabled = True
        with self._job:
            if job.state == "done":
                error = job.result["held_out_error"]
                ui.label(f"Retrained: error {error:.2f} % of the inter-ocular distance on held-out frames.")
            else:
                ui.label(sentence(job.sentence or "cancelled"))

    # -- pointer and keys

    def _press(self, event: events.GenericEventArguments) -> None:
        place = _place(event)
        point = self.view.nearest(self._points(), place)
        start = None if point is None else self._points()[point]
        self._pointer = _PointerDrag(place, self.view, point, start)
        if point is not None:
            self.choose(point)

    def _drag(self, event: events.GenericEventArguments) -> None:
        pointer = self._pointer
        if pointer is None:
            return
        pointer.by = _place(event) - pointer.place
        if pointer.point is None:
            self.view = pointer.view.moved(pointer.by)
            self._show()
        elif pointer.has_moved:
            points = self._points().copy()
            points[pointer.point] = pointer.target
            self._drawing.content = self.view.drawing(points, pointer.point)

    def _release(self, event: events.GenericEventArguments) -> None:
        pointer = self._pointer
        if pointer is None:
            return
        self._drag(event)
        self._pointer = None
        if pointer.point is not None and pointer.has_moved:
            self.edit(self.correction.move, pointer.point, pointer.target)

    def _drop(self) -> None:
        self._pointer = None
        self._draw()

    async def _moved_by_key(self, event: events.GenericEventArguments) -> None:
        key = event.args["key"]
        if key in _ARROWS:
            length = SETTINGS.fine_nudge_pixels if event.args["shiftKey"] else SETTINGS.nudge_pixels
            self.edit(self.correction.nudge, self.point, [length * way for way in _ARROWS[key]])
        else:
            await self.go_by(1 if key == "PageDown" else -1)

    async def _pressed_key(self, event: events.GenericEventArguments) -> None:
        larger = partial(self.zoom, SETTINGS.zoom_factor)
        smaller = partial(self.zoom, 1 / SETTINGS.zoom_factor)
        commands: dict[str, Callable[[], Any]] = {
            "n": lambda: self.choose(self.point + 1), "p": lambda: self.choose(self.point - 1),
            "d": self.next_doubtful, "+": larger, "=": larger, "-": smaller, "0": self.whole_face,
            "m": self.mirror, "f": self.propagate, "s": self.save,
            "u": self.undo, "r": self.redo, "ctrl z": self.undo, "ctrl y": self.redo,
        }  # fmt: skip
        held = "ctrl " if event.args["ctrlKey"] or event.args["metaKey"] else ""
        command = commands.get(held + event.args["key"].lower())
        done = command() if command else None
        if done is not None:
            await done

    # -- display

    def _points(self) -> F32:
        return np.asarray(self.correction.points[self.row])

    def _there(self) -> Bool:
        return np.asarray(np.isfinite(self.correction.points).all((1, 2)))

    def _show(self) -> None:
        """Show the picture and the points in the view."""
        self._image.set_source(data_url(self.view.picture(self.rgb)))
        self._draw()

    def _draw(self) -> None:
        self._drawing.content = self.view.drawing(self._points(), self.point)

    def _changed(self) -> None:
        """Update everything that depends on the points."""
        self._draw()
        self._update_status()
        there = self.correction.has_face(self.row)
        self._undo.enabled, self._redo.enabled = self.correction.can_undo, self.correction.can_redo
        self._left_out.visible, self._borrowed.visible = there, not there
        self._doubtful.enabled = bool(self.correction.doubtful.any())
        self._note_unsaved()
        self._strip.update(self.rgb)

    def _note_unsaved(self) -> None:
        """Have the browser ask before it leaves unsaved changes."""
        self._save.enabled = self.correction.unsaved
        if self.correction.unsaved != self._unsaved:
            self._unsaved = self.correction.unsaved
            ui.run_javascript(f"window.onbeforeunload = {'() => true' if self._unsaved else 'null'}")

    def _update_status(self) -> None:
        x, y = self._points()[self.point]
        what = (
            f"{name_of(self.point)}, at {x:.1f}, {y:.1f}"
            if self.correction.has_face(self.row)
            else "no points"
        )
        state = state_of(self.correction, self.row)
        self._status.text = f"Frame {self.row + 1} of {len(self.correction)}, {state}: {what}"


class _PointerDrag:
    """A pointer that is pressed on the picture.

    place : where it was pressed, screen units.   view : the view at that time.
    point, start : the dragged point and its position, frame pixels; None when the picture itself is dragged.
    """

    def __init__(self, place: F64, view: FrameView, point: int | None, start: F32 | None) -> None:
        self.place, self.view, self.point, self.start = place, view, point, start
        self.by = np.zeros(2)

    @property
    def has_moved(self) -> bool:
        """Whether it is more than a click."""
        return bool(np.hypot(*self.by) >= SETTINGS.click_units)

    @property
    def target(self) -> F64:
        """The point's new position (2,), frame pixels."""
        assert self.start is not None
        return np.asarray(self.start + self.by / self.view.scale)


def _place(event: events.GenericEventArguments) -> F64:
    return np.array([event.args["image_x"], event.args["image_y"]], np.float64)


def _icon(name: str, label: str, command: Callable[[], Any]) -> ui.button:
    button = ui.button(icon=name, on_click=command, color=None).props("flat round").tooltip(label)
    button.props["aria-label"] = label
    return button


def _tool(name: str, label: str, hint: str, command: Callable[[], Any]) -> ui.button:
    button = ui.button(label, icon=name, on_click=command, color=None)
    return button.props("outline dense").classes("px-2").tooltip(hint)
