"""What lies in a video file beside its pictures: packets to copy, and sound to hear."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import av
import av.error
import numpy as np
from av.audio.frame import AudioFrame
from av.audio.resampler import AudioResampler
from numpy.typing import NDArray

from guise.app.media.input import VideoInput
from guise.app.media.reader import Problems, Reader, open_container
from guise.common.closing import Closing

if TYPE_CHECKING:
    from guise.app.media.reader import AnyPacket

Samples = NDArray[np.float32]

RATE = 48_000  # samples a second of what is heard


def first_pts(source: VideoInput) -> int:
    """Time of the first picture, in units of the source's time base."""
    with contextlib.closing(Reader(source.path, Problems())) as reader:
        return next(iter(reader)).pts or 0


class Beside:
    """The packets of a file's other streams, in the file's order, as far as its pictures are used.

    first : time of the first picture.  Times are in units of the source's time base.
    cut : pictures were left when `rest` was read.
    """

    def __init__(self, source: VideoInput) -> None:
        self.first, self.cut = first_pts(source), False
        reader = source.open_reader(Problems())
        self._video, self._packets = reader.stream, reader.packets()
        self._reached = -math.inf

    def until(self, pts: int) -> Iterator[AnyPacket]:
        """What lies before the picture of that time."""
        while self._reached < pts and (packet := next(self._packets, None)) is not None:
            if packet.stream is self._video:
                self._reached = max(self._reached, -math.inf if packet.pts is None else packet.pts)
            elif packet.size:
                yield packet

    def rest(self, pts: int, end: int) -> Iterator[AnyPacket]:
        """What remains after the picture of that time: all, or up to its end when there are more pictures."""
        others: list[AnyPacket] = []
        for packet in self._packets:
            if packet.stream is not self._video:
                others += [packet] if packet.size else []
            elif packet.pts is not None and packet.pts > pts:
                limit = end * (self._video.time_base or 0)
                others = [p for p in others if p.dts is not None and p.dts * p.time_base < limit]
                self.cut = True
                break
        yield from others


class SoundReader(Closing):
    """The first sound stream of a video file, decoded from any time on as stereo, RATE samples a second.

    Use `has_audio` of the source to know whether there is one.
    """

    def __init__(self, source: VideoInput) -> None:
        self._container = open_container(source.path)
        self._stream = self._container.streams.audio[0]
        self.seek(0.0)

    def seek(self, seconds: float) -> None:
        """Go on with what is heard at that time of the file, or a little before."""
        with contextlib.suppress(av.error.FFmpegError):  # where there is no index, from the beginning
            self._container.seek(max(0, round(seconds * av.time_base)))
        self._blocks = self._decoded()

    def read(self) -> tuple[float, Samples] | None:
        """The next block: its time in the file, seconds, and (n, 2) float32 in [-1, 1]; None at the end."""
        return next(self._blocks, None)

    def close(self) -> None:
        """Close the file."""
        self._container.close()

    def _decoded(self) -> Iterator[tuple[float, Samples]]:
        resampler = AudioResampler("flt", "stereo", RATE)
        for packet in self._packets():
            try:
                frames = packet.decode()
            except av.error.FFmpegError:
                continue  # a damaged packet is silence
            for frame in frames:
                assert isinstance(frame, AudioFrame)
                for block in resampler.resample(frame):
                    yield float(block.time or 0.0), np.asarray(block.to_ndarray(), np.float32).reshape(-1, 2)

    def _packets(self) -> Iterator[AnyPacket]:
        with contextlib.suppress(av.error.FFmpegError):  # the file is cut short
            yield from self._container.demux(self._stream)  # type: ignore[misc]
