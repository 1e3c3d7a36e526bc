"""A file cut at keyframes into segments that can be read independently.

A segment yields exactly the frames that a pass from the start would yield there.  Where the packets do not determine
the frames with certainty, the whole file is one segment.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.app.media.frame import Frame
from guise.app.media.input import MediaInput, VideoInput, file_version
from guise.app.media.opening import open_input
from guise.app.media.problems import ProblemLog
from guise.app.media.reader import VideoReader
from guise.app.media.time_range import TimeRange

# Codecs in which every packet is one shown picture; others may have hidden or repeated ones.
_ONE_PICTURE_PER_PACKET = frozenset(
    {
        "h264", "hevc", "vvc", "av1", "vp9", "mpeg4", "mpeg2video", "mpeg1video", "h263", "mjpeg", "prores", "dnxhd",
        "ffv1", "huffyuv", "ffvhuff", "utvideo", "rawvideo", "png",
    }
)  # fmt: skip
_CHECKED_PICTURES = 16  # that are decoded to check whether they agree with the packets


@dataclass(frozen=True)
class Segment:
    """The frames [first, first + count) of a file, its segment number `index`."""

    index: int
    first: int
    count: int

    @property
    def end(self) -> int:
        """The first frame after the segment."""
        return self.first + self.count


@dataclass(frozen=True, eq=False)
class Scan:
    """The frames of a file.

    pts : (frames,) int64, ascending, in units of time_base.   keyframes : (k,) int32, frames at which decoding can
    start, the first of them 0.   dts : (k,) int64, their decoding times, to seek to.
    segments : these cover all frames, in order.
    """

    time_base: Fraction
    pts: NDArray[np.int64]
    keyframes: NDArray[np.int32]
    dts: NDArray[np.int64]
    segments: tuple[Segment, ...]

    @property
    def frames(self) -> int:
        """The number of frames."""
        return len(self.pts)

    def as_json(self) -> dict[str, Any]:
        """The scan as JSON holds it."""
        return {
            "time_base": str(self.time_base),
            "pts": self.pts.tolist(),
            "keyframes": self.keyframes.tolist(),
            "dts": self.dts.tolist(),
            "segments": [[piece.first, piece.count] for piece in self.segments],
        }

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Scan:
        """The scan from what `as_json` returned."""
        return cls(
            Fraction(values["time_base"]), np.array(values["pts"], np.int64),
            np.array(values["keyframes"], np.int32), np.array(values["dts"], np.int64),
            tuple(Segment(i, first, count) for i, (first, count) in enumerate(values["segments"])),
        )  # fmt: skip


def scan(path: Path | str, length: int = 240, part: TimeRange | None = None) -> Scan:
    """Find the frames of a file, and cut it at keyframes into segments of at least `length` frames.

    Only packets are read, unless they do not determine the frames with certainty; then, as for images, everything is
    decoded and there is one segment.  Raises MediaError when there is nothing to read.   part : as for `open_input`.
    """
    with open_input(path, part=part) as media:
        if isinstance(media, VideoInput) and (found := _from_packets(media, length)):
            return found
        pts = np.array([frame.pts for frame in media], np.int64)
        start = np.zeros(1, np.int32)
        return Scan(media.time_base, pts, start, pts[:1], (Segment(0, 0, len(pts)),))


def _from_packets(media: VideoInput, length: int) -> Scan | None:
    """The scan without decoding everything, or None where it would be uncertain."""
    packets = _video_packets(media)
    decoded = [frame.pts for frame in islice(media, _CHECKED_PICTURES)]
    if (
        packets is None or media.clock.jumps
    ):  # where packets lie among jumps, only a pass from the start tells
        return None
    times, dts, is_key = packets
    times, order = np.sort(times), times
    pts = times[
        np.searchsorted(times, decoded[0]) :
    ]  # pictures that refer to others before the file are not decoded
    if pts[:_CHECKED_PICTURES].tolist() != decoded:
        return None
    is_start = is_key & (order >= np.maximum.accumulate(order)) & (order > pts[0])
    keyframes = np.searchsorted(pts, [pts[0], *order[is_start]]).astype(np.int32)
    starts = np.array([pts[0], *dts[is_start]])
    return Scan(media.time_base, pts, keyframes, starts, _cut(keyframes, len(pts), length))


def _video_packets(
    media: VideoInput,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]] | None:
    """pts, dts and key flag (n,) of the video's packets in decoding order; None if they are ambiguous."""
    problems = ProblemLog()
    with media.open_reader(problems) as reader:
        reader.only_video()
        known = reader.stream.codec_context.codec.canonical_name in _ONE_PICTURE_PER_PACKET
        if not known or reader.has_decoding_times:
            return None
        rows: list[tuple[int, int, bool]] = []
        for packet in reader.packets():
            if packet.stream is not reader.stream or (packet.dts is None and not packet.size):
                continue
            if packet.pts is None or not packet.size or packet.is_corrupt:
                return None
            if not packet.is_discard and reader.is_within(packet.pts):
                dts = packet.pts if packet.dts is None else packet.dts
                rows.append((packet.pts, dts, packet.is_keyframe))
    table = np.array(rows, np.int64).reshape(-1, 3)
    if problems or len(table) == 0 or len(np.unique(table[:, 0])) < len(table):
        return None
    return table[:, 0], table[:, 1], table[:, 2] > 0


