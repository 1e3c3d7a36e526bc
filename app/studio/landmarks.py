"""The page Landmarks: correct the landmarks of a person's clip by hand, then retrain the model."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

from nicegui import ui

from guise.app.studio.landmark_correction import Correction, landmarks_job, load_correction
from guise.app.studio.landmark_editor import LandmarkEditor
from guise.app.studio.landmark_strip import ClipFrames
from guise.app.studio.site import Studio, empty_state, heading, page, sentence, show_job
from guise.app.studio.store import JobRow, Person, Upload

PATH = "/landmarks"
LANDMARKS_JOB = "landmarks"
UNSAVED_WORK_SECONDS = 600  # for which unsaved work outlives its connection


def register(studio: Studio) -> None:
    """Add the pages and their job."""
    studio.jobs.register(LANDMARKS_JOB, landmarks_job)
    page(studio, PATH, "Landmarks", lambda: _people(studio))
    page(
        studio,
        PATH + "/{id}",
        "Landmarks",
        lambda id: _open(studio, id),
        reconnect_seconds=UNSAVED_WORK_SECONDS,
    )


def _people(studio: Studio) -> None:
    """The choice of a person."""
    ui.label("A model is trained on the landmarks of a clip. Move the wrong ones, then retrain it.")
    clips = {clip.id for clip in studio.store.clips()}
    people = [person for person in studio.store.people() if person.clip in clips]
    if not people:
        words = "Learn somebody from a clip first, and keep the clip."
        with empty_state("face_retouching_off", "No landmarks to correct yet", words):
            ui.link("Learn somebody from a clip", "/people")
    with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2 md:grid-cols-4 mt-4"):
        for person in people:
            with ui.link(target=f"{PATH}/{person.id}").classes("choice"), ui.card().classes("w-full"):
                face = ui.element("img").classes("w-full rounded").props('alt=""')
                face.props["src"] = studio.portrait(str(person.path))
                ui.label(person.name).classes("text-h6 break-all")


def _open(studio: Studio, id: str) -> None:
    """A person's page; the landmarks are found first where that has not been done yet."""
    person = studio.store.person(id)
    clip = studio.store.upload(person.clip or "")
    heading(person.name)
    with ui.column().classes("w-full") as content:
        if landmark_file(clip).exists():
            ui.timer(0, partial(_edit, studio, person, clip), once=True)
        else:
            _find(studio, person, clip, content)


def _find(studio: Studio, person: Person, clip: Upload, content: ui.column) -> None:
    """Find the landmarks, then open the editor."""

    def ended(job: JobRow) -> None:
        content.clear()
        with content:
            if job.state == "done":
                ui.timer(0, partial(_edit, studio, person, clip), once=True)
            else:
                ui.label(sentence(job.sentence or "cancelled"))
                ui.link("Try again", f"{PATH}/{person.id}")

    about = {"clip": str(clip.path), "output": str(landmark_file(clip))}
    running = [j for j in studio.store.jobs() if j.kind == LANDMARKS_JOB and j.about == about and not j.ended]
    ui.label("Finding the landmarks of the clip.")
    show_job(studio, running[0].id if running else studio.jobs.start(LANDMARKS_JOB, about), ended)


async def _edit(studio: Studio, person: Person, clip: Upload) -> None:
    spinner = ui.spinner(size="lg")
    frames, correction = await asyncio.to_thread(_loaded, clip)
    spinner.delete()
    await LandmarkEditor(studio, person, landmark_file(clip), correction, frames).build()


def landmark_file(clip: Upload) -> Path:
    """The landmark file of a clip; training on the clip uses it."""
    return clip.path.with_suffix(".landmarks.npz")


def _loaded(clip: Upload) -> tuple[ClipFrames, Correction]:
    correction = load_correction(landmark_file(clip))
    return ClipFrames(clip.path, correction.pts), correction
