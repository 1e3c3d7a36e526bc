"""The WebRTC connection of one browser tab: its camera's frames and sound come in, finished frames go out.

Neither direction queues: a frame that is late is dropped.  No STUN server is asked for addresses, because browser and
server are on one machine.  Frames stay in the planes of the codec.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
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
from guise.app.live.microphone import Microphone
from guise.app.live.output import Output, OutputFrame
from guise.app.live.overlay import draw_mask, draw_mesh
from guise.app.live.slot import LatestSlot
from guise.app.media import Frame
from guise.app.media.colour import BT470BG
from guise.app.media.frame import clone_video_frame
from guise.app.media.picture_format import PictureFormat
from guise.app.studio.store import StudioError

RTP_TIME_BASE = Fraction(1, 90_000)  # seconds
CODECS = ("video/VP8", "video/rtx", "video/H264")  # aiortc encodes VP8 in a third of the time of H.264
BITS_PER_SECOND = 2_500_000  # in both directions; the loopback interface is never congested

vpx.DEFAULT_BITRATE = vpx.MIN_BITRATE = vpx.MAX_BITRATE = BITS_PER_SECOND  # aiortc has no other way


class BrowserCamera(Capture):
    """Always the latest frame of a browser's camera; ends when the connection does."""

    name = "the browser's camera"

    def __init__(self) -> None:
        self._slot: LatestSlot[Frame] = LatestSlot()
        self._count = 0

    def put(self, video: Any) -> None:
        """Offer a decoded video frame."""
        self.width, self.height = video.width, video.height
        self._slot.put(Frame(video, pts=video.pts, time_base=RTP_TIME_BASE, index=self._count))
        self._count += 1

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self._slot.get()) is not None:
            yield frame

    def stop(self) -> None:
        self._slot.close()

    def close(self) -> None:
        self._slot.close()


class ResultTrack(MediaStreamTrack):
    """What the browser receives: the latest frame whenever the encoder is ready for one."""

    kind = "video"

    def __init__(self) -> None:
        super().__init__()
        self.dropped = 0
        self._latest: asyncio.Queue[Any] = asyncio.Queue(1)

    def offer(self, video: Any) -> None:
        """Offer a video frame, or None for the end; it replaces one not yet sent.  Called in the event loop."""
        if self._latest.full():
            self._latest.get_nowait()
            self.dropped += 1
        self._latest.put_nowait(video)

    async def recv(self) -> Any:
        """The latest video frame, as soon as there is one."""
        video = None if self.readyState == "ended" else await self._latest.get()
        if video is None:
            self.stop()
            raise MediaStreamError
        return video


class PeerOutput(Output):
    """Sends finished frames to the browser; mirroring and messages are left to the page.

    Parameters
    ----------
    peer : of the browser.   controls : hold the settings, such as mask and mesh.
    """

    def __init__(self, peer: Peer, controls: Controls) -> None:
        self._peer, self._controls = peer, controls

    def show(self, shown: OutputFrame) -> None:
        """Offer a copy of a frame, stamped with its time of arrival."""
        video = picture(shown, mask=self._controls.settings.mask, mesh=self._controls.settings.mesh)
        video.pts, video.time_base = int(shown.arrived / RTP_TIME_BASE), RTP_TIME_BASE
        self._peer.send(video)


def picture(shown: OutputFrame, *, mask: bool, mesh: bool) -> Any:
    """A copy of a frame in the codec's format, with the requested overlays."""
    frame = shown.frame
    if shown.result.mesh is not None and (mask or mesh):
        frame = frame.copy()
        if mask:
            draw_mask(frame, shown.result.mesh)
        if mesh:
            draw_mesh(frame, shown.result.mesh)
    size = (frame.width, frame.height)
    even = (size[0] + size[0] % 2, size[1] + size[1] % 2)
    video = PictureFormat(size, even, "yuv420p", BT470BG).picture(frame)
    return clone_video_frame(video) if video is shown.frame.video_frame else video


