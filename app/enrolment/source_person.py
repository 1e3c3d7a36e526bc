"""Who is in the video: a given model, or one enrolled from the video itself, now or when it was swapped before."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from guise.aam.model import Identity
from guise.app.media import MediaError, MediaInput
from guise.app.media.pipes import READ_ONCE, is_pipe
from guise.app.people import kept
from guise.common.progress import Progress, Say


class Learning(Protocol):
    """How somebody is learned, as `guise.app.swapping.report.SwapSettings` says it."""

    @property
    def keep_people(self) -> bool: ...
    @property
    def progress(self) -> Progress: ...
    @property
    def say(self) -> Say: ...


def source_person(
    media: MediaInput, given: Any, like: Identity, settings: Learning, *, anew: bool = False
) -> Identity:
    """The model of the person in a video: the given one, or one enrolled from the video at the resolution of `like`.

    given : Identity, or LandmarkSource for the enrolment.
    anew : enrol even if a model is kept.
    """
    if isinstance(given, Identity):
        return given
    if is_pipe(media.path):
        raise MediaError(READ_ONCE)
    if media.kind == "image":
        from guise.app.enrolment.enrol import EnrolError

        raise EnrolError(
            f"{media.name} is a single image, which isn't enough to enroll a face from: "
            "give the model of the person in it with --source"
        )
    from guise.app.enrolment.landmark_source import landmark_file

    resolution, name = like.reference.resolution, media.path.stem

    def learn() -> Identity:
        from guise.aam.training import TrainingOptions
        from guise.app.enrolment.enrol import enrol

        training = TrainingOptions(resolution=resolution)
        return enrol(
            [media.path], given, name=name, options=training, progress=settings.progress, say=settings.say
        )

    file = given.files[0] if given.files else landmark_file(media.path)
    points = kept.video_key(file) if file is not None else "found"
    details = (resolution, points) if given.landmarker is None else None
    return keep_person(media, details, f"the person in {media.name}", learn, settings, anew=anew)


def keep_person(
    media: MediaInput, details: tuple[object, ...] | None, who: str, learn: Callable[[], Identity], settings: Learning,
    *, anew: bool = False,
) -> Identity:  # fmt: skip
    """The model of a person in a video that an earlier run has kept, or a new one, which is kept if settings say so.

    details : what it depends on besides the video; None if it is not to be kept.   who : the person, in words.
    """
    key = kept.video_key(media.path, *details) if settings.keep_people and details is not None else ""
    known = kept.cached(key, settings.say) if key and not anew else None
    if known is not None:
        settings.say(f"Using the saved model '{known.name}' for {who}.")
        return known
    settings.say(f"enrolling {who}")
    made = learn()
    return _kept(key, made, media.name, who, settings) if key else made


def _kept(key: str, made: Identity, origin: str, who: str, settings: Learning) -> Identity:
    """The model as it is read again, so that the next run gives the same; as it is where it cannot be kept."""
    try:
        path = kept.keep(key, made, origin)
    except OSError as error:
        settings.say(f"The model of {who} was not saved: {error}")
        return made
    settings.say(
        f"Saved the model of {who} for next time in {path.parent}. It is biometric data: guise people delete "
        "removes it."
    )
    return Identity.load(path)
