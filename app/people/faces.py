"""Every face of a segment of a video, tracked forward and backward from where it is found.

A detector runs on every frame with a low threshold: on the frame as it is, and turned by quarter turns (all three where
no upright face is certain, otherwise one of them in every third frame, in turn).  Where the faces that were seen lately
are large, small ones are searched in every third frame only.  Boxes that are certainly faces start a tracklet, which is
tracked from frame to frame and, from its first frame, back through the frames before; what else looks like a face is
kept as a bystander, and so are parts of faces at the picture's sides, searched in every third frame, and faces behind
bars or letters that are seen at a glance (`guise.aam.landmarks.glances`).  Pixels as shown, x right, y down; boxes
``x0 y0 x1 y1`` of the 68 iBUG points; frames RGB uint8; turns in radians, by which a face is rolled clockwise.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face, iou
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.detector import MIN_FACE_PIXELS, FaceDetector
from guise.aam.landmarks.glances import CYCLE, Glancer, is_face, is_surely_face, likeness_through
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import TURNED, UPRIGHT, RolledBoxes, detect_on_schedule, halved, turn_of
from guise.aam.landmarks.schemes import COUNT
from guise.aam.landmarks.sides import detect_at_sides
from guise.aam.landmarks.tracking import MultiFaceTracker, TrackingLimits
from guise.app.media import Frame
from guise.app.people.cuts import SMALL_SIZE, CutDetector
from guise.app.people.looks import Looks
from guise.common.arrays import F32, I32, U8


@dataclass(frozen=True)
class CandidateLimits:
    """Thresholds of what is tracked as a face and what is kept as a bystander's.

    Scores are the detector's, likenesses the landmarker's logits of how much a box looks like a face; a confirmed
    candidate needs no other sight of it.
    """

    smallest_pixels: float = 24  # of faces that are searched,
    longest_pixels: int = 1280  # the longer side of the picture in which they are
    min_score: float = 0.15  # of a box that supports a tracked face
    min_candidate_score: float = 0.2
    certain_score: float = 0.75  # from which an upright box is a face whatever it looks like
    min_likeness_certain: float = -3.0  # of one that needs no other sight
    high_score: float = 0.45  # from which an upright one needs little likeness:
    min_likeness_high_score: float = -1.0
    confirmed_likeness_high_score: float = 2.0  # from which a candidate is confirmed
    min_likeness_turned: float = 2.0  # with that score; ties and folds of clothes are found upside down
    min_likeness_small: float = 1.0  # below that score; smaller faces have lower scores
    min_likeness_large: float = 4.0
    confirmed_likeness: float = 6.0
    sure_likeness: float = 8.0  # from which it needs neither points nor skin
    small_face_pixels: int = 64
    side_interval_frames: int = 3  # from one search for parts of faces at the sides to the next
    min_likeness_at_side: float = 3.0
    confirmed_likeness_at_side: float = 5.0
    glance_interval_frames: int = 6  # from one glance to the next, beside a certain face
    support_frames: int = 24  # within which something unlikely needs a likely sight at its place
    sights: int = 2  # others that confirm a candidate,
    sight_frames: int = 6  # within so many frames
    sight_iou: float = 0.2  # and at its place
    min_tracklet_frames: int = 3
    searched_small_pixels: int = 72  # a face smaller than this
    searched_small_frames: int = 24  # keeps small ones searched in every frame for so many frames
    ear_reach_face_sizes: float = 0.2  # beside a face, where something small of a lower score than
    ear_score: float = 0.5  # this is its ear
    ear_face_sizes: float = 0.5  # and smaller than this
    worn_face_sizes: float = 0.4  # smaller than this, what lies on the body below an upright face
    body_face_sizes: tuple[float, float] = (0.6, 2.5)  # (half its width and how far below the face's middle)
    upright_radians: float = np.pi / 4
    wrong_roll_radians: float = 1.0  # from which a box on a tracked head is no face, unless it is certain and
    sure_confidence: float = 0.9  # what is tracked there is not


LIMITS = CandidateLimits()
TRACKING = TrackingLimits(
    min_confidence=0.15,
    min_start_confidence=0.5,
    min_match_iou=0.3,
    max_distinct_iou=0.5,
    max_missed_frames=12,
    max_undetected_frames=45,
    min_undetected_confidence=0.8,
)
LOOKBACK_BYTES = 64 << 20  # of frames that are kept for tracking backward
DETECTOR_THREADS = 2
DETECTED_AHEAD = 6  # frames, two of which take much longer than the others


@dataclass(frozen=True, eq=False)
class Candidate:
    """What may be a bystander's face: frame, box (4,), score, turn, and whether it needs no other sight of it.

    unlikely : whether nothing but detector and landmarker speaks for a face, and they only a little.
    """

    frame: int
    box: F32
    score: float
    confirmed: bool
    turn: float = 0.0
    unlikely: bool = False


@dataclass(frozen=True, eq=False)
class SegmentFaces:
    """The faces of a segment.

    Parameters
    ----------
    tracklet, frame, confidence, box, turn, points : (n,), (n,), (n,), (n, 4), (n,), (n, 81, 2), a row for each face
        and frame, by tracklet and then by frame; the points are NaN, and the confidence 0, where only a box was
        detected.
    bystander_frame, bystander_box, bystander_score, bystander_turn : (m,), (m, 4), (m,), (m,), by frame.
    cuts : frames with which a new shot begins.
    ends : (2, h, w) uint8, the first and the last frame, small.
    """

    tracklet: I32
    frame: I32
    confidence: F32
    box: F32
    turn: F32
    points: F32
    bystander_frame: I32
    bystander_box: F32
    bystander_score: F32
    bystander_turn: F32
    cuts: I32
    ends: U8

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The fields by name."""
        return dict(vars(self))


