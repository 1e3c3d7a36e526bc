"""The page De-identify: review the people in videos, choose what happens to each face, and render them.

See `guise.app.studio.videos`; the kinds of jobs are "deidentify-review" and "deidentify-render".
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.reach import reach_of_both
from guise.app.deidentify.report.page import COUNTS, HEADLINES
from guise.app.deidentify.run.results import beside
from guise.app.studio.cover_editor import VIEWS, about, picture_of_cover
from guise.app.studio.deidentify_editor import ACTIONS, COVERS, REGIONS, SOUNDS, TrackEditor
from guise.app.studio.deidentify_jobs import REPORTS, DeidentifyChoices, download_name, render, review
from guise.app.studio.option_form import EncodingOptions
from guise.app.studio.site import Studio, choice_row, heading, page, script
from guise.app.studio.store import JobRow, Upload
from guise.app.studio.uploads import CONFIDENTIAL, CONFIDENTIAL_PHOTO, shown
from guise.app.studio.videos import (
    VideoList,
    VideoPage,
    VideoWork,
    banner,
    delete_unused,
    download_row,
    found_videos,
    renderings,
    start_rendering,
)
from guise.app.studio.videos import begin as begin_video

PATH = "/deidentify"
WORK = VideoWork(
    PATH,
    "deidentify-review",
    "deidentify-render",
    "Every face gets another person's face with the same expression, or is covered. You review what was found before "
    f"anything is changed. Everything stays on this computer. {reach_of_both()}",
    "Find faces",
    "You can leave this page and come back.",
    CONFIDENTIAL_PHOTO,
    (DeidentifyOptions, EncodingOptions),
    CONFIDENTIAL,
)
TONES = {"good": "positive", "fair": "warning", "bad": "negative"}
CAVEATS = (
    "Hair, body, clothes, voice and surroundings stay as they are, and a detector can miss a face: watch all of it "
    "before you share it."
)
FACES = {"swap": "Swap", "cover": "Cover"}


def register(studio: Studio) -> None:
    """Add the pages and their jobs."""
    studio.jobs.register(WORK.find, review)
    studio.jobs.register(WORK.render, render)
    delete_unused(studio, WORK)
    page(studio, PATH, "De-identify", lambda: _list(studio))
    page(studio, PATH + "/{id}", "De-identify", lambda id: _ReviewPage(studio, id).build())


def begin(studio: Studio, clip: Upload) -> None:
    """Begin with a video."""
    begin_video(studio, WORK, clip)


def begin_reviewed(studio: Studio, source: Path, output: Path) -> str:
    """Begin with a video of which a review was made on the command line; its page."""
    about = {
        "source": str(source.absolute()), "name": source.stem, "files": {str(source.absolute()): source.name},
        "reviewed": str(output.absolute()), "tracks": str(beside(output.absolute(), ".tracks.json")),
    }  # fmt: skip
    return f"{PATH}/{studio.jobs.start(WORK.find, about)}"


def _list(studio: Studio) -> None:
    videos = VideoList(
        studio, WORK, lambda job: str(job.result["sentence"]), lambda: _for_all(studio, videos)
    )
    videos.build()


def _for_all(studio: Studio, videos: VideoList) -> None:
    """The same choices for all videos that wait for them."""
    ready = [
        job
        for job in found_videos(studio, WORK)
        if job.state == "done" and not renderings(studio, WORK, job.id)
    ]
    if not ready:
        return
    with ui.card().classes("w-full"):
        heading("The same choices for all").classes(remove="mt-4")
        faces = choice_row("Faces", FACES, "swap")
        cover = choice_row("Covers", COVERS, DeidentifyChoices({}, {}).cover)
        audio = choice_row("Sound", SOUNDS, DeidentifyChoices({}, {}).audio)
        region = choice_row("Replaced", REGIONS, DeidentifyChoices({}, {}).region)

        def start() -> None:
            for job in ready:
                folder = studio.store.folder_of(job.id)
                choices = DeidentifyChoices.load(folder)
                choices.cover, choices.audio, choices.region = cover.value, audio.value, region.value
                if faces.value == "cover":
                    choices.actions = dict.fromkeys(choices.actions, "cover")
                choices.save(folder)
                start_rendering(studio, WORK, job, choices, output=job.result["output"])
            videos.entries.refresh()

        ui.button(f"Render all {len(ready)} that are ready", icon="movie", on_click=start)


class _ReviewPage(VideoPage):
    """A video: its progress, its tracks, and its renderings."""

    work = WORK

    def build(self) -> None:
        script("boxes.js")  # in a page that is still being built
        super().build()

    def choices(self) -> None:
        with (
            ui.expansion("Faces", icon="groups", value=not self.made)
            .classes("w-full")
            .props('header-class="text-h6"')
        ):
            self._editor = TrackEditor(self.studio, self.job, self._render)
            self._editor.build()

    def _render(self, choices: DeidentifyChoices) -> None:
        self.render(choices, output=self.job.result["output"])

    def result(self, job: JobRow) -> None:
        tone, headline = HEADLINES[job.result["outcome"]]
        doubts = job.result.get("doubts", [])
        if doubts and tone == "good":
            tone, headline = "fair", "All faces are swapped, some of them poorly"
        banner(f"var(--q-{TONES[tone]})", headline, " ".join([job.result["sentence"], *doubts]))
        folder, output = self.studio.store.folder_of(job.id), job.about["output"]
        with ui.element("div").classes("desk"):
            shown(self.studio, folder / output, "The result").classes("full")
            with ui.column().classes("w-full"):
                _counts(job.result["counts"])
                ui.label(_chosen(DeidentifyChoices(**job.about["choices"]))).classes("opacity-70")
                for problem in job.result["problems"]:
                    ui.label(problem)
                words = {
                    "photo" if self.is_photo else "video": output,
                    "report (HTML)": REPORTS[0],
                    "report (JSON)": REPORTS[1],
                }
                name = job.about["name"]
                download_row(
                    self.studio,
                    {word: (folder / file, download_name(name, file)) for word, file in words.items()},
                )
                ui.link("Open the report", self.studio.url(folder / REPORTS[0]), new_tab=True)
                ui.label(CAVEATS).classes("opacity-70")
        self._finds(folder, job.result.get("covers", []))

    def _finds(self, folder: Path, covers: list[dict[str, Any]]) -> None:
        """What the audit found and covered, which the user may say something of for the next rendering."""
        if not covers:
            return
        with ui.expansion(f"Found by the audit, and covered: {len(covers)}", icon="visibility").classes(
            "w-full"
        ):
            ui.label("Mark what is not a face, or is a face to swap, then render again.")
            for cover in covers:
                with ui.row().classes("w-full items-center"):
                    picture_of_cover(self.studio, folder, cover)
                    ui.label(about(cover)).classes("grow")
                    for action in ("leave", "swap"):
                        button = ui.button(VIEWS[action], on_click=partial(self._say, cover, action))
                        button.props("outline").props["aria-label"] = (
                            f"Cover {cover['number']}: {VIEWS[action]}"
                        )

    async def _say(self, cover: dict[str, Any], action: str) -> None:
        place = {key: cover[key] for key in ("first", "last", "box")} | {
            "at": cover["shown"],
            "action": action,
        }
        await self._editor.covers.say(place)
        ui.notify("Noted. Render again to apply it.")


def _counts(counts: dict[str, int]) -> None:
    columns = [
        {"name": "what", "label": "Frames with", "field": "what", "align": "left"},
        {"name": "count", "label": "Number", "field": "count"},
    ]
    rows = [{"what": words, "count": f"{counts[name]:,}"} for name, words in COUNTS.items()]
    ui.table(columns=columns, rows=rows).props("flat dense hide-bottom").classes("w-full")


def _chosen(choices: DeidentifyChoices) -> str:
    done = list(choices.actions.values())
    faces = ", ".join(f"{done.count(action)} to {action}" for action in ACTIONS if action in done)
    return (
        f"Tracks: {faces or 'none'}. Covers: {COVERS.get(choices.cover, 'a picture').lower()}. "
        f"Expression: {choices.alpha:.1f}. Sound: {SOUNDS[choices.audio].lower()}. "
        f"Replaced: {REGIONS[choices.region].lower()}."
    )
