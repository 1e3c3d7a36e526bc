"""Photos of faces: reading, landmarks (detected or from a file), and checks.

Pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from guise.aam.landmarks import Face, Landmarker, interocular, load_annotations
from guise.aam.landmarks.plausible import visible_share
from guise.aam.landmarks.schemes import RIGID_WEIGHTS
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import align_planar
from guise.analogy.photo import PhotoError
from guise.app.media.image_writing import lost_in
from guise.app.media.images import DeepImage, read_deep
from guise.app.media.profiles import ProfileError, converted
from guise.app.swapping.puppet import PINNED_POINTS, PoseRemover
from guise.common.arrays import F64
from guise.common.progress import Say


@dataclass(frozen=True)
class PhotoLimits:
    """Thresholds of usable photos."""

    min_confidence: float = 0.5  # of a detected face
    min_eye_distance_px: int = 24  # between the outer eye corners
    min_visible_share: float = 0.9  # of the landmarks that lie in the picture
    max_turn_deg: float = 35.0  # to a side, up or down, as measured: a little less than it is
    max_turn_difference_deg: float = 20.0  # between two faces, beyond which the result suffers
    # Between the rigid parts of two faces, inter-ocular distances.  Of 40 people's neutral and smiling photos the same
    # person's differ by 0.008 in the median and 0.018 at most, two people's by 0.019 and by up to 0.04.
    max_shape_distance: float = 0.024


PHOTO_LIMITS = PhotoLimits()


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture of a face.

    Parameters
    ----------
    path : of the file, for messages.   image : with the bit depth of the file.   points : (81, 2) landmarks.
    """

    path: Path
    image: DeepImage
    points: F64

    @property
    def eyes(self) -> float:
        """Pixels between the outer eye corners."""
        return float(interocular(self.points))


def open_photo(path: Path, landmarks: Path | None, option: str, landmarker: Landmarker, say: Say) -> Photo:
    """Read a photo with its landmarks, from a file or of the largest face that the landmarker detects.

    option : of the landmark file, for messages.

    Raises
    ------
    MediaError, LandmarkError, PhotoError
        When the picture cannot be read, or has no usable face.
    """
    image = read_deep(path)
    points = (
        _load_landmarks(landmarks, option, say)
        if landmarks
        else _detect_landmarks(path, image, option, landmarker, say)
    )
    require_usable(points, image.pixels.shape[1], image.pixels.shape[0], str(path), option)
    return Photo(path, image, points)


def to_profile_of(photo: Photo, other: Photo, say: Say) -> Photo:
    """The photo converted to the colour profile of another one; to sRGB when that is grey."""
    return to_profile(photo, other.image.profile if other.image.pixels.ndim == 3 else None, say)


def to_profile(photo: Photo, profile: bytes | None, say: Say) -> Photo:
    """The photo converted to a colour profile, None for sRGB; unchanged if the conversion fails."""
    try:
        return replace(photo, image=converted(photo.image, profile))
    except ProfileError as error:
        say(f"{photo.path.name}: its colour profile cannot be used and is ignored ({error})")
        return photo


def require_usable(points: F64, width: int, height: int, name: str, option: str) -> None:
    """Raise PhotoError when the face of landmarks (81, 2) is cut off, too small or turned too far."""
    eyes = float(interocular(points))
    if visible_share(points, width, height) < PHOTO_LIMITS.min_visible_share:
        raise PhotoError(
            f"the face in {name} is cut off, or its landmarks belong to another picture: use a photo that shows the "
            f"whole face, or correct its landmarks with {option}"
        )
    if eyes < PHOTO_LIMITS.min_eye_distance_px:
        raise PhotoError(
            f"the face in {name} is too small, {eyes:.0f} pixels between the outer eye corners instead of at least "
            f"{PHOTO_LIMITS.min_eye_distance_px}: use a larger picture of it"
        )
    right, down = head_angles(points)
    if max(abs(right), abs(down)) > PHOTO_LIMITS.max_turn_deg:
        side = "to the side" if abs(right) >= abs(down) else "up" if down < 0 else "down"
        raise PhotoError(
            f"the head in {name} is turned {max(abs(right), abs(down)):.0f} degrees {side}, more than the "
            f"{PHOTO_LIMITS.max_turn_deg:.0f} that can be used: use a photo from the front, or correct its landmarks "
            f"with {option}"
        )


