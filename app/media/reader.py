"""Reading the pictures of a video file: decoding, damaged packets, pixel formats and time stamps.

All streams but the chosen video stream are passed on as packets, undecoded.
"""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import av
import av.error
from av.packet import Packet

from guise.app.media import colour
from guise.app.media.clock import STEADY, FileClock, Retimer
from guise.app.media.coded_quality import TELL_QUANTISER
from guise.app.media.container import (
    alpha_decoder,
    frame_rate,
    main_video,
    open_container,
)
from guise.app.media.errors import reason
from guise.app.media.letterbox import SQUARE, fitting_box, pasted
from guise.app.media.pixel_formats import NATIVE_FORMATS, depth, nearest_format
from guise.app.media.problems import ProblemLog
from guise.common.closing import Closing

AnyPacket: TypeAlias = "Packet[av.stream.Stream]"
# Containers that store one time for a packet, that of decoding, and codecs whose pictures it is then wrong for.
_DECODING_TIMES = frozenset({"avi", "asf", "mxf"})
_REORDERING = frozenset({"h264", "hevc", "mpeg1video", "mpeg2video", "vc1", "wmv3"})
_STATES_DURATION = frozenset({"mp4", "matroska", "avi", "flv"})  # containers whose header has it


@dataclass(frozen=True)
class ReadingLimits:
    """How much damage is tolerated, and from where on it is reported."""

    max_failed_reads: int = 64  # in a row, after which the file counts as ended
    max_missing_seconds: Fraction = Fraction(1, 2)  # at the end, by the duration in the header
    max_delayed_packets: int = 64  # that a decoder may hold back at the end of a file
    seek_seconds: Fraction = Fraction(2)  # before a part, from where its keyframe is searched backwards
    interleaving_seconds: Fraction = Fraction(10)  # by which sound may lie behind pictures in a file


LIMITS = ReadingLimits()


