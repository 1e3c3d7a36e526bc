"""What a user says of places, in the columns of a plan: what is no face stays, and what was missed is covered.

A place is covered for certain: its box in each of its frames, beside what is followed from it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import iou
from guise.app.deidentify.covers import CHOSEN, NO_REASON
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.follow import follow
from guise.app.deidentify.tracks import BYSTANDERS, MarkedPlace
from guise.app.swapping.policy import COVERED, LEFT, LIMITS, growth
from guise.common.arrays import F32, Bool

Columns = dict[str, NDArray[Any]]


def as_chosen(case: Case, others: Columns, tracked: Mapping[int, Mapping[int, F32]]) -> list[Columns]:
    """The columns of faces that are not tracked, as the user wants them, and those of places.

    others : as they were found.   tracked : by place that has become a track, its boxes by frame; only there nothing
    else is to be done.
    """
    gone, left = np.zeros((2, len(others["frame"])), bool)
    for frame, box in (pair for boxes in tracked.values() for pair in boxes.items()):
        at = np.flatnonzero(others["frame"] == frame)
        gone[at] |= _are_at(others["box"][at], box)
    for place in case.places:
        left |= _of(place, others) & (place.action == "leave")
    done, reason = np.where(left, LEFT, others["done"]), np.where(left, NO_REASON, others["reason"])
    kept = {name: values[~gone] for name, values in (others | {"done": done, "reason": reason}).items()}
    used, columns = int(others["cover"].max(initial=0)), [kept]
    for n, place in enumerate(case.places):
        if place.action == "leave" or not place.cover:
            mine = _columns(case, place, used + n + 1)
            seen = np.isin(mine["frame"], list(tracked.get(n, ())))
            columns.append({name: values[~seen] for name, values in mine.items()})
    return columns


def _of(place: MarkedPlace, others: Columns) -> Bool:
    """Which detections a place is about: those at its box; what has moved away may be a face that came by."""
    within = (others["frame"] >= place.first) & (others["frame"] <= place.last)
    if place.cover:
        within &= others["cover"] == place.cover
    within[within] = _are_at(others["box"][within], np.array(place.box, np.float32))
    return np.asarray(within)


def _are_at(boxes: F32, box: F32) -> Bool:
    return np.array([iou(one, box) > LIMITS.min_same_iou for one in boxes], bool)


def _columns(case: Case, place: MarkedPlace, number: int) -> Columns:
    frames = range(place.first, place.last + 1)
    is_left = place.action == "leave"  # also for the audit
    rows = [(frame, place.box, 1.0) for frame in frames] if is_left else list(_covered(case, place))
    count = len(rows)
    ones, done = np.ones(count), LEFT if is_left else COVERED
    return {
        "track": ones * BYSTANDERS, "frame": np.array([frame for frame, _, _ in rows]), "done": ones * done,
        "box": np.reshape([box for _, box, _ in rows], (count, 4)), "turn": ones * 0,
        "growth": np.array([larger for _, _, larger in rows]), "confidence": ones,
        "reason": ones * (NO_REASON if is_left else CHOSEN), "cover": ones * (place.cover or number),
    }  # fmt: skip


def _covered(case: Case, place: MarkedPlace) -> Iterator[tuple[int, Sequence[float], float]]:
    """Frames, boxes and growths of a face that was missed; where it is followed no more, the last box grows."""
    seen = _followed(case, place)
    known = np.array(sorted(seen))
    for frame in range(place.first, place.last + 1):
        yield frame, place.box, 1.0
        nearest = int(known[np.abs(known - frame).argmin()])
        unseen = abs(nearest - frame) / case.rate
        if unseen <= LIMITS.unseen_seconds and frame != place.at:
            yield frame, seen[nearest].tolist(), float(growth(unseen))


def _followed(case: Case, place: MarkedPlace) -> dict[int, F32]:
    """What `follow` finds, which is kept for the next plan."""
    name = f"followed.{hashlib.sha256(repr(place).encode()).hexdigest()[:16]}.npz"
    if not case.work.has(name):
        found = follow(case, place)
        case.work.save_arrays(name, frame=np.array(list(found)), box=np.array(list(found.values())))
    kept = case.work.load_arrays(name)
    return dict(zip(kept["frame"].tolist(), kept["box"], strict=True))
