"""Outputs: a video file, an animation, pages, one image, or a folder of images.

An output is written as NAME.part and renamed when it is complete; on any exception it is removed.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType

import av
import av.error
import numpy as np
from av.video.stream import VideoStream
from numpy.typing import NDArray

from guise.app.media.animation_writer import FORMS, LOSSLESS, add_profile, add_tags, open_writer
from guise.app.media.encoder import EncodeOptions, available_encoders, ordinary_priority
from guise.app.media.encoding import Encoding, encoding_for
from guise.app.media.errors import MediaError, reason
from guise.app.media.file_kind import READ_ONLY_SUFFIXES, has_image_name
from guise.app.media.frame import Frame
from guise.app.media.image_writing import PAGES, can_write, encode_deep, encode_pages, lossy_form, lost_in
from guise.app.media.images import DeepImage, changed
from guise.app.media.input import AnimationInput, ImageInput, MediaInput, VideoInput, VideoPart
from guise.app.media.pictures import letterboxed
from guise.app.media.pipes import is_pipe, written_as
from guise.app.media.reader import AnyPacket
from guise.app.media.rendition import is_hdr
from guise.app.media.stream_copies import (
    Audio,
    StreamCopier,
    can_rotate,
    fresh_metadata,
    keeps_times,
    muxer_options,
    timecode_of,
)
from guise.app.media.trial import Trial
from guise.common.errors import OutputError
from guise.common.files import WholeOutput

__all__ = ["EncodeOptions", "Sink", "open_sink"]

_NO_TAGS: Mapping[str, str] = MappingProxyType({})
_DEFAULTS = EncodeOptions()
_APPLE = frozenset({"mp4", "mov", "ipod"})
_GIF_SHORTEST = Fraction(1, 50)  # seconds; players show pictures of less for 0.1 s
_DEFAULT_DELAY = Fraction(1, 30)  # seconds, of a last picture without a duration


class Sink(WholeOutput):
    """An output that exists under its name only when it is complete.

    Use by `with`: a clean exit finishes and renames, an exception removes NAME.part.
    frames : number written so far.   needs_frames : whether writing none is an error.
    first_packet : time (`time.perf_counter`) at which the first encoded picture was written, or None.
    """

    needs_frames = True
    first_packet: float | None = None
    frames = 0

    def write(self, frame: Frame) -> None:
        """Write one frame; its time must be later than the last one's."""
        raise NotImplementedError

    def _finish(self) -> None:
        """Complete NAME.part and rename it."""
        raise NotImplementedError

    def complete(self) -> None:
        if self.needs_frames and self.frames == 0:
            raise MediaError(f"{self.path} was not written: no frame came from the input.")
        with as_media_error(self.path):
            self._finish()

    def claim(self) -> None:
        try:
            super().claim()
        except OutputError as error:
            raise MediaError(f"{error}.") from error
        except OSError as error:
            raise MediaError(
                f"{self.path} cannot be written ({error.strerror}): choose a folder that exists and is writable."
            ) from error

    def publish(self) -> None:
        if self.path.exists() and not self._force:
            raise MediaError(f"{self.path} appeared meanwhile: use --force to replace it, or another name.")
        super().publish()


class NullSink(Sink):
    """Discards its frames: for a pass that only looks at them."""

    needs_frames = False

    def write(self, frame: Frame) -> None:
        """Discard a frame."""


