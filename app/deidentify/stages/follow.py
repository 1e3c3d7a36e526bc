"""Following what a user has drawn a box about, which may be a face that no detector knows: by the flow of its points.

Points of a grid in the box are followed to the next frame and back (Kalal, Mikolajczyk and Matas, Forward-backward
error, ICPR 2010); the box moves and grows as the better half of them does.  Boxes ``x0 y0 x1 y1``, pixels as shown.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.tracks import MarkedPlace
from guise.common.arrays import F32, F64, U8


@dataclass(frozen=True)
class FollowLimits:
    """How points are followed, and when they are lost."""

    grid: int = 9  # points across
    longest_pixels: int = 640  # side of the picture in which they are
    min_points: int = 12
    max_error_share: float = 0.04  # of the box's size: of the way there and back
    max_back_frames: int = 250  # followed back from where the box was drawn


LIMITS = FollowLimits()


def follow(case: Case, place: MarkedPlace) -> dict[int, F32]:
    """By frame, the boxes (4,) of what a place shows, as far as it is followed within its frames and its shot."""
    cuts = np.array(case.cuts)
    first = max([place.first, place.at - LIMITS.max_back_frames, *cuts[cuts <= place.at].tolist()])
    last = min([place.last, *(cuts[cuts > place.at] - 1).tolist()])
    box = np.array(place.box, np.float32)
    boxes, before = {place.at: box}, deque[U8]()
    previous, scale = np.zeros((0, 0), np.uint8), 1.0
    for frame in case.frames(first, last + 1):
        small, scale = _small(frame.luma)
        if frame.index > place.at:
            moved = _moved(previous, small, scale * box)
            if moved is None:
                break
            box = boxes[frame.index] = np.asarray(moved / scale, np.float32)
        else:
            before.appendleft(small)
        previous = small
    return boxes | _followed_back(before, scale, place)


def _followed_back(pictures: Iterable[U8], scale: float, place: MarkedPlace) -> dict[int, F32]:
    """As `follow`, in the frames before; their pictures come last one first."""
    boxes: dict[int, F32] = {}
    box, grey = np.array(place.box, np.float32), None
    for frame, small in zip(range(place.at, -1, -1), pictures, strict=False):
        if grey is not None:
            moved = _moved(grey, small, scale * box)
            if moved is None:
                break
            box = boxes[frame] = np.asarray(moved / scale, np.float32)
        grey = small
    return boxes


def _small(luma: U8) -> tuple[U8, float]:
    scale = min(1.0, LIMITS.longest_pixels / max(luma.shape))
    return np.asarray(
        cv2.resize(luma, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
    ), scale


def _moved(one: U8, other: U8, box: F32) -> F64 | None:
    """A box (4,) of a picture (h, w) in the next one; None where it is lost."""
    axes = (np.linspace(low, high, LIMITS.grid + 2)[1:-1] for low, high in zip(box[:2], box[2:], strict=True))
    points = np.stack(np.meshgrid(*axes), -1).reshape(-1, 1, 2).astype(np.float32)
    there, found, _ = cv2.calcOpticalFlowPyrLK(one, other, points, np.empty_like(points))
    back, known, _ = cv2.calcOpticalFlowPyrLK(other, one, there, np.empty_like(points))
    error = np.linalg.norm((back - points)[:, 0], axis=1)
    both = (found[:, 0] > 0) & (known[:, 0] > 0)
    size = float(np.sqrt(max(1.0, float(np.prod(box[2:] - box[:2])))))
    good = both & (error <= max(1.0, LIMITS.max_error_share * size))
    if good.sum() < LIMITS.min_points:
        return None
    good &= error <= np.median(error[good])
    start, end = points[good, 0].astype(np.float64), there[good, 0].astype(np.float64)
    spread = np.median(np.linalg.norm(start - np.median(start, axis=0), axis=1))
    grown = float(np.median(np.linalg.norm(end - np.median(end, axis=0), axis=1)) / max(spread, 1e-6))
    centre = (box[:2] + box[2:]) / 2 + np.median(end - start, axis=0)
    half = np.clip(grown, 0.9, 1.1) * (box[2:] - box[:2]) / 2
    height, width = one.shape
    inside = bool((centre >= 0).all() and (centre < (width, height)).all())
    return np.concatenate([centre - half, centre + half]) if inside else None