@dataclass(frozen=True, eq=False)
class DetectedFrame:
    """A frame after the detector: index, RGB, what was found, and the frame made small.

    at_sides : parts of faces at its sides.   glimpsed : what was seen at a glance.
    """

    index: int
    rgb: U8
    found: RolledBoxes
    small: U8
    at_sides: RolledBoxes = field(default_factory=RolledBoxes.none)
    glimpsed: RolledBoxes = field(default_factory=RolledBoxes.none)


def detect_boxes(frames: Iterable[Frame], has_small_faces: Callable[[], bool]) -> Iterator[DetectedFrame]:
    """Detect faces in all frames, a few at a time.

    has_small_faces : whether small ones were seen lately, see `detect_on_schedule`; asked before a frame, when all but
        the `DETECTED_AHEAD` frames before that have been taken.
    """

    detector, glancer = FaceDetector(MIN_FACE_PIXELS, min_score=LIMITS.min_score), Glancer()

    def work(frame: Frame, small_faces: bool) -> DetectedFrame:
        rgb = frame.quick_rgb()
        seen, factor = _seen(rgb)  # once for all searches
        found = detect_on_schedule(detector, seen, frame.index, LIMITS.certain_score, small=small_faces)
        small = cv2.resize(frame.luma, SMALL_SIZE, interpolation=cv2.INTER_AREA)
        at_sides = RolledBoxes.none()
        if frame.index % LIMITS.side_interval_frames == 0:
            fine = small_faces or not (found.scores >= LIMITS.certain_score).any()
            at_sides = detect_at_sides(detector, seen if fine else halved(seen)).scaled(1 if fine else 2)
        found, at_sides = found.scaled(1 / factor), at_sides.scaled(1 / factor)
        glimpsed = _glimpsed(glancer, rgb, frame.index, found)
        return DetectedFrame(frame.index, rgb, found, np.asarray(small, np.uint8), at_sides, glimpsed)

    with ThreadPoolExecutor(DETECTOR_THREADS) as pool:
        waiting: deque[Future[DetectedFrame]] = deque()
        for frame in frames:
            waiting.append(pool.submit(work, frame, has_small_faces()))
            if len(waiting) > DETECTED_AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _seen(rgb: U8) -> tuple[U8, float]:
    """A frame as the detector sees it, and how much smaller that is."""
    height, width = rgb.shape[:2]
    factor = min(1.0, MIN_FACE_PIXELS / LIMITS.smallest_pixels, LIMITS.longest_pixels / max(height, width))
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    if size == (width, height):
        return rgb, 1.0
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8), factor


