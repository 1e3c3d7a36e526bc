"""The packets of a video file's other streams (audio, subtitles, data), to be copied beside new pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator

from guise.app.media.input import VideoInput
from guise.app.media.problems import ProblemLog
from guise.app.media.reader import AnyPacket


def first_pts(media: VideoInput) -> int:
    """Time of the first picture, in units of the input's time base."""
    with media.open_reader(ProblemLog()) as reader:
        return next(iter(reader)).pts or 0


class OtherStreams:
    """The packets of a file's other streams, in the file's order, as far as its pictures are used.

    first : time of the first picture.  Times are in units of the input's time base.
    cut : there were more pictures when `rest` was read.
    """

    def __init__(self, media: VideoInput) -> None:
        self.first, self.cut = first_pts(media), False
        reader = media.open_reader(ProblemLog())
        self._video, self._packets = reader.stream, reader.packets()
        self._reached = -math.inf

    def until(self, pts: int) -> Iterator[AnyPacket]:
        """The packets before the picture of that time."""
        while self._reached < pts and (packet := next(self._packets, None)) is not None:
            if packet.stream is self._video:
                self._reached = max(self._reached, -math.inf if packet.pts is None else packet.pts)
            elif packet.size:
                yield packet

    def rest(self, pts: int, end: int) -> Iterator[AnyPacket]:
        """The packets after the picture of that time: all, or up to its end when there are more pictures."""
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
