"""What gives frames: an input, and that of a video file.

Pictures come as `Frame`s in display orientation with integer time stamps.  Everything closes by `with`.
"""

from __future__ import annotations

import math
import stat
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import av

from guise.app.media.clock import clock_of
from guise.app.media.coded_quality import quantiser
from guise.app.media.container import frame_rate, main_video, open_container
from guise.app.media.deep_frame import frame_of
from guise.app.media.errors import MediaError
from guise.app.media.frame import Frame, is_transparent
from guise.app.media.hardware import HardwareDecoder, working_decoder
from guise.app.media.hdr import changing_metadata, light_levels
from guise.app.media.orientation import AS_STORED, Orientation, parse_display_matrix
from guise.app.media.pipes import READ_ONCE, is_pipe
from guise.app.media.pixel_formats import has_alpha
from guise.app.media.problems import ProblemLog
from guise.app.media.reader import LIMITS, AnyPacket, VideoReader
from guise.app.media.time_range import TimeRange
from guise.common.closing import Closing

if TYPE_CHECKING:
    from av.container.core import Chapter

Kind = Literal["video", "image", "images"]
IMAGES_PER_SECOND = Fraction(30)  # also of a video that has no rate
_MAX_FRAME_RATE = 500  # frames per second; a higher rate is that of the container's clock
_UNUSED_ALPHA = frozenset({"gif", "png", "apng", "webp"})  # decoders that give it also where all is opaque
_RATE_PACKETS = 64  # from which a frame rate is measured


class MediaInput(Closing):
    """An open input: its frames and its properties; iterate over it once per pass.

    width, height : pixels, as shown.
    time_base : unit of the frames' pts, seconds.
    frame_rate : average, frames per second.   frame_count, duration (seconds) : an estimate, or None.
    has_alpha : whether pixels may be transparent.
    rotation : degrees clockwise from the stored to the shown picture.
    problems : what went wrong so far without ending the work, in sentences; grows while frames are read.
    """

    kind: Kind
    width: int
    height: int
    frame_rate: Fraction
    frame_count: int | None = None
    duration: Fraction | None = None
    time_base: Fraction
    has_audio: bool = False
    has_alpha: bool = False
    orientation: Orientation = AS_STORED

    def __init__(self, path: Path) -> None:
        self.path = path
        self.name = "the pipe" if is_pipe(path) else path.name
        self.problems = ProblemLog()
        self._versions = [file_version(path)]

    @property
    def _files(self) -> list[Path]:
        return [self.path]

    @property
    def rotation(self) -> int:
        return self.orientation.rotation

    def __iter__(self) -> Iterator[Frame]:
        raise NotImplementedError

    def close(self) -> None:
        """Release the input."""

    def note_replaced(self) -> None:
        """Note that the input was changed or replaced since it was opened; called at the end of a pass."""
        if [file_version(file) for file in self._files] != self._versions:
            self.problems.note(
                f"{self.name} was changed or replaced while it was read: the result may be of neither, run again."
            )

    def describe(self) -> dict[str, object]:
        """The properties of the input, as JSON holds them."""
        return {
            "name": self.name,
            "kind": self.kind,
            "width": self.width,
            "height": self.height,
            "frame_rate": str(self.frame_rate),
            "frame_count": self.frame_count,
            "duration_seconds": None if self.duration is None else float(self.duration),
            "rotation": self.rotation,
            "has_audio": self.has_audio,
        }


