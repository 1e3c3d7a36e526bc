"""A crop under construction: the picture, the points and irises in it, and the classes of its cells.

Objects are added one after another; picture, parsing maps and visibility change together, so that the labels stay
exact.  Pixels, x right, y down, pixel centres at integers; images RGB uint8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks import schemes
from guise.aam.parsing import CELLS
from guise.common.arrays import F32, F64, I32, U8, Bool
from training.parsing_labels import (
    BACKGROUND,
    BROWS,
    CLASSES,
    EYES,
    FACIAL_HAIR,
    GLASSES,
    HAIR,
    INNER_MOUTH,
    LIPS,
    SKIN,
)

SIZE = 128  # pixels, the side of the network's input
LABELS_PER_SIDE = 192  # that are averaged to the maps
MIN_IRIS_SHARE = 0.25  # that must be seen for an iris to count

Picture = U8


@dataclass(frozen=True, eq=False)
class Sample:
    """A crop with its ground truth, in pixels of the crop.

    Parameters
    ----------
    crop : (128, 128, 3) uint8
    points, seen : (81, 2) float32, (81,) bool
    iris, iris_seen : (2, 3) float32 centre and radius, (2,) bool
    maps : (classes, 64, 64) float32
        Share of each class in a cell if `exact`, otherwise 1 for the classes that a cell may show.
    exact : bool
    """

    crop: Picture
    points: F32
    seen: Bool
    iris: F32
    iris_seen: Bool
    maps: F32
    exact: bool


@dataclass(eq=False)
class Canvas:
    """The state of a sample; see `Sample` for shapes and units."""

    crop: Picture
    points: F32
    visible: Bool
    iris: F32
    has_iris: bool
    maps: F32
    exact: bool

    def put(self, picture: Picture, alpha: Picture, kind: int) -> None:
        """Lay `picture` (128, 128, 3) over the crop, opaque by `alpha` (128, 128) 0..255, as class `kind`."""
        self.crop = blend(self.crop, picture, alpha)
        self.cover(alpha, kind)
        if kind not in (GLASSES, HAIR, FACIAL_HAIR):
            at = np.clip(np.round(self.points), 0, SIZE - 1).astype(int)
            self.visible = self.visible & (alpha[at[:, 1], at[:, 0]] < 128)

    def cover(self, alpha: Picture, kind: int) -> None:
        """Record that class `kind` covers the cells by `alpha` (128, 128) 0..255."""
        share = cv2.resize(alpha, (CELLS, CELLS), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
        if self.exact:
            self.maps *= 1 - share
            self.maps[kind] += share
            return
        self.maps[:, share > 0.6] = 0
        self.maps[kind][share > 0.08] = 1

    def finish(self) -> Sample:
        """The finished sample."""
        inside = (self.points > -0.5).all(1) & (self.points < SIZE - 0.5).all(1)
        return Sample(
            self.crop,
            self.points,
            self.visible & inside,
            self.iris,
            self._open_irises(),
            self.maps,
            self.exact,
        )

    def _open_irises(self) -> Bool:
        """Which irises (2,) are mostly visible in the parsing maps."""
        if not (self.has_iris and self.exact):
            return np.zeros(2, bool)
        found = []
        for x, y, r in self.iris:
            disc = np.zeros((CELLS, CELLS), np.uint8)
            centre = (round((x + 0.5) / 2 * 16 - 8), round((y + 0.5) / 2 * 16 - 8))
            cv2.circle(disc, centre, max(8, round(r / 2 * 16)), 1, -1, shift=4)
            inside = disc > 0
            found.append(bool(inside.any() and self.maps[EYES][inside].mean() > MIN_IRIS_SHARE))
        return np.array(found)


def blend(under: Picture, over: Picture, alpha: Picture) -> Picture:
    """Picture `over` on `under` (h, w, 3), opaque by `alpha` (h, w) 0..255."""
    share = alpha[..., None].astype(np.uint16)
    return np.asarray((over * share + under * (255 - share) + 127) // 255, np.uint8)


def whole(points: Any) -> I32:
    """Points (n, 2) at whole pixels, as OpenCV draws them."""
    return np.round(np.asarray(points)).astype(np.int32)


def pixel(point: Any) -> tuple[int, int]:
    """A point's pixel, as OpenCV draws it."""
    return int(point[0]), int(point[1])


