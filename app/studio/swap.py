"""The page Swap: choose a video, a face for each person in it, look at a frame, and render it.

All videos are at /swap, each one at /swap/ID, where ID is that of its job "swap-find".  Renderings are jobs
"swap-render", which refer to it in `about`.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import run, ui

from guise.app.studio.dialogs import confirm
from guise.app.studio.pictures import data_url
from guise.app.studio.site import Studio, choice_row, heading, page, show_job
from guise.app.studio.store import Clip, JobRow, StudioError
from guise.app.studio.swap_jobs import REPORT, Choices, find, preview, render
from guise.app.studio.uploads import uploader
from guise.app.swapping.donors import assign
from guise.common.errors import GuiseError
from guise.common.failures import explain
from guise.common.files import write_whole
from guise.common.samples import samples_folder

PATH = "/swap"
FIND, RENDER = "swap-find", "swap-render"
INTRO = (
    "Choose a video, then a face for each person in it. Get the consent of the people in the video and of those whose "
    "faces are shown. Everything stays on this computer."
)
OTHERS = {"leave": "Leave", "cover": "Cover", "fictional": "Fictional faces"}
SAMPLE, SAMPLE_FILE = "A sample clip", Path("p01", "talk2.mp4")
PREVIEW_WIDTH_PIXELS = 1280


def register(studio: Studio) -> None:
    """Add the pages and their jobs."""
    studio.jobs.register(FIND, find)
    studio.jobs.register(RENDER, render)
    page(studio, PATH, "Swap", lambda: _list(studio))
    page(studio, PATH + "/{id}", "Swap", lambda id: _SwapPage(studio, id).build())


def _list(studio: Studio) -> None:
    with ui.column().classes("w-full"):
        ui.label(INTRO)
        with ui.row():
            uploader(studio, "Upload a video", lambda clip: _begin(studio, clip))
            ui.button("Try a sample clip", icon="movie", on_click=lambda: _sample(studio)).props("outline")
        clips = {clip.id: clip.name for clip in studio.store.clips()}
        if clips:
            with ui.row().classes("w-full items-center no-wrap"):
                chosen = ui.select(clips, label="or choose one uploaded earlier").classes("grow")
                start = ui.button(
                    "Find people", on_click=lambda: _begin(studio, studio.store.clip(chosen.value))
                )
                start.bind_enabled_from(chosen, "value", bool)
        _earlier(studio)


def _earlier(studio: Studio) -> None:
    jobs = [job for job in studio.store.jobs() if job.kind == FIND and job.state != "cancelled"]
    if jobs:
        heading("Earlier")
        with ui.list().props("bordered separator role=group").classes("w-full"):
            for job in jobs:
                with (
                    ui.item().props(f'clickable href="{PATH}/{job.id}" role=link'),
                    ui.item_section(),
                ):
                    ui.item_label(job.about["name"]).classes("break-words")
                    ui.item_label(job.sentence or f"{len(_renderings(studio, job.id))} renderings").props(
                        "caption"
                    )


def _begin(studio: Studio, clip: Clip) -> None:
    id = studio.jobs.start(FIND, {"source": str(clip.path), "name": clip.name})
    ui.navigate.to(f"{PATH}/{id}")


def _sample(studio: Studio) -> None:
    """Begin with a clip that comes with Guise; it is kept once."""
    kept = [clip for clip in studio.store.clips() if clip.name == SAMPLE]
    if not kept:
        content = (samples_folder() / SAMPLE_FILE).read_bytes()
        kept = [studio.store.add_clip(SAMPLE, ".mp4")]
        write_whole(kept[0].path, content)
    _begin(studio, kept[0])


def _renderings(studio: Studio, id: str) -> list[JobRow]:
    """The renderings of a video, newest first, without cancelled ones."""
    jobs = [job for job in studio.store.jobs() if job.kind == RENDER and job.about["id"] == id]
    return [job for job in jobs if job.state != "cancelled"]


class _SwapPage:
    """A video: its people, a face for each, a frame before and after, and its renderings."""

    def __init__(self, studio: Studio, id: str) -> None:
        self._studio = studio
        self._job = studio.store.job(id)
        if self._job.kind != FIND:
            raise StudioError("this video no longer exists: go back to all videos")
        self._faces: dict[str, str] = {}
        self._wanted = 0  # counts the changes that a preview is wanted for
        self._busy = asyncio.Lock()

    def build(self) -> None:
        """The whole page."""
        with ui.row().classes("w-full items-center"):
            ui.link("All videos", PATH)
            heading(self._job.about["name"]).classes("grow break-all", remove="mt-4")
            ui.button("Delete", icon="delete", color=None, on_click=self._delete).props("flat")
        self._content()

    @ui.refreshable_method
    def _content(self) -> None:
        job = self._job = self._studio.store.job(self._job.id)
        if not job.ended:
            ui.label(
                "People are found and learned, which takes about as long as the video, and 20 seconds for each."
            )
            show_job(self._studio, job.id, lambda _: self._content.refresh())
        elif job.state == "done":
            self._choices()
            self._results()
        else:
            ui.label(job.sentence or "You cancelled it.").props('role="status"')

    # -- who gets whose face ---------------------------------------------------------------------------------------

    def _choices(self) -> None:
        people = self._job.result["people"]
        able = [str(one["number"]) for one in people if not one["why_not"]]
        if able and not self._faces:
            self._faces[able[0]] = assign([1], "auto", seed=0, salt=self._job.about["name"])[1]
        with ui.element("div").classes("w-full grid gap-4"):
            for one in people:
                self._person(one)
        with ui.row() as others:
            self._others = choice_row("Others", OTHERS, "leave")
        self._others.on_value_change(self._changed)
        others.bind_visibility_from(self, "_faces", lambda faces: len(faces) < len(people))
        self._stage()
        ui.button("Swap the video", icon="movie", on_click=self._render)

    def _person(self, one: dict[str, Any]) -> None:
        number = str(one["number"])
        folder = self._studio.store.folder_of(self._job.id)
        with ui.card().classes("w-full"), ui.row().classes("w-full items-start no-wrap"):
            picture = ui.image(self._studio.url(folder / f"{number}.jpg")).classes("w-24 shrink-0")
            picture.props["alt"] = f"Person {number}"
            with ui.column().classes("grow gap-1"):
                ui.label(f"Person {number}").classes("text-bold")
                ui.label(one["why_not"] or f"in {one['frames']} of {self._job.result['frames']} frames")
                if not one["why_not"]:
                    self._gallery(number)

    def _gallery(self, number: str) -> None:
        """Portraits to choose from; the chosen one is pressed."""
        with ui.row().classes("gap-2").props("role=group") as group:
            group.props["aria-label"] = f"Face of person {number}"
            buttons: dict[str, ui.button] = {}
            for spec, name in {"": "own face", **self._studio.faces()}.items():
                with ui.button(color=None, on_click=partial(self._choose, number, spec, buttons)) as button:
                    button.props("outline padding=xs").classes("face")
                    with ui.column().classes("items-center gap-0"):
                        if spec:
                            ui.image(self._studio.portrait(spec)).classes("w-16 h-16").props(
                                'alt="" fit=contain'
                            )
                        else:
                            ui.icon("person").classes("text-4xl h-16")
                        ui.label(name).classes("text-xs w-20 truncate")
                buttons[spec] = button
            self._press(number, buttons)

    async def _choose(self, number: str, spec: str, buttons: dict[str, ui.button]) -> None:
        faces = {key: face for key, face in self._faces.items() if key != number}
        self._faces = faces | ({number: spec} if spec else {})
        self._press(number, buttons)
        await self._changed()

    def _press(self, number: str, buttons: dict[str, ui.button]) -> None:
        for spec, button in buttons.items():
            pressed = spec == self._faces.get(number, "")
            button.props["aria-pressed"] = "true" if pressed else "false"
            button.update()

    def _chosen(self) -> Choices:
        return Choices(dict(sorted(self._faces.items())), self._others.value)

    # -- a frame before and after ----------------------------------------------------------------------------------

    def _stage(self) -> None:
        last = self._job.result["frames"] - 1
        with ui.element("div").classes("w-full relative") as stage:
            stage.props('role="group" aria-label="A frame before and after"')
            self._before = ui.element("img").classes("w-full block").props('alt="Before"')
            self._after = ui.element("img").classes("w-full block absolute top-0 left-0").props('alt="After"')
            self._after.style("clip-path: inset(0 0 0 30%)")
        with ui.row().classes("w-full items-center no-wrap"):
            ui.label("Before and after").classes("w-32 shrink-0")
            share = ui.slider(min=0, max=100, value=30).props('aria-label="Share of the frame before"')
            share.on(
                "update:model-value",
                js_handler=f"(v) => {{ document.getElementById('c{self._after.id}').style.clipPath = "
                "`inset(0 0 0 ${v}%)` }",
            )
        with ui.row().classes("w-full items-center no-wrap"):
            ui.label("Frame").classes("w-32 shrink-0")
            self._frame = ui.slider(min=0, max=last, value=self._job.result["first"]).props(
                'label aria-label="Frame"'
            )
            self._frame.on("change", self._changed)
        self._said = ui.label().props('role="status"').classes("opacity-70")
        ui.timer(0.05, self._changed, once=True)

    async def _changed(self) -> None:
        """Draw the frame anew; of several changes while one is drawn, only the last counts."""
        self._wanted += 1
        mine = self._wanted
        async with self._busy:
            if mine != self._wanted:
                return
            self._said.text = "drawing the frame …"
            began = time.perf_counter()
            source, folder = Path(self._job.about["source"]), self._studio.store.folder_of(self._job.id)
            try:
                drawn = await run.io_bound(
                    preview, source, folder, self._chosen(), int(self._frame.value), PREVIEW_WIDTH_PIXELS
                )
            except GuiseError as error:
                self._said.text = explain(error)[0]
                return
            for image, picture in zip((self._before, self._after), drawn or (), strict=False):
                image.props["src"] = data_url(picture)
                image.update()
            self._said.text = f"Frame {int(self._frame.value)}, drawn in {time.perf_counter() - began:.1f} s."

    # -- the whole video -------------------------------------------------------------------------------------------

    def _render(self) -> None:
        choices = self._chosen()
        if not choices.faces:
            raise StudioError("choose a face for at least one person")
        about = {
            "id": self._job.id, "source": self._job.about["source"], "name": self._job.about["name"],
            "found": str(self._studio.store.folder_of(self._job.id)), "choices": asdict(choices),
        }  # fmt: skip
        if about not in [job.about for job in _renderings(self._studio, self._job.id) if not job.ended]:
            self._studio.jobs.start(RENDER, about)
        self._results.refresh()

    @ui.refreshable_method
    def _results(self) -> None:
        """The renderings, newest first."""
        for job in _renderings(self._studio, self._job.id):
            with ui.card().classes("w-full"):
                if not job.ended:
                    show_job(self._studio, job.id, lambda _: self._results.refresh())
                elif job.state == "failed":
                    ui.label(job.sentence).props('role="status"')
                else:
                    self._result(job)

    def _result(self, job: JobRow) -> None:
        folder, facts = self._studio.store.folder_of(job.id), job.result
        ui.label(_sentence(facts)).props('role="status"')
        with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2"):
            for words, path in (("Before", Path(job.about["source"])), ("After", folder / facts["output"])):
                with ui.column().classes("gap-1"):
                    ui.label(words)
                    video = ui.video(self._studio.url(path)).classes("w-full")
                    video.props["aria-label"] = f"The video {words.lower()}"
        with ui.row().classes("items-center"):
            name = f"{job.about['name']}_swapped"
            for words, file in (("video", facts["output"]), ("report (JSON)", REPORT)):
                link = ui.link(f"Download {words}", self._studio.url(folder / file))
                link.props["download"] = name + Path(file).suffix
            ui.button("Delete", color=None, on_click=partial(self._remove, job)).props("flat")

    def _remove(self, job: JobRow) -> None:
        self._studio.store.remove_job(job.id)
        self._results.refresh()

    async def _delete(self) -> None:
        question = "Delete what was found in this video and all its renderings? The video itself is kept."
        if await confirm(question, "Delete", "Keep"):
            for job in [*_renderings(self._studio, self._job.id), self._job]:
                self._studio.jobs.cancel(job.id)
                self._studio.store.remove_job(job.id)
            ui.navigate.to(PATH)


def _sentence(facts: dict[str, Any]) -> str:
    """What was done, for the user.

    >>> _sentence({"frames": 9, "swapped": 8, "covered": 1, "seconds": 2.0})
    '8 of 9 frames swapped, 1 with a face covered because it was not certain; 2 s.'
    """
    covered = (
        f", {facts['covered']} with a face covered because it was not certain" if facts["covered"] else ""
    )
    return f"{facts['swapped']} of {facts['frames']} frames swapped{covered}; {facts['seconds']:.0f} s."
