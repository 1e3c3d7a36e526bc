"""What is behind the heads of a shot, from some frames of a segment of the original; for ``--region head``."""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.landmarks.heads import region
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.gaps import Gaps
from guise.app.deidentify.stages.head import LIMITS, Plate
from guise.app.swapping.policy import SWAPPED
from guise.common.arrays import U8

PICTURES = 24  # of a shot in a segment
HEAD_EDGE_PIXELS = 7  # of a picture, about what a head leaves, and
HEAD_GROWTH = (
    1.3  # of the region about a face, covers included, that is not looked at where that is not known
)


def plate_of(case: Case, segment: int, shot: int, gaps: Gaps) -> Plate | None:
    """The plate of a shot (counted from 0), as far as it lies in the segment; None when that is too short.

    gaps : what heads leave, by track and frame.
    """
    edges = [0, *case.cuts, case.scan.frames]
    first, last = (
        max(edges[shot], case.scan.segments[segment].first),
        min(edges[shot + 1], case.span(segment)[1]),
    )
    if last - first < LIMITS.plate_min_pictures:
        return None
    wanted = set(np.linspace(first, last - 1, PICTURES).round().astype(int).tolist())
    pictures, heads = [], []
    for frame in case.frames(first, last):
        if frame.index in wanted:
            scale = min(1.0, LIMITS.plate_side_pixels / max(frame.width, frame.height))
            size = [max(1, round(side * scale)) for side in (frame.width, frame.height)]
            pictures.append(np.asarray(cv2.resize(frame.rgb(), size, interpolation=cv2.INTER_AREA), np.uint8))
            inside = _heads(case, frame.index, scale, (size[1], size[0]), gaps)
            for gap in (gap for (_, index), gap in gaps.items() if index == frame.index):
                whole = gap.share((0, 0, frame.width, frame.height)) > 0
                near = cv2.resize(whole.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
                inside[cv2.dilate(near, np.ones((HEAD_EDGE_PIXELS,) * 2)) > 0] = 1
            heads.append(inside)
    return Plate.of(pictures, heads) if len(pictures) >= LIMITS.plate_min_pictures else None


def _heads(case: Case, frame: int, scale: float, size: tuple[int, int], gaps: Gaps) -> U8:
    """(h, w) 1 where the head of any face of a frame may be; those that leave a gap are there and nowhere else."""
    plan, inside = case.plan, np.zeros(size, np.uint8)
    leaving = {track.number for track in case.tracks if (track.origin, frame) in gaps}
    for row in np.flatnonzero(plan["frame"] == frame):
        if plan["done"][row] == SWAPPED and plan["track"][row] in leaving:
            continue
        place = region(plan["box"][row], HEAD_GROWTH * float(plan["growth"][row]), float(plan["turn"][row]))
        x0, y0 = np.maximum(np.floor(place[:2] * scale), 0).astype(int)
        x1, y1 = np.maximum(np.ceil(place[2:] * scale), 0).astype(int)
        inside[y0:y1, x0:x1] = 1
    return inside
