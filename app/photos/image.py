"""The expression of one photo put on another: files in, a file out (Song et al. 2007, section VI)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from guise.aam.landmarks import Landmarker, open_landmarker
from guise.analogy.photo import Method, Mouth, PhotoAnalogy
from guise.app.media.images import IMAGE_SUFFIXES, DeepImage, encode_deep
from guise.app.media.pictures import Picture, labelled, sheet
from guise.app.media.synthetic import synthetic_tags
from guise.app.photos.faces import Photo, in_colours_of, lost_by, open_photo, turn_between, warnings
from guise.app.photos.facing import Facing
from guise.common.errors import OutputError
from guise.common.files import require_outputs, write_whole
from guise.common.progress import Say, mute

Role = Literal["s", "s1", "t"]
OPTION = {"s": "--landmarks-s", "s1": "--landmarks-s1", "t": "--landmarks-t"}


@dataclass(frozen=True)
class How:
    """How an expression is carried over.

    Parameters
    ----------
    method : "tents", "ratio" or "warp".   mouth : "fill" or "none".
    strength : of the expression, 1 as it is.
    landmarker : see `guise.aam.landmarks.open_landmarker`.   force : replace existing outputs.
    """

    method: Method = "tents"
    mouth: Mouth = "fill"
    strength: float = 1.0
    landmarker: str = "builtin"
    force: bool = False


USUAL = How()
SLIGHT = 4.0  # degrees between the heads in S and S' that are left in the motion


@dataclass(frozen=True)
class ImageReport:
    """What a run did.

    Parameters
    ----------
    output, montage : what was written.   width, height, bits : of the output.
    setup_seconds : once for S and T; seconds : for the expression.   notes : what was said.
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

    def as_json(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        return asdict(self)

    def __str__(self) -> str:
        """One line for a person to read."""
        return (
            f"{self.output}: {self.width} x {self.height}, {self.method}; {self.setup_seconds:.1f} s to set up, "
            f"{1000 * self.seconds:.0f} ms for the expression"
        )


def analogy_image(
    source: Path, expressive: Path, target: Path, output: Path, how: How = USUAL, *,
    landmarks: dict[Role, Path | None] | None = None, montage: Path | None = None, say: Say = mute,
) -> ImageReport:  # fmt: skip
    """Write `target` with the expression that the person of `source` has in `expressive`.

    Parameters
    ----------
    source, expressive : photos of one person, neutral and not, of any sizes.   target : of another, neutral.
    output : of the target's size; what its format can keep of the target's depth, alpha and profile is kept.
    landmarks : files of landmarks, instead of the landmarker.   montage : all four in a row.
    say : called with notes for the user.

    Raises
    ------
    MediaError, LandmarkError, PhotoError, OutputError
        For a user's mistake; nothing is then left behind.
    """
    require_pictures([output, montage])
    require_outputs([output, montage], [source, expressive, target], force=how.force)
    notes = Notes(say)
    landmarker, files = open_landmarker(how.landmarker), landmarks or {}
    paths: dict[Role, Path] = {"s": source, "s1": expressive, "t": target}
    s, s1, t = (opened(role, path, files.get(role), landmarker, notes) for role, path in paths.items())
    notes.all([*warnings(s, s1, t), *lost_by(output, t.image)])
    s, s1 = in_colours_of(s, t, notes), in_colours_of(s1, t, notes)
    start = time.perf_counter()
    analogy = PhotoAnalogy(
        s.image.pixels, s.points, t.image.pixels, t.points, method=how.method, mouth=how.mouth
    )
    ready = time.perf_counter()
    facing = Facing(s.points)(s1.points) if turn_between(s.points, s1.points) > SLIGHT else None
    made = replace(t.image, pixels=analogy(s1.image.pixels, s1.points, how.strength, facing))
    done = time.perf_counter()
    save(output, made)
    if montage is not None:
        four = [s.image, s1.image, t.image, made]
        save(montage, DeepImage(row(four, ["S", "S'", "T", "T'"]), None, t.image.profile))
    height, width = made.pixels.shape[:2]
    return ImageReport(
        str(output), None if montage is None else str(montage), how.method, how.mouth, how.strength, width, height,
        made.bits, round(ready - start, 4), round(done - ready, 4), tuple(notes.said),
    )  # fmt: skip


class Notes:
    """Says each sentence, and keeps it for the report."""

    def __init__(self, say: Say) -> None:
        self._say = say
        self.said: list[str] = []

    def __call__(self, text: str) -> None:
        self.said.append(text)
        self._say(text)

    def all(self, texts: Sequence[str]) -> None:
        """Say several."""
        for text in texts:
            self(text)


def opened(role: Role, path: Path, landmarks: Path | None, landmarker: Landmarker, say: Say) -> Photo:
    """The photo of a role."""
    return open_photo(path, landmarks, OPTION[role], landmarker, say)


def require_pictures(outputs: Sequence[Path | None]) -> None:
    """Raise OutputError for an output that is no picture by its suffix."""
    for path in filter(None, outputs):
        if path.suffix.lower() not in IMAGE_SUFFIXES:
            raise OutputError(f"{path} must be a picture: name it .png, .jpg, .tif or .webp")


def save(path: Path, image: DeepImage) -> None:
    """Write a picture that is marked as synthetic; it appears only when it is complete."""
    data = encode_deep(image, path.suffix, synthetic_tags())
    write_whole(path, data)


def row(images: Sequence[DeepImage], names: Sequence[str]) -> Picture:
    """Pictures beside each other, with their names, as high as the last."""
    height = images[-1].pixels.shape[0]
    return sheet(
        [[labelled(_as_high(image.rgb8(), height), name) for image, name in zip(images, names, strict=True)]]
    )


def _as_high(picture: Picture, height: int) -> Picture:
    if picture.shape[0] == height:
        return picture
    factor = height / picture.shape[0]
    size = (max(1, round(picture.shape[1] * factor)), height)
    how = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, size, interpolation=how), np.uint8)
