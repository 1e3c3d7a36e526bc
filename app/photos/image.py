"""Transfers the expression of one photo to another, from files to a file (Song et al. 2007, section VI)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from guise.aam.landmarks import Landmarker, open_landmarker
from guise.analogy.photo import PhotoAnalogy
from guise.app.media.image_writing import encode_deep
from guise.app.media.images import IMAGE_SUFFIXES, DeepImage
from guise.app.media.pictures import Picture, labelled, sheet
from guise.app.media.synthetic import synthetic_tags
from guise.app.photos.faces import (
    Photo,
    PoseNormaliser,
    angle_between_heads,
    format_warnings,
    open_photo,
    quality_warnings,
    to_profile_of,
)
from guise.app.photos.options import AnalogyOptions
from guise.common.errors import OutputError
from guise.common.files import require_outputs, write_whole
from guise.common.progress import NoteLog, Say, mute
from guise.common.report import Report

Role = Literal["s", "s1", "t"]
LANDMARK_OPTIONS = {"s": "--landmarks-s", "s1": "--landmarks-s1", "t": "--landmarks-t"}


DEFAULT_OPTIONS = AnalogyOptions()
NEGLIGIBLE_TURN_DEG = 4.0  # between the heads in S and S', which is not removed


@dataclass(frozen=True)
class ImageReport(Report):
    """The report of a run.

    Parameters
    ----------
    output, montage : files that were written.   width, height, bits : of the output.
    setup_seconds : once for S and T; seconds : for the expression.   notes : for the user.
    """

    output: str
    montage: str | None
    method: str
    mouth: str
    strength: float
    width: int
    height: int
    bits: int
    setup_seconds: float
    seconds: float
    notes: tuple[str, ...] = field(default=())

    def __str__(self) -> str:
        """One line for people."""
        return (
            f"{self.output}: {self.width} x {self.height}, {self.method}; {self.setup_seconds:.1f} s to set up, "
            f"{1000 * self.seconds:.0f} ms for the expression"
        )


def analogy_image(
    source: Path, expressive: Path, target: Path, output: Path, options: AnalogyOptions = DEFAULT_OPTIONS, *,
    landmarks: dict[Role, Path | None] | None = None, montage: Path | None = None, say: Say = mute,
) -> ImageReport:  # fmt: skip
    """Write `target` with the expression that the person of `source` has in `expressive`.

    Parameters
    ----------
    source, expressive : photos of one person, neutral and not, of any sizes.   target : of another, neutral.
    output : of the target's size, with its bit depth, alpha and profile as far as the format allows.
    landmarks : landmark files, instead of the landmarker.   montage : all four in a row.
    say : called with notes for the user.

    Raises
    ------
    MediaError, LandmarkError, PhotoError, OutputError
        For a user's mistake; no output is then left behind.
    """
    require_picture_names([output, montage])
    require_outputs([output, montage], [source, expressive, target], force=options.force)
    notes = NoteLog(say)
    landmarker, files = open_landmarker(options.landmarker), landmarks or {}
    paths: dict[Role, Path] = {"s": source, "s1": expressive, "t": target}
    s, s1, t = (open_role(role, path, files.get(role), landmarker, notes) for role, path in paths.items())
    notes.extend([*quality_warnings(s, s1, t), *format_warnings(output, t.image)])
    s, s1 = to_profile_of(s, t, notes), to_profile_of(s1, t, notes)
    start = time.perf_counter()
    analogy = PhotoAnalogy(
        s.image.pixels, s.points, t.image.pixels, t.points, method=options.method, mouth=options.mouth
    )
    ready = time.perf_counter()
    posed = (
        PoseNormaliser(s.points)(s1.points)
        if angle_between_heads(s.points, s1.points) > NEGLIGIBLE_TURN_DEG
        else None
    )
    made = replace(t.image, pixels=analogy(s1.image.pixels, s1.points, options.strength, posed))
    done = time.perf_counter()
    save_synthetic(output, made)
    if montage is not None:
        four = [s.image, s1.image, t.image, made]
        save_synthetic(montage, DeepImage(draw_row(four, ["S", "S'", "T", "T'"]), None, t.image.profile))
    height, width = made.pixels.shape[:2]
    return ImageReport(
        str(output), None if montage is None else str(montage), options.method, options.mouth, options.strength,
        width, height,
        made.bits, round(ready - start, 4), round(done - ready, 4), tuple(notes.said),
    )  # fmt: skip


def open_role(role: Role, path: Path, landmarks: Path | None, landmarker: Landmarker, say: Say) -> Photo:
    """Read the photo of a role."""
    return open_photo(path, landmarks, LANDMARK_OPTIONS[role], landmarker, say)


def require_picture_names(outputs: Sequence[Path | None]) -> None:
    """Raise OutputError for an output without the suffix of a picture."""
    for path in filter(None, outputs):
        if path.suffix.lower() not in IMAGE_SUFFIXES:
            raise OutputError(f"{path} must be a picture: name it .png, .jpg, .heic, .avif, .tif or .webp")


def save_synthetic(path: Path, image: DeepImage) -> None:
    """Write a picture that is marked as synthetic; it appears only once complete."""
    data = encode_deep(image, path.suffix, synthetic_tags())
    write_whole(path, data)


def draw_row(images: Sequence[DeepImage], names: Sequence[str]) -> Picture:
    """Pictures in a row, with their names, scaled to the height of the last."""
    height = images[-1].pixels.shape[0]
    return sheet(
        [
            [
                labelled(_scale_to_height(image.rgb8(), height), name)
                for image, name in zip(images, names, strict=True)
            ]
        ]
    )


def _scale_to_height(picture: Picture, height: int) -> Picture:
    if picture.shape[0] == height:
        return picture
    factor = height / picture.shape[0]
    size = (max(1, round(picture.shape[1] * factor)), height)
    interpolation = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, size, interpolation=interpolation), np.uint8)
