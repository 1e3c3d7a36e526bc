"""How well a track can be swapped, judged by how large its face is and how certain its fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class TrackQualityLimits:
    """Below which a track is not good, and from which it is poor.  Widths in pixels, shares of the track's time."""

    good_width: float = 80.0
    poor_width: float = 40.0
    good_share: float = 0.85  # of the time in which the fit is certain
    poor_share: float = 0.5
    min_confidence: float = 0.5  # of a certain fit


LIMITS = TrackQualityLimits()


@dataclass(frozen=True)
class TrackQuality:
    """A judgement; `reason` is "" for a good track."""

    grade: Literal["good", "fair", "poor"]
    reason: str = ""

    def __str__(self) -> str:
        return f"{self.grade}: {self.reason}" if self.reason else self.grade


def track_quality(width: float, confidence: Sequence[float]) -> TrackQuality:
    """The quality of a track.   width : of the face, pixels.   confidence : in equal parts of its time.

    >>> str(track_quality(200, [0.9, 0.8])), str(track_quality(30, [0.9]))
    ('good', 'poor: the face is only 30 pixels wide')
    """
    sure = sum(one >= LIMITS.min_confidence for one in confidence) / max(1, len(confidence))
    uncertain = f"the face is uncertain in {100 * (1 - sure):.0f} % of the time"
    small = f"the face is only {width:.0f} pixels wide"
    if width < LIMITS.poor_width or sure < LIMITS.poor_share:
        return TrackQuality("poor", small if width < LIMITS.poor_width else uncertain)
    if width < LIMITS.good_width or sure < LIMITS.good_share:
        return TrackQuality("fair", small if width < LIMITS.good_width else uncertain)
    return TrackQuality("good")
