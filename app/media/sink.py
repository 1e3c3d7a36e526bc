"""What takes frames and writes them: a sink, and that of a video file.

An output is written as NAME.part and renamed when it is complete; on any exception it is removed.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType

import av
import av.error
from av.video.stream import VideoStream

from guise.app.media.encoder import EncodeOptions, available_encoders, ordinary_priority
from guise.app.media.encoding import Encoding, encoding_for
from guise.app.media.errors import MediaError, reason
from guise.app.media.frame import Frame
from guise.app.media.input import MediaInput, VideoInput, VideoPart
from guise.app.media.pipes import is_pipe, written_as
from guise.app.media.reader import AnyPacket
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

_NO_TAGS: Mapping[str, str] = MappingProxyType({})
_APPLE = frozenset({"mp4", "mov", "ipod"})


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