class VideoInput(MediaInput):
    """A video file.  On the next pass, the other streams' packets go to the sink that asked for them.

    quantiser : mean (0..51) of the first picture, where its decoder tells.
    light_levels, changing_metadata : what HDR pictures say beside their pixels, see `hdr.py`.
    clock : on which all passes put all streams.
    """

    kind = "video"

    def __init__(self, path: Path, hwaccel: HardwareDecoder = "none") -> None:
        super().__init__(path)
        self._device = working_decoder(hwaccel, self.problems.note)
        self._template = VideoReader(path, self.problems, self._device)
        self._first_pass: Iterator[av.VideoFrame] | None = iter(self._template)
        self._early_packets: list[AnyPacket] = []
        self._listener: Callable[[AnyPacket], None] | None = None
        self._others: list[VideoReader] = []
        try:
            self.clock = self._template.clock = clock_of(path, self.container, self.stream)
            self.problems.add(filter(None, [self.clock.note()]))
            self._template.on_packet = self._early_packets.append
            self._template.tell_quantiser()
            self.first_picture = self._prime()
            self.interlaced = bool(self.first_picture.interlaced_frame)
            self.quantiser = quantiser(self.first_picture)
            self.light_levels = light_levels(self.first_picture)
            self.changing_metadata = changing_metadata(self.first_picture)
            self.has_alpha = self._has_alpha(self.first_picture)
            self._read_properties()
        except BaseException:
            self.close()
            raise

    def _has_alpha(self, picture: av.VideoFrame) -> bool:
        """Whether the pictures have alpha, and more than a plane of it that is opaque throughout."""
        unused = self.stream.codec_context.name in _UNUSED_ALPHA
        return has_alpha(picture.format.name) and (is_transparent(picture) or not unused)

    def _prime(self) -> av.VideoFrame:
        """Decode the first picture: it proves the file and carries the orientation and the colour tags."""
        assert self._first_pass is not None
        picture = next(self._first_pass, None)
        if picture is None:
            reason = self.problems[0] if self.problems else "it is empty"
            raise MediaError(f"{self.path} holds no picture that can be decoded: {reason.rstrip('.')}.")
        return picture

    def _read_properties(self) -> None:
        stream, picture = self._template.stream, self.first_picture
        self.time_base = self._template.time_base
        matrix: Any = picture.side_data.get("DISPLAYMATRIX")
        self.display_matrix = None if matrix is None else parse_display_matrix(bytes(matrix))
        if self.display_matrix is not None:
            self.orientation = Orientation.from_display_matrix(self.display_matrix)
        self.width, self.height = self.orientation.size(picture.width, picture.height)
        rate = frame_rate(self.container, stream)
        self.frame_rate = rate if rate and rate < _MAX_FRAME_RATE else self._measured_rate()
        self.duration = self._find_duration()
        self.frame_count = (
            stream.frames
            or self.clock.pictures
            or (None if self.duration is None else max(round(self.duration * self.frame_rate), 1))
        )
        self.has_audio = len(self.container.streams.audio) > 0

    def _measured_rate(self) -> Fraction:
        """Frames per second at the beginning, where the container has no rate, as in a browser's recordings."""
        if is_pipe(self.path):
            return IMAGES_PER_SECOND
        with open_container(self.path) as container:
            packets = islice(container.demux(main_video(container, self.path)), _RATE_PACKETS)
            times = [packet.pts * packet.time_base for packet in packets if packet.pts is not None]
        span = max(times) - min(times) if times else Fraction(0)
        return Fraction((len(times) - 1) / span).limit_denominator(1001) if span else IMAGES_PER_SECOND

    def _find_duration(self) -> Fraction | None:
        if self.clock.pictures:
            return self.clock.end - self.clock.start
        if self.stream.duration:
            return self.stream.duration * self.time_base
        return Fraction(self.container.duration, av.time_base) if self.container.duration else None

    @property
    def container(self) -> av.container.InputContainer:
        """The open file, for its metadata, chapters and stream templates."""
        return self._template.container

    @property
    def stream(self) -> av.video.stream.VideoStream:
        """The video stream that is decoded."""
        return self._template.stream

    def chapters(self) -> list[Chapter]:
        """The chapters of the file."""
        return self.container.chapters()

    def send_packets_to(self, listener: Callable[[AnyPacket], None]) -> None:
        """Pass every packet of the other streams to `listener` during the next pass, and only that one."""
        self._listener = listener

    def __iter__(self) -> Iterator[Frame]:
        listener, self._listener = self._listener, None
        return self.frames_of(self._pictures(listener or _ignore))

    def open_reader(self, problems: ProblemLog) -> VideoReader:
        """Another pass over the file; it closes with this input.  A pipe has only one: MediaError."""
        if is_pipe(self.path):
            raise MediaError(READ_ONCE)
        reader = VideoReader(self.path, problems, self._device, self.clock)
        self._others.append(reader)
        return reader

    def frames_of(self, pictures: Iterable[av.VideoFrame]) -> Iterator[Frame]:
        """The pictures of a reader as frames, counted from 0."""
        for index, picture in enumerate(pictures):
            assert picture.pts is not None
            yield frame_of(
                picture, pts=picture.pts, time_base=self.time_base, index=index, orientation=self.orientation
            )
        self.note_replaced()

    def _pictures(self, listener: Callable[[AnyPacket], None]) -> Iterator[av.VideoFrame]:
        if self._first_pass is None:
            yield from self._replay(listener)
            return
        rest, self._first_pass = self._first_pass, None
        first, self.first_picture = self.first_picture, _blank_like(self.first_picture)
        early, self._early_packets = self._early_packets, []
        for packet in early:
            listener(packet)
        self._template.on_packet = listener
        yield first
        del first
        yield from rest

    def _replay(self, listener: Callable[[AnyPacket], None]) -> Iterator[av.VideoFrame]:
        reader = self.open_reader(self.problems)
        reader.on_packet = listener
        try:
            yield from reader
        finally:  # a clip that is played in a loop keeps no pass open
            reader.close()
            self._others.remove(reader)

    def close(self) -> None:
        for reader in [*self._others, self._template]:
            reader.close()


