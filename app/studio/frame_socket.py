"""The connection of one browser tab: its camera's pictures and sound come in, finished pictures go out.

Browser and studio are on one computer, so pictures travel as they are, without a codec: a websocket's binary messages
are a HEADER and the planes (or the samples).  Neither direction queues.  The browser sends a picture only while the
studio has room for it, which it knows by the numbers of the pictures that come back; a finished picture that is late
is replaced by the next.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import secrets
import struct
import time
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from guise.app.live.capture import Capture
from guise.app.live.controls import Controls
from guise.app.live.microphone import Microphone, SenderClock
from guise.app.live.options import LiveSettings
from guise.app.live.output import Output, OutputFrame
from guise.app.live.overlay import draw_face
from guise.app.media import Frame
from guise.app.media.colour import BT470BG, BT709, FULL, LIMITED, UNSPECIFIED
from guise.app.media.encoding import PictureFormat
from guise.app.media.frame import from_planes, plane_arrays
from guise.app.media.reader import reformat
from guise.app.studio.store import StudioError
from guise.common.channel import Channel

# Format, width, height, matrix (BT709 or BT470BG), whether full range, time in seconds of a clock of the camera's,
# number; of sound: SOUND, 0, 0, 0, 0, 0, position.
HEADER = struct.Struct("<4s4HdI")
SOUND = b"PCM "  # interleaved float32, stereo, 48 kHz
SENT = b"I420"
TIME_BASE = Fraction(1, 1_000_000)  # seconds, of a browser's pictures
MOST_LINES = 720  # of a picture that is worked on
MOST_PIXELS = 1 << 24  # of a picture that is accepted
# Our names of the browser's formats.
FORMATS = {
    SENT: "yuv420p",
    b"NV12": "nv12",
    b"RGBA": "rgba",
    b"RGBX": "rgba",
    b"BGRA": "bgra",
    b"BGRX": "bgra",
}


class BrowserCamera(Capture):
    """Always the latest frame of a browser's camera; ends when the connection does.

    Times are of `time.perf_counter`, when a picture was taken: however late it comes, it fits the sound.
    """

    name = "the browser's camera"

    def __init__(self) -> None:
        self._slot: Channel[Frame] = Channel(latest=True)
        self._first: int | None = None
        self._given = 0
        self._clock, self._last = SenderClock(), 0

    def put(self, video: Any, number: int, taken: float) -> None:
        """Offer the camera's picture of a number; those that are missing between two were not sent.

        taken : seconds of the camera's clock.
        """
        self.width, self.height = video.width, video.height
        self._first = number if self._first is None else self._first
        self.dropped = number - self._first - self._given
        at = self._clock.ours(taken, time.perf_counter())
        self._last = max(self._last + 1, round(at / TIME_BASE))
        self._slot.put(Frame(video, pts=self._last, time_base=TIME_BASE, index=number))

    def arrival(self, frame: Frame) -> float:
        return float(frame.pts * TIME_BASE)

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self._slot.get()) is not None:
            self._given += 1
            yield frame

    def stop(self) -> None:
        self._slot.close()

    def close(self) -> None:
        self._slot.close()


class PeerOutput(Output):
    """Sends finished frames to the browser; mirroring and messages are left to the page.

    Parameters
    ----------
    peer : of the browser.   controls : hold the settings, such as mask and mesh.
    """

    def __init__(self, peer: Peer, controls: Controls) -> None:
        self._peer, self._controls = peer, controls

    def show(self, shown: OutputFrame) -> None:
        """Send a frame under the number with which it came."""
        self._peer.send(packed(picture(shown, self._controls.settings), shown.frame.index))


def picture(shown: OutputFrame, settings: LiveSettings) -> Any:
    """A frame as the browser takes it, with the requested overlays, which are drawn on a copy."""
    frame = shown.frame
    if shown.result.mesh is not None and (settings.mask or settings.mesh):
        frame = frame.copy()
        draw_face(frame, shown.result.mesh, settings)
    size = (frame.width, frame.height)
    even = (size[0] + size[0] % 2, size[1] + size[1] % 2)
    return PictureFormat(size, even, "yuv420p", BT470BG).picture(frame)


def packed(video: Any, number: int, taken: float = 0.0) -> bytes:
    """The message for a yuv420p picture; see HEADER."""
    unknown = BT709 if video.height >= 720 else BT470BG
    matrix = unknown if video.colorspace == UNSPECIFIED else video.colorspace
    colour = BT709 if matrix == BT709 else BT470BG, video.color_range == FULL
    header = HEADER.pack(SENT, video.width, video.height, *colour, taken, number % (1 << 32))
    return b"".join([header, *(plane.tobytes() for plane in plane_arrays(video))])


def unpacked(message: bytes) -> tuple[Any, int]:
    """The picture of a message, and its number.  StudioError when it is none."""
    name, width, height, matrix, full, _, number = _header(message)
    if name not in FORMATS or not 0 < width * height <= MOST_PIXELS:
        raise StudioError("the browser sent a picture of an unknown kind: reload the page")
    form = FORMATS[name]
    try:
        video = from_planes(np.frombuffer(message, np.uint8, offset=HEADER.size), width, height, form)
    except ValueError as error:
        raise StudioError("the browser sent half a picture: reload the page") from error
    if form in ("rgba", "bgra"):
        return reformat(video, width, height, "yuv420p"), number
    video.colorspace, video.color_range = matrix, FULL if full else LIMITED
    return video, number


def _header(message: bytes) -> tuple[Any, ...]:
    if len(message) < HEADER.size:
        raise StudioError("the browser sent no picture: reload the page")
    fields = HEADER.unpack_from(message)
    if not math.isfinite(fields[-2]):
        raise StudioError("the browser sent a picture of no time: reload the page")
    return fields


def _reduced(video: Any, lines: int) -> Any:
    """A picture with at most so many lines, or as it is: browsers ask a camera for a size, and may get another."""
    if video.height <= lines:
        return video
    return reformat(video, 2 * round(video.width * lines / video.height / 2), lines, "yuv420p")


class Peer:
    """The server's end of a connection; constructed and used in an event loop.

    lines : of its pictures at most; larger ones are made smaller as they come.

    Attributes
    ----------
    id : the last part of the websocket's address, which nobody can guess.
    microphone : the browser's, if the user allows it.
    fault : why the studio has ended the connection, a sentence, or "".
    """

    def __init__(self, lines: int = MOST_LINES) -> None:
        self.id = secrets.token_urlsafe(24)
        self.microphone = Microphone()
        self.fault = ""
        self._lines, self._closed = lines, False
        self._camera = BrowserCamera()
        self._loop = asyncio.get_running_loop()
        self._latest: asyncio.Queue[bytes | None] = asyncio.Queue(1)

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

    def send(self, message: bytes) -> None:
        """Offer a finished picture to the browser; it replaces one not yet sent.  From any thread."""
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._offer, message)

    def close(self) -> None:
        """End the connection and the capture; can be called repeatedly.  In the event loop."""
        self._closed = True
        self._camera.stop()
        self._offer(None)

    async def serve(self, socket: WebSocket) -> None:
        """Talk to the browser until either side ends it."""
        await socket.accept()
        sending = asyncio.create_task(self._send(socket))
        try:
            while True:
                self._take(await socket.receive_bytes())
        except StudioError as error:
            self.fault = str(error)
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass  # the page sees that it has ended
        finally:
            self.close()
            await sending

    def _offer(self, message: bytes | None) -> None:
        if self._latest.full():
            self._latest.get_nowait()
        self._latest.put_nowait(None if self._closed else message)

    async def _send(self, socket: WebSocket) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while (message := await self._latest.get()) is not None:
                await socket.send_bytes(message)
            await socket.close()

    def _take(self, message: bytes) -> None:
        name, *_, taken, number = _header(message)
        if name == SOUND:
            samples = np.frombuffer(message, np.float32, offset=HEADER.size)
            self.microphone.put(number, samples[: len(samples) // 2 * 2].reshape(-1, 2))
        else:
            video, number = unpacked(message)
            self._camera.put(_reduced(video, self._lines), number, taken)
