"""What is done with the faces of a reviewed video: tracks with pictures, donors, covers and sound, on a page."""

from __future__ import annotations

import asyncio
import base64
import json
from collections.abc import Callable
from dataclasses import asdict
from functools import lru_cache
from typing import Any

from nicegui import ui

from guise.app.deidentify.report.html import Html, tag
from guise.app.deidentify.report.report import clock
from guise.app.deidentify.report.sheet import COLOURS
from guise.app.media.images import encode_image
from guise.app.people.montage import draw
from guise.app.studio.deidentify_jobs import TRACKS, Choices, thumbnail
from guise.app.studio.questions import agreed, answer
from guise.app.studio.site import Studio
from guise.app.studio.store import JobRow
from guise.app.swapping.donors import open_donor
from guise.common.files import write_whole

CHOICES = "choices.json"
SHOWN = 20  # tracks on a page
ANY = "any fictional person"
ACTIONS = {"swap": "Swap", "cover": "Cover", "leave": "Leave"}
COVERS = {"solid": "Solid", "mosaic": "Mosaic", "blur": "Blur"}
SOUNDS = {"keep": "Keep", "drop": "Drop", "mask": "Disguise voices"}
HINT = (
    "The bar shows when a face is seen in the video, and its height how sure Guise is of it. Faces that are not listed "
    "here are covered."
)


