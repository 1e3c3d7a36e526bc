"""The first stage: every face of a segment, followed forward and backward from where it is found.

A detector looks at every frame at a low threshold.  Boxes that are surely faces start a tracklet, which a landmarker
follows from frame to frame and, from its first frame, back through the frames before; what else looks like a face is
kept as a bystander.  Pixels as shown, x right, y down; boxes ``x0 y0 x1 y1`` of the 68 iBUG points; frames RGB uint8.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face, overlap
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.plausible import followed
from guise.aam.landmarks.schemes import COUNT, IBUG68
from guise.app.media import Frame
from guise.common.arrays import F32

Picture = NDArray[np.uint8]

LOWEST = 0.15  # score of a box from which it supports a face that is followed
POSSIBLE = 0.2  # score from which a box may be a bystander's face
SURE = 0.75  # score from which it is one whatever it looks like
SMALL_FACE = 64  # pixels, up to which scores are lower
LIKELY = 0.4  # score from which it needs little likeness
LIKE = -1.0  # that likeness
VERY_LIKE = {True: 1.0, False: 3.0}  # and what a small, or a large, one needs below
CLEAR = 3.0  # likeness beyond these from which it need not be seen again, twice
AGAIN = 6  # frames within which it must be seen again
START = 0.5  # confidence of the points from which a face is followed
FOLLOW = 0.15  # confidence from which it still is
SAME = 0.3  # overlap of a followed face with the box of its own
TWICE = 0.5  # overlap from which two tracklets have come to one face
PATIENCE = 12  # frames without a sign of it after which a face is given up
ALONE = 45  # frames without a box after which a face that is not sure is given up
LOOKBACK = 64 << 20  # bytes of frames that are kept for following backward
CUT = 0.6  # correlation of small pictures below which a new shot begins
EAR, EAR_SCORE = 0.2, 0.5  # sizes of a face beside which a low score on something small is its ear
THREADS = 2
SMALL = (32, 18)  # pixels of the small picture


@dataclass(frozen=True, eq=False)
class Row:
    """A face in a frame: points (81, 2), NaN where only a box was seen; confidence of the points; box (4,)."""

    points: F32
    confidence: float
    box: F32


@dataclass(frozen=True, eq=False)
class Glimpse:
    """What may be a bystander's face: frame, box (4,), score of the detector, and whether it needs no second look."""

    index: int
    box: F32
    score: float
    clear: bool