class VideoReader(Closing):
    """One pass over a video file: iterate for the decoded pictures, in native formats, pts ascending.

    device : that decodes, such as "cuda", which must work; what it cannot decode, the processor does.
    clock : on which the packets of all streams are put.
    on_packet : called with each packet of every other stream, in file order.
    damaged : whether any picture so far was lost or concealed; with several threads this is not deterministic.
    """

    damaged = False

    def __init__(
        self, path: Path, problems: ProblemLog, device: str | None = None, clock: FileClock = STEADY
    ) -> None:
        self.container = open_container(path, device)
        self.problems, self.clock = problems, clock
        self.on_packet: Callable[[AnyPacket], None] = lambda packet: None
        try:
            self.stream = main_video(self.container, path)
            self.decoder = alpha_decoder(self.stream) or self.stream.codec_context
        except BaseException:
            self.container.close()
            raise
        self._leave_out(self.container.streams.video)
        self.time_base = Fraction(self.stream.time_base or Fraction(1, 90000))
        self._recent: deque[int] = deque(maxlen=LIMITS.max_delayed_packets)
        self._last: int | None = None
        self._times: list[int] = []  # of decoding, of packets whose pictures have not come, the least first
        self._delay: int | None = (
            None  # from a time of decoding, which may begin below zero, to that of a picture
        )
        self._reached: dict[int, int] = {}  # by stream, how far its packets reach, in its unit of time
        self._shape: tuple[int, int, str] | None = None  # of what is yielded
        self._stored: tuple[int, int, str] | None = None  # of the picture before
        self._first_aspect = self._pixel_aspect()
        self._start: int | None = None
        self._started = True
        self._length: Fraction | None = None  # of the part that is read, seconds
        self._ended: set[int] = set()  # streams that have come to its end

    @cached_property
    def has_decoding_times(self) -> bool:
        """Whether packets may have their times of decoding only; pictures then take these in ascending order."""
        context = self.stream.codec_context
        reorders = context.codec.canonical_name in _REORDERING and context.reorder_depth > 0
        return reorders and bool(_DECODING_TIMES & set(self.container.format.name.split(",")))

    def only_video(self) -> None:
        """Read no packets of the other streams."""
        self._leave_out(self.container.streams)

    def use_one_thread(self) -> None:
        """Decode with one thread: slower, but with the same result each time, even from a damaged file."""
        self.decoder.thread_count = 1

    def tell_quantiser(self) -> None:
        """Have the decoder tell how finely its pictures were coded, see `coded_quality.py`."""
        self.decoder.options = {**self.decoder.options, **TELL_QUANTISER}

    def only_others(self) -> None:
        """Read no packets of the video stream."""
        self.stream.discard = av.stream.Discard.all

    def start_at(self, pts: int, dts: int, first: av.VideoFrame) -> None:
        """Start at the keyframe with these time stamps; `first`, the first picture, gives size and format.

        Yields nothing when the keyframe is not found.
        """
        self.only_video()
        self._start, self._started = pts, False
        self._shape = (first.width, first.height, first.format.name)
        shift = round(self.clock.shift(self.stream.index) / self.time_base)
        self.container.seek(min(pts, dts) - shift, stream=self.stream)

    def limit(self, length: Fraction | None, *, seeks: bool) -> None:
        """Yield only what begins in [0, length) seconds of the clock, of all streams; None is to the end.

        seeks : begin to read shortly before, instead of at the start of the file.
        """
        self._length = Fraction(2**62) if length is None else length
        if seeks:
            before = -LIMITS.seek_seconds - self.clock.shift(self.stream.index)
            self.container.seek(round(before / self.time_base), stream=self.stream)

    def _leave_out(self, streams: Iterable[av.stream.Stream]) -> None:
        """Read no packets of streams other than the chosen one."""
        for stream in streams:
            if stream.index != self.stream.index:
                stream.discard = av.stream.Discard.all

    def close(self) -> None:
        """Close the file."""
        self.container.close()

    def __iter__(self) -> Iterator[av.VideoFrame]:
        """Pictures with the duration until the next one, which a demuxer knows in decoding order only."""
        held: av.VideoFrame | None = None
        for picture in self._pictures():
            if held is not None:
                assert held.pts is not None
                assert picture.pts is not None
                held.duration = picture.pts - held.pts
                yield held
            held = picture
        if held is not None:
            held.duration = self._last_duration(held)
            yield held
        self._report_missing_end()

    def _pictures(self) -> Iterator[av.VideoFrame]:
        for packet in self.packets():
            self._follow(packet)
            if packet.stream is self.stream:
                self._started |= packet.pts == self._start
                if self._started:
                    yield from self._decode(packet)
            elif packet.size or (packet.dts is not None and packet.stream.type != "audio"):
                self.on_packet(packet)

    def _last_duration(self, picture: av.VideoFrame) -> int:
        """Until the end of the stream where the container tells it, otherwise the average; 0 if unknown."""
        assert picture.pts is not None
        if self._length is not None:
            left = math.ceil(self._length / self.time_base) - picture.pts
            return min(self._usual_duration(picture), left)
        end = (self.stream.start_time or 0) + (self.stream.duration or 0)
        end += round(self.clock.shift(self.stream.index) / self.time_base)
        if end > picture.pts and "mp4" in self.container.format.name:
            return end - picture.pts
        return self._usual_duration(picture)

    def _usual_duration(self, picture: av.VideoFrame) -> int:
        """From the average rate, or what the decoder says; 0 if unknown."""
        rate = frame_rate(self.container, self.stream)
        return round(1 / (rate * self.time_base)) if rate else int(picture.duration or 0)

    def _follow(self, packet: AnyPacket) -> None:
        """Record how far into the file the packets of its stream reach."""
        if packet.pts is not None:
            end = packet.pts + (packet.duration or 0)
            if end > self._reached.get(packet.stream_index, 0):
                self._reached[packet.stream_index] = end

    def packets(self) -> Iterator[AnyPacket]:
        """All packets, undecoded and on the clock, and an empty one at the end of each stream.

        A read error is reported and skipped, until there are too many in a row.
        """
        failures, retime = 0, Retimer(self.clock)
        while failures < LIMITS.max_failed_reads:
            try:
                for packet in self.container.demux():
                    failures = 0
                    retime(packet)
                    if self._length is None or self._is_needed(packet):
                        yield packet
                    elif self._is_over(packet):
                        yield self._flush()
                        return
                return
            except av.error.FFmpegError as error:
                failures += 1
                self.problems.note_damage(
                    f"The file is damaged after {self._clock()} ({reason(error)}); parts may be missing."
                )
        yield self._flush()

    def _flush(self) -> AnyPacket:
        """What makes the decoder give out the pictures that it holds."""
        flush: AnyPacket = Packet()
        flush.stream = self.stream
        return flush

    def _is_needed(self, packet: AnyPacket) -> bool:
        """Whether a packet belongs to the part, or is needed to decode it."""
        time = packet.dts if packet.stream is self.stream else packet.pts
        if time is None:
            time = packet.pts if packet.stream is self.stream else packet.dts
        if time is None or self._length is None:
            return True
        seconds = time * Fraction(packet.time_base)
        return seconds < self._length and (seconds >= 0 or packet.stream is self.stream)

    def _is_over(self, packet: AnyPacket) -> bool:
        """Whether all pictures and sounds are past the end of the part, now that this packet is outside."""
        time = packet.dts if packet.dts is not None else packet.pts
        if time is None or self._length is None or time * Fraction(packet.time_base) < self._length:
            return False
        self._ended.add(packet.stream_index)
        streams = (*self.container.streams.video, *self.container.streams.audio)
        followed = {s.index for s in streams if s.discard != av.stream.Discard.all}
        late = time * Fraction(packet.time_base) > self._length + LIMITS.interleaving_seconds
        return followed <= self._ended or (late and packet.stream is self.stream)

    def _decode(self, packet: AnyPacket) -> Iterator[av.VideoFrame]:
        if packet.pts is not None and not packet.is_discard:
            stored = packet.dts if self.has_decoding_times else None
            self._recent.append(packet.pts if stored is None else stored)
            if packet.size and stored is not None:
                heapq.heappush(self._times, stored)
        try:
            pictures = self.decoder.decode(packet)
        except EOFError:
            return
        except av.error.FFmpegError as error:
            self.damaged = True
            self._times = sorted(time for time in self._times if time != packet.dts)
            self.problems.note_damage(
                f"A damaged video packet at {self._clock(packet.pts)} was skipped ({reason(error)})."
            )
            return
        for picture in pictures:
            if self._start is not None and (picture.pts or 0) < self._start:
                continue  # it refers to pictures before the keyframe at which decoding started
            pts = self._time_of(picture)
            if not self.is_within(pts):
                self._last = pts
                continue
            if picture.is_corrupt:
                self.damaged = True
                self.problems.note_damage(
                    f"The picture at {self._clock(picture.pts)} is damaged in the input and was patched up."
                )
            yield self._prepare(picture, pts)

    def is_within(self, pts: int) -> bool:
        """Whether a picture with this time is in the part that is read."""
        return self._length is None or 0 <= pts * self.time_base < self._length

    def _report_missing_end(self) -> None:
        if self._length is not None:
            return
        missing = sum(1 for pts in self._recent if self._last is not None and pts > self._last)
        if missing:
            self.problems.note_damage(
                f"The last {missing} pictures, after {self._clock()}, could not be decoded."
            )
        announced, reached = self._announced_end(), self._reached_end()
        if announced is not None and reached < announced - LIMITS.max_missing_seconds:
            self.problems.note_damage(
                f"The file ends at {float(reached):.2f} s, but its header announces {float(announced):.2f} s."
            )

    def _reached_end(self) -> Fraction:
        """How far into the file packets reached, seconds."""
        streams = self.container.streams
        ends = [end * Fraction(streams[i].time_base or 0) for i, end in self._reached.items()]
        return max(ends, default=Fraction(0))

    def _announced_end(self) -> Fraction | None:
        """The end of the file by its header, seconds; None where that would be a guess."""
        kinds = set(self.container.format.name.split(","))
        whole = self._start is None and len(self.container.streams.video) == 1
        moved = self.clock.jumps or self.clock.shift(self.stream.index)
        if not self.container.duration or not whole or moved or not kinds & _STATES_DURATION:
            return None
        # in others than MP4, some programs count from zero and some from the first packet
        start = self.container.start_time or 0 if "mp4" in kinds else 0
        return Fraction(start + self.container.duration, av.time_base)

    # -- one picture --------------------------------------------------------------------------------------

    def _prepare(self, picture: av.VideoFrame, pts: int) -> av.VideoFrame:
        """A picture in a native format and the size of the first, with its time stamp."""
        picture.pts = pts
        converted = self._convert(picture)
        converted.pts, converted.time_base = pts, self.time_base
        self._last = pts
        return converted

    def _time_of(self, picture: av.VideoFrame) -> int:
        """An ascending time stamp for the next picture."""
        pts = picture.pts if picture.pts is not None else picture.dts
        if self._times:
            stored = heapq.heappop(self._times)
            if self._delay is None:
                self._delay = max(-stored - round(self.clock.moved_by / self.time_base), 0)
            pts = stored + self._delay
        if pts is None:
            self.problems.note("Pictures without a time stamp were placed by the frame rate.")
            if self._last is None:
                return round(self.clock.shift(self.stream.index) / self.time_base)
            return self._last + max(self._usual_duration(picture), 1)
        if self._last is not None and pts <= self._last:
            self.problems.note(f"The time stamp at {self._clock(pts)} does not ascend and was moved on.")
            return self._last + 1
        return int(pts)

    def _convert(self, picture: av.VideoFrame) -> av.VideoFrame:
        name = picture.format.name
        target = name if name in NATIVE_FORMATS else nearest_format(picture)
        self._shape = self._shape or (picture.width, picture.height, target)
        if target != name:
            bits = depth(self._shape[2])
            self.problems.note(f"Pictures were converted from {name} to {bits}-bit {self._shape[2]}.")
        stored = (picture.width, picture.height, name)
        if stored != self._stored:
            self._note_change(picture, stored)
        if stored == self._shape:
            return picture
        return self._letterboxed(picture)

    def _note_change(self, picture: av.VideoFrame, stored: tuple[int, int, str]) -> None:
        """Note that the size or format of the stored pictures changes, unless this is the first."""
        if self._stored is not None:
            assert self._shape is not None
            width, height, form = self._shape
            then = f"{stored[0]} x {stored[1]} {stored[2]}"
            if stored[:2] != (width, height):
                then = f"to {then}: it was letterboxed in {width} x {height}"
            else:
                then = (
                    f"back to {then}"
                    if self._stored[:2] != stored[:2]
                    else f"to {then}: it was kept as {form}"
                )
            self.problems.note(f"At {self._clock(picture.pts)} the picture changes {then}.")
        self._stored = stored

    def _pixel_aspect(self) -> Fraction:
        """Width over height of a pixel, as far as the stream tells."""
        return Fraction(self.stream.codec_context.sample_aspect_ratio or self.stream.sample_aspect_ratio or 1)

    def _letterboxed(self, picture: av.VideoFrame) -> av.VideoFrame:
        """A picture in the size and format of the first; another size is kept undistorted, between bars."""
        assert self._shape is not None
        return in_shape(picture, self._shape, self._pixel_aspect() / self._first_aspect)

    def _clock(self, pts: int | None = None) -> str:
        """A time stamp, or the last one that was yielded, in seconds."""
        known = pts if pts is not None else self._last
        return "an unknown time" if known is None else f"{float(known * self.time_base):.2f} s"