class Peer:
    """The server's end of a connection; constructed and used in an event loop.

    Attributes
    ----------
    track : what the browser receives.
    microphone : the browser's, if the user allows it.
    """

    def __init__(self) -> None:
        self.microphone = Microphone()
        self._closed = False
        self.track = ResultTrack()
        self._camera = BrowserCamera()
        self._loop = asyncio.get_running_loop()
        self._connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self._connection.on("track", self._receive)
        self._connection.on("connectionstatechange", self._changed)
        self._reading: dict[str, asyncio.Task[None]] = {}  # by kind of track

    async def answer(self, offer: Mapping[str, str]) -> dict[str, str]:
        """Accept the browser's offer {"type", "sdp"} and return the answer in the same form.

        Raises
        ------
        StudioError
            When it is not an offer of a video connection; the connection is closed then.
        """
        connection = self._connection
        try:
            described = RTCSessionDescription(offer["sdp"], offer["type"])
            connection.addTransceiver(self.track).setCodecPreferences(_codecs())
            await connection.setRemoteDescription(described)
            await connection.setLocalDescription(await connection.createAnswer())
        except _OFFER_ERRORS as error:
            await self.close()
            raise StudioError("the browser's connection offer was not understood: reload the page") from error
        answer = connection.localDescription
        return {"type": answer.type, "sdp": _with_bitrate(answer.sdp)}

    def alive(self) -> bool:
        """Whether neither side has closed the connection."""
        return not self._closed

    def camera(self) -> BrowserCamera:
        """A new capture of the browser's camera, which ends the previous one.  From any thread."""
        before, self._camera = self._camera, BrowserCamera()
        before.stop()
        if self._closed:
            self._camera.stop()
        return self._camera

    def send(self, video: Any) -> None:
        """Offer a finished video frame to the browser; from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self.track.offer, video)

    async def close(self) -> None:
        """End the connection, the capture and the track; can be called repeatedly."""
        self._closed = True
        self._camera.stop()
        self.track.offer(None)
        await self._connection.close()

    def _receive(self, track: MediaStreamTrack) -> None:
        if track.kind not in self._reading:
            read = self._read if track.kind == "video" else self._listen
            self._reading[track.kind] = asyncio.create_task(read(track))

    async def _read(self, track: MediaStreamTrack) -> None:
        with contextlib.suppress(MediaStreamError):
            while True:
                self._camera.put(await track.recv())
        await self.close()

    async def _listen(self, track: MediaStreamTrack) -> None:
        """Opus, which aiortc decodes to 16 bits, stereo, 48 kHz.

        It comes about as late as the pictures: both wait for later packets, those of pictures to be decoded as well.
        """
        with contextlib.suppress(MediaStreamError):
            while True:
                block: Any = await track.recv()
                samples = block.to_ndarray().reshape(-1, 2).astype(np.float32) / 2**15
                self.microphone.put(block.pts, samples)

    async def _changed(self) -> None:
        if self._connection.connectionState in ("failed", "closed"):
            await self.close()


_OFFER_ERRORS = (
    KeyError, IndexError, TypeError, ValueError, AssertionError, AttributeError, InvalidStateError, OperationError,
)  # fmt: skip


def _with_bitrate(sdp: str) -> str:
    """An answer that sets Chromium's bit rate, which otherwise starts low."""
    rate = ";".join(f"x-google-{word}-bitrate={BITS_PER_SECOND // 1000}" for word in ("min", "start", "max"))
    return re.sub(r"(a=rtpmap:(\d+) VP8/90000\r\n)", rf"\1a=fmtp:\2 {rate}\r\n", sdp)


def _codecs() -> list[Any]:
    """aiortc's codecs in the order of preference."""
    known = RTCRtpSender.getCapabilities("video").codecs
    return [codec for name in CODECS for codec in known if codec.mimeType == name]
