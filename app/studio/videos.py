"""What the pages Swap and De-identify share: a list of videos, a page for each, and a frame before and after.

All videos are at PATH, each one at PATH/ID, where ID is that of the job that found the faces in it.  Renderings are
jobs of another kind, which refer to it in `about`.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from nicegui import events, run, ui

from guise.app.media.file_kind import kind_of
from guise.app.studio.dialogs import confirm
from guise.app.studio.option_form import NO_OPTIONS, OptionForm
from guise.app.studio.pictures import data_url
from guise.app.studio.site import Studio, empty_state, heading, local_time, sentence, show_job
from guise.app.studio.store import CLIP, JobRow, MissingError, Upload
from guise.app.studio.uploads import CLIP as CLIPS
from guise.app.studio.uploads import UploadKind, shown, uploader
from guise.common.arrays import U8
from guise.common.errors import GuiseError
from guise.common.failures import explain
from guise.common.files import write_whole
from guise.common.samples import samples_folder

PREVIEW_WIDTH_PIXELS = 1280
DROP_HINT = "Drop videos or photos here, or paste a picture"
SAMPLE, SAMPLE_FILE = "A sample clip", Path("p01", "talk2.mp4")
_BAD = "var(--q-negative)"

Draw = Callable[
    [int], tuple[U8, U8]
]  # a frame before and after, RGB, by its number; called in another thread


@dataclass(frozen=True)
class VideoWork:
    """What is done with videos on a page.

    Parameters
    ----------
    path : of the page.   find, render : kinds of its jobs.
    intro : above the list.   begin : on the button that begins with a video.   finding : while it is looked through.
    photos, uploads : the kinds of the photos and videos that are uploaded there.   options : classes of its options.
    """

    path: str
    find: str
    render: str
    intro: str
    begin: str
    finding: str
    photos: UploadKind
    options: tuple[type, ...]
    uploads: UploadKind = CLIPS

    @property
    def own(self) -> list[UploadKind]:
        """Kinds of uploads that are on no other page."""
        return [kind for kind in (self.photos, self.uploads) if kind is not CLIPS]


def sample_clip(studio: Studio) -> Upload:
    """The sample clip that comes with Guise, among the clips of the studio; it is kept once."""
    for clip in studio.store.clips():
        if clip.name == SAMPLE:
            return clip
    clip = studio.store.add_upload(CLIP, SAMPLE, SAMPLE_FILE.suffix)
    write_whole(clip.path, (samples_folder() / SAMPLE_FILE).read_bytes())
    return clip


def begin(studio: Studio, work: VideoWork, clip: Upload, options: Mapping[str, Any] = NO_OPTIONS) -> None:
    """Look for faces in a video, and show its page."""
    ui.navigate.to(f"{work.path}/{enqueue(studio, work, clip, options)}")


def enqueue(studio: Studio, work: VideoWork, clip: Upload, options: Mapping[str, Any] = NO_OPTIONS) -> str:
    """Have faces looked for in a video when its turn comes; the id of the job.

    options : by their names on the command line.
    """
    about = {
        "source": str(clip.path), "name": clip.name, "files": {str(clip.path): clip.name}, "options": dict(options),
    }  # fmt: skip
    return studio.jobs.start(work.find, about)


def found_videos(studio: Studio, work: VideoWork) -> list[JobRow]:
    """The videos of a page, newest first, without cancelled ones."""
    return [job for job in studio.store.jobs() if job.kind == work.find and job.state != "cancelled"]


def renderings(studio: Studio, work: VideoWork, id: str) -> list[JobRow]:
    """The renderings of a video, newest first, without cancelled ones."""
    jobs = [job for job in studio.store.jobs() if job.kind == work.render and job.about["id"] == id]
    return [job for job in jobs if job.state != "cancelled"]


def delete(studio: Studio, work: VideoWork, id: str) -> None:
    """Delete all of a video: what was found, its renderings, and the upload, unless that is a clip of another page."""
    jobs = [job.id for job in studio.store.jobs() if id in (job.id, job.about.get("id"))]
    for job in jobs:
        studio.jobs.cancel(job)
    for job in jobs:
        studio.store.remove_job(job)
    delete_unused(studio, work)


def delete_unused(studio: Studio, work: VideoWork) -> None:
    """Delete what was cancelled, and uploads for this work alone of which nothing else is left."""
    for job in studio.store.jobs():
        if job.kind == work.find and job.state == "cancelled":
            studio.store.remove_job(job.id)
    used = {Path(job.about["source"]).name for job in found_videos(studio, work)}
    for upload in (upload for kind in work.own for upload in studio.store.uploads(kind.name)):
        if upload.path.name not in used:
            studio.store.remove_upload(upload.id)


def start_rendering(studio: Studio, work: VideoWork, found: JobRow, choices: Any, **more: str) -> None:
    """Render a video with the user's choices, a dataclass, unless that is waiting or under way already."""
    about = found.about | {
        "id": found.id, "found": str(studio.store.folder_of(found.id)), "choices": asdict(choices),
    } | more  # fmt: skip
    pending = [job.about for job in renderings(studio, work, found.id) if not job.ended]
    if about not in pending:  # from a double click, or from another tab
        studio.jobs.start(work.render, about)


