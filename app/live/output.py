"""The contract of an output of the live application: a window, a file, a virtual camera, a browser.

Several outputs see the same frame at once, each in its own thread: they only read it, and draw on copies.
"""

from __future__ import annotations

from dataclasses import dataclass

from guise.app.live.face import FaceResult
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame


@dataclass(frozen=True, eq=False)
class OutputFrame:
    """A finished frame and what is known about it.

    Parameters
    ----------
    frame : the picture; outputs do not change it.
    result : what was done to it.
    stats : of the pipeline so far.
    arrived : time.perf_counter() at capture, seconds.
    message : a sentence to show, "" for none.
    ring : share in [0, 1] of the enrolment that is complete; None when nobody is being enrolled.
    missing : what the enrolment still needs, "" for nothing.
    recording : for how many seconds the user has been recording; None while they are not.
    original : the unchanged picture, with the real face; only while the user asks for it beside the result, and while
        they are enrolled.
    """

    frame: Frame
    result: FaceResult
    stats: PipelineStats
    arrived: float
    message: str = ""
    ring: float | None = None
    recording: float | None = None
    original: Frame | None = None
    missing: str = ""


def clock(seconds: float) -> str:
    """A duration as a recorder shows it.

    >>> clock(72.9)
    '1:12'
    """
    return f"{int(seconds) // 60}:{int(seconds) % 60:02}"


class Output:
    """Where finished frames go.  Opened once, shown any number of frames, closed once, all in one thread.

    main_thread : it is opened, shown to, pumped and closed by the main thread.
    lossless : it gets every frame and may hold up the other outputs; otherwise it gets the latest frame when it is
        ready for one.
    """

    main_thread = False
    lossless = False

    def check(self) -> None:
        """Raise GuiseError, before any work is done, if the output could not be opened for want of something."""

    def open(self, width: int, height: int, fps: float) -> None:
        """Prepare for frames of a size in pixels; raises GuiseError when that fails."""

    def show(self, shown: OutputFrame) -> None:
        """Take a frame."""
        raise NotImplementedError

    def pump(self) -> bool:
        """Do what is due between frames, in the main thread; False when the user has closed the output."""
        return True

    def close(self) -> None:
        """Release what `open` acquired; also called after a failed `open`."""
