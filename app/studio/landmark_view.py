"""The square view of a frame in which landmarks are corrected: its picture, its drawing, and pointer positions.

The screen has SCREEN x SCREEN units, x right, y down, from 0 at its upper left corner; the browser scales it.  Pixel
centres of a frame are at integers, as everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from guise.aam.landmarks import GROUPS
from guise.aam.landmarks.schemes import CLOSED_LINES, OPEN_LINES
from guise.common.arrays import F32, F64, U8

SCREEN = 720  # screen units on each side


@dataclass(frozen=True)
class LandmarkViewLimits:
    """Sizes of the view."""

    pick_radius_units: float = 36  # screen units around a pointer within which a point is picked
    ring_radius_units: int = 12  # of the ring around the chosen point
    min_size_pixels: int = 24  # of the frame, across the view
    face_margin: float = 1.5  # side of the view relative to the face's


LIMITS = LandmarkViewLimits()
_BACKGROUND = (32, 32, 32)
_LINES = tuple([*group, group[0]] for group in CLOSED_LINES) + tuple(list(group) for group in OPEN_LINES)


@dataclass(frozen=True)
class FrameView:
    """The square [x, x + size) x [y, y + size) of whole pixels of a frame; it may reach beyond the frame.

    width, height : of the frame, pixels.
    """

    x: int
    y: int
    size: int
    width: int
    height: int

    @classmethod
    def whole(cls, width: int, height: int) -> FrameView:
        """The view that shows all of a frame."""
        side = max(width, height)
        return cls((width - side) // 2, (height - side) // 2, side, width, height)

    def around(self, points: F32) -> FrameView:
        """The view of the same frame that shows points (n, 2) with a margin."""
        low, high = points.min(0), points.max(0)
        size = self._size(LIMITS.face_margin * float((high - low).max()))
        x, y = np.round((low + high) / 2 - size / 2).astype(int).tolist()
        return replace(self, x=x, y=y, size=size)._inside()

    def zoomed(self, factor: float, about: F64 | F32) -> FrameView:
        """The view enlarged `factor` times around `about` (2,), frame pixels."""
        size = self._size(self.size / factor)
        corner = np.array([self.x, self.y])
        x, y = np.round(about - (about - corner) * (size / self.size)).astype(int).tolist()
        return replace(self, x=x, y=y, size=size)._inside()

    def moved(self, by: ArrayLike) -> FrameView:
        """The view with its contents moved by (2,), screen units."""
        x, y = np.round(np.array([self.x, self.y]) - np.asarray(by) / self.scale).astype(int).tolist()
        return replace(self, x=x, y=y)._inside()

    @property
    def scale(self) -> float:
        """Screen units per frame pixel."""
        return SCREEN / self.size

    def to_screen(self, points: ArrayLike) -> F64:
        """Frame pixels (..., 2) as screen units."""
        return np.asarray((np.asarray(points, np.float64) - (self.x, self.y) + 0.5) * self.scale)

    def to_frame(self, places: ArrayLike) -> F64:
        """Screen units (..., 2) as frame pixels."""
        return np.asarray(np.asarray(places, np.float64) / self.scale - 0.5 + (self.x, self.y))

    def nearest(self, points: F32, place: ArrayLike) -> int | None:
        """Index of the point (n, 2) closest to a pointer at `place` (2,), screen units; None when all are too far."""
        distances = np.linalg.norm(self.to_screen(points) - np.asarray(place), axis=1)
        point = int(np.nan_to_num(distances, nan=np.inf).argmin())
        return point if distances[point] <= LIMITS.pick_radius_units else None

    def picture(self, rgb: U8, side: int = SCREEN) -> U8:
        """The view of a frame (h, w, 3) as (side, side, 3), dark beyond the frame."""
        x0, y0 = max(self.x, 0), max(self.y, 0)
        part = rgb[y0 : max(self.y + self.size, 0), x0 : max(self.x + self.size, 0)]
        right, down = self.size - (x0 - self.x) - part.shape[1], self.size - (y0 - self.y) - part.shape[0]
        padded = cv2.copyMakeBorder(
            part, y0 - self.y, down, x0 - self.x, right, cv2.BORDER_CONSTANT, value=_BACKGROUND
        )
        way = cv2.INTER_AREA if side < self.size else cv2.INTER_CUBIC
        return np.asarray(cv2.resize(padded, (side, side), interpolation=way), np.uint8)

    def drawing(self, points: F32, chosen: int | None) -> str:
        """SVG of points (81, 2), the lines between them, and a ring around the chosen one; "" without points."""
        if not np.isfinite(points).all():
            return ""
        places = self.to_screen(points)
        lines = "".join(f"M{_listed(places[line])}" for line in _LINES)
        dots = "".join(f"M{x:.2f},{y:.2f}h0" for x, y in places)
        ring = "" if chosen is None else _ring(*places[chosen])
        return (
            f'<g fill="none" stroke-linecap="round" stroke-linejoin="round">{_path(lines, "#0007", 3)}'
            f"{_path(lines, '#7fd4ff', 1.2)}{_path(dots, '#000', 8)}{_path(dots, '#5aff78', 6)}{ring}</g>"
        )

    def _size(self, wanted: float) -> int:
        smallest = LIMITS.min_size_pixels
        return int(np.clip(round(wanted), smallest, max(self.width, self.height, smallest)))

    def _inside(self) -> FrameView:
        """The view moved so that it shows as little as possible beyond the frame."""
        return replace(
            self, x=_within(self.x, self.size, self.width), y=_within(self.y, self.size, self.height)
        )


def name_of(point: int) -> str:
    """The name of a point.

    >>> name_of(36)
    'right eye, point 36'
    """
    group = next(name for name, points in GROUPS.items() if point in points)
    return f"{group.replace('_', ' ')}, point {point}"


def _path(way: str, colour: str, width: float) -> str:
    """SVG of a path whose stroke width is in the browser's pixels, whatever the size of the picture."""
    return f'<path d="{way}" stroke="{colour}" stroke-width="{width}" vector-effect="non-scaling-stroke"/>'


def _ring(x: float, y: float) -> str:
    r = LIMITS.ring_radius_units
    circle = f"M{x - r:.2f},{y:.2f}a{r},{r} 0 1 0 {2 * r},0a{r},{r} 0 1 0 {-2 * r},0"
    return _path(circle, "#000", 5) + _path(circle, "#ffd84d", 2.5)


def _listed(places: F64) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in places)


def _within(start: int, size: int, length: int) -> int:
    """The start of a span moved into a length, or centred when the span is longer.

    >>> _within(-5, 10, 100), _within(95, 10, 100), _within(7, 100, 50)
    (0, 90, -25)
    """
    return (length - size) // 2 if size >= length else min(max(start, 0), length - size)