class VideoList:
    """The page of all videos: uploads, clips that are there already, and what was begun with each.

    words : about a finished rendering.   several : what is shown above the list where it holds several videos.
    """

    def __init__(
        self, studio: Studio, work: VideoWork, words: Callable[[JobRow], str],
        several: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        self._studio, self._work, self._words, self._several = studio, work, words, several
        self._chosen = 1  # files of the last upload
        self._form = OptionForm(work.path.strip("/"), work.options)

    def build(self) -> None:
        """The whole page."""
        studio, work = self._studio, self._work
        ui.label(work.intro).classes("mb-4")
        with ui.element("div").classes("desk"):
            with ui.column().classes("w-full"):
                field = uploader(
                    studio,
                    "Choose files",
                    self._uploaded,
                    (work.uploads, work.photos),
                    several=True,
                    hint=DROP_HINT,
                )
                field.on("added", self._count, js_handler="(files) => emit(files.length)")
                self._form.build()
                self._clips()
                sample = ui.button("Try a sample clip", icon="movie")
                sample.on_click(lambda: begin(studio, work, sample_clip(studio))).props("outline")
            with ui.column().classes("w-full"):
                self.entries()

    def _count(self, event: events.GenericEventArguments) -> None:
        self._chosen = int(event.args)

    def _uploaded(self, clip: Upload) -> None:
        """A single file is shown at once, several are queued."""
        if self._chosen == 1:
            begin(self._studio, self._work, clip, self._form.values)
            return
        enqueue(self._studio, self._work, clip, self._form.values)
        self.entries.refresh()

    def _clips(self) -> None:
        clips = {clip.id: clip.name for clip in self._studio.store.clips()}
        if clips:
            with ui.row().classes("w-full items-center no-wrap"):
                chosen = ui.select(clips, label="or choose one uploaded earlier").classes("grow")
                start = ui.button(
                    self._work.begin,
                    on_click=lambda: begin(
                        self._studio, self._work, self._studio.store.upload(chosen.value), self._form.values
                    ),
                )
                start.bind_enabled_from(chosen, "value", bool)

    @ui.refreshable_method
    def entries(self) -> None:
        """What was begun, newest first, each with its progress."""
        delete_unused(self._studio, self._work)
        jobs = found_videos(self._studio, self._work)
        if not jobs:
            empty_state("movie", "Nothing yet", "Videos and photos are listed here, with their progress.")
            return
        heading("Videos and photos").classes(remove="mt-4")
        with ui.list().props("bordered separator role=group").classes("w-full"):
            for job in jobs:
                self._entry(job)
        if len(jobs) > 1:
            self._several()

    def _entry(self, job: JobRow) -> None:
        made = renderings(self._studio, self._work, job.id)
        at_work = next((one for one in (job, *made) if not one.ended), None)
        with ui.item().props(f'clickable href="{self._work.path}/{job.id}" role=link'):
            with ui.item_section():
                ui.item_label(job.about["name"]).classes("break-words")
                ui.item_label(f"{local_time(job.created)} · {self._state(job, made)}").props("caption")
            with ui.item_section().props("side"):
                ui.icon("chevron_right")
        if at_work is not None:
            with ui.item():
                show_job(self._studio, at_work.id, lambda _: self.entries.refresh())

    def _state(self, job: JobRow, made: list[JobRow]) -> str:
        """The state of a video in a few words."""
        if job.state == "failed":
            return sentence(job.sentence)
        if not job.ended:
            return "finding faces"
        if not made:
            return "ready for your choices"
        if made[0].state == "done":
            return self._words(made[0])
        return made[0].sentence or "rendering"


class VideoPage:
    """The page of a video: its progress, what is chosen for it, and its renderings.

    Raises MissingError when there is no such video.
    """

    work: VideoWork

    def __init__(self, studio: Studio, id: str) -> None:
        self.studio = studio
        self.job = studio.store.job(id)
        if self.job.kind != self.work.find:
            raise MissingError("this video no longer exists: go back to all videos")
        self.is_photo = kind_of(Path(self.job.about["source"])) == "image"

    def choices(self) -> None:
        """Let the user choose."""
        raise NotImplementedError

    def result(self, job: JobRow) -> None:
        """Show a finished rendering."""
        raise NotImplementedError

    def build(self) -> None:
        """The whole page."""
        ui.link("All videos and photos", self.work.path)
        with ui.row().classes("w-full items-center no-wrap gap-2 mb-2"):
            title(self.job.about["name"]).classes("grow min-w-0 break-words")
            ui.button("Delete", icon="delete", color=None, on_click=self._delete).props("flat").classes(
                "shrink-0"
            )
        self._content()

    @property
    def made(self) -> list[JobRow]:
        """The renderings, newest first."""
        return renderings(self.studio, self.work, self.job.id)

    @ui.refreshable_method
    def _content(self) -> None:
        job = self.job = self.studio.store.job(self.job.id)
        if not job.ended:
            ui.label("This takes a few seconds." if self.is_photo else self.work.finding)
            show_job(self.studio, job.id, lambda _: self._content.refresh())
            source = Path(job.about["source"])
            if source.is_relative_to(self.studio.store.folder):  # not that of a review on the command line
                shown(self.studio, source, "The file").classes("full")
        elif job.state == "done":
            self.results()
            self.choices()
        else:
            delete_unused(self.studio, self.work)
            self._nothing(job)

    def _nothing(self, job: JobRow) -> None:
        """Why nothing came of a video."""
        if job.state == "cancelled":
            empty_state("block", "Cancelled", "Nothing was done.")
        else:
            why, _, advice = sentence(job.sentence).partition(": ")
            empty_state("search_off", why, advice[:1].upper() + advice[1:]).props('role="status"')

    @ui.refreshable_method
    def results(self) -> None:
        """The renderings, the newest one unfolded."""
        for place, job in enumerate(self.made):
            if not job.ended:
                show_job(self.studio, job.id, lambda _: self.results.refresh())
            elif job.state == "failed":
                banner(_BAD, "The rendering failed", sentence(job.sentence))
            else:
                with ui.expansion(local_time(job.created), icon="movie", value=place == 0).classes("w-full"):
                    self.result(job)

    def render(self, choices: Any, **more: str) -> None:
        """Render the video with the user's choices, and show how far that is."""
        start_rendering(self.studio, self.work, self.job, choices, **more)
        self.results.refresh()
        ui.run_javascript("scrollTo(0, 0)")

    async def _delete(self) -> None:
        store, source = self.studio.store, Path(self.job.about["source"]).name
        is_clip, is_upload = (
            source in {one.path.name for kind in kinds for one in store.uploads(kind.name)}
            for kinds in ([CLIPS], self.work.own)
        )
        kept = "The video itself is kept, on the page People." if is_clip else "The file itself is kept."
        if is_upload:
            kept = "The uploaded file is deleted, too. This cannot be undone."
        question = f"Delete what was found in it and all its renderings? {kept}"
        if await confirm(question, "Delete", "Keep"):
            delete(self.studio, self.work, self.job.id)
            ui.navigate.to(self.work.path)


class FrameComparison:
    """A frame before and after, with a slider between the two and one for the frame.

    Parameters
    ----------
    draw : draws a frame.   last, first : numbers of the last frame, and of the one that is shown first.
    boxed : called with a box that the user draws, x0 y0 x1 y1 as shares of width and height; None: nothing is drawn.
    """

    def __init__(
        self, draw: Draw, last: int, first: int = 0, boxed: Callable[[list[float]], None] | None = None
    ) -> None:
        self._draw = draw
        self._wanted = 0  # counts the changes that a frame is wanted for
        self.drawn = False  # whether there is a frame to be seen
        self._busy = asyncio.Lock()
        with ui.element("div").classes("frame-stage") as self._stage:
            stage = self._stage.props('role="group" aria-label="A frame before and after"')
            self._spinner = ui.spinner(size="4rem")
            self._before = ui.element("img").classes("w-full block").props('alt="Before"')
            self._after = ui.element("img").classes("w-full block absolute top-0 left-0").props('alt="After"')
            self._after.style("clip-path: inset(0 0 0 30%)")
            border = ui.element("div").classes("border-between").style("left: 30%")
            for part in (self._before, self._after, border):  # until there is a frame
                part.bind_visibility_from(self, "drawn")
            if boxed is not None:
                stage.classes("box-stage")
                stage.on("pointerdown", js_handler="(e) => guiseBoxes.begin(e)")
                stage.on("pointermove", js_handler="(e) => guiseBoxes.move(e)")
                said = "(e) => { const box = guiseBoxes.end(e); if (box) emit(box); }"
                stage.on("pointerup", lambda event: boxed(event.args), js_handler=said)
        with ui.row().classes("w-full items-center no-wrap"):
            ui.label("Before and after").classes("w-32 shrink-0")
            share = ui.slider(min=0, max=100, value=30).props('aria-label="Share of the frame before"')
            share.on(
                "update:model-value",
                js_handler=f"(v) => {{ getHtmlElement({self._after.id}).style.clipPath = `inset(0 0 0 ${{v}}%)`; "
                f"getHtmlElement({border.id}).style.left = `${{v}}%`; }}",
            )
        with ui.row().classes("w-full items-center no-wrap") as frames:
            frames.set_visibility(last > 0)
            ui.label("Frame").classes("w-32 shrink-0")
            self._frame = ui.slider(min=0, max=last, value=first).props('label aria-label="Frame"')
            self._frame.on("change", self.update)
        self._said = ui.label().props('role="status"').classes("opacity-70")
        ui.timer(0.05, self.update, once=True)

    @property
    def frame(self) -> int:
        """The number of the frame that is shown."""
        return int(self._frame.value)

    async def update(self) -> None:
        """Draw the frame anew; of several changes while one is drawn, only the last counts."""
        self._wanted += 1
        mine = self._wanted
        async with self._busy:
            if mine != self._wanted:
                return
            self._said.text = "Drawing the frame …"
            self._spinner.set_visibility(True)
            began = time.perf_counter()
            try:
                drawn = await run.io_bound(self._draw, self.frame)
            except GuiseError as error:
                self._said.text = sentence(explain(error)[0])
                return
            finally:
                self._spinner.set_visibility(False)
            if drawn is None:  # the studio is closing
                return
            self._show(*drawn)
            self._said.text = f"Drawn in {time.perf_counter() - began:.1f} s."

    def _show(self, before: U8, after: U8) -> None:
        """Show a frame, as large as the window allows."""
        for image, picture in ((self._before, before), (self._after, after)):
            image.props["src"] = data_url(picture)
            image.update()
        height, width = before.shape[:2]
        self._stage.style(f"max-width: max(18rem, calc((100dvh - 20rem) * {width / height:.4f}))")
        self.drawn = True


def title(text: str, level: int = 2) -> ui.label:
    """A heading within a card or a row."""
    classes = "text-h6" if level == 2 else "text-bold"
    return ui.label(text).props(f"role=heading aria-level={level}").classes(classes)


def banner(colour: str, headline: str, words: str) -> None:
    """What came of something, with a bar in a CSS colour."""
    with ui.column().classes("w-full gap-1 p-3 border-l-8").props('role="status"') as box:
        title(headline)
        ui.label(words).classes("break-words")
    box.style(f"border-color: {colour}")


def download_row(studio: Studio, files: dict[str, tuple[Any, str]]) -> None:
    """Links to files: words -> path and the name under which it is downloaded."""
    for words, (path, name) in files.items():
        link = ui.link(f"Download {words}", studio.url(path))
        link.props["download"] = name
