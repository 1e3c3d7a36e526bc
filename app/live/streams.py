"""A stream over the network as a capture: the newest picture at once, and again after an interruption."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from urllib.parse import urlsplit

from guise.app.live.capture import AGAIN, CAMERA_TIME, Capture, Say
from guise.app.media import Frame, MediaError
from guise.app.media.network import NetworkReader, Picture

PATIENCE = 5.0  # seconds without a picture after which a stream is taken to have stopped
PLAYLIST_PATIENCE = 20.0  # the same for streams that come in pieces of several seconds
LATE = 1.0  # seconds by which a picture may come too late before the later ones are shown later as well


class StreamCapture(Capture):
    """A camera or a video on the network; when it stops it is waited for, and that is said.

    Parameters
    ----------
    url : address; rtsp, rtmp, http, udp, srt and the like.
    say : called with notes for the user.
    patience : seconds, see PATIENCE.

    Raises
    ------
    MediaError
        When nothing comes from there.
    """

    def __init__(self, url: str, say: Say = print, patience: float | None = None) -> None:
        usual = PLAYLIST_PATIENCE if urlsplit(url).path.endswith((".m3u8", ".mpd")) else PATIENCE
        self._url, self._say, self._patience = url, say, patience or usual
        reader = NetworkReader(url, self._patience)
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
                pts = max(round((time.perf_counter() - start) / CAMERA_TIME), self._last + 1)
                picture.duration, self._last = 0, pts
                yield Frame(picture, pts=pts, time_base=CAMERA_TIME, index=index)
                index += 1
                if self._stopped.is_set():
                    return
            if self._reader.ends:
                return
            self._say(f"{self.name} gives no pictures; waiting for it")
            self.close()

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _until_it_stops(self, reader: NetworkReader) -> Iterator[Picture]:
        try:
            yield from self._in_time(reader) if reader.timed else reader
        except MediaError:
            if reader.ends:
                raise

    def _in_time(self, reader: NetworkReader) -> Iterator[Picture]:
        """Pictures at the pace of their times."""
        begun: float | None = None
        for picture in reader:
            at, now = picture.time or 0.0, time.perf_counter()
            if begun is None or not -LATE < begun + at - now < PLAYLIST_PATIENCE:
                begun = now - at
            self._stopped.wait(max(0.0, begun + at - now))
            yield picture

    def _reopen(self) -> None:
        """One try; the thread sleeps before it."""
        if self._stopped.wait(AGAIN):
            return
        try:
            self._reader = NetworkReader(self._url, self._patience, self._shape)
        except MediaError:
            return
        self._say(f"{self.name} is back")
