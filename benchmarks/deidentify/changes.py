"""What a de-identified video changed: the pixels that differ from the input, seen beside the true faces.

Guise writes losslessly, so that any difference is a change, even where skin is drawn over like skin; deface writes at
its encoder's best, and LOSSY grey levels count.  Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import F64
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.reference import ReferenceFrame
from guise.app.media import open_input

LOSSLESS, LOSSY = 1, 6  # grey levels from which a pixel counts as changed
CLOSING_FACE_WIDTHS = 0.15  # of unchanged specks within a changed area: skin may resemble skin
MIN_AREA_SQUARE_FACE_WIDTHS = 0.02  # below which a changed area does not count
MIN_CHANGED_SHARE = 0.9  # of a true box, in a changed area
POINT_REACH_FACE_WIDTHS = 0.02  # about a changed area, within which a point counts as covered
MIN_VISIBLE_SHARE = 0.25  # of the face's points, in the picture and before everything else
TRIANGLES = np.array(
    [t for t in ReferenceFrame.canonical(48).triangles if max(t) < 68]
)  # without the forehead's


@dataclass(frozen=True)
class Share:
    """How much of a true face was changed in a frame.

    Parameters
    ----------
    box : share of the box of its points, as far as it lies in the picture, within the box of the changed area.
    seen : the same for the points that can be seen: the others lie under hair or on the far side of the head.
    face : share of the pixels in the outline of the points that can be seen that lie within a changed area.
    bare : the same in the triangles of the reference's mesh whose three corners can be seen: a box or an outline also
        spans what is in front of the face, and a hand that a swap leaves in front is unchanged.
    points : share of the points that can be seen that lie in a changed area, or next to one.
    covered : whether the face was covered rather than swapped; None where that is not known.
    """

    frame: int
    box: float
    seen: float
    face: float
    bare: float
    points: float = 1.0
    covered: bool | None = None

    @property
    def is_leaked(self) -> bool:
        """Whether too little was changed: of the box that can be seen, and of the face itself.

        A cover must hold every point that can be seen.
        """
        return max(self.seen, self.bare) < MIN_CHANGED_SHARE or (self.covered is True and self.points < 1)


class SwappedFaces:
    """The boxes (4,) of the faces that a report says were swapped, by frame."""

    def __init__(self, report: dict[str, Any]) -> None:
        self._boxes: dict[int, list[tuple[float, ...]]] = {}
        done = report["done"].index("swapped")
        for track in report["tracks"]:
            rows = track["rows"]
            for i in np.flatnonzero(np.array(rows["done"]) == done):
                box = tuple(float(rows[side][i]) for side in ("x0", "y0", "x1", "y1"))
                self._boxes.setdefault(int(rows["frame"][i]), []).append(box)

    def holds(self, frame: int, points: F64) -> bool:
        """Whether the middle of points (n, 2) is in one of them."""
        x, y = (points.min(0) + points.max(0)) / 2
        return any(x0 < x < x1 and y0 < y < y1 for x0, y0, x1, y1 in self._boxes.get(frame, []))


@dataclass(frozen=True, eq=False)
class Truth:
    """The true face of a person: points (t, 68, 2) and whether they can be seen (t, 68)."""

    points: F64
    visible: NDArray[np.bool_]

    @classmethod
    def load(cls, file: Path) -> Truth:
        """From an npz of data/synthetic."""
        with np.load(file) as stored:
            return cls(stored["landmarks"][:, IBUG68].astype(np.float64), stored["visibility"][:, IBUG68])


def shares(
    before: Path, after: Path, truth: Truth, least: int, swapped: SwappedFaces | None = None
) -> Iterator[Share]:
    """The frames in which the face can be seen, and how much of it was changed by `least` grey levels.

    swapped : the faces that were not covered, if they are known.
    """
    with open_input(before) as one, open_input(after) as other:
        for frame, made in zip(one, other, strict=True):
            points, visible = truth.points[frame.index], truth.visible[frame.index]
            if visible.mean() >= MIN_VISIBLE_SHARE:
                changed = np.abs(frame.rgb().astype(np.int16) - made.rgb()).max(2) >= least
                covered = None if swapped is None else not swapped.holds(frame.index, points)
                yield share(frame.index, changed, points, visible, covered=covered)


def share(
    index: int,
    changed: NDArray[np.bool_],
    points: F64,
    visible: NDArray[np.bool_],
    *,
    covered: bool | None = None,
) -> Share:
    """How much of a face with points (68, 2) lies in the changed pixels (h, w)."""
    width = float(np.ptp(points[:, 0]))
    reach = max(3, round(CLOSING_FACE_WIDTHS * width))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    area = cv2.morphologyEx(changed.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    boxes = np.zeros_like(area)
    count, _, stats, _ = cv2.connectedComponentsWithStats(area)
    for left, top, w, h, size in stats[1:count]:
        if size > MIN_AREA_SQUARE_FACE_WIDTHS * width**2:
            boxes[top : top + h, left : left + w] = 1
    outline = cv2.convexHull(np.round(points[visible]).astype(np.int32))[:, 0]
    corners = TRIANGLES[visible[TRIANGLES].all(1)]
    return Share(
        index, _within(boxes, points), _within(boxes, points[visible]),
        _covered(area, [outline]), _covered(area, list(np.round(points[corners]).astype(np.int32))),
        _held(area, points[visible], max(1, round(POINT_REACH_FACE_WIDTHS * width))), covered,
    )  # fmt: skip


def _covered(area: NDArray[np.uint8], polygons: list[NDArray[np.int32]]) -> float:
    """Share of convex polygons (n, 2), clipped to the picture, that is 1."""
    inside = np.zeros_like(area)
    for polygon in polygons:
        cv2.fillConvexPoly(inside, polygon, 1)
    return float(area[inside > 0].mean()) if inside.any() else 1.0


def _held(area: NDArray[np.uint8], points: F64, reach: int) -> float:
    """Share of points (n, 2) that lie in an area or so many pixels from it."""
    near = cv2.dilate(area, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    limit = np.array(area.shape[::-1]) - 1
    x, y = np.clip(np.round(points), 0, limit).astype(int).T
    return float(near[y, x].mean())


def _within(boxes: NDArray[np.uint8], points: F64) -> float:
    """Share of the box of points (n, 2), clipped to the picture, that is 1."""
    limit = np.array(boxes.shape[::-1]) - 1
    x0, y0 = np.clip(np.floor(points.min(0)), 0, limit).astype(int)
    x1, y1 = np.clip(np.ceil(points.max(0)), 0, limit).astype(int)
    return float(boxes[y0 : y1 + 1, x0 : x1 + 1].mean())
