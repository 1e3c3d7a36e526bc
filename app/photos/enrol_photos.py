"""A person's model from one photo, or a few.

The first photo is animated by the expressions of a sample clip (`guise.app.photos.animate`), and the model is learned
from that virtual clip as from any other, with the other photos as further frames.  What no photo shows is guessed:
teeth and tongue, the face with lids shut, and turned views.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from guise.aam.training import TrainingOptions
from guise.app.enrolment.enrol import EnrolError
from guise.app.enrolment.file import EnrolReport, enrol_file
from guise.app.enrolment.landmark_source import LandmarkSource, landmark_file
from guise.app.media import EncodeOptions
from guise.app.media.file_kind import is_picture
from guise.common.files import require_free
from guise.common.progress import Progress, Say, mute, silent
from guise.common.samples import samples_folder

DRIVER = Path("p01", "talk.mp4")  # of the sample clips, whose expressions are taken
MAX_PHOTOS = 9  # more are learned as they are, without a virtual clip


def are_photos(files: Sequence[Path]) -> bool:
    """Whether a person is to be learned from photos alone, and there are few of them."""
    return len(files) <= MAX_PHOTOS and all(file.is_file() and is_picture(file) for file in files)


def enrol_photos(
    photos: Sequence[Path], output: Path, *, name: str, options: TrainingOptions = TrainingOptions(),
    force: bool = False, progress: Progress = silent, say: Say = mute,
) -> EnrolReport:  # fmt: skip
    """Train a person's model on photos and write it, marked as made from photos.

    Parameters
    ----------
    photos : of one person, the first at rest and from the front.
    progress : called with the stage and the share of it that is done.   say : called with notes for the user.

    Raises
    ------
    GuiseError
        For a user's mistake, such as a photo without a face; no output is then left behind.
    """
    require_free(output, force=force)
    number = "one photo" if len(photos) == 1 else f"{len(photos)} photos"
    say(
        f"learned from {number}: teeth, shut lids and turned views are guessed, a clip of 10 seconds is better; use it "
        "only if the person agrees"
    )
    driver = samples_folder() / DRIVER
    facts = {"made_from": number, "clips": [photo.name for photo in photos]}
    with tempfile.TemporaryDirectory(prefix="guise-") as folder:
        clip = Path(folder) / "virtual.mp4"
        _animate(driver, photos[0], clip, progress)
        return enrol_file(
            [clip, *photos[1:]], output, LandmarkSource(), name=name, options=options, force=force, facts=facts,
            progress=progress, say=lambda text: say(text.replace(clip.name, photos[0].name)),
        )  # fmt: skip


def _animate(driver: Path, photo: Path, clip: Path, progress: Progress) -> None:
    from guise.analogy.photo import PhotoError  # half a second, which clips don't need
    from guise.app.photos.animate import animate_file
    from guise.app.photos.driving_track import TrackingOptions

    tracking = TrackingOptions(landmarks=landmark_file(driver))
    encode = EncodeOptions(crf=8, preset="ultrafast")
    try:
        animate_file(None, driver, photo, clip, tracking=tracking, encode=encode, progress=progress)
    except PhotoError as error:
        raise EnrolError(str(error).partition(", or give its landmarks")[0]) from error
