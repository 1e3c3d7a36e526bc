"""Photos with a face each: read, their landmarks found or taken from a file, and judged.

Pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from guise.aam.landmarks import Face, Landmarker, interocular, load_annotations
from guise.aam.landmarks.plausible import visible_share
from guise.aam.reference import RIGID_WEIGHTS, ReferenceFrame
from guise.analogy.photo import PhotoError
from guise.app.media.images import DeepImage, lost_in, read_deep
from guise.app.media.profiles import ProfileError, converted
from guise.app.swapping.puppet import PoseRemover
from guise.common.arrays import F64
from guise.common.progress import Say

CONFIDENT = 0.5  # from which a found face is taken for one
LEAST_EYES = 24  # pixels between the outer eye corners
LEAST_VISIBLE = 0.9  # share of the landmarks that must lie in the picture
MOST_TURN = 35.0  # degrees to a side, up or down, as they are measured: a little less than they are
TURN_APART = 20.0  # degrees between two faces from which the result suffers
# Between what does not move in two faces, inter-ocular distances.  Of 40 people's neutral and smiling photos the same
# person's differ by 0.008 in the median and 0.018 at most, two people's by 0.019 and by up to 0.04.
SHAPES_APART = 0.024


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture of a face.

    Parameters
    ----------
    path : of the file, for sentences.   image : as deep as stored.   points : (81, 2) landmarks.
    """

    path: Path
    image: DeepImage
    points: F64

    @property
    def eyes(self) -> float:
        """Pixels between the outer eye corners."""
        return float(interocular(self.points))


def open_photo(path: Path, landmarks: Path | None, option: str, landmarker: Landmarker, say: Say) -> Photo:
    """Read a photo; its landmarks come from a file, or else from the landmarker, which takes the largest face.

    option : by which the user gives the file, for sentences.

    Raises
    ------
    MediaError, LandmarkError, PhotoError
        When there is no picture, or no face in it that can be used.
    """
    image = read_deep(path)
    points = _given(landmarks, option, say) if landmarks else _found(path, image, option, landmarker, say)
    require_usable(points, image.pixels.shape[1], image.pixels.shape[0], str(path), option)
    return Photo(path, image, points)


def in_colours_of(photo: Photo, other: Photo, say: Say) -> Photo:
    """The photo in the colours of another one's profile; of sRGB when that is grey."""
    return in_colours(photo, other.image.profile if other.image.pixels.ndim == 3 else None, say)


def in_colours(photo: Photo, profile: bytes | None, say: Say) -> Photo:
    """The photo in the colours of a profile, None for sRGB; as it is where that cannot be done."""
    try:
        return replace(photo, image=converted(photo.image, profile))
    except ProfileError as error:
        say(f"{photo.path.name}: its colour profile was not used, as it cannot be ({error})")
        return photo


def require_usable(points: F64, width: int, height: int, name: str, option: str) -> None:
    """Raise PhotoError when landmarks (81, 2) of a picture do not suffice, or make no face to be seen."""
    eyes = float(interocular(points))
    if visible_share(points, width, height) < LEAST_VISIBLE:
        raise PhotoError(
            f"the face in {name} is cut off, or its landmarks are those of another picture: use a photo that shows all "
            f"of the face, or correct its landmarks with {option}"
        )
    if eyes < LEAST_EYES:
        raise PhotoError(
            f"the face in {name} is too small, {eyes:.0f} pixels between the outer eye corners instead of at least "
            f"{LEAST_EYES}: use a larger picture of it"
        )
    right, down = turned(points)
    if max(abs(right), abs(down)) > MOST_TURN:
        side = "to the side" if abs(right) >= abs(down) else "up" if down < 0 else "down"
        raise PhotoError(
            f"the head in {name} is turned {max(abs(right), abs(down)):.0f} degrees {side}, more than the "
            f"{MOST_TURN:.0f} that can be used: use a photo from the front, or correct its landmarks with {option}"
        )


def warnings(source: Photo, expressive: Photo, target: Photo) -> list[str]:
    """Sentences on what makes a good result unlikely."""
    out = []
    apart = shapes_apart(source.points, expressive.points)
    if apart > SHAPES_APART:
        out.append(
            f"{source.path.name} and {expressive.path.name} do not look like the same person (eyes and nose differ by "
            f"{100 * apart:.1f} % of the distance of the eyes): the result shows the difference of two faces"
        )
    for one, other in ((source, expressive), (source, target)):
        turn = turn_between(one.points, other.points)
        if turn > TURN_APART:
            out.append(
                f"the heads in {one.path.name} and {other.path.name} are turned {turn:.0f} degrees apart: better "
                "take photos from the same side"
            )
    return out


def lost_by(output: Path, image: DeepImage) -> list[str]:
    """A sentence on what the output's format does not keep, or none."""
    lost = lost_in(output.suffix, image)
    keeps = "a .png file keeps it" if len(lost) == 1 else "a .png file keeps them"
    return [f"{output.name} does not keep {' and '.join(lost)}: {keeps}"] if lost else []


def turned(points: F64) -> tuple[float, float]:
    """Degrees by which the head of landmarks (81, 2) is turned to the image right, and down."""
    frame, remover = pose_remover()
    return remover.angles(frame.align(points) - frame.points)


def turn_between(one: F64, other: F64) -> float:
    """Degrees between the heads of landmarks (81, 2)."""
    return float(np.hypot(*(np.array(turned(one)) - turned(other))))


def shapes_apart(one: F64, other: F64) -> float:
    """Weighted root mean square between what does not move in two faces (81, 2), turns left out; inter-oculars."""
    frame, remover = pose_remover()
    left = remover.without(frame.align(other) - frame.align(one))
    return float(np.sqrt(RIGID_WEIGHTS @ (left**2).sum(1))) / float(interocular(frame.points))


@cache
def pose_remover() -> tuple[ReferenceFrame, PoseRemover]:
    """What knows about turned heads, and the frame that it does so in."""
    frame = ReferenceFrame.canonical(64)
    return frame, PoseRemover(frame)


def _given(file: Path, option: str, say: Say) -> F64:
    annotations = load_annotations(file)
    if len(annotations) != 1:
        raise PhotoError(
            f"{file} holds landmarks of {len(annotations)} frames: give {option} those of the photo alone"
        )
    if annotations.note:
        say(annotations.note)
    return np.asarray(annotations.points[0], np.float64)


def _found(path: Path, image: DeepImage, option: str, landmarker: Landmarker, say: Say) -> F64:
    faces: list[Face] = [f for f in landmarker.detect(image.rgb8()) if f.confidence >= CONFIDENT]
    if not faces:
        raise PhotoError(
            f"no face found in {path}: use a photo that shows one upright and from the front, or give its landmarks "
            f"with {option}"
        )
    if len(faces) > 1:
        say(f"{path.name} shows {len(faces)} faces; the largest is taken, another one with {option}")
    return faces[0].points.astype(np.float64)
