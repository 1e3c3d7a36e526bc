"""A network stream as a capture: always the newest picture, and reconnection after an interruption."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from urllib.parse import urlsplit

from guise.app.live.capture import CAMERA_TIME_BASE, RECONNECT_SECONDS, Capture
from guise.app.media import Frame, MediaError
from guise.app.media.network import NetworkReader, Picture
from guise.common.progress import Say


@dataclass(frozen=True)
class StreamTimeouts:
    """How long a stream may be silent or late, seconds."""

    stream_seconds: float = 5.0  # without a picture, after which a stream counts as interrupted
    playlist_seconds: float = 20.0  # the same for playlists, which deliver segments of several seconds
    late_seconds: float = 1.0  # by which a picture may be late before the playback clock is reset


TIMEOUTS = StreamTimeouts()


class StreamCapture(Capture):
    """A camera or video on the network; when it stops, the user is told and the capture reconnects.

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
        self._url, self._say, self._timeout = url, say, timeout or usual
        reader = NetworkReader(url, self._timeout)
        assert reader.shape is not None
        self.name, self.fps, self._shape = reader.name, reader.fps, reader.shape
        self.width, self.height, _ = reader.shape
        self._reader: NetworkReader | None = reader
        self._stopped = threading.Event()
        self._last = -1

    def __iter__(self) -> Iterator[Frame]:
        index, start = 0, time.perf_counter()
        while not self._stopped.is_set():
            if self._reader is None:
                self._reopen()
                continue
            for picture in self._until_it_stops(self._reader):
                pts = max(round((time.perf_counter() - start) / CAMERA_TIME_BASE), self._last + 1)
                picture.duration, self._last = 0, pts
                yield Frame(picture, pts=pts, time_base=CAMERA_TIME_BASE, index=index)
                index += 1
                if self._stopped.is_set():
                    return
            if self._reader.is_finite:
                return
            self._say(f"{self.name} has stopped sending pictures; waiting for it")
            self.close()

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _until_it_stops(self, reader: NetworkReader) -> Iterator[Picture]:
        try:
            yield from self._paced(reader) if reader.needs_pacing else reader
        except MediaError:
            if reader.is_finite:
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

    def _reopen(self) -> None:
        """Try once to reconnect, after a pause."""
        if self._stopped.wait(RECONNECT_SECONDS):
            return
        try:
            self._reader = NetworkReader(self._url, self._timeout, self._shape)
        except MediaError:
            return
        self._say(f"{self.name} is back")
