"""Covers as a viewer sees them: over what, from when to when, and why, each with a number by which a review refuses it.

What was done is kept in columns (`Rows`), a row for each face in each frame: first as it is planned, then as it was
drawn.  Reports, tables and sentences count these rows and nothing else.  Boxes ``x0 y0 x1 y1`` of the 68 iBUG points,
pixels as shown; frames counted from 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.app.swapping.policy import COVERED, DONE, LIMITS, FacePlace, FaceTreatment
from guise.common.arrays import F32, I32

Rows = Mapping[str, NDArray[Any]]  # columns as COLUMNS says, by frame
COLUMNS: dict[str, type[np.generic]] = {
    "track": np.int32, "frame": np.int32, "done": np.uint8, "box": np.float32, "turn": np.float32,
    "growth": np.float32, "confidence": np.float32, "reason": np.uint8, "cover": np.int32,
}  # fmt: skip
# Why a face is covered; "" of one that is not.
REASONS = (
    "", "your choice", "not enrolled", "unsure fit", "gap", "before or after", "bystander", "found by the audit",
    "turned too far", "could not be drawn", "taken for a thing", "still recognised",
)  # fmt: skip
NO_REASON, CHOSEN, NOT_ENROLLED, UNSURE_FIT, GAP, EDGE, BYSTANDER, FOUND, TURNED, NOT_DRAWN, THING, RECOGNISED = (
    range(len(REASONS))
)  # fmt: skip


@dataclass(frozen=True)
class CoverSpan:
    """A cover, or what is left of a track between two swaps.

    Parameters
    ----------
    number : from 1; those of bystanders come first, and depend on the input only.
    track : whose face, or 0 for one that is not tracked.
    first, last : frames, inclusive.   shown : one of them, for a picture of what is covered.
    box : of the face in that frame.   reason : one of REASONS.
    """

    number: int
    track: int
    first: int
    last: int
    shown: int
    box: tuple[int, int, int, int]
    reason: str


def rows_of(parts: Iterable[Rows]) -> dict[str, NDArray[Any]]:
    """Some columns one after the other, by frame."""
    parts = list(parts)
    joined = {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}
    order = np.argsort(joined["frame"], kind="stable")
    return {name: joined[name][order].astype(kind) for name, kind in COLUMNS.items()}


def rows_from(treatments: Mapping[int, Iterable[FaceTreatment]]) -> dict[str, NDArray[Any]]:
    """The columns of what was done, by frame."""
    pairs = [(frame, one) for frame in sorted(treatments) for one in treatments[frame]]
    values: dict[str, list[Any]] = {
        "track": [one.who for _, one in pairs],
        "frame": [frame for frame, _ in pairs],
        "box": np.reshape([one.box for _, one in pairs], (-1, 4)).tolist(),
    }
    values |= {name: [getattr(one, name) for _, one in pairs] for name in COLUMNS if name not in values}
    empty = np.zeros((0, 4), np.float32)
    return {name: np.array(v, COLUMNS[name]) if v else empty if name == "box" else np.zeros(0, COLUMNS[name])
            for name, v in values.items()}  # fmt: skip


def numbered(frames: I32, boxes: F32, reach: int, first: int = 1) -> I32:
    """Numbers (n,) of detections, ascending in frames: one at the place of another of the last frames has its number.

    reach : how many frames.   first : number.
    """
    numbers, last, places = np.zeros(len(frames), np.int32), list[int](), list[FacePlace]()
    for row, (frame, box) in enumerate(zip(frames.tolist(), boxes, strict=True)):
        place = FacePlace(box.astype(np.float64), 0.0)
        near = [k for k in range(len(last) - 1, -1, -1) if frame - last[k] <= reach]
        same = next((k for k in near if places[k].overlap(place) > LIMITS.min_same_iou), None)
        if same is None:
            same = len(last)
            last.append(frame)
            places.append(place)
        last[same], places[same], numbers[row] = frame, place, first + same
    return numbers


def covers_of(rows: Rows) -> list[CoverSpan]:
    """The covers of some columns, in the order of their numbers; with what would be one, were it no thing."""
    covered = np.flatnonzero((rows["done"] == COVERED) | (rows["reason"] == THING))
    count = int(rows["cover"].max(initial=0))
    groups: dict[int, list[int]] = {}
    open_spans: dict[int, tuple[int, int, int]] = {}  # by track: number, frame and reason of its last row
    for row in covered.tolist():
        number, track, frame = (int(rows[name][row]) for name in ("cover", "track", "frame"))
        if not number:
            reason = int(rows["reason"][row])
            number, before, why = open_spans.get(track, (0, -2, 0))
            if frame - before > 1 or why != reason:
                number = count = count + 1
            open_spans[track] = number, frame, reason
        groups.setdefault(number, []).append(row)
    return [_cover(number, rows, groups[number]) for number in sorted(groups)]


def _cover(number: int, rows: Rows, group: list[int]) -> CoverSpan:
    shown = max(group, key=lambda row: float(rows["confidence"][row]))
    x0, y0, x1, y1 = (round(float(v)) for v in rows["box"][shown])
    frames = rows["frame"][group]
    return CoverSpan(
        number, int(rows["track"][shown]), int(frames.min()), int(frames.max()), int(rows["frame"][shown]),
        (x0, y0, x1, y1), REASONS[int(rows["reason"][shown])],
    )  # fmt: skip


def counts_of(frames: int, rows: Iterable[tuple[I32, NDArray[np.uint8]]]) -> dict[str, int]:
    """Of so many frames, how many there are by the least hidden face in each.   rows : frames and what was done."""
    worst = np.full(frames, -1, np.int8)
    for these, done in rows:
        np.maximum.at(worst, these, done.astype(np.int8))
    return {name: int((worst == rank).sum()) for rank, name in enumerate(("without face", *DONE), start=-1)}
