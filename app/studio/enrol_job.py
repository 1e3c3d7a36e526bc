"""The job behind the page People: train a person's model on a clip or on photos."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from guise.aam.model import Identity, rename_model
from guise.app.enrolment.file import enrol_file
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.enrolment.options import TrainingChoices
from guise.app.people.kept import free_name
from guise.app.photos.enrol_photos import enrol_photos
from guise.app.studio.option_form import taken
from guise.app.studio.store import preview_of
from guise.app.swapping.file import enrolment_grade
from guise.common.progress import Progress

ENROL_JOB = "enrol"
_MODEL = "model.guise"  # in the job's folder


def enrol_job(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Train on a clip, with the landmarks beside it if there are any, or on photos.

    about : "clip" and "model", paths, or instead of the clip "photos", paths; "name", the person's; "options" of
        `guise enroll`, by name.
    """
    done, options = folder / _MODEL, taken(TrainingChoices, about.get("options", {})).training()
    if photos := list(map(Path, about.get("photos", ()))):
        report = enrol_photos(photos, done, name=about["name"], options=options, progress=progress)
    else:
        clips = [Path(about["clip"])]
        report = enrol_file(
            clips, done, LandmarkSource(), name=about["name"], options=options, progress=progress
        )
    identity = Identity.load(done)
    graded = enrolment_grade(identity)
    return {
        "held_out_error": report.held_out_error, "seconds": report.seconds, "weaknesses": list(report.weaknesses),
        "quality": str(graded or ""),
    }  # fmt: skip


def keep_person(about: dict[str, Any], folder: Path) -> None:
    """Put the model that a job has made among the people, and delete the photos that it was learned from."""
    model = Path(about["model"])
    rename_model(folder / _MODEL, free_name(about["name"], model))
    shutil.move(folder / _MODEL, model)
    for photo in map(Path, about.get("photos", ())):
        photo.unlink(missing_ok=True)
        preview_of(photo).unlink(missing_ok=True)
