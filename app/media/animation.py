"""Files of several pictures: animated GIF, WebP, PNG and AVIF, pages of TIFF, views of MPO."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from guise.app.media import ifd
from guise.app.media.errors import MediaError
from guise.app.media.file_kind import FileKind, format_of, views
from guise.app.media.images import CMYK, DeepImage, fitting, reading_errors, require_plain, shown
from guise.app.media.problems import ProblemLog

TIME_BASE = Fraction(
    1, 90_000
)  # of animations: whole for hundredths and thousandths of a second, and most rates
_NO_DELAY = Fraction(1, 10)  # seconds that players show a picture whose delay is 0


class Pictures:
    """The pictures of a file: iterate for each with its delay, in units of TIME_BASE; that of a page is 0.

    count : number, once the first was read.   plays : how often an animation is played, 0 for ever.
    has_alpha : whether an animation's pictures may be transparent.   profile : its ICC profile, or None.
    problems : what went wrong, in sentences; a damaged file ends where it cannot be read.
    """

    count = plays = 0
    has_alpha = False
    profile: bytes | None = None

    def __init__(self, path: Path, kind: FileKind, problems: ProblemLog) -> None:
        self.path, self.problems = path, problems
        self._moves = kind == "animation"

    def __iter__(self) -> Iterator[tuple[DeepImage, int]]:
        read = 0
        try:
            for picture in self._animated() if self._moves else self._pages():
                yield picture
                read += 1
        except MediaError:
            raise
        except reading_errors():
            self.problems.note_damage(
                f"{self.path.name} is damaged after {read} of its pictures; the rest is missing."
            )

    def _animated(self) -> Iterator[tuple[DeepImage, int]]:
        """Each picture and its delay in units of time_base."""
        from PIL import Image

        with Image.open(self.path) as file:
            picture: Any = file
            first = 1 if getattr(picture, "default_image", False) else 0  # what is shown where nothing moves
            self.count = _count(picture) - first
            self.plays, self.profile = _plays(picture), file.info.get("icc_profile")
            self.has_alpha = picture.has_transparency_data and not self._is_opaque_webp()
            for number in range(first, first + self.count):
                picture.seek(number)
                rgba = np.asarray(picture.convert("RGBA" if self.has_alpha else "RGB"), np.uint8)
                delay = round(Fraction(picture.info.get("duration", 0)) / 1000 / TIME_BASE)
                if not delay:
                    self.problems.note(f"Pictures of {self.path.name} without a delay are shown for 0.1 s.")
                    delay = round(_NO_DELAY / TIME_BASE)
                alpha = np.ascontiguousarray(rgba[..., 3]) if self.has_alpha else None
                yield DeepImage(np.ascontiguousarray(rgba[..., :3]), alpha, self.profile), delay

    def _is_opaque_webp(self) -> bool:
        """Whether the header of a WebP file says that nothing in it is transparent."""
        with self.path.open("rb") as file:
            head = file.read(32)
        return format_of(head) == "webp" and not head[20] & 0x10

    def _pages(self) -> Iterator[tuple[DeepImage, int]]:
        """Each page or view, and 0."""
        data = self.path.read_bytes()
        if format_of(data) == "tiff":
            kinds = ifd.pages(io.BytesIO(data))
            profile = ifd.read_values(data).get(ifd.PROFILE)
            whole = np.frombuffer(data, np.uint8)
            self.count = len(kinds)
            for number, kind in kinds.items():
                if kind == CMYK:
                    yield from _views(data, [number])
                    continue
                done, found = cv2.imdecodemulti(whole, cv2.IMREAD_UNCHANGED, range=(number, number + 1))
                if not done:
                    raise ValueError("a page cannot be read")
                require_plain(f"Page {number + 1} of {self.path.name}", found[0], kind)
                yield shown(np.asarray(found[0]), b"", profile), 0
            return
        numbers = views(io.BytesIO(data))
        self.count = len(numbers)
        yield from _views(data, numbers)


def _views(data: bytes, numbers: Sequence[int]) -> Iterator[tuple[DeepImage, int]]:
    """Pages or views as Pillow reads them, 8 bits per component, each with 0."""
    from PIL import Image, ImageOps

    with Image.open(io.BytesIO(data)) as picture:
        for number in numbers:
            picture.seek(number)
            rgb = np.asarray(ImageOps.exif_transpose(picture).convert("RGB"), np.uint8)
            yield DeepImage(rgb, None, fitting(picture.info.get("icc_profile"), rgb)), 0


def _count(picture: Any) -> int:
    """How many pictures there are to read; of a damaged file, one more than can be found."""
    number = 0
    try:
        return int(picture.n_frames)
    except reading_errors():
        with suppress(*reading_errors()):
            for number in count():
                picture.seek(number)
        picture.seek(0)
        return number + 1


def _plays(picture: Any) -> int:
    """How often an animation is played, 0 for ever; GIF counts repetitions."""
    loop = picture.info.get("loop")
    if picture.format == "GIF":
        return 1 if loop is None else int(loop) + (1 if loop else 0)
    return int(loop or 0)
