"""A part of a video, as a user says it: from a time to a time."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

from guise.app.media.errors import MediaError

if TYPE_CHECKING:
    from guise.app.media.frame import Frame

Outside = Literal["keep", "cut"]  # what becomes of the rest of a video
_CLOCK = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d*)?|\.\d+)")


@dataclass(frozen=True)
class TimeRange:
    """The frames [start, end) of a video, seconds after its first frame; end None is the end of the video.

    cuts : whether the rest is cut off, or else kept as it is.
    """

    start: Fraction = Fraction(0)
    end: Fraction | None = None
    cuts: bool = False

    def __post_init__(self) -> None:
        if self.end is not None and self.end <= self.start:
            raise MediaError(
                f"--to {float(self.end):g} must be later than --from {float(self.start):g} (seconds)."
            )

    @classmethod
    def between(cls, start: str | None, end: str | None, outside: Outside = "keep") -> TimeRange | None:
        """The part between two times as `time_of` reads them; None for the whole.

        >>> TimeRange.between("1:30", None)
        TimeRange(start=Fraction(90, 1), end=None, cuts=False)
        """
        if start is None and end is None:
            return None
        return cls(time_of(start or "0"), None if end is None else time_of(end), outside == "cut")

    def holds(self, seconds: Fraction) -> bool:
        """Whether a frame that begins so many seconds after the first one is within."""
        return self.start <= seconds and (self.end is None or seconds < self.end)

    def told(self) -> str:
        """The part in words, for messages."""
        return f"from {float(self.start):g} s" + ("" if self.end is None else f" to {float(self.end):g} s")


def time_of(text: str) -> Fraction:
    """A time in seconds, from seconds, minutes:seconds or hours:minutes:seconds.

    >>> time_of("1:02:03.5"), time_of("90")
    (Fraction(7447, 2), Fraction(90, 1))
    """
    found = _CLOCK.fullmatch(text.strip())
    if found is None:
        raise MediaError(f"{text} is not a time: give seconds, such as 90 or 90.5, or 1:30 or 1:02:30.")
    hours, minutes, seconds = found.groups()
    return 3600 * int(hours or 0) + 60 * int(minutes or 0) + Fraction(seconds)


def within(part: TimeRange | None) -> Callable[[Frame], bool]:
    """Whether each frame of one pass over a whole video is in a part; the pass begins with the first frame."""
    if part is None:
        return lambda frame: True
    first: list[Fraction] = []

    def holds(frame: Frame) -> bool:
        now = frame.pts * frame.time_base
        if not first:
            first.append(now)
        return part.holds(now - first[0])

    return holds