def quality_warnings(source: Photo, expressive: Photo, target: Photo) -> list[str]:
    """Warnings about inputs that make a good result unlikely."""
    out = []
    apart = shape_distance(source.points, expressive.points)
    if apart > PHOTO_LIMITS.max_shape_distance:
        out.append(
            f"{source.path.name} and {expressive.path.name} do not look like the same person (eyes and nose differ by "
            f"{100 * apart:.1f} % of the distance of the eyes): the result shows the difference of two faces"
        )
    for one, other in ((source, expressive), (source, target)):
        turn = angle_between_heads(one.points, other.points)
        if turn > PHOTO_LIMITS.max_turn_difference_deg:
            out.append(
                f"the heads in {one.path.name} and {other.path.name} are turned {turn:.0f} degrees apart: use photos "
                "from the same side"
            )
    return out


def format_warnings(output: Path, image: DeepImage) -> list[str]:
    """A warning about what the format of the output does not keep, if any."""
    lost = lost_in(output.suffix, image)
    keeps = "a .png file keeps it" if len(lost) == 1 else "a .png file keeps them"
    return [f"{output.name} does not keep {' and '.join(lost)}: {keeps}"] if lost else []


def head_angles(points: F64) -> tuple[float, float]:
    """Angles by which the head of landmarks (81, 2) is turned to the image right, and down; degrees."""
    frame, remover = pose_remover()
    return remover.angles(frame.align(points) - frame.points)


def angle_between_heads(one: F64, other: F64) -> float:
    """Angle between the heads of landmarks (81, 2), degrees."""
    return float(np.hypot(*(np.array(head_angles(one)) - head_angles(other))))


def shape_distance(one: F64, other: F64) -> float:
    """Weighted RMS distance between the rigid parts of two faces (81, 2), turns removed; inter-ocular distances."""
    frame, remover = pose_remover()
    left = remover.without(frame.align(other) - frame.align(one))
    return float(np.sqrt(RIGID_WEIGHTS @ (left**2).sum(1))) / float(interocular(frame.points))


@cache
def pose_remover() -> tuple[ReferenceFrame, PoseRemover]:
    """The remover of head turns, and its reference frame."""
    frame = ReferenceFrame.canonical(64)
    return frame, PoseRemover(frame)


class PoseNormaliser:
    """Normalises head poses to that of a neutral picture, so that a turn does not count as expression.

    Parameters
    ----------
    neutral : (81, 2) landmarks.
    """

    def __init__(self, neutral: F64) -> None:
        self._frame, self._remover = pose_remover()
        self._neutral, self._rest = neutral, self._frame.align(neutral)
        self._linear = align_planar(self._frame.points, neutral, RIGID_WEIGHTS).linear

    def __call__(self, points: F64) -> F64:
        """Landmarks (81, 2) of another picture, moved to the head pose of the neutral one; the skull does not move."""
        moved = self._remover.without(self._frame.align(points) - self._rest)
        moved[PINNED_POINTS] = 0
        return np.asarray(self._neutral + moved @ self._linear)


def _load_landmarks(file: Path, option: str, say: Say) -> F64:
    annotations = load_annotations(file)
    if len(annotations) != 1:
        raise PhotoError(
            f"{file} contains landmarks of {len(annotations)} frames: give {option} a file for the photo alone"
        )
    if annotations.note:
        say(annotations.note)
    return np.asarray(annotations.points[0], np.float64)


def _detect_landmarks(path: Path, image: DeepImage, option: str, landmarker: Landmarker, say: Say) -> F64:
    faces: list[Face] = [
        f for f in landmarker.detect(image.rgb8()) if f.confidence >= PHOTO_LIMITS.min_confidence
    ]
    if not faces:
        raise PhotoError(
            f"no face found in {path}: use a photo that shows one upright and from the front, or give its landmarks "
            f"with {option}"
        )
    if len(faces) > 1:
        say(f"{path.name} shows {len(faces)} faces; using the largest; choose another with {option}")
    return faces[0].points.astype(np.float64)
