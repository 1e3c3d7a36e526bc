"""Where new shots of a video begin, told from pictures of its frames made small; (h, w) uint8, grey."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from guise.common.arrays import U8


@dataclass(frozen=True)
class CutLimits:
    """How much changes with a cut."""

    cut_correlation: float = 0.6  # of small pictures, below which a new shot begins
    cut_grey_levels: float = 8.0  # of mean change, from which it can
    sudden_correlation: float = 0.9  # the same where the picture changes
    sudden_grey_levels: float = 4.0  # so much
    sudden_ratio: float = 8.0  # and so many times as much as in any
    sudden_frames: int = 5  # of the frames before


LIMITS = CutLimits()
SMALL_SIZE = (32, 18)  # pixels, width and height of the small picture


def is_cut(before: U8, after: U8) -> bool:
    """Whether a new shot begins between two small pictures: their correlation is low and the change large."""
    change = float(np.abs(before.astype(np.float64) - after).mean())
    return change >= LIMITS.cut_grey_levels and _correlation(before, after) < LIMITS.cut_correlation


def _correlation(before: U8, after: U8) -> float:
    """Of two pictures; 0 where one of them is plain."""
    a, b = (picture.astype(np.float64).ravel() - picture.mean() for picture in (before, after))
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 1e-9 else 0.0


class CutDetector:
    """Tells with which of a video's frames new shots begin.

    Between two people in one place, or before one background, little of the picture changes; but it does at once, while
    what moves has changed the frames before as well.
    """

    def __init__(self) -> None:
        self._before: U8 | None = None
        self._changes: deque[float] = deque(maxlen=LIMITS.sudden_frames)

    def update(self, small: U8) -> bool:
        """Whether a new shot begins with the next frame, made small."""
        before, self._before = self._before, small
        if before is None:
            return False
        change = float(np.abs(small.astype(np.float64) - before).mean())
        known = len(self._changes) == LIMITS.sudden_frames
        sudden = known and change >= max(LIMITS.sudden_grey_levels, LIMITS.sudden_ratio * max(self._changes))
        cut = is_cut(before, small) or (sudden and _correlation(before, small) < LIMITS.sudden_correlation)
        self._changes.append(change)
        if cut:
            self._changes.clear()
        return cut
