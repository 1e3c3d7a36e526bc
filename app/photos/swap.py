"""Swap the faces of a photo: an array, or a file, which goes the way of a video of several people.

Nothing is needed of the people in the photo, and of a donor one photo is enough.  Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from guise.aam.model import Identity
from guise.app.media.file_kind import is_picture
from guise.app.swapping.file import swap_file
from guise.app.swapping.report import DEFAULTS, PersonOutcome, SwapError, SwapReport, SwapSettings
from guise.common.arrays import U8

if TYPE_CHECKING:
    from guise.app.enrolment.landmark_source import LandmarkSource
    from guise.app.people.found import VideoPeople
    from guise.app.swapping.several import Casting


def swap_any(
    file: Path, identity: Identity, output: Path, *, source: Identity | LandmarkSource,
    settings: SwapSettings = DEFAULTS,
) -> SwapReport:  # fmt: skip
    """As `swap_file`; of a photo whose person has no model, the largest face is swapped."""
    if is_picture(file) and not isinstance(source, Identity):
        from guise.app.swapping.several import Casting, swap_people

        if source.files or source.landmarker is not None:
            raise SwapError(f"the landmarks of {file.name} are found, as it is a photo: give none")
        return swap_people(file, Casting({"largest": identity}), output, settings=settings)
    return swap_file(file, identity, output, source=source, settings=settings)


@dataclass(frozen=True, eq=False)
class SwappedPhoto:
    """A photo with other faces.

    Parameters
    ----------
    picture : (h, w, 3) RGB uint8; outside the drawn faces the photo's own pixels.
    people : what was done with everybody, larger faces first.
    found : where they are: `found.people[k].box`es and points, in pixels.
    """

    picture: U8
    people: tuple[PersonOutcome, ...]
    found: VideoPeople


def swap_photo(
    photo: U8,
    faces: Identity | Casting,
    *,
    settings: SwapSettings = DEFAULTS,
    found: VideoPeople | None = None,
) -> SwappedPhoto:
    """A photo with a face on its largest head, or with faces on those that are said.

    Parameters
    ----------
    photo : (h, w, 3) RGB uint8; it isn't changed.
    faces : the face of the largest head, or who gets which, as for a video with several people: "left", "right",
        "largest", a number from 1 (larger faces first), or a model.
    settings : of which `look` and `unsure` count; who cannot be drawn for certain is covered unless that is "leave".
    found : what `people_in_photo` has found in it, so that it isn't done again.

    Raises
    ------
    SwapError
        When there is no face, or none could be drawn.
    GuiseError
        For another mistake, such as a name that is nobody's.

    Examples
    --------
    >>> import numpy as np
    >>> from guise.app.swapping.donors import open_face
    >>> swap_photo(np.zeros((90, 120, 3), np.uint8), open_face("Mei"))
    Traceback (most recent call last):
    guise.app.swapping.report.SwapError: no face is seen in the photo: use a photo that shows one more clearly
    """
    from guise.app.swapping.several import Casting, draw_photo

    casting = Casting({"largest": faces}) if isinstance(faces, Identity) else faces
    return SwappedPhoto(*draw_photo(photo, casting, found=found, settings=settings))
