"""The page De-identify: upload a video, review the people in it, choose what happens to each face, and render it.

All videos are at /deidentify, each one at /deidentify/ID, where ID is that of its job "deidentify-review".  Renderings
are jobs "deidentify-render", which refer to the review in `about`.
"""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime

from nicegui import ui

from guise.app.deidentify.report.page import COUNTS, HEADLINES
from guise.app.studio.deidentify_editor import ACTIONS, COVERS, SOUNDS, TrackEditor, title
from guise.app.studio.deidentify_jobs import REPORTS, Choices, download_name, render, review
from guise.app.studio.dialogs import confirm
from guise.app.studio.site import Studio, heading, page, show_job
from guise.app.studio.store import Clip, JobRow, StudioError
from guise.app.studio.uploads import uploader

PATH = "/deidentify"
REVIEW, RENDER = "deidentify-review", "deidentify-render"
TONES = {"good": "positive", "fair": "warning", "bad": "negative"}
INTRO = (
    "Every face in a video is replaced by another person's, keeping the expression, or is covered. You review what was "
    "found before anything is changed. Everything stays on this computer."
)
CAVEATS = (
    "Hair, body, clothes, voice and surroundings stay as they are, and a detector can miss a face: watch the whole "
    "video before you share it."
)


def register(studio: Studio) -> None:
    """Add the pages and their jobs."""
    studio.jobs.register(REVIEW, review)
    studio.jobs.register(RENDER, render)
    page(studio, PATH, "De-identify", lambda: _list(studio))
    page(studio, PATH + "/{id}", "De-identify", lambda id: _review_page(studio, id))


# -- all videos -----------------------------------------------------------------------------------------------


def _list(studio: Studio) -> None:
    with ui.column().classes("w-full"):
        ui.label(INTRO)
        uploader(studio, "Upload a video", lambda clip: _begin(studio, clip))
        _existing_clips(studio)
        _earlier_reviews(studio)


def _existing_clips(studio: Studio) -> None:
    """The choice of a video that was uploaded before."""
    clips = {clip.id: clip.name for clip in studio.store.clips()}
    if clips:
        with ui.row().classes("w-full items-center no-wrap"):
            chosen = ui.select(clips, label="or choose one uploaded earlier").classes("grow")
            start = ui.button("Find faces", on_click=lambda: _begin(studio, studio.store.clip(chosen.value)))
            start.bind_enabled_from(chosen, "value", bool)


def _earlier_reviews(studio: Studio) -> None:
    reviews = [job for job in studio.store.jobs() if job.kind == REVIEW]
    if reviews:
        heading("Earlier")
        with ui.list().props("bordered separator role=group").classes("w-full"):
            for job in reviews:
                _entry(studio, job)


def _begin(studio: Studio, clip: Clip) -> None:
    id = studio.jobs.start(REVIEW, {"source": str(clip.path), "name": clip.name})
    ui.navigate.to(f"{PATH}/{id}")


def _entry(studio: Studio, job: JobRow) -> None:
    with ui.item().props(f'clickable href="{PATH}/{job.id}" role=link'):
        with ui.item_section():
            ui.item_label(job.about["name"]).classes("break-words")
            ui.item_label(f"{_when(job)} · {_state(studio, job)}").props("caption")
        with ui.item_section().props("side"):
            ui.icon("chevron_right")


def _state(studio: Studio, job: JobRow) -> str:
    """The state of a video in a few words."""
    if job.state != "done":
        return {"failed": job.sentence, "cancelled": "cancelled"}.get(job.state, "finding faces")
    renderings = _renderings(studio, job.id)
    if not renderings:
        return "ready for review"
    return renderings[0].result.get("sentence") or renderings[0].sentence or "rendering"


def _renderings(studio: Studio, id: str) -> list[JobRow]:
    """The renderings of a video, newest first, without cancelled ones."""
    jobs = [job for job in studio.store.jobs() if job.kind == RENDER and job.about["id"] == id]
    return [job for job in jobs if job.state != "cancelled"]


def _when(job: JobRow) -> str:
    return f"{datetime.fromisoformat(job.created).astimezone():%Y-%m-%d %H:%M}"


# -- a video --------------------------------------------------------------------------------------------------


def _review_page(studio: Studio, id: str) -> None:
    review_page = _ReviewPage(studio, id)
    with ui.column().classes("w-full"):
        review_page.build()