def in_shape(
    picture: av.VideoFrame, shape: tuple[int, int, str], stretch: Fraction = SQUARE
) -> av.VideoFrame:
    """A picture with another (width, height, pixel format), undistorted, between bars where its aspect ratio differs.

    stretch : how much wider its pixels are than those of the shape.
    """
    width, height, form = shape
    if (picture.width, picture.height) == (width, height):
        return reformat(picture, width, height, form)
    left, top, wide, tall = fitting_box(picture.width, picture.height, (width, height), stretch)
    return pasted(reformat(picture, wide, tall, form), (width, height), left, top)


def reformat(picture: av.VideoFrame, width: int, height: int, fmt: str) -> av.VideoFrame:
    """Convert size and pixel format; matrix and range stay, RGB becomes limited-range YUV."""
    if picture.format.is_rgb or picture.format.has_palette:
        matrix = colour.BT709 if height >= 720 else colour.SMPTE170M
        out = picture.reformat(width, height, fmt, dst_colorspace=matrix, dst_color_range=colour.LIMITED)
        out.colorspace, out.color_range = matrix, colour.LIMITED
        return out
    span = colour.FULL if is_full_range(picture) else colour.LIMITED
    out = picture.reformat(width, height, fmt, src_color_range=span, dst_color_range=span)
    out.colorspace, out.color_range = picture.colorspace, picture.color_range
    out.color_trc, out.color_primaries = picture.color_trc, picture.color_primaries
    return out


def is_full_range(picture: av.VideoFrame) -> bool:
    """Whether a picture's components span 0..255."""
    name = picture.format.name
    return name.startswith("yuvj") or picture.color_range == colour.FULL
