"""What every output of the live application is: a window, a file, a virtual camera, a browser.

A frame that is shown is seen by several outputs at once, each in its own thread: they read it and draw on copies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from guise.app.live.face import Look
    from guise.app.live.pipeline import Stats
    from guise.app.media import Frame


@dataclass(frozen=True, eq=False)
class Shown:
    """A finished picture and what is known about it.

    Parameters
    ----------
    frame : the picture; outputs do not change it.
    look : what was done to it.
    stats : of the pipeline so far.
    arrived : time.perf_counter() at which the camera gave it, seconds.
    message : a sentence to show, "" for none.
    ring : share in [0, 1] of the enrolment that is done; None when there is none.
    recording : it goes into a file that the user asked for.
    original : the picture as it came, with the real face; only while the user asks for it beside the result.
    """

    frame: Frame
    look: Look
    stats: Stats
    arrived: float
    message: str = ""
    ring: float | None = None
    recording: bool = False
    original: Frame | None = None


class Output:
    """Where finished pictures go.  Opened once, shown to any number of times, closed once, all in one thread.

    main_thread : it is opened, shown to, pumped and closed by the main thread.
    lossless : it gets every frame and may make the others wait; otherwise the latest, when it is ready for one.
    """

    main_thread = False
    lossless = False

    def open(self, width: int, height: int, fps: float) -> None:
        """Get ready for pictures of a size, pixels; raises what `guise.common.failures` knows as a user's mistake."""

    def show(self, shown: Shown) -> None:
        """Take a picture."""
        raise NotImplementedError

    def pump(self) -> bool:
        """Do what must be done between pictures, in the main thread; False when the user has closed it."""
        return True

    def close(self) -> None:
        """Release what `open` took; also after a failed `open`."""
