"""Outputs that are pictures: one image, a folder of them, pages, an animation."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType

import av
import av.error
import numpy as np
from numpy.typing import NDArray

from guise.app.media.animation_writer import FORMS, add_profile, add_tags, open_writer
from guise.app.media.encoder import EncodeOptions
from guise.app.media.errors import MediaError
from guise.app.media.frame import Frame
from guise.app.media.image_writing import can_write, encode_deep, encode_pages, lost_in
from guise.app.media.images import DeepImage, changed
from guise.app.media.input import MediaInput, VideoInput
from guise.app.media.picture_inputs import AnimationInput
from guise.app.media.pictures import letterboxed
from guise.app.media.rendition import is_hdr
from guise.app.media.sink import Sink, as_media_error

_NO_TAGS: Mapping[str, str] = MappingProxyType({})
_GIF_SHORTEST = Fraction(1, 50)  # seconds; players show pictures of less for 0.1 s
_DEFAULT_DELAY = Fraction(1, 30)  # seconds, of a last picture without a duration


class ImageSink(Sink):
    """One image file.   note : told what it does not keep of the input."""

    def __init__(
        self, path: Path, *, force: bool = False, tags: Mapping[str, str] = _NO_TAGS,
        note: Callable[[str], None] = lambda sentence: None,
    ) -> None:  # fmt: skip
        super().__init__(path, force=force)
        self._tags, self._note = dict(tags), note
        self.claim()

    def write(self, frame: Frame) -> None:
        if self.frames:
            raise MediaError(f"{self.path} holds one image but more came: write to a folder or a video.")
        data = _encoded(frame, self.path.name, self._tags, self._note)
        with as_media_error(self.path):
            self.part.write_bytes(data)
        self.frames = 1

    def _finish(self) -> None:
        self.publish()


class FolderSink(Sink):
    """A folder of images that keep their names; frames without a name become numbered PNG files.

    note : told which names could not be kept.
    """

    def __init__(
        self, path: Path, *, force: bool = False, tags: Mapping[str, str] = _NO_TAGS,
        note: Callable[[str], None] = lambda sentence: None,
    ) -> None:  # fmt: skip
        super().__init__(path, force=force, folder=True)
        self._note = note
        self._tags = dict(tags)
        self.claim()

    def write(self, frame: Frame) -> None:
        name = frame.name or f"frame_{self.frames:06d}.png"
        if not can_write(Path(name).suffix):
            self._note(f"{name} was written as .png, because {Path(name).suffix or name} cannot be written.")
            name = f"{name}.png"
        data = _encoded(frame, name, self._tags, self._note)
        with as_media_error(self.path):
            (self.part / name).write_bytes(data)
        self.frames += 1

    def _finish(self) -> None:
        if not self.path.exists():
            self.publish()
            return
        for file in self.part.iterdir():
            file.replace(self.path / file.name)
        self.discard()


class AnimationSink(Sink):
    """An animated picture file; frames of another size are letterboxed."""

    def __init__(
        self, path: Path, media: MediaInput, options: EncodeOptions, *, force: bool, tags: Mapping[str, str],
        size: tuple[int, int] | None,
    ) -> None:  # fmt: skip
        super().__init__(path, force=force)
        self._form, self._tags = FORMS[path.suffix.lower()], dict(tags)
        self._size = size or (media.width, media.height)
        self._held: tuple[Fraction, Fraction, NDArray[np.uint8]] | None = None
        source = media.pictures if isinstance(media, AnimationInput) else None
        alpha = media.has_alpha if source is None else source.has_alpha
        self._profile = source.profile if source else None
        self._alpha = alpha and self._form != "avif" and self._size == (media.width, media.height)
        _note_lost(media, path, self._form)
        self._shortest = _GIF_SHORTEST if self._form == "gif" and source is None else Fraction(0)
        self.claim()
        try:
            with as_media_error(path):
                self._writer = open_writer(
                    self.part, self._form, self._size, source.plays if source else 0, alpha=self._alpha,
                    lossless=options.lossless,
                )  # fmt: skip
        except BaseException:
            self.abort()
            raise

    def write(self, frame: Frame) -> None:
        start, held = frame.pts * frame.time_base, self._held
        if held is not None and start <= held[0]:
            raise ValueError(f"frame times must ascend, got {start} s after {held[0]} s")
        self.frames += 1
        end = start + (frame.duration * frame.time_base or _DEFAULT_DELAY)
        if held is not None:
            if start - held[0] < self._shortest:
                self._held = held[0], end, held[2]
                return
            self._add(held, start)
        rgb = letterboxed(frame.rgb(), *self._size)
        cover = frame.opacity()
        cover = np.full(rgb.shape[:2], 255, np.uint8) if cover is None else cover
        self._held = start, end, np.dstack([rgb, cover]) if self._alpha else rgb

    def _add(self, held: tuple[Fraction, Fraction, NDArray[np.uint8]], end: Fraction) -> None:
        with as_media_error(self.path):
            self._writer.add(held[2], held[0], end)

    def _finish(self) -> None:
        assert self._held is not None
        self._add(self._held, self._held[1])
        self._writer.close()
        if self._profile:
            add_profile(self.part, self._form, self._profile)
        if self._tags:
            add_tags(self.part, self._form, self._tags)
        self.publish()

    def discard(self) -> None:
        with contextlib.suppress(AttributeError, av.error.FFmpegError, OSError, ValueError):
            self._writer.close()
        super().discard()


def _note_lost(media: MediaInput, path: Path, form: str) -> None:
    """Note what an animated picture does not keep of its input."""
    if media.has_audio:
        media.problems.note(f"A {path.suffix} file holds no sound: the audio was left out.")
    if isinstance(media, VideoInput) and is_hdr(media.first_picture.color_trc):
        media.problems.note(
            f"A {path.suffix} file has 8 bits: its pictures are SDR, as which the HDR is shown."
        )
    if form == "avif" and (media.pictures if isinstance(media, AnimationInput) else media).has_alpha:
        media.problems.note(f"A {path.suffix} file does not keep transparency: a .png or .webp file does.")
    if form in ("gif", "avif") and isinstance(media, AnimationInput) and media.pictures.profile:
        media.problems.note(
            f"A {path.suffix} file does not keep the colour profile: a .png or .webp file does."
        )
    if form == "gif" and not isinstance(media, AnimationInput) and media.frame_rate > 1 / _GIF_SHORTEST:
        media.problems.note(
            f"A {path.suffix} file shows at most {1 / _GIF_SHORTEST} pictures a second: the rest was left out."
        )


class PagesSink(Sink):
    """A TIFF file of pages, or an MPO file of views."""

    def __init__(self, path: Path, *, force: bool, tags: Mapping[str, str]) -> None:
        super().__init__(path, force=force)
        self._tags, self._pages = dict(tags), list[DeepImage]()
        self.claim()

    def write(self, frame: Frame) -> None:
        self._pages.append(_drawn(frame))
        self.frames += 1

    def _finish(self) -> None:
        self.part.write_bytes(encode_pages(self._pages, self.path.suffix, self._tags))
        self.publish()


def _encoded(frame: Frame, name: str, tags: Mapping[str, str], note: Callable[[str], None]) -> bytes:
    """The bytes of an image file that shows a frame, with what its own image file had, where nothing was drawn."""
    image, suffix = _drawn(frame), Path(name).suffix
    if lost := lost_in(suffix, image):
        note(f"A {suffix} file does not keep {' and '.join(lost)}: a .png file does.")
    return encode_deep(image, suffix, tags)


def _drawn(frame: Frame) -> DeepImage:
    rgb, image = frame.rgb(), frame.stored
    return DeepImage(rgb, frame.alpha) if image is None else changed(image, rgb)
