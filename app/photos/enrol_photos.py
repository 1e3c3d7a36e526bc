"""A person's model from one photo, or a few, in a file.

The first photo is the face at rest (`guise.aam.one_photo`); how the person moves is that of other people, and what the
other photos show.  What no photo shows is guessed: teeth and tongue, the face with lids shut, and turned views.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from guise.aam.one_photo import person_in_photo, tracked, with_photos
from guise.aam.training import TrainingOptions
from guise.aam.views import Views
from guise.app.enrolment.file import EnrolReport, saved
from guise.app.enrolment.photo import largest_face, srgb
from guise.app.enrolment.quality import weaknesses
from guise.app.media.file_kind import is_picture
from guise.app.media.images import read_deep
from guise.app.swapping.donors import anybody
from guise.common.files import require_free
from guise.common.progress import Progress, Say, mute, silent
from guise.common.threads import one_thread

MAX_PHOTOS = 9  # more are learned as a clip


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
    options : of which the resolution and the tracker's count.
    progress : called with the stage and the share of it that is done.   say : called with notes for the user.

    Raises
    ------
    GuiseError
        For a user's mistake, such as a photo without a face; no output is then left behind.
    """
    require_free(output, force=force)
    start, number = time.perf_counter(), "one photo" if len(photos) == 1 else f"{len(photos)} photos"
    say(
        f"Enrolled from {number}: teeth, closed eyes and turned views are guessed; a 10-second clip is better. Use it "
        "only with the person's consent."
    )
    pictures = [srgb(read_deep(photo)) for photo in photos]
    shapes = [largest_face(rgb, photo.name, say) for rgb, photo in zip(pictures, photos, strict=True)]
    progress("training", 0.1)
    with one_thread():
        first = person_in_photo(pictures[0], shapes[0], name, anybody().at_resolution(options.resolution))
        others = list(zip(pictures, shapes, strict=True))[1:]
        person = tracked(with_photos(first, others), options.tracker)
    progress("training", 1.0)
    person.facts.update(
        {
            "frames": len(photos), "made_from": number, "clips": [photo.name for photo in photos],
            "views": Views.of(shapes).as_facts(), "weaknesses": weaknesses(np.stack(shapes), person),
        }
    )  # fmt: skip
    for sentence in person.facts["weaknesses"]:
        say(f"{name}: {sentence}")
    return saved(person, output, start)
