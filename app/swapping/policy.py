"""The one policy for faces that are not surely seen: when a face is swapped, held, covered or left, and for how long.

It fails closed: in doubt a face is covered.  The rules are the same in files, in de-identification and live, and all
are in seconds, so that they do not depend on the frame rate.

- A face is swapped where its confidence is at least `min_confidence` and was so for `near_seconds`.  Where the future
  is known, which is everywhere but at a camera, it must be so for as long afterwards, too, and a swap of less than
  `min_swap_seconds` is a cover instead.  A single person in a file is swapped wherever they are tracked: the user has
  said that it is they, and the future is not known, as frames are drawn as they are tracked.
- Otherwise it is covered.  Only for a single person in a file the last face is first held for `bridge_seconds`; what
  follows is covered, unless the user asked to hold it for `hold_seconds`, or to leave it.  `guise.Swapper` covers
  nothing: its caller is told what was lost.
- A cover hides the head about the face's box and about those of the last `near_seconds` (of the next, too, where they
  are known), as boxes jitter where a hand hides.  As a head turns too far for a swap, the cover comes in over it.
- Where the face is not seen, the region lies where it was seen last, or on the line between two sights, and grows by
  `growth_per_second` from the nearest sight on, for `unseen_seconds`.
- What ends it: another sight, a cut, or `unseen_seconds` without a sight.  Then a followed face has left: in a file,
  of which every frame is searched, nothing is covered any more; at a camera, whose search lags behind, the whole
  picture is, until somebody who is known is found.  Where the future is known, as much is covered before a first sight.
- A face that nobody follows, such as a bystander's, is covered where it is detected and for `unseen_seconds` after it
  (before it, too, where the future is known); one that rests is covered where it was detected last.  Where one that is
  followed from then on, or was until then, is at its place, it was that one, which has its own cover.
- What an audit of the result finds is covered for `near_seconds` before and after it.

Boxes ``x0 y0 x1 y1`` of the 68 iBUG points, pixels as shown, x right, y down; turns in radians, clockwise.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import iou
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import RolledBoxes, turn_of
from guise.aam.landmarks.schemes import IBUG68
from guise.common.arrays import F32, F64, I32, Bool, Floating
from guise.common.tuned import derived, tuned

Action = Literal["swap", "cover", "leave"]
Done = Literal["swapped", "covered", "left"]
# What a user wants of a frame in which a face is lost but may be visible.
Unsure = Literal["cover", "hold", "leave"]
ACTIONS: tuple[Action, ...] = ("swap", "cover", "leave")
DONE: tuple[Done, ...] = ("swapped", "covered", "left")
SWAPPED, COVERED, LEFT = (DONE.index(done) for done in ("swapped", "covered", "left"))
NOBODY = 0  # of whom a face is that is not followed


@dataclass(frozen=True)
class PolicyLimits:
    """Thresholds of the policy; sizes of faces are shares, all times are seconds."""

    # From which a face is swapped.
    min_confidence: float = derived(0.5, "confidence", "as likely right as wrong")
    # What is so near in time to a frame counts there, too: doubt, places of a covered face, what an audit finds.
    near_seconds: float = tuned(0.12, "seconds", "deidentify.leaks")
    # Of doubt, after which a tracked face is taken to be somebody else's.
    lose_seconds: float = tuned(0.2, "seconds", "live.closed")
    min_swap_seconds: float = tuned(0.3, "seconds", "deidentify.leaks")
    # Of a track's frames that must be fit to swap; otherwise all of it is covered.
    min_swap_share: float = tuned(0.05, "share", "deidentify.leaks")
    # For which a lost face is held in any case, so that no cover flashes up, and where the user asked for it.
    bridge_seconds: float = tuned(0.16, "seconds", "unswapped")
    hold_seconds: float = derived(1.0, "seconds", "what --unsure hold promises")
    # Between two sights of somebody who was there meanwhile.
    max_gap_seconds: float = tuned(1.5, "seconds", "people.several")
    # For which a face stays covered although it is not seen, and how fast the region grows meanwhile, relatively.
    unseen_seconds: float = tuned(0.6, "seconds", "live.closed")
    growth_per_second: float = tuned(2.0, "1/second", "live.closed")
    # Of covers beside heads that are replaced, so that they hide hair and outline as well.
    head_growth: float = tuned(1.35, "ratio", "deidentify.leaks")
    # Of a detected box: where a lost person was, before they were seen at all, and upright, beside which not all rolls
    # are searched in each frame.
    min_box_score: float = tuned(0.15, "score", "unswapped")
    min_first_score: float = tuned(0.5, "score", "unswapped")
    sure_score: float = tuned(0.75, "score", "unswapped")
    # Of two boxes: a detected one that is a sight of a lost face, of one face, and of a face that rests.
    min_lost_iou: float = tuned(0.15, "share", "unswapped")
    min_same_iou: float = tuned(0.2, "share", "live.closed")
    min_unmoved_iou: float = tuned(0.7, "share", "live.closed")


LIMITS = PolicyLimits()
_ROUNDING = derived(1e-6, "seconds or frames", "far less than a frame, far more than rounding")


def growth(unseen: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """How much larger a covered region is, `unseen` seconds from the nearest sight of its face.

    >>> growth(0.1).item(), growth(9.0).item()
    (1.2, 2.2)
    """
    return 1 + LIMITS.growth_per_second * np.clip(unseen, 0, LIMITS.unseen_seconds)


def frames_within(seconds: float, rate: float) -> int:
    """How many frames after one lie within some seconds of it.   rate : frames a second.

    >>> frames_within(0.1, 25), frames_within(0.1, 60)
    (2, 6)
    """
    return int(seconds * rate + _ROUNDING)


@dataclass(frozen=True, eq=False)
class FacePlace:
    """Where a face is: the box (4,) of its 68 points, and the turn by which it is rolled."""

    box: F64
    turn: float

    @classmethod
    def of(cls, shape: F64) -> FacePlace:
        """The place of a face with landmarks (81, 2)."""
        inner = shape[IBUG68]
        return cls(np.concatenate([inner.min(0), inner.max(0)]), turn_of(shape))

    @classmethod
    def detected(cls, found: RolledBoxes) -> list[FacePlace]:
        """The places of detected faces."""
        pairs = zip(found.boxes.astype(np.float64), found.turns.tolist(), strict=True)
        return [cls(box, turn) for box, turn in pairs]

    def region(self, growth: float = 1.0) -> F64:
        """The rectangle (4,) that covers it."""
        return region(self.box, growth, self.turn)

    def overlap(self, other: FacePlace) -> float:
        """The intersection over union of two boxes."""
        return float(iou(self.box, other.box.astype(np.float32)))


@dataclass(frozen=True, eq=False)
class FaceTreatment:
    """What is to be done with a face in a frame.

    Parameters
    ----------
    who : whose it is, or NOBODY.
    done : index into DONE.
    box, turn : (4,) and radians, of the face.   growth : of its cover.
    otherwise : COVERED or LEFT, what is done where a swap is not possible after all.
    confidence : of the fit, or of the detector.
    reason, cover : why it is covered, and the number of the cover, see `guise.app.deidentify.covers`; 0 for none.
    """

    who: int
    done: int
    box: F32
    growth: float
    turn: float = 0.0
    otherwise: int = COVERED
    confidence: float = 0.0
    reason: int = 0
    cover: int = 0

    @property
    def region(self) -> F64:
        """The rectangle (4,) that is covered, if the face is."""
        return region(self.box, self.growth, self.turn)


class FollowedFace:
    """A person's face as far as it has been seen: whether it may be swapped, and what must be covered otherwise.

    Times are those of the frames, in seconds and in order.
    """

    def __init__(self) -> None:
        self._sights: list[tuple[float, FacePlace]] = []  # of the last `near_seconds` before the last one
        self._doubted = -np.inf

    @property
    def was_seen(self) -> bool:
        """Whether the face has been seen at all."""
        return bool(self._sights)

    def is_trusted(self, now: float, confidence: float) -> bool:
        """Whether the face may be swapped in a frame, given the confidence there."""
        if confidence < LIMITS.min_confidence:
            self._doubted = now
        return now - self._doubted > LIMITS.near_seconds + _ROUNDING

    def see(self, now: float, place: FacePlace) -> None:
        """The face is at a place."""
        recent = [one for one in self._sights if now - one[0] <= LIMITS.near_seconds + _ROUNDING]
        self._sights = [*recent, (now, place)]

    def look_for(self, now: float, found: Sequence[FacePlace]) -> None:
        """See the face, which is lost, in the one of the detected places that is nearest to where it was."""
        if self._sights and found:
            last = self._sights[-1][1]
            best = max(found, key=last.overlap)
            if last.overlap(best) > LIMITS.min_lost_iou:
                self.see(now, best)

    def has_left(self, now: float) -> bool:
        """Whether it is no longer known where the face is."""
        return not self._sights or now - self._sights[-1][0] > LIMITS.unseen_seconds + _ROUNDING

    def region(self, now: float, found: Sequence[FacePlace] = ()) -> F64 | None:
        """The rectangle (4,) to cover, with what is detected on the face as a fit may lag; None if it has left."""
        if self.has_left(now):
            return None
        larger = float(growth(now - self._sights[-1][0]))
        places = [place for _, place in self._sights] + [one for one in found if self.holds(now, one)]
        regions = np.array([place.region(larger) for place in places])
        return np.concatenate([regions[:, :2].min(0), regions[:, 2:].max(0)])

    def holds(self, now: float, place: FacePlace) -> bool:
        """Whether a detected place lies on the face."""
        if self.has_left(now):
            return False
        own, centre = self._sights[-1][1], (place.box[:2] + place.box[2:]) / 2
        inside = bool((centre > own.box[:2]).all() and (centre < own.box[2:]).all())
        return inside or own.overlap(place) > LIMITS.min_same_iou


class UnfollowedFaces:
    """Faces that are covered without being followed, as far as they have been seen; times as in `FollowedFace`."""

    def __init__(self) -> None:
        self._sights: list[tuple[float, FacePlace]] = []

    def see(self, now: float, found: Sequence[FacePlace]) -> list[F64]:
        """The rectangles to cover in a frame, given what is detected there."""
        kept = [
            (at, place)
            for at, place in self._sights
            if now - at <= LIMITS.unseen_seconds + _ROUNDING
            and not any(place.overlap(one) > LIMITS.min_unmoved_iou for one in found)
        ]
        self._sights = kept + [(now, place) for place in found]
        return [place.region() for _, place in self._sights]


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
    margin = max(1, frames_within(LIMITS.unseen_seconds, rate))
    start = max([0, first - margin, *(c for c in cuts if c <= first)])
    stop = min([total, last + margin + 1, *(c for c in cuts if c > last)])
    frames = np.arange(start, stop, dtype=np.int32)
    boxes = np.stack([np.interp(frames, rows.frames, rows.boxes[:, k]) for k in range(4)], axis=1)
    turns = np.interp(frames, rows.frames, np.unwrap(rows.turns))
    seen = np.isin(frames, rows.frames)
    confidence = np.zeros(len(frames), np.float32)
    confidence[seen] = rows.trust
    done = _done(confidence, action, rate)
    boxes = np.where(
        (done == COVERED)[:, None], enclosing(boxes, frames_within(LIMITS.near_seconds, rate)), boxes
    )
    larger = growth(_distance(frames, rows.frames) / rate)
    return Decision(
        frames, done, boxes.astype(np.float32), turns.astype(np.float32), larger.astype(np.float32), confidence
    )  # fmt: skip


def enclosing(boxes: Floating, reach: int) -> Floating:
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
    swapped = eroded(confidence >= LIMITS.min_confidence, frames_within(LIMITS.near_seconds, rate))
    swapped = without_short(swapped, int(np.ceil(LIMITS.min_swap_seconds * rate - _ROUNDING)))
    return np.where(swapped, SWAPPED, COVERED).astype(np.uint8)


def eroded(trusted: Bool, count: int) -> Bool:
    """Without the `count` elements next to a false one.

    >>> eroded(np.array([1, 1, 1, 0, 1, 1], bool), 1).astype(int).tolist()
    [1, 1, 0, 0, 0, 1]
    """
    near = np.convolve(~trusted, np.ones(2 * count + 1), "same") > 0.5
    return (
        np.asarray(trusted & ~near[: len(trusted)]) if len(trusted) > 2 * count else trusted & trusted.all()
    )


def without_short(flags: Bool, min_length: int) -> Bool:
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


def _distance(frames: NDArray[np.int32], known: NDArray[np.int32]) -> NDArray[np.int32]:
    """Frames from each to the nearest one in which the face was seen."""
    after = np.searchsorted(known, frames)
    before = np.clip(after - 1, 0, len(known) - 1)
    behind, ahead = frames - known[before], known[np.clip(after, 0, len(known) - 1)] - frames
    return np.asarray(np.minimum(np.abs(behind), np.abs(ahead)), np.int32)


def boxes_by_frame(rows: Iterable[tuple[I32, F32]]) -> dict[int, list[F32]]:
    """By frame, the boxes (4,) of rows of frames (n,) and boxes (n, 4)."""
    found = defaultdict[int, list[F32]](list)
    for frames, boxes in rows:
        for frame, box in zip(frames.tolist(), boxes, strict=True):
            found[frame].append(box)
    return dict(found)


@dataclass(frozen=True, eq=False)
class Bystanders:
    """Faces that are covered without being tracked: (n,) frames, ascending; (n, 4) boxes; (n,) scores; (n,) turns.

    followed : by frame, the boxes (4,) of the faces that are tracked, see `boxes_by_frame`.
    """

    frames: NDArray[np.int32]
    boxes: F32
    scores: F32
    turns: F32
    followed: Mapping[int, Sequence[F32]] = field(default_factory=dict)

    def spread(self, *, total: int, rate: float, cuts: Sequence[int]) -> Bystanders:
        """With the frames about each detection, as far as the shot goes; a frame may get the boxes of several."""
        frames, chosen = self.around(total=total, rate=rate, cuts=cuts)
        return Bystanders(frames, self.boxes[chosen], self.scores[chosen], self.turns[chosen])

    def around(self, *, total: int, rate: float, cuts: Sequence[int]) -> tuple[I32, NDArray[np.intp]]:
        """The frames (m,), ascending, about the detections, and of which detection each is."""
        frames, rows = [], []
        edges = np.array([0, *cuts, total])
        for row, frame in enumerate(map(int, self.frames)):
            shot = int(np.searchsorted(edges, frame, side="right"))
            low, high = (
                max(frame - self._reach(row, -1, rate), edges[shot - 1]),
                frame + self._reach(row, 1, rate),
            )
            for at in range(int(low), int(min(high + 1, edges[shot]))):
                frames.append(at)
                rows.append(row)
        order = np.argsort(np.array(frames, np.int64), kind="stable")
        return np.array(frames, np.int32)[order], np.array(rows, np.intp)[order]

    def _reach(self, row: int, step: int, rate: float) -> int:
        """For how many frames after (step 1) or before (-1) a detection it is covered: up to the next at its place."""
        near = frames_within(LIMITS.near_seconds, rate)
        if any(self._is_followed(row, step * away) for away in range(1, near + 1)) and not self._is_followed(
            row, 0
        ):
            return near
        most, at = max(1, frames_within(LIMITS.unseen_seconds, rate)), row + step
        while 0 <= at < len(self.frames) and (away := abs(int(self.frames[at] - self.frames[row]))) <= most:
            if away and iou(self.boxes[at], self.boxes[row]) > LIMITS.min_unmoved_iou:
                return max(away - 1, near)
            at += step
        return most

    def _is_followed(self, row: int, later: int) -> bool:
        """Whether a tracked face is at the place of a detection so many frames later."""
        boxes = self.followed.get(int(self.frames[row]) + later, ())
        return any(iou(box, self.boxes[row]) > LIMITS.min_same_iou for box in boxes)
