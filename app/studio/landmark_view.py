"""The square part of a frame in which landmarks are corrected: its picture, its drawing, what a pointer means.

A screen has SCREEN x SCREEN units, x right, y down, from 0 at its upper left corner; the browser scales it.  A frame's
pixels count from their centres, as everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from guise.aam.landmarks import (
    GROUPS,
    INNER_LIPS,
    LEFT_BROW,
    LEFT_EYE,
    OUTER_LIPS,
    RIGHT_BROW,
    RIGHT_EYE,
)
from guise.aam.landmarks.schemes import NOSE_BRIDGE, NOSE_WINGS, SILHOUETTE
from guise.common.arrays import F64

Picture = NDArray[np.uint8]

SCREEN = 720
REACH = 36  # screen units from a pointer within which a point is taken
RING = 12  # screen units, the radius of what marks the chosen point
SMALLEST = 24  # frame pixels across the view
ROOM = 1.5  # sides of the view to that of the face
_PAPER = (32, 32, 32)
_CLOSED = (SILHOUETTE, RIGHT_EYE, LEFT_EYE, OUTER_LIPS, INNER_LIPS)
_OPEN = (RIGHT_BROW, LEFT_BROW, NOSE_BRIDGE, NOSE_WINGS)
_LINES = tuple([*group, group[0]] for group in _CLOSED) + tuple(list(group) for group in _OPEN)


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

    def around(self, points: NDArray[np.float32]) -> FrameView:
        """The view of the same frame that shows points (n, 2) with some room."""
        low, high = points.min(0), points.max(0)
        size = self._size(ROOM * float((high - low).max()))
        x, y = np.round((low + high) / 2 - size / 2).astype(int).tolist()
        return replace(self, x=x, y=y, size=size)._inside()

    def zoomed(self, factor: float, about: F64 | NDArray[np.float32]) -> FrameView:
        """The view in which everything is `factor` times as large; the place `about` (2,), frame pixels, stays."""
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
        """Screen units to a pixel."""
        return SCREEN / self.size

    def to_screen(self, points: ArrayLike) -> F64:
        """Points (..., 2) of the frame on the screen."""
        return np.asarray((np.asarray(points, np.float64) - (self.x, self.y) + 0.5) * self.scale)

    def to_frame(self, places: ArrayLike) -> F64:
        """Places (..., 2) on the screen in the frame."""
        return np.asarray(np.asarray(places, np.float64) / self.scale - 0.5 + (self.x, self.y))

    def nearest(self, points: NDArray[np.float32], place: ArrayLike) -> int | None:
        """The point (n, 2) of the frame that a pointer at `place` (2,) on the screen means; None when all are far."""
        away = np.linalg.norm(self.to_screen(points) - np.asarray(place), axis=1)
        point = int(np.nan_to_num(away, nan=np.inf).argmin())
        return point if away[point] <= REACH else None

    def picture(self, rgb: Picture, side: int = SCREEN) -> Picture:
        """What is seen of a frame (h, w, 3); (side, side, 3), dark beyond it."""
        x0, y0 = max(self.x, 0), max(self.y, 0)
        part = rgb[y0 : max(self.y + self.size, 0), x0 : max(self.x + self.size, 0)]
        right, down = self.size - (x0 - self.x) - part.shape[1], self.size - (y0 - self.y) - part.shape[0]
        padded = cv2.copyMakeBorder(
            part, y0 - self.y, down, x0 - self.x, right, cv2.BORDER_CONSTANT, value=_PAPER
        )
        way = cv2.INTER_AREA if side < self.size else cv2.INTER_CUBIC
        return np.asarray(cv2.resize(padded, (side, side), interpolation=way), np.uint8)

    def drawing(self, points: NDArray[np.float32], chosen: int | None) -> str:
        """SVG of points (81, 2) and the lines between them, one of them chosen; "" where there are none."""
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
        return int(np.clip(round(wanted), SMALLEST, max(self.width, self.height, SMALLEST)))

    def _inside(self) -> FrameView:
        """Moved so that it shows no more beyond the frame than it must."""
        return replace(
            self, x=_within(self.x, self.size, self.width), y=_within(self.y, self.size, self.height)
        )


def name_of(point: int) -> str:
    """What a point is called.

    >>> name_of(36)
    'right eye, point 36'
    """
    group = next(name for name, points in GROUPS.items() if point in points)
    return f"{group.replace('_', ' ')}, point {point}"


def _path(way: str, colour: str, width: float) -> str:
    """SVG of a path whose width, pixels of the browser, does not depend on the size of the picture there."""
    return f'<path d="{way}" stroke="{colour}" stroke-width="{width}" vector-effect="non-scaling-stroke"/>'


def _ring(x: float, y: float) -> str:
    circle = f"M{x - RING:.2f},{y:.2f}a{RING},{RING} 0 1 0 {2 * RING},0a{RING},{RING} 0 1 0 {-2 * RING},0"
    return _path(circle, "#000", 5) + _path(circle, "#ffd84d", 2.5)


def _listed(places: F64) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in places)


def _within(start: int, size: int, length: int) -> int:
    """The start of a span within a length, or about the middle of a length that is shorter.

    >>> _within(-5, 10, 100), _within(95, 10, 100), _within(7, 100, 50)
    (0, 90, -25)
    """
    return (length - size) // 2 if size >= length else min(max(start, 0), length - size)
