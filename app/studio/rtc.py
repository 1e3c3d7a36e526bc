"""The video connection of one browser tab: the pictures of its camera come in, finished pictures go out.

Neither way queues: whoever is late loses the picture, not the time.  No server outside is asked for addresses (STUN),
as browser and server are on one machine.  Pictures stay in the planes of the codec.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

from aiortc import (
    MediaStreamTrack,
    RTCConfiguration,
    RTCPeerConnection,
    RTCRtpSender,
    RTCSessionDescription,
)
from aiortc.codecs import vpx
from aiortc.exceptions import InvalidStateError, OperationError
from aiortc.mediastreams import MediaStreamError

from guise.app.live.capture import Capture
from guise.app.live.controls import Controls
from guise.app.live.output import Output, Shown
from guise.app.live.overlay import draw_mask, draw_mesh
from guise.app.live.slot import Slot
from guise.app.media import Frame
from guise.app.media.colour import BT470BG
from guise.app.media.frame import clone_video_frame
from guise.app.media.target import Target
from guise.app.studio.store import StudioError

TICK = Fraction(1, 90_000)  # seconds; the clock of video in RTP
CODECS = ("video/VP8", "video/rtx", "video/H264")  # aiortc encodes VP8 in a third of the time
BITRATE = 2_500_000  # bits a second, both ways; the machine's own loopback is never congested

vpx.DEFAULT_BITRATE = vpx.MIN_BITRATE = vpx.MAX_BITRATE = BITRATE  # aiortc has no other way


class BrowserCamera(Capture):
    """Frames of a browser's camera, the latest each time; ends when the connection does."""

    name = "the browser's camera"

    def __init__(self) -> None:
        self._slot: Slot[Frame] = Slot()
        self._count = 0

    def put(self, video: Any) -> None:
        """Offer a decoder's picture."""
        self.width, self.height = video.width, video.height
        self._slot.put(Frame(video, pts=video.pts, time_base=TICK, index=self._count))
        self._count += 1

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self._slot.get()) is not None:
            yield frame

    def stop(self) -> None:
        self._slot.close()

    def close(self) -> None:
        self._slot.close()


class ResultTrack(MediaStreamTrack):
    """What the browser is sent: the latest picture each time that the encoder is ready for one."""

    kind = "video"

    def __init__(self) -> None:
        super().__init__()
        self.dropped = 0
        self._latest: asyncio.Queue[Any] = asyncio.Queue(1)

    def offer(self, video: Any) -> None:
        """Offer a picture, or None for the end; it replaces one that was not sent yet.  In the event loop."""
        if self._latest.full():
            self._latest.get_nowait()
            self.dropped += 1
        self._latest.put_nowait(video)

    async def recv(self) -> Any:
        """The latest picture, as soon as there is one."""
        video = None if self.readyState == "ended" else await self._latest.get()
        if video is None:
            self.stop()
            raise MediaStreamError
        return video


class PeerOutput(Output):
    """Sends finished pictures to the browser; the page shows what is to be read, mirrored or not.

    Parameters
    ----------
    peer : of the browser.   controls : say whether mask and mesh are drawn.
    """

    def __init__(self, peer: Peer, controls: Controls) -> None:
        self._peer, self._controls = peer, controls

    def show(self, shown: Shown) -> None:
        """Offer a copy of a picture, stamped with the time at which it came."""
        video = picture(shown, mask=self._controls.settings.mask, mesh=self._controls.settings.mesh)
        video.pts, video.time_base = int(shown.arrived / TICK), TICK
        self._peer.send(video)


def picture(shown: Shown, *, mask: bool, mesh: bool) -> Any:
    """A copy of a shown picture as the codec wants it, with the overlays that are wanted."""
    frame = shown.frame
    if shown.look.mesh is not None and (mask or mesh):
        frame = frame.copy()
        if mask:
            draw_mask(frame, shown.look.mesh)
        if mesh:
            draw_mesh(frame, shown.look.mesh)
    size = (frame.width, frame.height)
    even = (size[0] + size[0] % 2, size[1] + size[1] % 2)
    video = Target(size, even, "yuv420p", BT470BG).picture(frame)
    return clone_video_frame(video) if video is shown.frame.video_frame else video


class Peer:
    """The server's end of a connection; made and used in an event loop.

    Attributes
    ----------
    track : what the browser is sent.
    """

    def __init__(self) -> None:
        self._closed = False
        self.track = ResultTrack()
        self._camera = BrowserCamera()
        self._loop = asyncio.get_running_loop()
        self._connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self._connection.on("track", self._receive)
        self._connection.on("connectionstatechange", self._changed)
        self._reading: asyncio.Task[None] | None = None

    async def answer(self, offer: Mapping[str, str]) -> dict[str, str]:
        """Take the browser's offer {"type", "sdp"} and give the answer of the same form.

        Raises
        ------
        StudioError
            When it is no offer of a video connection; the connection is over then.
        """
        connection = self._connection
        try:
            described = RTCSessionDescription(offer["sdp"], offer["type"])
            connection.addTransceiver(self.track).setCodecPreferences(_codecs())
            await connection.setRemoteDescription(described)
            await connection.setLocalDescription(await connection.createAnswer())
        except _MISUNDERSTOOD as error:
            await self.close()
            raise StudioError("the browser's offer was not understood: reload the page") from error
        answer = connection.localDescription
        return {"type": answer.type, "sdp": _with_bitrate(answer.sdp)}

    def alive(self) -> bool:
        """Whether it is not over yet, whoever would end it."""
        return not self._closed

    def camera(self) -> BrowserCamera:
        """The browser's camera anew; the frames of the one before end.  From any thread."""
        before, self._camera = self._camera, BrowserCamera()
        before.stop()
        if self._closed:
            self._camera.stop()
        return self._camera

    def send(self, video: Any) -> None:
        """Offer a finished picture to the browser; from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self.track.offer, video)

    async def close(self) -> None:
        """End the connection, the camera's frames and the track; may be called again."""
        self._closed = True
        self._camera.stop()
        self.track.offer(None)
        await self._connection.close()

    def _receive(self, track: MediaStreamTrack) -> None:
        if track.kind == "video" and self._reading is None:
            self._reading = asyncio.create_task(self._read(track))

    async def _read(self, track: MediaStreamTrack) -> None:
        with contextlib.suppress(MediaStreamError):
            while True:
                self._camera.put(await track.recv())
        await self.close()

    async def _changed(self) -> None:
        if self._connection.connectionState in ("failed", "closed"):
            await self.close()


_MISUNDERSTOOD = (
    KeyError, IndexError, TypeError, ValueError, AssertionError, AttributeError, InvalidStateError, OperationError,
)  # fmt: skip


def _with_bitrate(sdp: str) -> str:
    """An answer that tells Chromium how much to send, which otherwise begins with little."""
    rate = ";".join(f"x-google-{word}-bitrate={BITRATE // 1000}" for word in ("min", "start", "max"))
    return re.sub(r"(a=rtpmap:(\d+) VP8/90000\r\n)", rf"\1a=fmtp:\2 {rate}\r\n", sdp)


def _codecs() -> list[Any]:
    """What aiortc can do, in the order of preference."""
    known = RTCRtpSender.getCapabilities("video").codecs
    return [codec for name in CODECS for codec in known if codec.mimeType == name]
