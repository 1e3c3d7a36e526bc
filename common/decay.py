"""How fast what was known fades with time, whatever the frame rate."""

from __future__ import annotations

from dataclasses import dataclass

FRAME_SECONDS = 1 / 30  # the step at which paces were tuned


@dataclass(frozen=True)
class Decay:
    """A share in [0, 1) of what was known is kept over so many seconds.

    >>> Decay(0.5, 0.1).over(0.2)
    0.25
    """

    share: float
    seconds: float = FRAME_SECONDS

    def over(self, seconds: float) -> float:
        """The share that is kept over a time."""
        return float(self.share ** round(seconds / self.seconds, 6))
