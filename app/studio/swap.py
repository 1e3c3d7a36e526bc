"""The page Swap: choose a video, a face for each person in it, look at a frame, and render it.

See `guise.app.studio.videos`; the kinds of jobs are "swap-find" and "swap-render".
"""

from __future__ import annotations

import json
import shutil
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from guise.app.media.file_kind import kind_of
from guise.app.studio.dialogs import confirm
from guise.app.studio.portraits import Portraits
from guise.app.studio.site import Studio, choice_row, page
from guise.app.studio.store import JobRow, StudioError, Upload, preview_of
from guise.app.studio.swap_jobs import OPTIONS, REPORT, SwapChoices, find, preview, render
from guise.app.studio.uploads import FACE_PHOTO, SWAP_PHOTO, shown, uploader
from guise.app.studio.videos import (
    PREVIEW_WIDTH_PIXELS,
    SAMPLE,
    FrameComparison,
    VideoList,
    VideoPage,
    VideoWork,
    download_row,
    start_rendering,
)
from guise.app.studio.videos import begin as begin_video
from guise.app.swapping.donors import assign
from guise.common.arrays import U8
from guise.common.files import write_json

PATH = "/swap"
WORK = VideoWork(
    PATH,
    "swap-find",
    "swap-render",
    "Choose a face for each person in a video or a photo. Ask these people first, and those whose faces you show. "
    "Everything stays on this computer.",
    "Find people",
    "Finding and learning people takes about as long as the video, and 20 seconds for each of them.",
    SWAP_PHOTO,
    OPTIONS,
)
FACES = "faces.json"  # in a finding's folder: photos of faces that the user has added, path -> name
MODES = {"swap": "Swap faces", "puppet": "Puppet"}
OTHERS = {"leave": "Leave", "cover": "Cover", "fictional": "Fictional faces"}
FACE = "swap_face"  # the setting: whose face is proposed first, chosen on the page People


def register(studio: Studio) -> None:
    """Add the pages and their jobs."""
    studio.jobs.register(WORK.find, find)
    studio.jobs.register(WORK.render, render)
    page(studio, PATH, "Swap", lambda: VideoList(studio, WORK, _words).build())
    page(studio, PATH + "/{id}", "Swap", lambda id: _SwapPage(studio, id).build())


def begin(studio: Studio, clip: Upload) -> None:
    """Begin with a video."""
    begin_video(studio, WORK, clip)