def class_maps(labels: Picture, side: int, matrix: F64, border: int) -> F32:
    """Share of every class (classes, 64, 64) in the cells of a crop.

    labels : (k, k) classes of a picture of `side` pixels; matrix : (2, 3) from its pixels to the crop's.
    """
    up, fine = len(labels) / side, LABELS_PER_SIDE / SIZE
    linear = matrix[:, :2] * fine / up
    # A point at pixel x of the picture lies at up (x + 1/2) - 1/2 among its labels, and likewise in the crop.
    offset = fine * (matrix[:, :2] @ np.full(2, 0.5 / up - 0.5) + matrix[:, 2] + 0.5) - 0.5
    warped = cv2.warpAffine(
        labels,
        np.column_stack([linear, offset]),
        (LABELS_PER_SIDE, LABELS_PER_SIDE),
        flags=cv2.INTER_NEAREST,
        borderMode=border,
    )
    maps = np.zeros((len(CLASSES), CELLS, CELLS), np.float32)
    for k in np.flatnonzero(np.bincount(warped.ravel())):
        one = np.where(warped == k, np.uint8(255), np.uint8(0))
        maps[k] = cv2.resize(one, (CELLS, CELLS), interpolation=cv2.INTER_AREA)
    maps /= maps.sum(0)  # each was rounded
    return maps


def possible_maps(points: F32) -> F32:
    """Which classes (classes, 64, 64) the cells of a crop may show, given its 81 points and nothing in front.

    Along the borders of lips and eyes both sides are possible.
    """
    maps = np.zeros((len(CLASSES), CELLS, CELLS), np.float32)
    whole = _area(cv2.convexHull(np.asarray(points, np.float32))[:, 0])
    maps[[SKIN, HAIR]] = 1
    maps[BACKGROUND] = _shrunk(whole) == 0
    maps[FACIAL_HAIR] = maps[GLASSES] = 1
    maps[BROWS] = _grown(_grown(_area(cv2.convexHull(points[schemes.BROWS])[:, 0])))
    for eye in (points[schemes.RIGHT_EYE], points[schemes.LEFT_EYE]):
        _inset(maps, _area(eye), EYES, (EYES, GLASSES))
    outer, inner = _area(points[schemes.OUTER_LIPS]), _area(points[schemes.INNER_LIPS])
    _inset(maps, outer, LIPS, (LIPS, FACIAL_HAIR))
    maps[[LIPS, SKIN]] = np.maximum(maps[[LIPS, SKIN]], _grown(inner) * outer)
    _inset(maps, inner, INNER_MOUTH, (INNER_MOUTH,))
    return maps


def _inset(maps: F32, area: Picture, kind: int, inside: tuple[int, ...]) -> None:
    """Allow `kind` in and around an area; well inside it only the classes `inside` remain."""
    core = _shrunk(area) > 0
    maps[kind] = np.maximum(maps[kind], _grown(area))
    maps[:, core] = 0
    maps[np.ix_(inside)] = np.maximum(maps[np.ix_(inside)], core)


def _area(polygon: F32) -> Picture:
    area = np.zeros((CELLS, CELLS), np.uint8)
    corners = np.round(((np.asarray(polygon, np.float64) + 0.5) / 2 - 0.5) * 16).astype(np.int32)
    cv2.fillPoly(area, [corners], 1, shift=4)
    return area


def _grown(area: Picture) -> Picture:
    return np.asarray(cv2.dilate(area, np.ones((3, 3), np.uint8)), np.uint8)


def _shrunk(area: Picture) -> Picture:
    return np.asarray(cv2.erode(area, np.ones((3, 3), np.uint8)), np.uint8)
