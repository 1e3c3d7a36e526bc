"""Lids shut by their looks: where a landmarker leaves those of a shut eye apart, the parsing sees no eye between them.

How much of the outline of an eye the parsing (`parsing.py`) takes for eye differs between people, pictures and glasses;
so what is seen is compared with the most that was seen of the same eye lately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import EYE_OUTLINES
from guise.aam.parsing import FaceClass, Parsing
from guise.common.arrays import F64
from guise.common.interpolation import interpolation


@dataclass(frozen=True)
class LidClosingLimits:
    """Shares of the area between lids."""

    seen: tuple[float, float] = (0.3, 0.6)  # share of eye in a cell, at which nothing and all of it counts
    closed: tuple[float, float] = (0.25, 0.6)  # of the usual, at which lids are shut, and as they were found
    least: float = 0.5  # that is usual of eyes of which the parsing can tell
    forgotten: float = 0.004  # of the usual, a parsed frame
    min_eye_pixels: float = 14.0  # of an eye's width, below which the parsing sees one now and then only
    columns: int = 9
    rows: int = 5


LIMITS = LidClosingLimits()
# From a corner, two points of a lid and the other corner to columns, and how far down between lids rows lie.
_ALONG = interpolation(np.linspace(0, 3, LIMITS.columns + 2)[1:-1], np.arange(4.0))
_DOWN = (np.arange(LIMITS.rows) + 0.5)[:, None, None] / LIMITS.rows


class LidCloser:
    """Shuts the lids of one face, frame by frame."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin with the next face."""
        self._usual, self._open = np.zeros(len(EYE_OUTLINES)), np.ones(len(EYE_OUTLINES))

    def see(self, parsing: Parsing, points: F64) -> None:
        """Look at the eyes of a parsed face with points (81, 2), pixels."""
        seen = np.array([_seen(parsing, points, *eye) for eye in EYE_OUTLINES])
        self._usual = np.maximum((1 - LIMITS.forgotten) * self._usual, seen)
        share = np.interp(seen / np.maximum(self._usual, LIMITS.least), LIMITS.closed, (0, 1))
        widths = np.array([np.linalg.norm(np.subtract(*points[corners])) for corners, _, _ in EYE_OUTLINES])
        can_tell = (self._usual > LIMITS.least) & (widths >= LIMITS.min_eye_pixels)
        self._open = np.where(can_tell, share, 1.0)

    def __call__(self, points: F64) -> F64:
        """The points (81, 2) with upper lids as far down as they were seen last."""
        closed = points.copy()
        for (_, upper, lower), share in zip(EYE_OUTLINES, self._open, strict=True):
            closed[upper] = points[lower] + share * (points[upper] - points[lower])
        return closed


def _seen(parsing: Parsing, points: F64, corners: np.ndarray, upper: np.ndarray, lower: np.ndarray) -> float:
    """Share of the area between lids in which there is an eye."""
    first, last = points[corners]
    top, bottom = (_ALONG @ np.vstack([first, points[lid], last]) for lid in (upper, lower))
    places = (top + _DOWN * (bottom - top)).reshape(-1, 2)
    return float(np.interp(parsing.at(places, parsing.shares[FaceClass.EYES]), LIMITS.seen, (0, 1)).mean())