def _cut(keyframes: NDArray[np.int32], frames: int, length: int) -> tuple[Segment, ...]:
    """Segments of at least `length` frames from keyframe to keyframe; a shorter rest is added to the one before."""
    starts = [0]
    for keyframe in keyframes.tolist():
        if keyframe - starts[-1] >= length and frames - keyframe >= length:
            starts.append(keyframe)
    ends = [*starts[1:], frames]
    return tuple(Segment(i, a, b - a) for i, (a, b) in enumerate(zip(starts, ends, strict=True)))


def read_frames(
    path: Path | str, scan: Scan, first: int, last: int, *, problems: ProblemLog | None = None,
    kept: KeptFrames | None = None, part: TimeRange | None = None,
) -> Iterator[Frame]:  # fmt: skip
    """The frames [first, last) of a scanned file, as a pass from the start yields them; indices count from its start.

    A picture that cannot be decoded is left out, as in that pass, and noted in `problems`.  With `kept`, a file that
    fits in there is decoded once.   part : that of the scan.
    """
    noted = ProblemLog() if problems is None else problems
    if kept is not None and (frames := kept.frames(path, noted, part)) is not None:
        yield from (frame.copy() for frame in frames if first <= frame.index < last)
        return
    with open_input(path, part=part) as media:
        try:
            window = _window(media, scan, first, last)
            if kept is None or (first, last) != (0, scan.frames):
                yield from window
            else:
                yield from kept.filled(path, window, scan.frames, media.problems, part)
        finally:
            noted.add(media.problems)


class KeptFrames:
    """The frames of the file that was last read whole, if they have no more bytes than `most` allows then."""

    def __init__(self, most: Callable[[], int]) -> None:
        self._most = most
        self._held: tuple[object, list[Frame], ProblemLog] | None = None

    def frames(
        self, path: Path | str, problems: ProblemLog, part: TimeRange | None = None
    ) -> list[Frame] | None:
        """The frames of a file, to be copied, and what went wrong when it was read; None where they aren't kept."""
        held = self._held
        if held is None or held[0] != (file_version(Path(path)), part):
            return None
        problems.add(held[2])
        return held[1]

    def filled(
        self,
        path: Path | str,
        frames: Iterator[Frame],
        count: int,
        problems: ProblemLog,
        part: TimeRange | None = None,
    ) -> Iterator[Frame]:
        """All `count` frames of a file; they are kept once the last one was read."""
        self.clear()
        version, most, copies = file_version(Path(path)), self._most(), list[Frame]()
        for frame in frames:
            if count * frame.nbytes <= most:
                copies.append(frame.copy())
            yield frame
        if copies and version is not None:
            self._held = (version, part), copies, problems

    def clear(self) -> None:
        """Let go of them."""
        self._held = None


def _window(media: MediaInput, scan: Scan, first: int, last: int) -> Iterator[Frame]:
    """From the keyframe before where that works, with one thread where the file is damaged, or else from the start."""
    key = int(np.searchsorted(scan.keyframes, first, "right")) - 1
    following = first
    for number, single_threaded in [(key, False), (key, True), (0, True)]:
        attempt = _Attempt(media, scan, number, single_threaded=single_threaded)
        for frame in attempt:
            if frame.index >= last:
                return
            if frame.index >= following:
                following = frame.index + 1
                yield frame
        if not attempt.gave_up:
            return


class _Attempt:
    """One attempt to decode the frames from a keyframe to the end.

    gave_up : whether it stopped because a pass from the start with one thread might yield other frames.
    """

    gave_up = False

    def __init__(self, media: MediaInput, scan: Scan, key: int, *, single_threaded: bool) -> None:
        self._media, self._scan = media, scan
        self._first = int(scan.keyframes[key])
        self._dts = int(scan.dts[key])
        # From the next keyframe on, decoding cannot depend on where it started.
        following = int(scan.keyframes[key + 1]) if key + 1 < len(scan.keyframes) else scan.frames
        self._uncertain_until = following if key > 0 else 0
        self._single_threaded = single_threaded

    def __iter__(self) -> Iterator[Frame]:
        if not isinstance(self._media, VideoInput):
            yield from self._media
            return
        problems = ProblemLog()
        try:
            yield from self._decode(self._media, problems)
        finally:
            if not self.gave_up:
                self._media.problems.add(problems)

    def _decode(self, media: VideoInput, problems: ProblemLog) -> Iterator[Frame]:
        reader = media.open_reader(problems)
        if self._single_threaded:
            reader.use_one_thread()
        if self._first > 0:
            reader.start_at(int(self._scan.pts[self._first]), self._dts, media.first_picture)
        held: deque[Frame] = deque()  # pictures before another may refer to it, and be damaged with it
        expected = self._first
        for frame in _numbered(media.frames_of(reader), self._scan, problems):
            corrupt = frame.video_frame is not None and frame.video_frame.is_corrupt
            strange = expected < self._uncertain_until and (frame.index != expected or corrupt)
            if strange or self._is_unreliable(reader):
                self.gave_up = True
                return
            expected = frame.index + 1
            held.append(frame)
            if len(held) > reader.decoder.reorder_depth:
                yield held.popleft()
        self.gave_up = self._is_unreliable(reader)
        if not self.gave_up:
            yield from held

    def _is_unreliable(self, reader: VideoReader) -> bool:
        return reader.damaged and not self._single_threaded


def _numbered(frames: Iterator[Frame], scan: Scan, problems: ProblemLog) -> Iterator[Frame]:
    """The frames with their indices in the scan; those that are not in it are left out."""
    for frame in frames:
        index = int(np.searchsorted(scan.pts, frame.pts))
        if index < scan.frames and scan.pts[index] == frame.pts:
            frame.index = index
            yield frame
        else:
            problems.note("Pictures whose times do not occur in the file's packets were left out.")
