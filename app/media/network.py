"""The pictures of a stream that comes over the network, as soon as they come.

Nothing is buffered beyond what the decoder needs.  A stream may stop at any time; opening it again is for the caller.
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

from guise.app.media.errors import MediaError
from guise.app.media.frame import NATIVE_FORMATS
from guise.app.media.reader import is_still, nearest_format, reformat
from guise.common.closing import Closing

if TYPE_CHECKING:
    VideoPacket = av.Packet[VideoStream]

Picture = av.VideoFrame
PROTOCOLS = ("rtsp", "rtsps", "rtmp", "rtmps", "http", "https", "udp", "tcp", "rtp", "srt")
_PARTS = "crypto,data,hls,httpproxy,tls,rtmpt,srtp"  # what these are made of; files of this computer are not among it
_OPTIONS = {
    "protocol_whitelist": ",".join((*PROTOCOLS, _PARTS)),
    "rtsp_transport": "tcp",
    "analyzeduration": "2000000",  # microseconds
}
_PLAYLISTS = frozenset({"hls", "dash"})  # come in pieces of several seconds
_AT_ONCE = 0.5  # of the time between pictures; a packet that took no longer to read had been waiting
_PILED_UP = 1.0  # seconds for which packets were waiting after which the older ones are passed over


def shown_address(url: str) -> str:
    """An address as it may be shown: without user, password and query.

    >>> shown_address("rtsp://me:secret@10.0.0.7:554/door?token=1")
    'rtsp://10.0.0.7:554/door'
    """
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"


class NetworkReader(Closing):
    """An open stream; iterate once for its pictures, in native formats and of one size.

    Parameters
    ----------
    url : its address.   patience : seconds after which a stream that gives nothing is taken to have stopped.
    shape : (width, height, pixel format) that pictures are converted to; None for the first one's.

    Attributes
    ----------
    shape : as above.   fps : frames a second, nominal.
    timed : the pictures come faster than they are to be shown, as those of a file on a server do.
    ends : the stream has an end, after which nothing more will come.

    Raises
    ------
    MediaError
        When nothing comes from there.
    """

    def __init__(self, url: str, patience: float, shape: tuple[int, int, str] | None = None) -> None:
        self.name, self.shape = shown_address(url), shape
        if urlsplit(url).scheme not in PROTOCOLS:
            raise MediaError(f"{self.name} is no address of a stream: it begins with {', '.join(PROTOCOLS)}.")
        try:
            self._container = av.open(url, timeout=(patience, patience), options=_OPTIONS)
        except (av.error.FFmpegError, OSError, ValueError) as error:
            raise self._stopped(error) from error
        try:
            self._learn()
        except BaseException:
            self.close()
            raise

    def _learn(self) -> None:
        stream = next((s for s in self._container.streams.video if not is_still(s)), None)
        if stream is None or stream.codec_context is None:
            raise MediaError(f"{self.name} has no pictures that can be decoded: give the address of a video.")
        self._stream = stream
        self.ends = bool(self._container.duration)
        self.timed = self.ends or bool(_PLAYLISTS & set(self._container.format.name.split(",")))
        stream.thread_type = "AUTO" if self.timed else "SLICE"  # threads over frames cost a delay
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
        packets = self._packets() if self.timed else _Newest(self._packets(), _AT_ONCE / self.fps)
        for packet in packets:
            try:
                pictures = self._stream.decode(packet)
            except EOFError:
                return
            except av.error.FFmpegError:
                continue  # a damaged packet, as after a loss on the way
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
        converted = reformat(picture, *self.shape)
        converted.pts, converted.time_base = pts, base
        return converted

    def _stopped(self, error: Exception) -> MediaError:
        silent = isinstance(error, av.error.ExitError)
        reason = "nothing comes" if silent else getattr(error, "strerror", None) or str(error)
        return MediaError(
            f"{self.name} cannot be played ({reason}): check the address and that it is sending."
        )


class _Newest:
    """Packets, of which those that pile up because decoding is too slow are passed over up to a keyframe.

    at_once : seconds; a packet that took no longer to read had been waiting.
    """

    def __init__(self, packets: Iterator[VideoPacket], at_once: float) -> None:
        self._packets, self._at_once = packets, at_once
        self._waited = time.perf_counter()  # when reading last had to wait

    def __iter__(self) -> Iterator[VideoPacket]:
        skipping = False
        while True:
            begun = time.perf_counter()
            packet = next(self._packets, None)
            if packet is None:
                return
            now = time.perf_counter()
            if now - begun > self._at_once:
                self._waited = now
            piled_up = now - self._waited > _PILED_UP
            skipping = piled_up or (skipping and not packet.is_keyframe)
            if not skipping:
                yield packet