@dataclass(eq=False)
class Tracklet:
    """A face through some frames of a segment."""

    rows: dict[int, Row] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Found:
    """What a segment holds.

    Parameters
    ----------
    tracklet, frame, confidence, box, points : (n,), (n,), (n,), (n, 4), (n, 81, 2), a row for each face and frame,
        by tracklet and then by frame.
    bystander_frame, bystander_box, bystander_score : (m,), (m, 4), (m,), by frame.
    cuts : frames with which a new shot begins.
    ends : (2, h, w) uint8, the first and the last frame, small.
    """

    tracklet: NDArray[np.int32]
    frame: NDArray[np.int32]
    confidence: F32
    box: F32
    points: F32
    bystander_frame: NDArray[np.int32]
    bystander_box: F32
    bystander_score: F32
    cuts: NDArray[np.int32]
    ends: NDArray[np.uint8]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The fields by name."""
        return dict(vars(self))


@dataclass(frozen=True, eq=False)
class Seen:
    """A frame after the detector: index, RGB, boxes (n, 4) with scores (n,), and the frame made small."""

    index: int
    rgb: Picture
    boxes: F32
    scores: F32
    small: Picture


def look(frames: Iterable[Frame], detector: FaceDetector, threads: int = THREADS) -> Iterator[Seen]:
    """Detect faces in all frames, a few at a time."""

    def work(frame: Frame) -> Seen:
        rgb = frame.quick_rgb()
        boxes, scores = detector.detect_scored(rgb)
        small = cv2.resize(frame.luma, SMALL, interpolation=cv2.INTER_AREA)
        return Seen(frame.index, rgb, boxes, scores, np.asarray(small, np.uint8))

    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Seen]] = deque()
        for frame in frames:
            waiting.append(pool.submit(work, frame))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def is_cut(before: Picture, after: Picture) -> bool:
    """Whether a new shot begins between two small pictures: their correlation is low and the change large."""
    a, b = before.astype(np.float64).ravel(), after.astype(np.float64).ravel()
    if np.abs(a - b).mean() < 8:
        return False
    a, b = a - a.mean(), b - b.mean()
    return bool(a @ b < CUT * np.sqrt((a @ a) * (b @ b)) + 1e-9)


class Chaser:
    """Follows all faces; `step` for each frame in order, then `found`."""

    def __init__(self, landmarker: BuiltinLandmarker) -> None:
        self._landmarker = landmarker
        self._live: list[_Live] = []
        self._tracklets: list[Tracklet] = []
        self._bystanders: list[Glimpse] = []
        self._recent: deque[Seen] = deque()
        self._cuts: list[int] = []
        self._first: Picture | None = None

    def step(self, seen: Seen) -> None:
        """The next frame."""
        if self._first is None:
            self._first = seen.small
        if self._recent and is_cut(self._recent[-1].small, seen.small):
            self._cuts.append(seen.index)
            self._live.clear()
            self._recent.clear()
        self._remember(seen)
        taken = self._follow(seen)
        self._search(seen, taken)

    def found(self) -> Found:
        """All of it."""
        tracklets = [t for t in self._tracklets if self._holds(t)]
        rows = [(n, index, t.rows[index]) for n, t in enumerate(tracklets) for index in sorted(t.rows)]
        wide = _seen_again(sorted(self._bystanders, key=lambda b: b.index))
        small = np.zeros(SMALL[::-1], np.uint8)
        last = self._recent[-1].small if self._recent else small
        return Found(
            np.array([n for n, _, _ in rows], np.int32),
            np.array([index for _, index, _ in rows], np.int32),
            np.array([row.confidence for _, _, row in rows], np.float32),
            np.array([row.box for _, _, row in rows], np.float32).reshape(-1, 4),
            np.array([row.points for _, _, row in rows], np.float32).reshape(-1, COUNT, 2),
            np.array([b.index for b in wide], np.int32),
            np.array([b.box for b in wide], np.float32).reshape(-1, 4),
            np.array([b.score for b in wide], np.float32),
            np.array(self._cuts, np.int32),
            np.stack([small if self._first is None else self._first, last]),
        )

    # -- following ----------------------------------------------------------------------------------------

    def _follow(self, seen: Seen) -> set[int]:
        """Take every live face to this frame; returns the boxes that belong to them."""
        for live in self._live:
            live.move(self._landmarker, seen)
        self._part()
        for live in self._live:
            if live.row is not None:
                live.tracklet.rows[seen.index] = live.row
        self._live = [live for live in self._live if not live.over]
        places = [live.row.box for live in self._live if live.row is not None]
        return {i for i, box in enumerate(seen.boxes) if any(_belongs(box, place) for place in places)}

    def _part(self) -> None:
        """Of two faces that have come to one place, the one that moved less stays."""
        for live in sorted(self._live, key=lambda one: -one.kept):
            if live.row is None:
                continue
            rivals = [o for o in self._live if o is not live and o.row is not None and o.kept >= live.kept]
            if any(overlap(live.row.box, o.row.box) > TWICE for o in rivals if o.row is not None):
                live.row, live.over = None, True

    def _search(self, seen: Seen, taken: set[int]) -> None:
        """Start a tracklet at each box that is left and has a face, and keep the others that look like one."""
        for i in sorted(set(range(len(seen.boxes))) - taken, key=lambda i: -float(seen.scores[i])):
            box, score = seen.boxes[i], float(seen.scores[i])
            if score < POSSIBLE or any(l.row and _belongs(box, l.row.box) for l in self._live):
                continue
            if score < EAR_SCORE and any(l.row and _is_part(box, l.row.box) for l in self._live):
                continue
            face = self._landmarker.points_in_box(seen.rgb, box)
            if face is not None and face.confidence >= START:
                self._start(seen, face)
                continue
            small = bool((box[2:] - box[:2] <= SMALL_FACE).all())
            like = self._landmarker.likeness(seen.rgb, box) - (LIKE if score >= LIKELY else VERY_LIKE[small])
            if score >= SURE or like >= 0:
                self._bystanders.append(Glimpse(seen.index, box, score, score >= SURE or like >= CLEAR))

    def _start(self, seen: Seen, face: Face) -> None:
        row = _row(face)
        if any(l.row and overlap(row.box, l.row.box) > SAME for l in self._live):
            return
        tracklet = Tracklet({seen.index: row})
        self._tracklets.append(tracklet)
        self._live.append(_Live(tracklet, face, row))
        for earlier in list(self._recent)[-2::-1]:
            face_before = _refined(self._landmarker, earlier.rgb, face)
            if face_before is None or self._known(earlier.index, face_before):
                return
            face = face_before
            tracklet.rows[earlier.index] = _row(face)

    def _known(self, index: int, face: Face) -> bool:
        box = _row(face).box
        rows = (t.rows.get(index) for t in self._tracklets)
        return any(row is not None and overlap(row.box, box) > SAME for row in rows)

    def _holds(self, tracklet: Tracklet) -> bool:
        """Whether a tracklet is more than a glimpse, which is kept as a bystander instead."""
        if len(tracklet.rows) >= 3:
            return True
        self._bystanders += [
            Glimpse(i, row.box, max(row.confidence, LOWEST), True) for i, row in tracklet.rows.items()
        ]
        return False

    def _remember(self, seen: Seen) -> None:
        self._recent.append(seen)
        while len(self._recent) > 2 and sum(s.rgb.nbytes for s in self._recent) > LOOKBACK:
            self._recent.popleft()


class _Live:
    """A face that is being followed.

    row : what was seen of it in this frame, or None.   kept : overlap of its box with the one before.
    over : it is given up.
    """

    def __init__(self, tracklet: Tracklet, face: Face, row: Row) -> None:
        self.tracklet = tracklet
        self.kept, self.over = 1.0, False
        self._face, self._box = face, row.box
        self._missing = self._alone = 0
        self.row: Row | None = row

    def move(self, landmarker: BuiltinLandmarker, seen: Seen) -> None:
        """Find the face in the next frame."""
        near = _nearest(self._box, seen.boxes)
        face = _refined(landmarker, seen.rgb, self._face)
        if face is None and near is not None:
            again = landmarker.points_in_box(seen.rgb, seen.boxes[near])
            face = again if again is not None and again.confidence >= FOLLOW else None
        row = _row(face) if face is not None else None
        if row is None and near is not None:
            row = Row(np.full((COUNT, 2), np.nan, np.float32), 0.0, seen.boxes[near])
        self._alone = 0 if near is not None else self._alone + 1
        self._missing = 0 if row is not None else self._missing + 1
        self.over = self._missing > PATIENCE or (
            self._alone > ALONE and (face is None or face.confidence < 0.8)
        )
        self.kept = 0.0 if row is None else overlap(row.box, self._box)
        self.row, self._face = row, face or self._face
        self._box = self._box if row is None else row.box


def _refined(landmarker: BuiltinLandmarker, rgb: Picture, previous: Face) -> Face | None:
    face = landmarker.refine(rgb, previous)
    if face is None or face.confidence < FOLLOW or not followed(previous.points, face.points):
        return None
    return face


def _row(face: Face) -> Row:
    inner = face.points[IBUG68]
    return Row(face.points, face.confidence, np.concatenate([inner.min(0), inner.max(0)]).astype(np.float32))


def _nearest(box: F32, boxes: F32) -> int | None:
    """The box that overlaps most with a face's, if any does enough."""
    shares = [overlap(box, other) for other in boxes]
    best = int(np.argmax(shares)) if shares else -1
    return best if best >= 0 and shares[best] > SAME else None


