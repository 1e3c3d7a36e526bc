"""The person in a photo, from its file: the landmarks of the largest face, and whether it is fit to be learned from.

Pixels, x right, y down.
"""

from __future__ import annotations

from pathlib import Path

from guise.aam.landmarks import Face, interocular, open_landmarker
from guise.aam.landmarks.plausible import visible_share
from guise.aam.model import Identity
from guise.aam.one_photo import person_in_photo
from guise.aam.solid_shape import SolidPrior
from guise.app.enrolment.enrol import EnrolError
from guise.app.enrolment.quality import weaknesses
from guise.app.media.images import DeepImage, read_deep
from guise.app.media.profiles import ProfileError, converted
from guise.common.arrays import F64, U8
from guise.common.progress import Say, mute

MIN_CONFIDENCE = 0.5
MIN_EYE_DISTANCE = 24  # pixels between the outer eye corners
MIN_VISIBLE_SHARE = 0.9  # of the landmarks, that lie in the picture
MAX_TURN_DEGREES = 45.0  # beyond which half of the face is not seen


def person_of_photo(path: Path, like: Identity, *, name: str | None = None, say: Say = mute) -> Identity:
    """The model of the person in a photo, the largest face if there are several; it says what it is made from.

    like : see `person_in_photo`.   name : the person's, by default that of the file.   say : called with notes.

    Raises
    ------
    MediaError, EnrolError
        When the picture cannot be read, or shows no face that can be used.
    """
    rgb = srgb(read_deep(path))
    face = largest_face(rgb, path.name, say)
    person = person_in_photo(rgb, face, name or path.stem, like)
    weak = weaknesses(face[None], person)
    person.facts.update({"made_from": "one photo", "clips": [path.name], "weaknesses": weak})
    return person


def srgb(image: DeepImage) -> U8:
    """A picture (h, w, 3) as a screen shows it; in its own colours where its profile cannot be used."""
    try:
        return converted(image, None).rgb8()
    except ProfileError:
        return image.rgb8()


def largest_face(rgb: U8, photo: str, say: Say) -> F64:
    """The landmarks (81, 2) of the largest face in a picture (h, w, 3).

    photo : what it is called.   Raises EnrolError when there is none that can be learned from.
    """
    faces: list[Face] = [
        face for face in open_landmarker("builtin").detect(rgb) if face.confidence >= MIN_CONFIDENCE
    ]
    if not faces:
        raise EnrolError(f"no face found in {photo}: use a photo that shows one from the front")
    if len(faces) > 1:
        say(f"{photo} shows {len(faces)} faces; using the largest; crop the photo to use another")
    points: F64 = faces[0].points.astype("float64")
    eyes, turn = float(interocular(points)), SolidPrior.shipped().fit(points).pose.turn
    if visible_share(points, *rgb.shape[1::-1]) < MIN_VISIBLE_SHARE:
        raise EnrolError(f"the face in {photo} is cut off: use a photo that shows the whole face")
    if eyes < MIN_EYE_DISTANCE:
        raise EnrolError(
            f"the face in {photo} is too small, {eyes:.0f} pixels between the outer eye corners instead of at least "
            f"{MIN_EYE_DISTANCE}: use a larger picture of it"
        )
    if turn > MAX_TURN_DEGREES:
        raise EnrolError(
            f"the head in {photo} is turned by {turn:.0f} degrees, more than the {MAX_TURN_DEGREES:.0f} that can be "
            "used: use a photo from the front"
        )
    return points
