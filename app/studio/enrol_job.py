"""The job behind the page People: train a person's model and draw it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from guise.aam.model import Identity
from guise.app.enrolment.enrol import LandmarkSource
from guise.app.enrolment.file import enrol_file
from guise.app.media.pictures import save_picture
from guise.app.people.montage import montage
from guise.app.studio.naming import user_names
from guise.common.progress import Progress

ENROL_JOB = "enrol"


def enrol_job(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Train on a clip, with the landmarks beside it if there are any.

    about : "clip" and "model", paths; "called", the clip's name; "name", the person's.
    """
    model, done, clip = Path(about["model"]), folder / "model.guise", Path(about["clip"])
    with user_names({clip: about["called"]}):
        report = enrol_file([clip], done, LandmarkSource(), name=about["name"], progress=progress)
    save_picture(model.with_suffix(".png"), montage(Identity.load(done)))
    done.replace(model)  # last, because a person is listed as soon as their model exists
    return {
        "held_out_error": report.held_out_error, "seconds": report.seconds, "weaknesses": list(report.weaknesses),
    }  # fmt: skip
