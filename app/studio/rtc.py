"""The video connection of one browser tab: the pictures of its camera come in, finished pictures go out.

Neither way queues: whoever is late loses the picture, not the time.  No server outside is asked for addresses (STUN),
as browser and server are on one machine.  Pictures stay in the planes of the codec.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from typing import Any

from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError

from app.live.output import Output, Shown
from app.live.slot import Slot
from app.media import Frame

TICKS = Fraction(1, 90_000)  # seconds; the clock of video in RTP


class PeerError(Exception):
    """A connection that cannot be made; the message is for the user."""


class BrowserCamera:
    """Frames of the browser's camera for one thread, the latest each time; ends when the connection ends."""

    def __init__(self) -> None:
        self._slot: Slot[Frame] = Slot()
        self._count = 0

    def put(self, video: Any) -> None:
        """Offer a decoder's picture."""
        self._slot.put(Frame(video, pts=video.pts, time_base=TICKS, index=self._count))
        self._count += 1

    @property
    def dropped(self) -> int:
        """Number of pictures that were replaced before they were taken."""
        return self._slot.dropped

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self._slot.get()) is not None:
            yield frame

    def close(self) -> None:
        """End the frames."""
        self._slot.close()


class PeerOutput(Output):
    """Sends finished pictures to the browser, from the thread of an output."""

    def __init__(self, track: ResultTrack, loop: asyncio.AbstractEventLoop) -> None:
        self._track, self._loop = track, loop

    def show(self, shown: Shown) -> None:
        """Offer a copy of a picture, stamped with the time at which the camera gave it."""
        video = shown.frame.copy().video_frame
        assert video is not None
        video.pts, video.time_base = int(shown.arrived / TICKS), TICKS
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._track.offer, video)


class ResultTrack(MediaStreamTrack):
    """What the browser is sent: the latest picture each time that the encoder is ready for one."""

    kind = "video"

    def __init__(self) -> None:
        super().__init__()
        self.dropped = 0
        self._latest: asyncio.Queue[Any] = asyncio.Queue(1)

    def offer(self, video: Any) -> None:
        """Offer a picture, or None for the end; replaces one that was not sent yet."""
        if self._latest.full():
            self.dropped += self._latest.get_nowait() is not None
        self._latest.put_nowait(video)

    async def recv(self) -> Any:
        """The latest picture, as soon as there is one."""
        video = None if self.readyState == "ended" else await self._latest.get()
        if video is None:
            self.stop()
            raise MediaStreamError
        return video


class Peer:
    """The server's end of a connection; made and used in an event loop.

    Parameters
    ----------
    camera : where the browser's pictures go.
    ended : called once when the connection is over, whoever ended it.
    """

    def __init__(self, camera: BrowserCamera | None, ended: Callable[[], None]) -> None:
        self.track = ResultTrack()
        self.output = PeerOutput(self.track, asyncio.get_running_loop())
        self._camera, self._ended = camera, ended
        self._connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self._connection.on("track", self._receive)
        self._connection.on("connectionstatechange", self._changed)
        self._reading: asyncio.Task[None] | None = None

    async def answer(self, offer: Mapping[str, str]) -> dict[str, str]:
        """Take the browser's offer {"type", "sdp"} and give the answer of the same form.

        Raises
        ------
        PeerError
            When it is no offer of a video connection.
        """
        try:
            await self._connection.setRemoteDescription(RTCSessionDescription(offer["sdp"], offer["type"]))
            self._connection.addTrack(self.track)
            await self._connection.setLocalDescription(await self._connection.createAnswer())
        except (KeyError, ValueError, IndexError, AttributeError) as error:
            await self.close()
            raise PeerError(
                "the browser's offer of a video connection was not understood: reload the page"
            ) from error
        answer = self._connection.localDescription
        return {"type": answer.type, "sdp": answer.sdp}

    async def close(self) -> None:
        """End the connection, the camera's frames and the track; may be called again."""
        ended, self._ended = self._ended, _nothing
        if self._reading is not None:
            self._reading.cancel()
        if self._camera is not None:
            self._camera.close()
        self.track.offer(None)
        await self._connection.close()
        ended()

    def _receive(self, track: MediaStreamTrack) -> None:
        if track.kind == "video" and self._camera is not None and self._reading is None:
            self._reading = asyncio.ensure_future(self._read(track, self._camera))

    async def _read(self, track: MediaStreamTrack, camera: BrowserCamera) -> None:
        with contextlib.suppress(MediaStreamError):
            while True:
                camera.put(await track.recv())
        await self.close()

    async def _changed(self) -> None:
        if self._connection.connectionState in ("failed", "closed"):
            await self.close()


def _nothing() -> None:
    """Done already."""
