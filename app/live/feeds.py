"""Live from and to a program: frames from an iterable or a function, and finished ones to a function."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from guise.app.live.capture import CAMERA_TIME_BASE, Capture
from guise.app.live.output import Output, OutputFrame
from guise.app.media import Frame, MediaError
from guise.common.arrays import U8


class FrameFeed(Capture):
    """Frames that a program gives.

    Parameters
    ----------
    frames : RGB uint8 pictures (h, w, 3) of one size.   fps : of them, nominal.
    paced : frames come in real time, and those that are not taken are lost; otherwise all are waited for.
    """

    def __init__(self, frames: Iterable[U8], *, fps: float = 30.0, paced: bool = False) -> None:
        self.fps, self.paced, self._stopped = fps, paced, False
        self._frames = iter(frames)
        first = next(self._frames, None)
        if first is None:
            raise MediaError("there is no frame to begin with: give at least one")
        self._first = first
        self.height, self.width = first.shape[:2]

    def __iter__(self) -> Iterator[Frame]:
        start, last = time.perf_counter(), -1
        for index, picture in enumerate(self._pictures()):
            now = time.perf_counter() - start if self.paced else index / self.fps
            last = max(round(now / CAMERA_TIME_BASE), last + 1)
            yield Frame.from_rgb(picture, last, CAMERA_TIME_BASE, index)

    def _pictures(self) -> Iterator[U8]:
        yield self._first
        while not self._stopped and (picture := next(self._frames, None)) is not None:
            if picture.shape != self._first.shape:
                raise MediaError(
                    f"all frames must have one size, {self.width} x {self.height} pixels, got {picture.shape}"
                )
            yield picture

    def stop(self) -> None:
        self._stopped = True

    def close(self) -> None:
        close = getattr(self._frames, "close", None)  # of a generator
        if close is not None:
            close()


class FrameCall(Output):
    """Calls a function with each finished frame, in a thread of its own.

    lossless : it gets every frame; otherwise the latest when it is ready for one.
    """

    def __init__(self, call: Callable[[OutputFrame], object], *, lossless: bool) -> None:
        self._call, self.lossless = call, lossless

    def show(self, shown: OutputFrame) -> None:
        """Call it."""
        self._call(shown)


@dataclass(frozen=True)
class Program:
    """A program that calls: its frames, None for those of the options; its outputs; and its wish to end."""

    capture: Capture | None = None
    outputs: Sequence[Output] = ()
    stopped: threading.Event = field(default_factory=threading.Event)
