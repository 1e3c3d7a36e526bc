"""Who is in the video: a given model, or one enrolled from the video itself."""

from __future__ import annotations

from typing import Any

from guise.aam.model import Identity
from guise.app.media import MediaInput
from guise.app.swapping.report import SwapError
from guise.app.swapping.settings import SwapSettings


def source_person(media: MediaInput, given: Any, like: Identity, settings: SwapSettings) -> Identity:
    """The model of the person in a video: the given one, or one enrolled from the video at the resolution of `like`.

    given : Identity, or LandmarkSource for the enrolment.
    """
    if isinstance(given, Identity):
        return given
    if media.kind == "image":
        raise SwapError(
            f"{media.name} is a single image, which isn't enough to enrol a face from: "
            "give the model of the person in it with --source"
        )
    from guise.aam.training import TrainingOptions
    from guise.app.enrolment.enrol import enrol

    settings.say(f"enrolling the person in {media.name}")
    training = TrainingOptions(resolution=like.reference.resolution)
    name = media.path.stem
    return enrol(
        [media.path], given, name=name, options=training, progress=settings.progress, say=settings.say
    )