class _ReviewPage:
    """A video: its progress, its tracks, and its renderings."""

    def __init__(self, studio: Studio, id: str) -> None:
        self._studio = studio
        self._job = studio.store.job(id)
        if self._job.kind != REVIEW:
            raise StudioError("this video no longer exists: go back to all videos")

    def build(self) -> None:
        """The whole page."""
        with ui.row().classes("w-full items-center"):
            ui.link("All videos", PATH)
            title(self._job.about["name"]).classes("grow break-all")
            ui.button("Delete", icon="delete", color=None, on_click=self._delete).props("flat")
        self._content()

    @ui.refreshable_method
    def _content(self) -> None:
        job = self._job = self._studio.store.job(self._job.id)
        if not job.ended:
            ui.label("You may leave this page and come back.")
            show_job(self._studio, job.id, lambda _: self._content.refresh())
        elif job.state == "done":
            new = not _renderings(self._studio, job.id)
            with (
                ui.expansion("Faces", icon="groups", value=new)
                .classes("w-full")
                .props('header-class="text-h6"')
            ):
                TrackEditor(self._studio, job, self._render).build()
            self._results()
        else:
            _banner("bad", "Nothing was done", job.sentence or "You cancelled it.")

    @ui.refreshable_method
    def _results(self) -> None:
        """The renderings, newest first."""
        for place, job in enumerate(_renderings(self._studio, self._job.id)):
            if not job.ended:
                show_job(self._studio, job.id, lambda _: self._results.refresh())
            elif job.state == "failed":
                _banner("bad", "The rendering failed", job.sentence)
            else:
                with ui.expansion(_when(job), icon="movie", value=place == 0).classes("w-full"):
                    _result(self._studio, job)

    def _render(self, choices: Choices) -> None:
        about = {
            "id": self._job.id, "source": self._job.about["source"], "name": self._job.about["name"],
            "review": str(self._studio.store.folder_of(self._job.id)), "output": self._job.result["output"],
            "choices": asdict(choices),
        }  # fmt: skip
        pending = [job.about for job in _renderings(self._studio, self._job.id) if not job.ended]
        if about not in pending:  # from a double click, or from another tab
            self._studio.jobs.start(RENDER, about)
        self._results.refresh()

    async def _delete(self) -> None:
        question = "Delete the review of this video and all its renderings? The video itself is kept."
        if await confirm(question, "Delete", "Keep"):
            for job in [*_renderings(self._studio, self._job.id), self._job]:
                self._studio.jobs.cancel(job.id)
                self._studio.store.remove_job(job.id)
            ui.navigate.to(PATH)


def _banner(tone: str, headline: str, words: str) -> None:
    with ui.column().classes("w-full gap-1 p-3 border-l-8").props('role="status"') as banner:
        title(headline)
        ui.label(words).classes("break-words")
    banner.style(f"border-color: var(--q-{TONES[tone]})")


# -- a rendering --------------------------------------------------------------------------------------------


def _result(studio: Studio, job: JobRow) -> None:
    tone, headline = HEADLINES[job.result["outcome"]]
    _banner(tone, headline, job.result["sentence"])
    folder, output = studio.store.folder_of(job.id), job.about["output"]
    with ui.row().classes("w-full"):
        video = ui.video(studio.url(folder / output)).classes("grow basis-80")
        video.style("max-height: 70vh").props('aria-label="The rendered video"')
        with ui.column().classes("grow basis-60"):
            _counts(job.result["counts"])
            ui.label(_chosen(Choices(**job.about["choices"]))).classes("opacity-70")
            for problem in job.result["problems"]:
                ui.label(problem)
    with ui.row():
        for name, words in ((output, "video"), (REPORTS[0], "report (HTML)"), (REPORTS[1], "report (JSON)")):
            link = ui.link(f"Download {words}", studio.url(folder / name))
            link.props["download"] = download_name(job.about["name"], name)
        ui.link("Open the report", studio.url(folder / REPORTS[0]), new_tab=True)
    ui.label(CAVEATS).classes("opacity-70")


def _counts(counts: dict[str, int]) -> None:
    columns = [
        {"name": "what", "label": "Frames with", "field": "what", "align": "left"},
        {"name": "count", "label": "Number", "field": "count"},
    ]
    rows = [{"what": words, "count": f"{counts[name]:,}"} for name, words in COUNTS.items()]
    ui.table(columns=columns, rows=rows).props("flat dense hide-bottom").classes("w-full")


def _chosen(choices: Choices) -> str:
    done = list(choices.actions.values())
    faces = ", ".join(f"{done.count(action)} to {action}" for action in ACTIONS if action in done)
    return (
        f"Tracks: {faces or 'none'}. Covers: {COVERS[choices.cover].lower()}. "
        f"Expression: {choices.alpha:.1f}. Sound: {SOUNDS[choices.audio].lower()}."
    )
