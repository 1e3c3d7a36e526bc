"""What a user says of places, in the columns of a plan: what is no face stays, and what was missed is covered.

A place is covered for certain: its box in each of its frames, beside what is followed from it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
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


def as_chosen(case: Case, others: Columns, tracked: Iterable[tuple[int, F32]]) -> list[Columns]:
    """The columns of faces that are not tracked, as the user wants them, and those of places.

    others : as they were found.   tracked : frames and boxes of faces there that are tracked by now.
    """
    gone, left = np.zeros((2, len(others["frame"])), bool)
    for frame, box in tracked:
        at = np.flatnonzero(others["frame"] == frame)
        gone[at] |= _are_at(others["box"][at], box)
    places = [place for n, place in enumerate(case.places) if n not in case.added["places"]]
    for place in case.places:
        mine = _of(place, others)
        left |= mine & (place.action == "leave")
        gone |= mine & (place.cover > 0) & (place not in places)
    done, reason = np.where(left, LEFT, others["done"]), np.where(left, NO_REASON, others["reason"])
    kept = {name: values[~gone] for name, values in (others | {"done": done, "reason": reason}).items()}
    used = int(others["cover"].max(initial=0))
    return [kept, *(_columns(case, place, others, used + n) for n, place in enumerate(places, 1))]


def _of(place: MarkedPlace, others: Columns) -> Bool:
    """Which detections a place is about: those of its cover, or those at its box."""
    if place.cover:
        return np.asarray(others["cover"] == place.cover)
    within = (others["frame"] >= place.first) & (others["frame"] <= place.last)
    within[within] = _are_at(others["box"][within], np.array(place.box, np.float32))
    return within


def _are_at(boxes: F32, box: F32) -> Bool:
    return np.array([iou(one, box) > LIMITS.min_same_iou for one in boxes], bool)


def _columns(case: Case, place: MarkedPlace, others: Columns, number: int) -> Columns:
    rows = list(_left(place, others) if place.action == "leave" else _covered(case, place))
    count = len(rows)
    ones, done = np.ones(count), LEFT if place.action == "leave" else COVERED
    return {
        "track": ones * BYSTANDERS, "frame": np.array([frame for frame, _, _ in rows]), "done": ones * done,
        "box": np.reshape([box for _, box, _ in rows], (count, 4)), "turn": ones * 0,
        "growth": np.array([larger for _, _, larger in rows]), "confidence": ones,
        "reason": ones * (CHOSEN if done == COVERED else NO_REASON), "cover": ones * (place.cover or number),
    }  # fmt: skip


def _left(place: MarkedPlace, others: Columns) -> Iterator[tuple[int, Sequence[float], float]]:
    """Frames, boxes and growths of what is no face, so that the audit leaves it: where it is seen next, or drawn."""
    mine = np.flatnonzero(others["cover"] == place.cover) if place.cover else np.zeros(0, np.intp)
    for frame in range(place.first, place.last + 1):
        near = mine[np.abs(others["frame"][mine] - frame).argmin()] if len(mine) else None
        yield frame, place.box if near is None else others["box"][near], 1.0


def _covered(case: Case, place: MarkedPlace) -> Iterator[tuple[int, Sequence[float], float]]:
    """The same of a face that was missed; where it is followed no more, what it was followed to grows."""
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