def _belongs(box: F32, face: F32) -> bool:
    """Whether a box is that of a face, or a part of it, or a guess that holds it."""
    return overlap(box, face) > SAME or _holds_centre(face, box) or _holds_centre(box, face)


def _is_part(box: F32, face: F32) -> bool:
    """Whether a small box lies on a followed head: an ear."""
    size = face[2:] - face[:2]
    reach = np.concatenate([face[:2] - EAR * size, face[2:] + EAR * size])
    return _holds_centre(reach, box) and bool(((box[2:] - box[:2]) < 0.5 * size).all())


def _holds_centre(box: F32, other: F32) -> bool:
    centre = (other[:2] + other[2:]) / 2
    return bool((centre > box[:2]).all() and (centre < box[2:]).all())


def _seen_again(glimpses: list[Glimpse]) -> list[Glimpse]:
    """The clear ones, and the others that are seen again twice, near by and soon."""
    kept = []
    for n, one in enumerate(glimpses):
        around = glimpses[max(0, n - 200) : n + 200]
        near = (o for o in around if 0 < abs(o.index - one.index) <= AGAIN)
        if one.clear or sum(overlap(o.box, one.box) > 0.2 for o in near) >= 2:
            kept.append(one)
    return kept


def detect_faces(frames: Iterable[Frame]) -> Found:
    """All faces of consecutive frames."""
    chaser = Chaser(BuiltinLandmarker())
    for seen in look(frames, FaceDetector(min_score=LOWEST)):
        chaser.step(seen)
    return chaser.found()