def _glimpsed(glancer: Glancer, rgb: U8, index: int, found: RolledBoxes) -> RolledBoxes:
    """A glance at a frame, also at another roll; beside an upright face that is certain, at every sixth frame."""
    is_upright = np.abs(found.turns) <= LIMITS.upright_radians
    if not (found.scores[is_upright] >= LIMITS.certain_score).any():
        return glancer.faces(rgb, index, (*UPRIGHT, TURNED[index // CYCLE % len(TURNED)]))
    number, rest = divmod(index, LIMITS.glance_interval_frames)
    return RolledBoxes.none() if rest else glancer.faces(rgb, number)


class SegmentTracker:
    """Tracks all faces of a segment; `update` with each frame in order, then `faces`."""

    def __init__(self, landmarker: BuiltinLandmarker) -> None:
        self._looks = Looks(landmarker)
        self._tracker = MultiFaceTracker(
            self._looks, TRACKING, face_in_box=self._looks.face_in_box, lookback_bytes=LOOKBACK_BYTES
        )
        self._tracklets: dict[int, dict[int, Face]] = {}  # by number, the faces by frame
        self._candidates: list[Candidate] = []
        self._shot: list[int] = []  # frames since the last cut
        self._cuts: list[int] = []
        self._ends: list[U8] = []
        self._cut_detector = CutDetector()
        self._small_until = 0  # frame
        self._frames = 0

    def has_small_faces(self) -> bool:
        """Whether a small face was seen lately, or a shot has begun."""
        return len(self._shot) < LIMITS.searched_small_frames or self._shot[-1] < self._small_until

    def update(self, frame: DetectedFrame) -> None:
        """The next frame."""
        if self._cut_detector.update(frame.small):
            self._cuts.append(frame.index)
            self._tracker.restart()
            self._shot.clear()
        self._ends[1:] = [frame.small]
        self._frames += 1
        self._shot.append(frame.index)
        for number, face in self._tracker.update(frame.rgb, frame.found).items():
            self._tracklets[number][frame.index] = face
        self._search(frame)

    def present(self) -> dict[int, Face]:
        """The faces of the last frame by the numbers of their tracklets."""
        last = self._shot[-1] if self._shot else -1
        return {number: t[last] for number, t in self._tracklets.items() if last in t}

    def numbers(self) -> list[int]:
        """The numbers of the tracklets in the order of `faces`."""
        return [n for n, t in self._tracklets.items() if len(t) >= self._least]

    @property
    def _least(self) -> int:
        """Frames of a tracklet, at least; a photo has one."""
        return min(LIMITS.min_tracklet_frames, self._frames)

    def faces(self) -> SegmentFaces:
        """All of the segment so far."""
        tracklets = [self._tracklets[number] for number in self.numbers()]
        short = [t for t in self._tracklets.values() if len(t) < self._least]
        glimpsed = [
            Candidate(index, face.box, max(face.confidence, LIMITS.min_score), True, turn)
            for tracklet in short
            for (index, face), turn in zip(tracklet.items(), _turns(tracklet.values()), strict=True)
        ]
        tracklets = [dict(sorted(t.items())) for t in tracklets]
        rows = [(n, index, face) for n, t in enumerate(tracklets) for index, face in t.items()]
        turns = [turn for t in tracklets for turn in _turns(t.values())]
        bystanders = confirmed(sorted([*self._candidates, *glimpsed], key=lambda one: one.frame))
        first_last = (self._ends or [np.zeros(SMALL_SIZE[::-1], np.uint8)]) * 2
        return SegmentFaces(
            np.array([n for n, _, _ in rows], np.int32),
            np.array([index for _, index, _ in rows], np.int32),
            np.array([face.confidence for _, _, face in rows], np.float32),
            np.array([face.box for _, _, face in rows], np.float32).reshape(-1, 4),
            np.array(turns, np.float32),
            np.array([face.points for _, _, face in rows], np.float32).reshape(-1, COUNT, 2),
            np.array([one.frame for one in bystanders], np.int32),
            np.array([one.box for one in bystanders], np.float32).reshape(-1, 4),
            np.array([one.score for one in bystanders], np.float32),
            np.array([one.turn for one in bystanders], np.float32),
            np.array(self._cuts, np.int32),
            np.stack(first_last[:2]),
        )

    def _search(self, frame: DetectedFrame) -> None:
        """Start a tracklet at each box that is left and has a face, and keep the others that look like one."""
        found, candidates = frame.found, list[Candidate]()
        left = [i for i, box in enumerate(found.boxes) if not self._is_on_known(box)]
        for i in sorted(left, key=lambda i: -float(found.scores[i])):
            box, score, turn = found.boxes[i], float(found.scores[i]), float(found.turns[i])
            if score < LIMITS.min_candidate_score or self._is_on_known(box, score, turn):
                continue
            face, likeness = self._looks.look_in_box(frame.rgb, box, turn)
            if face is not None and face.confidence >= TRACKING.start_confidence:
                self._start(frame.index, face)
            elif (candidate := _candidate(frame.index, box, score, turn, likeness)) is not None:
                candidates.append(candidate)
        candidates += self._at_sides(frame)
        candidates += self._at_glance(frame, candidates)
        # Boxes at a wrong roll may come before the face's own.
        candidates = [one for one in candidates if not self._is_on_known(one.box, one.score, one.turn)]
        self._candidates += [self._judged(frame.rgb, one) for one in candidates]
        boxes = [*self._tracker.boxes, *(one.box for one in candidates)]
        if any(float((box[2:] - box[:2]).max()) < LIMITS.searched_small_pixels for box in boxes):
            self._small_until = frame.index + LIMITS.searched_small_frames

    def _judged(self, rgb: U8, one: Candidate) -> Candidate:
        """A candidate without points, with whether anything else speaks for it; skin does not on a body."""
        if one.score >= LIMITS.certain_score:
            return one
        face, likeness = self._looks.look_in_box(rgb, one.box, one.turn)
        is_likely = face is not None or likeness >= LIMITS.sure_likeness
        if not is_likely and not any(_is_worn(one.box, face) for face in self._tracker.faces):
            is_likely = self._looks.has_skin(rgb, one.box, one.turn)
        return replace(one, unlikely=not is_likely)

    def _at_sides(self, frame: DetectedFrame) -> Iterator[Candidate]:
        for box, score in zip(frame.at_sides.boxes, frame.at_sides.scores, strict=True):
            likeness = self._looks.likeness(frame.rgb, box, 0.0)
            if likeness >= LIMITS.min_likeness_at_side:
                yield Candidate(frame.index, box, float(score), likeness >= LIMITS.confirmed_likeness_at_side)

    def _at_glance(self, frame: DetectedFrame, others: Sequence[Candidate]) -> Iterator[Candidate]:
        """What was glimpsed beside other candidates; a tracklet is started where there are points."""
        glimpsed = frame.glimpsed
        for box, score, turn in zip(
            glimpsed.boxes, glimpsed.scores.tolist(), glimpsed.turns.tolist(), strict=True
        ):
            is_other = any(iou(box, one.box) > TRACKING.min_match_iou for one in others)
            if is_other or self._is_on_known(box, score, turn):
                continue
            likeness = likeness_through(self._looks, frame.rgb, box, turn)
            if not is_face(score, likeness):
                continue
            face = self._looks.face_in_box(frame.rgb, box, turn)
            if face is not None and face.confidence >= TRACKING.start_confidence:
                self._start(frame.index, face)
            else:
                yield Candidate(frame.index, box, score, is_surely_face(score, likeness), turn)

    def _is_on_known(self, box: F32, score: float = 1.0, turn: float = 0.0) -> bool:
        """Whether a box is that of a face that is tracked in this frame, or of something on its head."""
        return any(
            _belongs(box, face.box)
            or (score < LIMITS.ear_score and _is_ear(box, face.box))
            or (
                (score < LIMITS.certain_score or face.confidence >= LIMITS.sure_confidence)
                and _is_at_wrong_roll(box, turn, face)
            )
            for face in self._tracker.faces
        )

    def _start(self, index: int, face: Face) -> None:
        number = self._tracker.start(face)
        if number is None:
            return
        tracklet = self._tracklets[number] = {index: face}
        for before, earlier in zip(self._shot[-2::-1], self._tracker.look_back(face), strict=False):
            if self._is_known(before, earlier):
                return
            tracklet[before] = earlier

    def _is_known(self, index: int, face: Face) -> bool:
        known = (t[index].box for t in self._tracklets.values() if index in t)
        return any(iou(box, face.box) > TRACKING.min_match_iou for box in known)


def _candidate(index: int, box: F32, score: float, turn: float, likeness: float) -> Candidate | None:
    """A box without points as a candidate, if it is likely enough to be a face.   likeness : of its crop, a logit."""
    is_small = bool((box[2:] - box[:2] <= LIMITS.small_face_pixels).all())
    least = LIMITS.min_likeness_small if is_small else LIMITS.min_likeness_large
    confirmed = LIMITS.confirmed_likeness
    is_upright = abs(turn) <= LIMITS.upright_radians
    if score >= LIMITS.high_score and is_upright:
        least, confirmed = LIMITS.min_likeness_high_score, LIMITS.confirmed_likeness_high_score
    elif score >= LIMITS.high_score:
        least = LIMITS.min_likeness_turned
    if likeness < least and (score < LIMITS.certain_score or not is_upright):
        return None
    is_certain = score >= LIMITS.certain_score and likeness >= LIMITS.min_likeness_certain
    is_confirmed = is_certain or likeness >= confirmed
    return Candidate(index, box, score, is_confirmed, turn)


def _turns(faces: Iterable[Face]) -> list[float]:
    """Of faces in the order of time; where only a box was detected, that of the last one with points."""
    turns, last = [], 0.0
    for face in faces:
        last = turn_of(face.points) if np.isfinite(face.points).all() else last
        turns.append(last)
    return turns


def _belongs(box: F32, face: F32) -> bool:
    """Whether a box is that of a face, or a part of it, or a guess that holds it."""
    return iou(box, face) > TRACKING.min_match_iou or _holds_centre(face, box) or _holds_centre(box, face)


def _is_ear(box: F32, face: F32) -> bool:
    """Whether a small box lies on a tracked head."""
    size = face[2:] - face[:2]
    margin = LIMITS.ear_reach_face_sizes * size
    reach = np.concatenate([face[:2] - margin, face[2:] + margin])
    return _holds_centre(reach, box) and bool(((box[2:] - box[:2]) < LIMITS.ear_face_sizes * size).all())


def _is_worn(box: F32, face: Face) -> bool:
    """Whether a box is that of something worn by somebody whose face is upright."""
    is_upright = np.isfinite(face.points).all() and abs(turn_of(face.points)) < LIMITS.upright_radians
    return bool(is_upright and face.confidence >= LIMITS.sure_confidence) and is_worn_below(box, face.box)


def is_worn_below(box: F32, face: F32) -> bool:
    """Whether a box (4,) lies on the body below an upright face (4,), too small for a face before it: ties, badges."""
    size, away = face[2:] - face[:2], (box[:2] + box[2:] - face[:2] - face[2:]) / 2
    half, below = LIMITS.body_face_sizes * size
    is_below = abs(away[0]) < half and size[1] / 2 < away[1] < below
    return bool(is_below and ((box[2:] - box[:2]) < LIMITS.worn_face_sizes * size).all())


def _is_at_wrong_roll(box: F32, turn: float, face: Face) -> bool:
    """Whether a box lies on a tracked head, hair included, that is rolled differently."""
    if not np.isfinite(face.points).all():
        return False
    own = turn_of(face.points)
    head = region(face.box, turn=own).astype(np.float32)
    return abs(np.angle(np.exp(1j * (turn - own)))) > LIMITS.wrong_roll_radians and _holds_centre(head, box)


def _holds_centre(box: F32, other: F32) -> bool:
    centre = (other[:2] + other[2:]) / 2
    return bool((centre > box[:2]).all() and (centre < box[2:]).all())


def confirmed(candidates: list[Candidate]) -> list[Candidate]:
    """Of candidates by frame the confirmed ones, and those of which there are others nearby and soon.

    What is unlikely needs a sight of the same that is not.
    """
    likely = [one for one in candidates if not one.unlikely]
    frames = [one.frame for one in likely]

    def is_supported(one: Candidate) -> bool:
        low, high = (
            bisect_left(frames, one.frame + d) for d in (-LIMITS.support_frames, LIMITS.support_frames + 1)
        )
        return not one.unlikely or any(iou(o.box, one.box) > LIMITS.sight_iou for o in likely[low:high])

    candidates, kept = [one for one in candidates if is_supported(one)], []
    for n, one in enumerate(candidates):
        around = candidates[max(0, n - 200) : n + 200]
        near = (other for other in around if 0 < abs(other.frame - one.frame) <= LIMITS.sight_frames)
        if one.confirmed or sum(iou(o.box, one.box) > LIMITS.sight_iou for o in near) >= LIMITS.sights:
            kept.append(one)
    return kept


def detect_faces(frames: Iterable[Frame]) -> SegmentFaces:
    """All faces of consecutive frames."""
    tracker = SegmentTracker(BuiltinLandmarker())
    for frame in detect_boxes(frames, tracker.has_small_faces):
        tracker.update(frame)
    return tracker.faces()