class _SwapPage(VideoPage):
    """A video: its people, a face for each, a frame before and after, and its renderings."""

    work = WORK

    def __init__(self, studio: Studio, id: str) -> None:
        super().__init__(studio, id)
        self._faces: dict[str, str] = {}
        self._added = studio.store.folder_of(id) / FACES

    # -- who gets whose face ---------------------------------------------------------------------------------------

    def choices(self) -> None:
        people = self.job.result["people"]
        able = [str(one["number"]) for one in people if not one["why_not"]]
        if able and not self._faces:
            self._faces[able[0]] = self._proposed()
        if able and self.job.about["name"] == SAMPLE and not self.made:
            start_rendering(self.studio, WORK, self.job, SwapChoices(dict(self._faces)))
        with ui.element("div").classes("desk"):
            with ui.column().classes("picture w-full"):
                self._frame = FrameComparison(
                    self._draw, self.job.result["frames"] - 1, self.job.result["first"]
                )
            with ui.column().classes("w-full"):
                uploader(self.studio, "Another face, from a photo", self._add_face, (FACE_PHOTO,))
                self._people()
                with ui.row() as modes:
                    self._mode = choice_row("Mode", MODES, "swap")
                modes.set_visibility(not self.is_photo)
                with ui.row() as others:
                    self._others = choice_row("Others", OTHERS, "leave")
                others.bind_visibility_from(self, "_faces", lambda faces: len(faces) < len(people))
                for choice in (self._mode, self._others):
                    choice.on_value_change(self._frame.update)
                with ui.element("div").classes("act w-full"):
                    words = "Swap the photo" if self.is_photo else "Swap the video"
                    ui.button(words, icon="movie", on_click=self._render).classes("w-full")

    def _proposed(self) -> str:
        face = self.studio.store.setting(FACE)
        if face in self.studio.faces():
            return str(face)
        return assign([1], "auto", seed=0, salt=self.job.about["name"])[1]

    @ui.refreshable_method
    def _people(self) -> None:
        for one in self.job.result["people"]:
            self._person(one)

    def _own_faces(self) -> dict[str, str]:
        """Faces that were added from photos: path -> name."""
        found: dict[str, str] = (
            json.loads(self._added.read_text(encoding="utf-8")) if self._added.exists() else {}
        )
        return found

    async def _add_face(self, upload: Upload) -> None:
        """Offer the face of a photo, which is kept with the video."""
        question = f"Did the person in {upload.name} agree to have their face shown?"
        agreed = await confirm(question, "Yes, or it is me", "No", "primary")
        path = self._added.with_name(upload.path.name)
        if agreed:
            shutil.copyfile(upload.path, path)
            shutil.copyfile(upload.preview, preview_of(path))
        self.studio.store.remove_upload(upload.id)
        if not agreed:
            return
        write_json(self._added, self._own_faces() | {str(path): upload.name})
        able = [str(one["number"]) for one in self.job.result["people"] if not one["why_not"]]
        if len(able) == 1:
            await self._choose(able[0], str(path))
        self._people.refresh()

    def _person(self, one: dict[str, Any]) -> None:
        number = str(one["number"])
        folder = self.studio.store.folder_of(self.job.id)
        with ui.card().classes("w-full"):
            with ui.row().classes("items-center no-wrap"):
                picture = ui.image(self.studio.url(folder / f"{number}.jpg")).classes("w-20 shrink-0 rounded")
                picture.props["alt"] = f"Person {number}"
                with ui.column().classes("gap-0"):
                    ui.label(f"Person {number}").classes("text-bold")
                    seen = (
                        "" if self.is_photo else f"in {one['frames']} of {self.job.result['frames']} frames"
                    )
                    ui.label(one["why_not"] or seen)
            if not one["why_not"]:
                faces = {"": "Own face", **self._own_faces(), **self.studio.faces()}
                chosen, label = self._faces.get(number, ""), f"Face of person {number}"
                Portraits(self.studio, faces, chosen, label, partial(self._choose, number))

    async def _choose(self, number: str, spec: str) -> None:
        faces = {key: face for key, face in self._faces.items() if key != number}
        self._faces = faces | ({number: spec} if spec else {})
        await self._frame.update()

    def _chosen(self) -> SwapChoices:
        return SwapChoices(dict(sorted(self._faces.items())), self._others.value, self._mode.value)

    # -- the whole video -------------------------------------------------------------------------------------------

    def _draw(self, frame: int) -> tuple[U8, U8]:
        source, folder = Path(self.job.about["source"]), self.studio.store.folder_of(self.job.id)
        options = self.job.about.get("options", {})
        return preview(source, folder, self._chosen(), frame, PREVIEW_WIDTH_PIXELS, options)

    def _render(self) -> None:
        choices = self._chosen()
        if not choices.faces:
            raise StudioError("choose a face for at least one person")
        self.render(choices)

    def result(self, job: JobRow) -> None:
        folder, facts = self.studio.store.folder_of(job.id), job.result
        before, after = Path(job.about["source"]), folder / facts["output"]
        with ui.element("div").classes("desk"):
            shown(self.studio, after, "The result").classes("full")
            with ui.column().classes("w-full"):
                ui.label(_sentence(facts, self.is_photo)).props('role="status"')
                ui.label(
                    "The file is marked as synthetic. When you share it, tell people it is synthetic."
                ).classes("opacity-70")
                for words in _qualities(facts):
                    ui.label(words)
                download_row(self.studio, {
                    words: (folder / file, f"{job.about['name']}_swapped" + Path(file).suffix)
                    for words, file in (
                        ("photo" if self.is_photo else "video", facts["output"]), ("report (JSON)", REPORT),
                    )
                })  # fmt: skip
                ui.label("Original:")
                shown(self.studio, before, "The original").classes("w-full rounded")
                delete = ui.button("Delete this rendering", icon="delete", color=None)
                delete.on_click(partial(self._remove, job)).props("flat")

    def _remove(self, job: JobRow) -> None:
        self.studio.store.remove_job(job.id)
        self.results.refresh()


def _words(job: JobRow) -> str:
    """What was done, in the list."""
    return _sentence(job.result, kind_of(Path(job.about["source"])) == "image")


def _qualities(facts: dict[str, Any]) -> list[str]:
    """A sentence about the quality of each swap."""
    graded = [
        (f"Person {one['number']}: quality", one) for one in facts.get("people", ()) if one.get("grade")
    ]
    graded += [("Quality", facts)] if facts.get("grade") else []
    return [
        f"{words} {one['grade']} of 100{'; ' * bool(one['advice'])}{one['advice']}." for words, one in graded
    ]


def _sentence(facts: dict[str, Any], photo: bool = False) -> str:
    """What was done, for the user.

    >>> _sentence({"frames": 9, "swapped": 8, "covered": 1, "seconds": 2.0})
    '8 of 9 frames swapped, 1 with a face covered because it was not certain; 2 s.'
    """
    if photo:
        doubts = " A face is covered because it was not certain." if facts["covered"] else ""
        return f"Photo swapped in {facts['seconds']:.1f} s.{doubts}"
    covered = (
        f", {facts['covered']} with a face covered because it was not certain" if facts["covered"] else ""
    )
    return f"{facts['swapped']} of {facts['frames']} frames swapped{covered}; {facts['seconds']:.0f} s."
