"""The page Landmarks: a person's clip frame by frame, where points are moved by hand, and the model learned anew."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

from nicegui import ui

from guise.app.studio.correction import Correction, landmarks_job, load_correction
from guise.app.studio.landmark_editor import Editor
from guise.app.studio.landmark_frames import Frames
from guise.app.studio.site import Studio, heading, page, show_job
from guise.app.studio.store import Clip, JobRow, Person

PATH = "/landmarks"
KIND = "landmarks"
PATIENCE = 600  # seconds for which unsaved work outlives its connection


def register(studio: Studio) -> None:
    """Add the pages and what they need done."""
    studio.jobs.register(KIND, landmarks_job)
    page(studio, PATH, "Landmarks", lambda: _people(studio))
    page(studio, PATH + "/{id}", "Landmarks", lambda id: _open(studio, id), patience=PATIENCE)


def _people(studio: Studio) -> None:
    """Whom to correct."""
    ui.label(
        "A model is learned from these points. Where they are wrong, move them, and have the model learned anew."
    )
    clips = {clip.id for clip in studio.store.clips()}
    people = [person for person in studio.store.people() if person.clip in clips]
    if not people:
        ui.label("There is nobody whose clip is still here.")
        ui.link("Learn a person from a clip", "/people")
    with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2"):
        for person in people:
            with ui.link(target=f"{PATH}/{person.id}").classes("no-underline text-inherit"), ui.card():
                ui.label(person.name).classes("text-h6 break-all")
                ui.image(studio.url(person.montage)).classes("w-full").props["alt"] = ""


def _open(studio: Studio, id: str) -> None:
    """A person's page: the landmarks are found first where that was not done yet."""
    person = studio.store.person(id)
    clip = studio.store.clip(person.clip or "")
    heading(person.name)
    with ui.column().classes("w-full") as desk:
        if landmark_file(clip).exists():
            ui.timer(0, partial(_begin, studio, person, clip), once=True)
        else:
            _find(studio, person, clip, desk)


def _find(studio: Studio, person: Person, clip: Clip, desk: ui.column) -> None:
    """Find the landmarks, then begin."""

    def ended(job: JobRow) -> None:
        desk.clear()
        with desk:
            if job.state == "done":
                ui.timer(0, partial(_begin, studio, person, clip), once=True)
            else:
                ui.label(job.sentence or "Cancelled.")
                ui.link("Try again", f"{PATH}/{person.id}")

    about = {"clip": str(clip.path), "output": str(landmark_file(clip))}
    running = [j for j in studio.store.jobs() if j.kind == KIND and j.about == about and not j.ended]
    ui.label("The landmarks of the clip are being found.")
    show_job(studio, running[0].id if running else studio.jobs.start(KIND, about), ended)


async def _begin(studio: Studio, person: Person, clip: Clip) -> None:
    spinner = ui.spinner(size="lg")
    frames, correction = await asyncio.to_thread(_loaded, clip)
    spinner.delete()
    await Editor(studio, person, landmark_file(clip), correction, frames).build()


def landmark_file(clip: Clip) -> Path:
    """Where the landmarks of a clip lie; learning from the clip finds them there."""
    return clip.path.with_suffix(".landmarks.npz")


def _loaded(clip: Clip) -> tuple[Frames, Correction]:
    correction = load_correction(landmark_file(clip))
    return Frames(clip.path, correction.pts), correction