class VideoPart(VideoInput):
    """A part of a video file, of all streams; times count from its first picture."""

    def __init__(self, path: Path, part: TimeRange, hwaccel: HardwareDecoder = "none") -> None:
        self._length: Fraction | None = None
        self._seeks = False
        super().__init__(path, hwaccel)
        try:
            self._cut(part)
        except BaseException:
            self.close()
            raise

    def _cut(self, part: TimeRange) -> None:
        """Count from the first picture of the part on."""
        begin, whole = (self.first_picture.pts or 0) * self.time_base, self.clock.shift(self.stream.index)
        self._first_pass, self._early_packets = None, []
        self._seeks = part.start > LIMITS.seek_seconds
        first = self._move(math.ceil((begin + part.start) / self.time_base) * self.time_base)
        if first is None:
            lasts = "" if self.duration is None else f", which lasts {float(self.duration):.2f} s"
            raise MediaError(
                f"--from {float(part.start):g} lies after the last picture of {self.name}{lasts}."
            )
        if part.end is not None:
            self._length = begin + part.end + self.clock.shift(self.stream.index) - whole
            if self._length <= 0:
                raise MediaError(f"{self.name} shows no picture {part.told()}.")
        left = None if self.duration is None else max(self.duration - part.start - first, Fraction(0))
        self.duration = self._length if left is None else min(left, self._length or left)
        if self.duration is not None:
            self.frame_count = max(round(self.duration * self.frame_rate), 1)

    def _move(self, begin: Fraction) -> Fraction | None:
        """Let the clock begin with the first picture from a time on; how much later it is shown, None without one."""
        indices = [stream.index for stream in self.container.streams]
        whole, self.clock = self.clock, self.clock.moved(begin, indices)
        self._seeks &= not self.clock.jumps and self._reaches()
        with self.open_reader(ProblemLog()) as reader:
            picture = next(iter(reader), None)
        if picture is None:
            return None
        first = (picture.pts or 0) * self.time_base
        self.clock = whole.moved(begin + first, indices)
        return first

    def _reaches(self) -> bool:
        """Whether seeking leads to a keyframe before the part."""
        with super().open_reader(ProblemLog()) as reader:
            if reader.has_decoding_times:  # which count from the start
                return False
            reader.only_video()
            try:
                reader.limit(None, seeks=True)
            except av.error.FFmpegError:
                return False
            packet = next((p for p in reader.packets() if p.stream is reader.stream and p.size), None)
            return packet is not None and packet.is_keyframe and packet.pts is not None and packet.pts <= 0

    def chapters(self) -> list[Chapter]:
        """Those of the part, in its times."""
        found: list[Chapter] = []
        moved = self.clock.shift(self.stream.index)
        for chapter in super().chapters():
            unit = Fraction(chapter["time_base"] or 1)
            start = max(moved + chapter["start"] * unit, Fraction(0))
            end = moved + chapter["end"] * unit
            end = end if self._length is None else min(end, self._length)
            if end > start:
                copy = chapter.copy()
                copy["start"], copy["end"] = round(start / unit), round(end / unit)
                found.append(copy)
        return found

    def open_reader(self, problems: ProblemLog) -> VideoReader:
        reader = super().open_reader(problems)
        reader.limit(self._length, seeks=self._seeks)
        return reader


def file_version(path: Path) -> tuple[str, int, int] | None:
    """What changes with a file: its name, size and time; None for what isn't a file, such as a pipe."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return (str(path.absolute()), facts.st_size, facts.st_mtime_ns) if stat.S_ISREG(facts.st_mode) else None


def _ignore(packet: AnyPacket) -> None:
    """A listener that drops packets."""


def _blank_like(picture: av.VideoFrame) -> av.VideoFrame:
    """A blank picture with the same tags, so that the decoded one need not be kept."""
    blank = av.VideoFrame(picture.width, picture.height, picture.format.name)
    blank.colorspace, blank.color_range = picture.colorspace, picture.color_range
    blank.color_trc, blank.color_primaries = picture.color_trc, picture.color_primaries
    return blank
