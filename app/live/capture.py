"""Live sources: a camera, or a file played at its own pace.  Streams are in `guise.app.live.streams`.

A capture yields frames with ascending times and closes by `with`.  Pictures are as displayed.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Generic, TypeVar

import cv2
import numpy as np

from guise.app.media import Frame, MediaError, open_input
from guise.app.media.deep_frame import frame_of
from guise.app.media.network import Picture
from guise.common.arrays import U8
from guise.common.closing import Closing
from guise.common.progress import Say

Source = TypeVar("Source")
CAMERA_TIME_BASE = Fraction(1, 1_000_000)  # seconds
RECONNECT_SECONDS = 1.0  # between two attempts to reopen a camera or stream


class Capture(Closing):
    """A source of frames that is iterated once.

    Attributes
    ----------
    name : of the camera, file or stream, for messages and for the cached model.
    width, height : pixels.   fps : nominal frames per second.
    paced : frames come in real time, and those that are not taken are lost.
    dropped : frames of the source that the capture left out because newer ones came.
    """

    name = ""
    width = height = 0
    fps = 30.0
    paced = True
    dropped = 0

    def __iter__(self) -> Iterator[Frame]:
        raise NotImplementedError

    def arrival(self, frame: Frame) -> float:
        """When a frame that has just been given arrived, time.perf_counter()."""
        return time.perf_counter()

    def stop(self) -> None:
        """End the iteration soon; from any thread."""
        raise NotImplementedError


class FileCapture(Capture):
    """A video file, an image or a folder of images.

    Parameters
    ----------
    path : of the file or folder.
    loop : start over at the end; times continue to ascend.
    paced : play at the file's own pace, otherwise as fast as frames are taken.

    Raises
    ------
    MediaError
        When there is nothing to read.
    """

    def __init__(self, path: Path, *, loop: bool = False, paced: bool = True) -> None:
        self.media = open_input(path)
        self.name, self.paced = self.media.name, paced
        self.width, self.height = self.media.width, self.media.height
        self.fps = float(self.media.frame_rate)
        self.begun: float | None = None  # perf_counter at time 0; known while a paced file plays
        self._loop, self._stopped = loop, False

    def __iter__(self) -> Iterator[Frame]:
        base, interval = 0, max(1, round(1 / self.media.frame_rate / self.media.time_base))
        while not self._stopped:
            first = last = None
            for frame in self.media:
                if self._stopped:
                    return
                first = frame.pts if first is None else first
                frame.pts = base + frame.pts - first
                last = frame.pts
                if self.paced:
                    self._wait(frame)
                yield frame
            if not self._loop or last is None:
                return
            base = last + interval

    def _wait(self, frame: Frame) -> None:
        at = frame.seconds
        if self.begun is None:
            self.begun = time.perf_counter() - at
        time.sleep(max(0.0, self.begun + at - time.perf_counter()))

    def stop(self) -> None:
        self._stopped = True

    def close(self) -> None:
        self.media.close()


class ReconnectingCapture(Capture, Generic[Source]):
    """A camera or stream, which may stop at any time: the user is told, and the capture waits until it is back.

    source : what gives the pictures, opened.   say : called with messages for the user.
    """

    def __init__(self, source: Source, say: Say) -> None:
        self._source: Source | None = source
        self._say = say
        self._stopped = threading.Event()

    def _open(self) -> Source | None:
        """The source opened once more, or None."""
        raise NotImplementedError

    def _release(self, source: Source) -> None:
        raise NotImplementedError

    def _pictures(self, source: Source) -> Iterator[Picture | U8]:
        """Its pictures until it stops, decoded or RGB (h, w, 3)."""
        raise NotImplementedError

    def _has_ended(self, source: Source) -> bool:
        """Whether a source that has stopped was all there is."""
        return False

    def __iter__(self) -> Iterator[Frame]:
        index, last, start = 0, -1, time.perf_counter()
        while not self._stopped.is_set():
            if self._source is None:
                self._reopen()
                continue
            for picture in self._pictures(self._source):
                last = max(round((time.perf_counter() - start) / CAMERA_TIME_BASE), last + 1)
                yield frame_of(picture, pts=last, time_base=CAMERA_TIME_BASE, index=index)
                index += 1
                if self._stopped.is_set():
                    return
            if self._has_ended(self._source):
                return
            self._say(f"{self.name} has stopped sending pictures; waiting for it")
            self.close()

    def _reopen(self) -> None:
        """Try once, after a pause."""
        if not self._stopped.wait(RECONNECT_SECONDS):
            self._source = self._open()
            if self._source is not None:
                self._say(f"{self.name} is back")

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        if self._source is not None:
            self._release(self._source)
            self._source = None


class CameraCapture(ReconnectingCapture[cv2.VideoCapture]):
    """A camera of this computer.

    Parameters
    ----------
    index : of the camera, 0 for the first.
    size : requested (width, height), pixels; the camera may choose another.
    fps : requested.
    say : called with messages for the user.

    Raises
    ------
    MediaError
        When there is no such camera.
    """

    def __init__(
        self, index: int = 0, size: tuple[int, int] = (1280, 720), fps: float = 30.0, say: Say = print
    ) -> None:
        self.name, self._index, self._size, self.fps = _camera_name(index), index, size, fps
        device = self._open()
        if device is None:
            raise MediaError(
                f"camera {index} cannot be opened: connect it, allow access to it, choose another with --camera, "
                "or use --input FILE"
            )
        super().__init__(device, say)
        self.width = int(device.get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height = int(device.get(cv2.CAP_PROP_FRAME_HEIGHT))

    def _open(self) -> cv2.VideoCapture | None:
        device = cv2.VideoCapture(self._index)
        device.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
        device.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        device.set(cv2.CAP_PROP_FPS, self.fps)
        device.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        if device.isOpened():
            return device
        device.release()
        return None

    def _release(self, source: cv2.VideoCapture) -> None:
        source.release()

    def _pictures(self, source: cv2.VideoCapture) -> Iterator[U8]:
        while True:
            ok, picture = source.read()
            if not ok or picture is None:
                return
            yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)


def _camera_name(index: int) -> str:
    """The system's name for a camera, where a file holds it; otherwise its number."""
    name = Path(f"/sys/class/video4linux/video{index}/name")
    return name.read_text(errors="replace").strip() if name.is_file() else f"camera {index}"
