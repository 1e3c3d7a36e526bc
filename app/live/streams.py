"""A network stream as a capture: always the newest picture, and reconnection after an interruption."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from urllib.parse import urlsplit

from guise.app.live.capture import ReconnectingCapture
from guise.app.media import MediaError
from guise.app.media.network import NetworkReader, Picture
from guise.common.progress import Say


@dataclass(frozen=True)
class StreamTimeouts:
    """How long a stream may be silent or late, seconds."""

    stream_seconds: float = 5.0  # without a picture, after which a stream counts as interrupted
    playlist_seconds: float = 20.0  # the same for playlists, which deliver segments of several seconds
    late_seconds: float = 1.0  # by which a picture may be late before the playback clock is reset


TIMEOUTS = StreamTimeouts()


class StreamCapture(ReconnectingCapture[NetworkReader]):
    """A camera or video on the network.

    Parameters
    ----------
    url : address; rtsp, rtmp, http, udp, srt and the like.
    say : called with messages for the user.
    timeout : seconds without a picture after which the stream counts as interrupted; default: see `StreamTimeouts`.

    Raises
    ------
    MediaError
        When the address delivers no video.
    """

    def __init__(self, url: str, say: Say = print, timeout: float | None = None) -> None:
        playlist = urlsplit(url).path.endswith((".m3u8", ".mpd"))
        usual = TIMEOUTS.playlist_seconds if playlist else TIMEOUTS.stream_seconds
        self._url, self._timeout = url, timeout or usual
        reader = NetworkReader(url, self._timeout)
        super().__init__(reader, say)
        assert reader.shape is not None
        self.name, self.fps, self._shape = reader.name, reader.fps, reader.shape
        self.width, self.height, _ = reader.shape

    def _open(self) -> NetworkReader | None:
        try:
            return NetworkReader(self._url, self._timeout, self._shape)
        except MediaError:
            return None

    def _release(self, source: NetworkReader) -> None:
        source.close()

    def _has_ended(self, source: NetworkReader) -> bool:
        return source.is_finite

    def _pictures(self, source: NetworkReader) -> Iterator[Picture]:
        try:
            for picture in self._paced(source) if source.needs_pacing else source:
                picture.duration = 0
                yield picture
        except MediaError:
            if source.is_finite:
                raise

    def _paced(self, reader: NetworkReader) -> Iterator[Picture]:
        """Pictures at the pace of their own times."""
        begun: float | None = None
        for picture in reader:
            at, now = picture.time or 0.0, time.perf_counter()
            if begun is None or not -TIMEOUTS.late_seconds < begun + at - now < TIMEOUTS.playlist_seconds:
                begun = now - at
            self._stopped.wait(max(0.0, begun + at - now))
            yield picture
