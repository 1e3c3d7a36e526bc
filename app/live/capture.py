"""Where live pictures come from: a camera, or a file played at its own pace.  Streams are in `guise.app.live.streams`.

A capture gives `Frame`s whose times ascend; it closes by `with`.  Pictures are as shown.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import cv2

from guise.app.media import Frame, MediaError, open_input
from guise.common.closing import Closing

Say = Callable[[str], None]

CAMERA_TIME = Fraction(1, 1_000_000)  # seconds, unit of a camera's times
AGAIN = 1.0  # seconds between two tries to open a camera that went away


class Capture(Closing):
    """Frames from somewhere, one iteration.

    Attributes
    ----------
    name : of what is captured, for notes and for the cached model.
    width, height : pixels.   fps : frames a second, nominal.
    paced : frames come in real time, and one that is not taken is lost.
    """

    name = ""
    width = height = 0
    fps = 30.0
    paced = True

    def __iter__(self) -> Iterator[Frame]:
        raise NotImplementedError

    def stop(self) -> None:
        """End the iteration soon; from any thread."""
        raise NotImplementedError


class FileCapture(Capture):
    """A video file, an image or a folder of images.

    Parameters
    ----------
    path : of it.
    loop : begin again at its end; times go on.
    paced : play it at its own pace, otherwise as fast as frames are taken.

    Raises
    ------
    MediaError
        When there is nothing to read.
    """

    def __init__(self, path: Path, *, loop: bool = False, paced: bool = True) -> None:
        self.source = open_input(path)
        self.name, self.paced = self.source.name, paced
        self.width, self.height = self.source.width, self.source.height
        self.fps = float(self.source.frame_rate)
        self.begun: float | None = None  # perf_counter of time 0, known when paced and running
        self._loop, self._stopped = loop, False

    def __iter__(self) -> Iterator[Frame]:
        base, step = 0, max(1, round(1 / self.source.frame_rate / self.source.time_base))
        while not self._stopped:
            first = last = None
            for frame in self.source:
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
            base = last + step

    def _wait(self, frame: Frame) -> None:
        at = float(frame.pts * frame.time_base)
        if self.begun is None:
            self.begun = time.perf_counter() - at
        time.sleep(max(0.0, self.begun + at - time.perf_counter()))

    def stop(self) -> None:
        self._stopped = True

    def close(self) -> None:
        self.source.close()


class CameraCapture(Capture):
    """A camera of this computer; when it is unplugged it is waited for, and that is said.

    Parameters
    ----------
    index : of the camera, 0 for the first.
    size : (width, height) asked for, pixels; the camera may give another.
    fps : asked for.
    say : called with notes for the user.

    Raises
    ------
    MediaError
        When there is no such camera.
    """

    def __init__(
        self, index: int = 0, size: tuple[int, int] = (1280, 720), fps: float = 30.0, say: Say = print
    ) -> None:
        self.name, self._index, self._size, self._say = _camera_name(index), index, size, say
        self.fps, self._stopped = fps, False
        device = self._opened()
        if device is None:
            raise MediaError(
                f"camera {index} cannot be opened: plug one in, allow its use, choose another with --camera, "
                "or use --source FILE"
            )
        self._device: cv2.VideoCapture | None = device
        self.width = int(device.get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height = int(device.get(cv2.CAP_PROP_FRAME_HEIGHT))

    def __iter__(self) -> Iterator[Frame]:
        index, start = 0, time.perf_counter()
        while not self._stopped:
            good, picture = self._device.read() if self._device is not None else (False, None)
            if not good or picture is None:
                self._reopen()
                continue
            pts = round((time.perf_counter() - start) / CAMERA_TIME)
            rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
            yield Frame.from_rgb(rgb, pts, CAMERA_TIME, index)  # type: ignore[arg-type]
            index += 1

    def stop(self) -> None:
        self._stopped = True

    def close(self) -> None:
        if self._device is not None:
            self._device.release()

    def _reopen(self) -> None:
        """Wait for the camera; the thread sleeps between tries."""
        if self._device is not None:
            self._say(f"{self.name} gives no pictures; waiting for it")
            self._device.release()
            self._device = None
        time.sleep(AGAIN)
        if not self._stopped:
            self._device = self._opened()
            if self._device is not None:
                self._say(f"{self.name} is back")

    def _opened(self) -> cv2.VideoCapture | None:
        device = cv2.VideoCapture(self._index)
        device.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
        device.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        device.set(cv2.CAP_PROP_FPS, self.fps)
        device.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        if device.isOpened():
            return device
        device.release()
        return None


def _camera_name(index: int) -> str:
    """What the system calls a camera, where it says so in a file; otherwise its number."""
    name = Path(f"/sys/class/video4linux/video{index}/name")
    return name.read_text(errors="replace").strip() if name.is_file() else f"camera {index}"
