"""The job behind the page People: train a person's model on a clip or on photos, and draw it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from guise.aam.model import Identity
from guise.app.enrolment.file import enrol_file
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.media.pictures import save_picture
from guise.app.people.montage import montage
from guise.app.photos.enrol_photos import enrol_photos
from guise.app.studio.store import preview_of
from guise.app.swapping.file import enrolment_grade
from guise.common.progress import Progress

ENROL_JOB = "enrol"
_MODEL, _MONTAGE = "model.guise", "montage.png"  # in the job's folder


def enrol_job(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Train on a clip, with the landmarks beside it if there are any, or on photos.

    about : "clip" and "model", paths, or instead of the clip "photos", paths; "name", the person's.
    """
    done = folder / _MODEL
    if photos := list(map(Path, about.get("photos", ()))):
        report = enrol_photos(photos, done, name=about["name"], progress=progress)
    else:
        clips = [Path(about["clip"])]
        report = enrol_file(clips, done, LandmarkSource(), name=about["name"], progress=progress)
    identity = Identity.load(done)
    save_picture(folder / _MONTAGE, montage(identity))
    graded = enrolment_grade(identity)
    return {
        "held_out_error": report.held_out_error, "seconds": report.seconds, "weaknesses": list(report.weaknesses),
        "quality": str(graded or ""),
    }  # fmt: skip


def keep_person(about: dict[str, Any], folder: Path) -> None:
    """Put the model that a job has made among the people, and delete the photos that it was learned from."""
    model = Path(about["model"])
    (folder / _MONTAGE).replace(model.with_suffix(".png"))
    (folder / _MODEL).replace(model)  # last, because a person is listed as soon as their model exists
    for photo in map(Path, about.get("photos", ())):
        photo.unlink(missing_ok=True)
        preview_of(photo).unlink(missing_ok=True)
