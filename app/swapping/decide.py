"""What happens to a track in every frame: swapped where the fit is trusted, covered wherever else the face may be.

Fail closed: a gap is covered along the line between its ends, a track for a margin of time beyond its ends, and a frame
next to one that is not trusted is not trusted either.  Boxes ``x0 y0 x1 y1`` of the 68 iBUG points, pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from guise.common.arrays import F32

Action = Literal["swap", "cover", "leave"]
Done = Literal["swapped", "covered", "left"]
ACTIONS: tuple[Action, ...] = ("swap", "cover", "leave")
DONE: tuple[Done, ...] = ("swapped", "covered", "left")
Bools = NDArray[np.bool_]

SWAPPED, COVERED, LEFT = (DONE.index(done) for done in ("swapped", "covered", "left"))


@dataclass(frozen=True)
class DecisionLimits:
    """Thresholds of swap and cover."""

    min_swap_confidence: float = 0.5
    distrust_seconds: float = 0.1  # about a frame that is not trusted, which are not trusted either
    min_swap_seconds: float = 0.3
    track_margin_seconds: float = 0.4  # covered beyond a track's ends
    bystander_margin_seconds: float = 0.2  # covered before and after each detection of a bystander
    growth_per_frame: float = (
        0.03  # of the covered region, away from the nearest frame in which the face was seen
    )
    max_growth: float = 1.6
    cover_seconds: float = (
        0.1  # about a frame, whose boxes its cover holds as well: boxes jitter where a hand hides
    )


LIMITS = DecisionLimits()


@dataclass(frozen=True, eq=False)
class TrackObservations:
    """What is known of a track.

    (n,) frames, ascending; (n, 4) boxes; (n,) turns; (n,) confidence that a swap is right.
    """

    frames: NDArray[np.int32]
    boxes: F32
    turns: F32
    trust: F32


@dataclass(frozen=True, eq=False)
class Decision:
    """What happens to a track.

    Parameters
    ----------
    frames : (n,) int32, consecutive.   done : (n,) uint8, index into DONE.
    boxes, turns : (n, 4), (n,) of the face, seen or interpolated.   growth : (n,) of the covered region.
    confidence : (n,) that a swap is right; 0 where the face was not seen.
    """

    frames: NDArray[np.int32]
    done: NDArray[np.uint8]
    boxes: F32
    turns: F32
    growth: F32
    confidence: F32


def decide(
    rows: TrackObservations, action: Action, *, total: int, rate: float, cuts: Sequence[int]
) -> Decision:
    """What happens to a track in the frames about it.

    total : frames of the video.   rate : a second.   cuts : first frames of new shots.
    """
    first, last = int(rows.frames[0]), int(rows.frames[-1])
    margin = max(1, round(LIMITS.track_margin_seconds * rate))
    start = max([0, first - margin, *(c for c in cuts if c <= first)])
    stop = min([total, last + margin + 1, *(c for c in cuts if c > last)])
    frames = np.arange(start, stop, dtype=np.int32)
    boxes = np.stack([np.interp(frames, rows.frames, rows.boxes[:, k]) for k in range(4)], axis=1)
    turns = np.interp(frames, rows.frames, np.unwrap(rows.turns))
    seen = np.isin(frames, rows.frames)
    confidence = np.zeros(len(frames), np.float32)
    confidence[seen] = rows.trust
    done = _done(confidence, action, rate)
    reach = round(LIMITS.cover_seconds * rate)
    boxes = np.where((done == COVERED)[:, None], enclosing(boxes, reach), boxes)
    return Decision(
        frames, done, boxes.astype(np.float32), turns.astype(np.float32),
        _growth(frames, rows.frames), confidence,
    )  # fmt: skip


def enclosing(boxes: NDArray[np.floating], reach: int) -> NDArray[np.floating]:
    """For each of consecutive boxes (n, 4) the one that holds it and the `reach` boxes before and after it.

    >>> enclosing(np.array([[0, 0, 2, 2], [1, 0, 3, 2], [5, 5, 6, 6]]), 1).tolist()
    [[0, 0, 3, 2], [0, 0, 6, 6], [1, 0, 6, 6]]
    """
    padded = np.pad(boxes, ((reach, reach), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0)
    return np.concatenate([windows[:, :2].min(2), windows[:, 2:].max(2)], axis=1)


def _done(confidence: F32, action: Action, rate: float) -> NDArray[np.uint8]:
    if action == "leave":
        return np.full(len(confidence), LEFT, np.uint8)
    if action == "cover":
        return np.full(len(confidence), COVERED, np.uint8)
    swapped = eroded(confidence >= LIMITS.min_swap_confidence, round(LIMITS.distrust_seconds * rate))
    swapped = without_short(swapped, round(LIMITS.min_swap_seconds * rate))
    return np.where(swapped, SWAPPED, COVERED).astype(np.uint8)


def eroded(trusted: Bools, count: int) -> Bools:
    """Without the `count` elements next to a false one.

    >>> eroded(np.array([1, 1, 1, 0, 1, 1], bool), 1).astype(int).tolist()
    [1, 1, 0, 0, 0, 1]
    """
    near = np.convolve(~trusted, np.ones(2 * count + 1), "same") > 0.5
    return (
        np.asarray(trusted & ~near[: len(trusted)]) if len(trusted) > 2 * count else trusted & trusted.all()
    )


def without_short(flags: Bools, min_length: int) -> Bools:
    """Without runs of fewer than `min_length` true elements.

    >>> without_short(np.array([1, 1, 0, 1], bool), 2).astype(int).tolist()
    [1, 1, 0, 0]
    """
    kept = flags.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.view(np.int8), [0]])))
    for start, stop in edges.reshape(-1, 2):
        if stop - start < min_length:
            kept[start:stop] = False
    return kept


def _growth(frames: NDArray[np.int32], known: NDArray[np.int32]) -> F32:
    """How much larger the region is where the face was not seen."""
    after = np.searchsorted(known, frames)
    before = np.clip(after - 1, 0, len(known) - 1)
    distance = np.minimum(
        np.abs(frames - known[before]), np.abs(known[np.clip(after, 0, len(known) - 1)] - frames)
    )
    return np.asarray(np.minimum(1 + LIMITS.growth_per_frame * distance, LIMITS.max_growth), np.float32)


@dataclass(frozen=True, eq=False)
class Bystanders:
    """Faces that are covered without being tracked: (n,) frames, ascending; (n, 4) boxes; (n,) scores; (n,) turns."""

    frames: NDArray[np.int32]
    boxes: F32
    scores: F32
    turns: F32

    def spread(self, *, total: int, rate: float, cuts: Sequence[int]) -> Bystanders:
        """With the frames about each detection, as far as the shot goes; a frame may get the boxes of several."""
        reach = max(1, round(LIMITS.bystander_margin_seconds * rate))
        frames, rows = [], []
        edges = np.array([0, *cuts, total])
        for row, frame in enumerate(self.frames):
            shot = int(np.searchsorted(edges, frame, side="right"))
            low, high = max(int(frame) - reach, edges[shot - 1]), min(int(frame) + reach + 1, edges[shot])
            for at in range(int(low), int(high)):
                frames.append(at)
                rows.append(row)
        order = np.argsort(np.array(frames, np.int64), kind="stable")
        chosen = np.array(rows, np.intp)[order]
        return Bystanders(
            np.array(frames, np.int32)[order], self.boxes[chosen], self.scores[chosen], self.turns[chosen]
        )
