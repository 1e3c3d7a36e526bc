"""The work behind the page People, in a process of its own: learn a person's model and draw it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from aam.model import Identity
from app.enrol import LandmarkSource
from app.enrolling import enrol_file
from app.montage import montage
from app.pictures import save_picture
from app.studio.jobs import Progress
from app.studio.naming import called

KIND = "enrol"


def enrol_job(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Train on a clip, with the landmarks that lie beside it if there are any.

    about : "clip" and "model", paths; "called", the clip's name; "name", the person's.
    """
    model, done, clip = Path(about["model"]), folder / "model.guise", Path(about["clip"])
    with called({clip: about["called"]}):
        report = enrol_file([clip], done, LandmarkSource(), name=about["name"], progress=progress)
    save_picture(model.with_suffix(".png"), montage(Identity.load(done)))
    done.replace(model)  # at last, since a person is shown as soon as it is there
    return {"held_out_error": report.held_out_error, "seconds": report.seconds}