class VideoOutput(Sink):
    """A video file: one encoded stream, and copies of the input's other streams."""

    def __init__(
        self, path: Path, media: MediaInput, encoding: Encoding, *, force: bool, tags: Mapping[str, str],
        private: bool, audio: Audio,
    ) -> None:  # fmt: skip
        super().__init__(path, force=force)
        self._lock = threading.Lock()
        self._encoding = encoding
        self._copies: StreamCopier | None = None
        format_name, more = written_as(path) if is_pipe(path) else (_container_of(path), {})
        self._check_rotation(format_name)
        metadata = _metadata(media, tags, private)
        self.claim()
        try:
            place = "pipe:1" if is_pipe(path) else str(self.part.absolute())
            self._output = av.open(
                place, "w", format=format_name, metadata_errors="surrogateescape",
                container_options=muxer_options(format_name, metadata, media.time_base) | more,
            )  # fmt: skip
            self._output.metadata.update(metadata)
            self._stream = self._add_video(media)
            code = "" if private or isinstance(media, VideoPart) else timecode_of(media, format_name)
            self._stream.metadata.update({"timecode": code} if code else {})
            if isinstance(media, VideoInput):
                self._copies = StreamCopier(self._output, media, private=private, audio=audio, timecode=code)
                if not private and (chapters := media.chapters()):
                    self._output.set_chapters(chapters)
                    if not Trial(format_name).keeps_chapters():
                        media.problems.note(f"The chapters were left out: {format_name} has none.")
            self._start()
        except BaseException:
            self.abort()
            raise

    def claim(self) -> None:
        if not is_pipe(self.path):
            super().claim()

    def publish(self) -> None:
        if not is_pipe(self.path):
            super().publish()

    def _check_rotation(self, format_name: str) -> None:
        form = self._encoding.picture_format
        if form.display_matrix and not form.orientation.is_identity and not can_rotate(format_name):
            raise MediaError(
                f"{self.path.name} cannot keep the picture's rotation: write to .mp4, .mov or .mkv."
            )

    def _add_video(self, media: MediaInput) -> VideoStream:
        encoding = self._encoding
        try:
            stream = self._output.add_stream(encoding.encoder, encoding.rate, encoding.settings)
        except ValueError as error:
            raise MediaError(
                f"{self.path.name} cannot hold video from encoder {encoding.encoder!r}: "
                "use --encoder libx264 with .mp4 or .mkv, or libvpx-vp9 with .webm."
            ) from error
        assert isinstance(stream, VideoStream)
        encoding.configure(stream.codec_context)
        if encoding.codec == "hevc" and self._output.format.name in _APPLE:
            stream.codec_context.codec_tag = "hvc1"  # the kind that Apple's players take
        if encoding.picture_format.display_matrix:
            stream.set_display_matrix(encoding.picture_format.display_matrix)
        if isinstance(media, VideoInput):
            stream.disposition = media.stream.disposition
            language = media.stream.metadata.get("language")
            if language:
                stream.metadata["language"] = language
        return stream

    def _start(self) -> None:
        """Open the encoder and write the header, so that refused settings are known before any work."""
        try:
            with ordinary_priority():
                self._output.start_encoding()
        except (av.error.FFmpegError, ValueError) as error:
            raise MediaError(
                f"Encoder {self._encoding.encoder!r} or {self.path.name} refuses these settings "
                f"({reason(error)}): use one of {available_encoders()} and .mp4 or .mkv."
            ) from error

    def _copy(self, packet: AnyPacket) -> None:
        assert self._copies is not None
        with self._lock, as_media_error(self.path):
            self._copies.mux(packet)

    def _mux(self, packets: Iterable[AnyPacket]) -> None:
        with self._lock:
            for packet in packets:
                self._output.mux_one(packet)
                if self.first_packet is None:
                    self.first_packet = time.perf_counter()

    def _finish(self) -> None:
        if self._copies is not None:
            self._copies.finish()
        self._output.close()
        self.publish()

    def discard(self) -> None:
        with contextlib.suppress(AttributeError, av.error.FFmpegError, OSError, ValueError):
            self._output.close()
        if not is_pipe(self.path):
            super().discard()


class VideoSink(VideoOutput):
    """Encodes the pictures and copies the input's other streams."""

    def __init__(
        self, path: Path, media: MediaInput, options: EncodeOptions, *, force: bool = False,
        tags: Mapping[str, str] = _NO_TAGS, size: tuple[int, int] | None = None, private: bool = False,
    ) -> None:  # fmt: skip
        encoding = encoding_for(media, options, path, size, captions=not private)
        super().__init__(path, media, encoding, force=force, tags=tags, private=private, audio="keep")
        self._last: Fraction | None = None
        if isinstance(media, VideoInput):
            media.send_packets_to(self._copy)

    def write(self, frame: Frame) -> None:
        self._last = later_time(frame, self._last)
        with as_media_error(self.path):
            self._mux(self._stream.encode(self._encoding.picture(frame)))
        self.frames += 1

    def _finish(self) -> None:
        self._mux(self._stream.encode(None))
        super()._finish()


def later_time(frame: Frame, last: Fraction | None) -> Fraction:
    """The frame's time, seconds, which must be later than the last one's."""
    time = frame.pts * frame.time_base
    if last is not None and time <= last:
        raise ValueError(f"frame times must ascend, got {time} s after {last} s")
    return time


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


