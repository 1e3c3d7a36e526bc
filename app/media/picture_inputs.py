"""Inputs of pictures: images, folders of them, animations and pages."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

from guise.app.media.animation import TIME_BASE, Pictures
from guise.app.media.errors import MediaError
from guise.app.media.file_kind import FileKind
from guise.app.media.frame import Frame
from guise.app.media.images import DeepImage, eight_bits, list_images, read_deep
from guise.app.media.input import IMAGES_PER_SECOND, MediaInput, file_version
from guise.app.media.time_range import TimeRange


class ImageInput(MediaInput):
    """One image file, or the images of a folder in natural order, 30 per second.

    part : of the folder; its times count from its first image.
    """

    def __init__(self, path: Path, part: TimeRange | None = None) -> None:
        super().__init__(path)
        self.kind = "images" if path.is_dir() else "image"
        self.files = list_images(path, self.problems.note) if path.is_dir() else [path]
        if not self.files:
            raise MediaError(
                f"{path} is a folder without images: give one with .png or .jpg files, or a video file."
            )
        if part is not None:
            self.files = _those_within(part, self.files, path)
        self._versions = [file_version(file) for file in self.files]
        self.frame_rate = IMAGES_PER_SECOND
        first = next(iter(self), None)
        if first is None:
            raise MediaError(f"{path} holds no image that can be read: {self.problems[0]}")
        self.width, self.height = first.width, first.height
        self.frame_count = len(self.files)
        self.duration = len(self.files) / IMAGES_PER_SECOND
        self.time_base = 1 / IMAGES_PER_SECOND

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        for file in self.files:
            try:
                image = read_deep(file, self.problems.note_damage)
            except MediaError as error:
                if self.kind == "image":
                    raise
                self.problems.note_damage(
                    f"{str(error).rstrip('.').replace(str(file), file.name)}; it was skipped."
                )
                continue
            if image.gain_map:
                self.problems.note(f"The HDR gain map of {file.name} was left out: the result is SDR.")
            if image.bits != 8:
                self.problems.note(
                    f"{file.name} has {image.depth or image.bits} bits per component; faces are drawn with 8."
                )
            yield _frame_of(image, index, 1 / IMAGES_PER_SECOND, index, file.name)
            index += 1
        self.note_replaced()

    @property
    def _files(self) -> list[Path]:
        return self.files


def _those_within(part: TimeRange, files: list[Path], folder: Path) -> list[Path]:
    """The images of a folder that are shown in a part."""
    found = [file for index, file in enumerate(files) if part.holds(index / IMAGES_PER_SECOND)]
    if not found:
        raise MediaError(
            f"{folder} has no image {part.told()}: its {len(files)} images count as 30 per second."
        )
    return found


class AnimationInput(MediaInput):
    """A file of several pictures, see `Pictures`: an animation, which moves like a video, or pages, like a folder."""

    def __init__(self, path: Path, kind: FileKind, part: TimeRange | None = None) -> None:
        super().__init__(path)
        self._part = part or TimeRange()
        self.kind = "video" if kind == "animation" else "images"
        self.time_base = TIME_BASE if kind == "animation" else 1 / IMAGES_PER_SECOND
        self.pictures = Pictures(path, kind, self.problems)
        first = next(iter(self), None)
        if first is None:
            if part is not None:
                raise MediaError(f"{path} shows no picture {self._part.told()}.")
            raise MediaError(f"{path} is damaged: none of its pictures can be read.")
        self.width, self.height = first.width, first.height
        self.frame_rate = 1 / (first.duration * self.time_base) if first.duration else IMAGES_PER_SECOND
        self.frame_count = self.pictures.count
        self.duration = self.frame_count / self.frame_rate

    def __iter__(self) -> Iterator[Frame]:
        pts = index = before = 0
        for image, delay in self.pictures:
            if self._part.holds(pts * self.time_base):
                before = before if index else pts
                frame = _frame_of(image, pts - before, self.time_base, index)
                frame.duration = delay
                yield frame
                index += 1
            pts += delay or 1
        self.note_replaced()


def _frame_of(image: DeepImage, pts: int, time_base: Fraction, index: int, name: str | None = None) -> Frame:
    """A picture as a frame, which also holds it as it is stored."""
    alpha = None if image.alpha is None else eight_bits(image.alpha)
    frame = Frame.from_rgb(image.rgb8(), pts, time_base, index, name=name, alpha=alpha)
    frame.stored = image
    return frame