class Editor:
    """The tracks of a video and what is to be done with each; every change is kept.

    job : the review.   render : called with the choices when the user wants the video made.
    """

    def __init__(self, studio: Studio, job: JobRow, render: Callable[[Choices], None]) -> None:
        self._studio, self._job, self._render = studio, job, render
        self._folder = studio.store.folder_of(job.id)
        value = json.loads((self._folder / TRACKS).read_text(encoding="utf-8"))
        self._frames: int = value["frames"]
        self._tracks: list[dict[str, Any]] = value["tracks"]
        self._faces = {"": ANY} | studio.faces()
        self._choices = self._kept()
        self._page = 1

    def build(self) -> None:
        """Tracks, settings, and the button that begins."""
        ui.label(
            HINT if self._tracks else "No face could be followed. What may be a face somewhere is covered."
        )
        self._people()
        pages = -(-len(self._tracks) // SHOWN)
        if pages > 1:
            ui.pagination(1, pages, direction_links=True, on_change=lambda event: self._turn(event.value))
        self._settings()
        self._begin()

    def _kept(self) -> Choices:
        """What was chosen before; for a donor who is no longer there, any."""
        path = self._folder / CHOICES
        if not path.exists():
            return Choices.proposed(self._tracks)
        choices = Choices(**json.loads(path.read_text(encoding="utf-8")))
        choices.donors = {k: spec if spec in self._faces else "" for k, spec in choices.donors.items()}
        return choices

    def _keep(self) -> None:
        text = json.dumps(asdict(self._choices))
        write_whole(self._folder / CHOICES, lambda part: part.write_text(text, encoding="utf-8"))

    def _turn(self, page: int) -> None:
        self._page = page
        self._people.refresh()

    @ui.refreshable_method
    def _people(self) -> None:
        people: dict[int, list[dict[str, Any]]] = {}
        for track in self._tracks[(self._page - 1) * SHOWN : self._page * SHOWN]:
            people.setdefault(track["person"], []).append(track)
        for person, tracks in people.items():
            with ui.card().classes("w-full"):
                with ui.row().classes("w-full items-center"):
                    title(f"Person {person}").classes("grow")
                    if any(track["can_swap"] for track in tracks):
                        _Donor(self._faces, self._choices.donors[str(person)], self._with(str(person)))
                for track in tracks:
                    self._track(track)

    def _with(self, person: str) -> Callable[[str], None]:
        """What remembers the donor of a person."""

        def chosen(spec: str) -> None:
            self._choices.donors[person] = spec
            self._keep()

        return chosen

    def _track(self, track: dict[str, Any]) -> None:
        number = str(track["track"])
        ui.separator()
        with ui.row().classes("w-full items-center"):
            with ui.column().classes("gap-0 grow basis-60"):
                title(f"Track {number}", 3)
                ui.label(_about(track)).classes("opacity-70")
                if track["reason"]:
                    ui.label(f"Guise would cover it: {track['reason']}.")
            self._action(track, lambda: line.set_content(self._line(track)))
        with ui.row().classes("gap-1"):
            for place in range(self._job.result["pictures"][number]):
                picture = ui.image(self._studio.url(self._folder / thumbnail(track["track"], place)))
                picture.classes("w-20 h-20 rounded").props(f'alt="Track {number}, picture {place + 1}"')
        with ui.column().classes("w-full gap-0"):
            line = ui.html(self._line(track), sanitize=False).classes("w-full")
            with ui.row().classes("w-full justify-between text-caption opacity-70"):
                ui.label(clock(0))
                ui.label(clock(self._job.result["seconds"]))

    def _action(self, track: dict[str, Any], changed: Callable[[], Any]) -> None:
        actions, number = self._choices.actions, str(track["track"])

        async def choose() -> None:
            action = toggle.value
            if action == actions[number]:
                return
            if action == "leave" and not await agreed(_warning(track), "Show this face", "Keep it hidden"):
                toggle.value = actions[number]
                return
            actions[number] = action
            self._keep()
            changed()
            self._begin.refresh()

        able = {k: word for k, word in ACTIONS.items() if k != "swap" or track["can_swap"]}
        toggle = ui.toggle(able, value=actions[number], on_change=choose)
        toggle.props(f'no-caps role="group" aria-label="What is done with track {number}"')

    def _line(self, track: dict[str, Any]) -> str:
        return timeline(track, self._frames, self._choices.actions[str(track["track"])])

    def _settings(self) -> None:
        with ui.card().classes("w-full"):
            self._one_of("Covers", "cover", COVERS)
            self._one_of("Sound", "audio", SOUNDS)
            with ui.row().classes("items-center w-full no-wrap pr-4"):
                ui.label("Expression").classes("w-24")
                slider = ui.slider(min=0, max=1, step=0.1, value=self._choices.alpha)
                slider.on_value_change(lambda event: self._set("alpha", event.value))
                slider.props('label aria-label="Expression"')
            ui.label("0: only what the donor's own face has done; 1: all of it.").classes("opacity-70")

    def _one_of(self, words: str, name: str, values: dict[str, str]) -> None:
        with ui.row().classes("items-center"):
            ui.label(words).classes("w-24")
            toggle = ui.toggle(values, value=getattr(self._choices, name))
            toggle.on_value_change(lambda event: self._set(name, event.value))
            toggle.props(f'no-caps role="group" aria-label="{words}"')

    def _set(self, name: str, value: Any) -> None:
        setattr(self._choices, name, value)
        self._keep()

    @ui.refreshable_method
    def _begin(self) -> None:
        if left := list(self._choices.actions.values()).count("leave"):
            words = (
                "1 track will show the real face" if left == 1 else f"{left} tracks will show the real faces"
            )
            ui.label(f"{words}, for all to recognise.").classes("text-negative text-bold").props(
                'role="status"'
            )
        ui.button("Render", icon="movie", on_click=lambda: self._render(self._choices))


def title(text: str, level: int = 2) -> ui.label:
    """A heading inside of something."""
    look = "text-h6" if level == 2 else "text-bold"
    return ui.label(text).props(f"role=heading aria-level={level}").classes(look)


def timeline(track: dict[str, Any], frames: int, action: str) -> Html:
    """When a track is seen in a video of so many frames, and how sure Guise is of it; as SVG in the action's colour."""
    first, last = track["frames"]
    curve, colour = track["confidence"], f"rgb{COLOURS[action]}"
    x0, step = 1000 * first / frames, 1000 * (last + 1 - first) / frames / len(curve)
    tops = "".join(f"V{38 - 34 * c:.1f}h{step:.2f}" for c in curve)
    words = f"Track {track['track']}: {_about(track)}; mean confidence {sum(curve) / len(curve):.2f}"
    return tag(
        "svg",
        tag("title", words),
        tag("rect", width=1000, height=40, fill="currentColor", fill_opacity=0.08),
        tag("path", d=f"M{x0:.1f} 38{tops}V38Z", fill=colour, fill_opacity=0.75),
        tag("rect", x=f"{x0:.1f}", y=38, width=f"{step * len(curve):.1f}", height=2, fill=colour),
        viewBox="0 0 1000 40", preserveAspectRatio="none", role="img",
        style="width: 100%; height: 2.5rem; display: block",
    )  # fmt: skip


def _about(track: dict[str, Any]) -> str:
    first, last = map(clock, track["seconds"])
    return f"{first} to {last}, seen in {track['seen']:,} frames, {track['width']:.0f} pixels wide"


def _warning(track: dict[str, Any]) -> str:
    return (
        f"The face of track {track['track']} will be shown as it is in {track['seen']:,} frames, for all to recognise. "
        "Do this only when the person has agreed."
    )


class _Donor:
    """A button that says whose face is shown, and opens a choice of faces."""

    def __init__(self, faces: dict[str, str], spec: str, chosen: Callable[[str], None]) -> None:
        self._faces, self._spec, self._chosen = faces, spec, chosen
        self._button = ui.button(color=None, on_click=self._choose).props("outline no-caps")
        self._show()

    def _show(self) -> None:
        self._button.clear()
        self._button.props["aria-label"] = f"Donor: {self._faces[self._spec]}"
        with self._button, ui.row().classes("items-center no-wrap gap-2"):
            if self._spec:
                picture = ui.image(_portrait(self._spec)).classes("w-8 h-8 rounded shrink-0")
                picture.props("no-spinner no-transition")
            ui.label(f"Donor: {self._faces[self._spec]}").classes("min-w-0 break-words")

    async def _choose(self) -> None:
        with ui.dialog() as dialog, ui.card().classes("w-full"):
            title("Whose face is shown")
            with ui.row().classes("w-full justify-center"):
                for spec, name in self._faces.items():
                    await _offer(spec, name, dialog)
        spec = await answer(dialog)
        if spec is not None:
            self._spec = spec
            self._show()
            self._chosen(spec)


async def _offer(spec: str, name: str, dialog: ui.dialog) -> None:
    button = ui.button(color=None, on_click=lambda: dialog.submit(spec)).props("flat no-caps").classes("w-32")
    button.props["aria-label"] = name
    with button, ui.column().classes("items-center"):
        if spec:
            picture = ui.image(await asyncio.to_thread(_portrait, spec)).classes("w-24 h-24 rounded")
            picture.props("no-spinner no-transition")
        else:
            ui.icon("casino", size="6rem")
        ui.label(name).classes("w-24 break-words")


@lru_cache(maxsize=64)
def _portrait(spec: str) -> str:
    """The neutral face of a donor, as a data URI."""
    look = open_donor(spec).appearance
    data = encode_image(draw(look, look.neutral, face=96), None, ".jpg", {})
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"
