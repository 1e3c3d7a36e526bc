"""The pictures of a network stream, as soon as they arrive.

Nothing is buffered beyond what the decoder needs.  A stream may stop at any time; reopening it is left to the caller.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import chain
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import av
import av.error
from av.video.stream import VideoStream

from guise.app.media.container import is_still
from guise.app.media.errors import MediaError, reason
from guise.app.media.pixel_formats import NATIVE_FORMATS, nearest_format
from guise.app.media.reader import in_shape
from guise.common.closing import Closing

if TYPE_CHECKING:
    VideoPacket = av.Packet[VideoStream]

Picture = av.VideoFrame
PROTOCOLS = ("rtsp", "rtsps", "rtmp", "rtmps", "http", "https", "udp", "tcp", "rtp", "srt")
_LOWER_PROTOCOLS = "crypto,data,hls,httpproxy,tls,rtmpt,srtp"  # below those; no local files
_OPTIONS = {
    "protocol_whitelist": ",".join((*PROTOCOLS, _LOWER_PROTOCOLS)),
    "rtsp_transport": "tcp",
    "analyzeduration": "2000000",  # microseconds
}
_PLAYLISTS = frozenset({"hls", "dash"})  # deliver segments of several seconds
_QUEUED_READ_INTERVALS = 0.5  # frame intervals; a packet that is read faster had been waiting
_MAX_BACKLOG_SECONDS = 1.0  # of packets that had been waiting, after which the older ones are skipped


def shown_address(url: str) -> str:
    """An address that is safe to show: without user, password and query.

    >>> shown_address("rtsp://me:secret@10.0.0.7:554/door?token=1")
    'rtsp://10.0.0.7:554/door'
    """
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"


class NetworkReader(Closing):
    """An open stream; iterate once for its pictures, all in one native format and size.

    Parameters
    ----------
    url : its address.   timeout : seconds without data after which the stream counts as stopped.
    shape : (width, height, pixel format) to which pictures are converted; None for those of the first one.

    Attributes
    ----------
    shape : as above.   fps : nominal frames per second.
    needs_pacing : pictures arrive faster than they are to be shown, as from a file on a server.
    is_finite : the stream has an end.

    Raises
    ------
    MediaError
        When the address delivers no pictures.
    """

    def __init__(self, url: str, timeout: float, shape: tuple[int, int, str] | None = None) -> None:
        self.name, self.shape = shown_address(url), shape
        if urlsplit(url).scheme not in PROTOCOLS:
            raise MediaError(
                f"{self.name} is not the address of a stream: it must begin with {', '.join(PROTOCOLS)}."
            )
        try:
            self._container = av.open(url, timeout=(timeout, timeout), options=_OPTIONS)
        except (av.error.FFmpegError, OSError, ValueError) as error:
            raise self._stopped(error) from error
        try:
            self._read_properties()
        except BaseException:
            self.close()
            raise

    def _read_properties(self) -> None:
        stream = next((s for s in self._container.streams.video if not is_still(s)), None)
        if stream is None or stream.codec_context is None:
            raise MediaError(f"{self.name} has no pictures that can be decoded: give the address of a video.")
        self._stream = stream
        self.is_finite = bool(self._container.duration)
        self.needs_pacing = self.is_finite or bool(_PLAYLISTS & set(self._container.format.name.split(",")))
        stream.thread_type = "AUTO" if self.needs_pacing else "SLICE"  # threads over frames cost a delay
        self.fps = float(stream.average_rate or stream.guessed_rate or 30)
        pictures = self._pictures()
        first = next(pictures, None)
        if first is None:
            raise MediaError(f"{self.name} ended before its first picture: check that it is sending.")
        self._rest = chain([first], pictures)

    def __iter__(self) -> Iterator[Picture]:
        """Until the stream ends; MediaError when it stops."""
        return self._rest

    def close(self) -> None:
        """Close the connection."""
        self._container.close()

    def _pictures(self) -> Iterator[Picture]:
        packets = (
            self._packets()
            if self.needs_pacing
            else _BacklogSkipper(self._packets(), _QUEUED_READ_INTERVALS / self.fps)
        )
        for packet in packets:
            try:
                pictures = self._stream.decode(packet)
            except EOFError:
                return
            except av.error.FFmpegError:
                continue  # a damaged packet, as after a transmission loss
            for picture in pictures:
                yield self._native(picture)

    def _packets(self) -> Iterator[VideoPacket]:
        try:
            yield from self._container.demux(self._stream)
        except (av.error.FFmpegError, OSError) as error:
            raise self._stopped(error) from error

    def _native(self, picture: Picture) -> Picture:
        name = picture.format.name
        if self.shape is None:
            fmt = name if name in NATIVE_FORMATS else nearest_format(picture)
            self.shape = (picture.width, picture.height, fmt)
        if (picture.width, picture.height, name) == self.shape:
            return picture
        pts, base = picture.pts, picture.time_base
        converted = in_shape(picture, self.shape)
        converted.pts, converted.time_base = pts, base
        return converted

    def _stopped(self, error: Exception) -> MediaError:
        why = "no data arrives" if isinstance(error, av.error.ExitError) else reason(error)
        return MediaError(f"{self.name} cannot be played ({why}): check the address and that it is sending.")


class _BacklogSkipper:
    """Packets, without those that pile up because decoding is too slow: these are skipped up to a keyframe.

    queued_seconds : a packet that takes no longer to read had been waiting.
    """

    def __init__(self, packets: Iterator[VideoPacket], queued_seconds: float) -> None:
        self._packets, self._queued_seconds = packets, queued_seconds
        self._waited = time.perf_counter()  # when a read last had to wait

    def __iter__(self) -> Iterator[VideoPacket]:
        skipping = False
        while True:
            begun = time.perf_counter()
            packet = next(self._packets, None)
            if packet is None:
                return
            now = time.perf_counter()
            if now - begun > self._queued_seconds:
                self._waited = now
            backlogged = now - self._waited > _MAX_BACKLOG_SECONDS
            skipping = backlogged or (skipping and not packet.is_keyframe)
            if not skipping:
                yield packet