def open_sink(
    path: Path | str, media: MediaInput, options: EncodeOptions = _DEFAULTS, *, force: bool = False,
    tags: Mapping[str, str] = _NO_TAGS, size: tuple[int, int] | None = None, private: bool = False,
) -> Sink:  # fmt: skip
    """Open the output for an input; its suffix determines the kind.  Whatever can fail early fails here.

    force : replace an existing output.   tags : metadata to add.
    size : (width, height) of the frames if it differs from the input's; they are then taken as shown.
    private : keep only the audio of the input's other streams, without its names, and leave out all metadata,
        chapters and closed captions.
    Raises MediaError for a user's mistake, and then leaves nothing behind.
    """
    path = Path(path)
    if is_pipe(path):
        return VideoSink(path, media, options, force=force, tags=tags, size=size, private=private)
    check_free(path, media, force)
    if not path.is_dir() and is_animation(path, media):
        _check_animation(path, options)
        return AnimationSink(path, media, options, force=force, tags=tags, size=size)
    if path.suffix.lower() in PAGES and media.kind == "images" and not path.is_dir():
        return PagesSink(path, force=force, tags=tags)
    if has_image_name(path) and not path.is_dir():
        _check_image(path, media, options)
        return ImageSink(path, force=force, tags=tags, note=media.problems.note)
    if path.suffix.lower() in READ_ONLY_SUFFIXES:
        raise MediaError(
            f"{path.name} is a picture that Guise reads but does not write: use .png, .jpg or .webp."
        )
    if media.kind == "images" and (path.is_dir() or not path.suffix):
        _check_images(media, options)
        return FolderSink(path, force=force, tags=tags, note=media.problems.note)
    return VideoSink(path, media, options, force=force, tags=tags, size=size, private=private)


def check_free(path: Path, media: MediaInput, force: bool) -> None:
    """Raise MediaError when the output would replace something it must not."""
    if path.exists() and media.path.exists() and path.samefile(media.path):
        raise MediaError(f"{path} is the input itself: choose another name for the output.")
    if path.is_dir() and media.kind != "images":
        raise MediaError(f"{path} is a folder: give a file name such as {path / 'out.mp4'}.")
    if path.exists() and not force and not (path.is_dir() and not any(path.iterdir())):
        raise MediaError(f"{path} exists: use --force to replace it, or choose another name.")


def _check_image(path: Path, media: MediaInput, options: EncodeOptions) -> None:
    if media.kind != "image":
        raise MediaError(
            f"The output {path.name} is one image but {media.name} is not: write to out.webp, which moves, or "
            "to a video such as out.mp4."
        )
    if options.lossless and (form := lossy_form(path.suffix)):
        raise MediaError(f"{path.name} cannot be lossless, as {form} never is: write to .png.")


def is_animation(path: Path, media: MediaInput) -> bool:
    """Whether an output is an animated picture: its form moves, and so does the input, or it has no other form."""
    form = FORMS.get(path.suffix.lower())
    if form is None or (path.suffix.lower() == ".png" and not isinstance(media, AnimationInput)):
        return False
    return media.kind != "image" or not has_image_name(path)


def _check_animation(path: Path, options: EncodeOptions) -> None:
    form = FORMS[path.suffix.lower()]
    if options.lossless and form not in LOSSLESS:
        raise MediaError(
            f"{path.name} cannot be lossless, as {form.upper()} never is: write to .webp or .mkv."
        )


def _check_images(media: MediaInput, options: EncodeOptions) -> None:
    files = media.files if isinstance(media, ImageInput) else []
    lossy = next((file for file in files if lossy_form(file.suffix)), None)
    if options.lossless and lossy:
        raise MediaError(
            f"{lossy.name} cannot be written lossless, as {lossy_form(lossy.suffix)} never is: "
            "write to a video such as out.mkv."
        )


def _encoded(frame: Frame, name: str, tags: Mapping[str, str], note: Callable[[str], None]) -> bytes:
    """The bytes of an image file that shows a frame, with what its own image file had, where nothing was drawn."""
    image, suffix = _drawn(frame), Path(name).suffix
    if lost := lost_in(suffix, image):
        note(f"A {suffix} file does not keep {' and '.join(lost)}: a .png file does.")
    return encode_deep(image, suffix, tags)


def _drawn(frame: Frame) -> DeepImage:
    rgb, image = frame.rgb(), frame.stored
    return DeepImage(rgb, frame.alpha) if image is None else changed(image, rgb)


def _container_of(path: Path) -> str:
    """FFmpeg's name of the container for the suffix."""
    try:
        with av.open(str(path), "w") as probe:  # creates no file until its header is written
            name = probe.format.name
    except ValueError as error:
        raise MediaError(f"{path} does not name a video container: use .mp4, .mov or .mkv.") from error
    if not keeps_times(name):
        raise MediaError(f"{path.name} cannot keep video with its time stamps: use .mp4, .mov or .mkv.")
    return name


def _metadata(media: MediaInput, tags: Mapping[str, str], private: bool) -> dict[str, str]:
    if private or not isinstance(media, VideoInput):
        return dict(tags)
    return fresh_metadata(media.container.metadata) | dict(tags)


@contextlib.contextmanager
def as_media_error(path: Path) -> Iterator[None]:
    """Turn a full disk, a lost drive or an encoder's refusal into one sentence."""
    try:
        yield
    except (av.error.FFmpegError, OSError) as error:
        raise MediaError(f"Writing {path} failed ({reason(error)}): nothing was kept.") from error
