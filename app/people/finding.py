"""Who is in a video: its faces tracked, and told apart by what they look like.

A track alone doesn't say who it follows: where two heads cross it may go on with the other one.  So its frames are
taken in short pieces that no other face comes near, each piece has a signature (`guise.aam.recognition`), and pieces
that are alike are of one person, whatever the track.  Nothing else speaks for that over a cut, so people of two shots
must be as alike as two enrolments of one person.  Faces that are seen at once are of different people.  What is too
short or too unlike anybody stays unknown.

Pixels as shown, x right, y down; boxes ``x0 y0 x1 y1`` of the 68 iBUG points; frames counted from 0.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.plausible import is_plausible_motion
from guise.aam.recognition import (
    MIN_SAME_PERSON_SIMILARITY,
    SIGNATURE_RESOLUTION,
    cosine_similarity,
    signature_of,
)
from guise.aam.reference import ReferenceFrame
from guise.app.media import Frame, MediaInput
from guise.app.media.pictures import labelled, sheet
from guise.app.people.cuts import SMALL_SIZE, CutDetector
from guise.app.people.faces import SegmentFaces, SegmentTracker, detect_boxes
from guise.app.people.found import (
    THUMBNAIL_PIXELS,
    UnknownFaces,
    VideoPeople,
    VideoPerson,
    head_picture,
    people_in_photo,
)
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.threads import one_thread

# Measured on pieces of 20 frames of 41 clips: 97 of 100 pairs of one clip are more alike than this, and of the
# pairs of different people none.
MIN_ALIKE = 0.68  # cosine of signatures, from which two pieces of a shot are of one person
MAX_UNLIKE = 0.50  # below which a piece is of somebody else than the rest of its track
SHEET_COLUMNS = 6  # of people in a row


@dataclass(frozen=True)
class PieceLimits:
    """How tracks are cut into pieces, and what makes a person."""

    frames: int = 20  # of a piece, at most
    min_confidence: float = 0.6  # of points from which the texture is taken
    min_sure_frames: int = 8  # of a piece that may begin a new person
    min_person_frames: int = 12  # of a person; fewer are nobody's
    near_head_boxes: float = 0.75  # of two heads' rectangles, shrunk by this; where they meet, tracks may mix


LIMITS = PieceLimits()


@dataclass(eq=False)
class Piece:
    """A part of a track.

    Parameters
    ----------
    track : number.   frames : in which it was seen, ascending.   crossing : whether another face is near.
    texture : (t, 3) sum over `count` frames.
    person : index of the person, or -1.
    """

    track: int
    crossing: bool
    frames: list[int] = field(default_factory=list)
    texture: F32 | None = None
    count: int = 0
    person: int = -1

    def add(self, frame: int, texture: F32 | None) -> None:
        """Another frame, with its texture if the points are sure."""
        self.frames.append(frame)
        if texture is not None:
            self.texture = texture if self.texture is None else self.texture + texture
            self.count += 1

    @property
    def signature(self) -> F32 | None:
        """(64,) of its mean texture."""
        return None if self.texture is None else signature_of(self.texture / np.float32(self.count))


class PieceCollector:
    """Cuts tracks into pieces while they are followed."""

    def __init__(self) -> None:
        self.pieces: list[Piece] = []
        self._current: dict[int, Piece] = {}
        self._sampler = ReferenceFrame.canonical(SIGNATURE_RESOLUTION).sampler

    def add(
        self, frame: Frame, track: int, points: NDArray[np.floating], confidence: float, near: bool
    ) -> None:
        """A face (81, 2) of the frame; NaN points where only its box is known."""
        sure = confidence >= LIMITS.min_confidence and bool(np.isfinite(points).all())
        texture = frame.sample_rgb(self._sampler.positions(points.astype(np.float64))) if sure else None
        piece = self._current.get(track)
        full = piece is not None and len(piece.frames) >= LIMITS.frames
        if piece is None or full or piece.crossing != near or piece.frames[-1] != frame.index - 1:
            piece = self._current[track] = Piece(track, near)
            self.pieces.append(piece)
        piece.add(frame.index, texture)


def find_people(media: MediaInput, progress: Callable[[float], None] = lambda share: None) -> VideoPeople:
    """Find the people of a video; a pass over all its frames.   progress : called with the finished share.

    In a photo, everybody whose face is found is somebody.
    """
    if media.kind == "image":
        return people_in_photo(next(iter(media)))
    tracker, collector, thumbnails = SegmentTracker(BuiltinLandmarker()), PieceCollector(), _Thumbnails()
    count = 0
    waiting: dict[int, Frame] = {}

    def passing() -> Iterable[Frame]:
        for frame in media:
            waiting[frame.index] = frame
            yield frame

    with one_thread():
        for detected in detect_boxes(passing(), tracker.has_small_faces):
            tracker.update(detected)
            frame, faces = waiting.pop(detected.index), tracker.present()
            for number, face in faces.items():
                others = [other.box for n, other in faces.items() if n != number]
                near = any(_meet(face.box, box) for box in others)
                collector.add(frame, number, face.points, face.confidence, near)
                thumbnails.see(number, frame, face.box, 0.0 if near else face.confidence)
            count += 1
            progress(min(1.0, count / max(1, media.frame_count or 1)))
    return _people(tracker.faces(), tracker.numbers(), collector.pieces, thumbnails, count)


def group(pieces: Sequence[Piece], cuts: Sequence[int] = ()) -> list[F32]:
    """Say whose each piece is, in place; returns the signatures (64,) of the people.

    Each shot by itself, then people of different shots who are alike are one; last what is left over, such as the
    pieces of a short shot.

    cuts : frames with which new shots begin, ascending; no piece lies on both sides of one.
    """
    people: list[_Person] = []
    signatures = {id(piece): piece.signature for piece in pieces}
    shots: dict[int, list[Piece]] = defaultdict(list)
    for piece in pieces:
        shots[bisect_right(cuts, piece.frames[0])].append(piece)
    for shot in shots.values():
        people += _group_shot(shot, signatures, len(people))
    _merge(people, pieces, MIN_SAME_PERSON_SIMILARITY)
    for piece in pieces:
        own = signatures[id(piece)]
        if piece.person < 0 and own is not None:
            _join(piece, own, people, MIN_SAME_PERSON_SIMILARITY)
    _continue(pieces, signatures, people)
    return [person.signature for person in people]


def _group_shot(pieces: Sequence[Piece], signatures: dict[int, F32 | None], first: int) -> list[_Person]:
    """The people of a shot, whose numbers begin with `first`.

    Clear pieces come first, longest first; each joins the person whom it is most like, unless that person is seen
    elsewhere at the same time, or begins a new one.
    """
    people: list[_Person] = []
    for piece in sorted(pieces, key=lambda p: (p.crossing, -p.count)):
        own = signatures[id(piece)]
        if own is None or _join(piece, own, people, MIN_ALIKE):
            continue
        if (
            not piece.crossing
            and piece.count >= LIMITS.min_sure_frames
            and not _is_like_its_track(piece, people, pieces, own)
        ):
            people.append(_Person())
            people[-1].take(piece, own, len(people) - 1)
    _merge(people, pieces, MIN_ALIKE)
    for piece in pieces:
        piece.person += first if piece.person >= 0 else 0
    return people


class _Person:
    """What is known of a person while pieces are grouped."""

    def __init__(self) -> None:
        self.total: F32 = np.zeros(64, np.float32)
        self.frames: set[tuple[int, int]] = set()  # frame and track

    @property
    def signature(self) -> F32:
        """(64,) of unit length: the mean of the pieces' by their frames."""
        return np.asarray(self.total / max(float(np.linalg.norm(self.total)), 1e-9), np.float32)

    def take(self, piece: Piece, own: F32, number: int) -> None:
        self.total = self.total + np.float32(piece.count) * own
        self.frames |= {(frame, piece.track) for frame in piece.frames}
        piece.person = number

    def is_elsewhere(self, piece: Piece) -> bool:
        """Whether the person is seen on another track in a frame of the piece."""
        at = set(piece.frames)
        return any(frame in at and track != piece.track for frame, track in self.frames)


def _join(piece: Piece, own: F32, people: Sequence[_Person], least: float) -> bool:
    """Give a piece to the person whom it is most like, if their similarity reaches `least`; whether it did."""
    free = [k for k, person in enumerate(people) if not person.is_elsewhere(piece)]
    best = max(free, key=lambda k: cosine_similarity(people[k].signature, own), default=None)
    if best is None or cosine_similarity(people[best].signature, own) < least:
        return False
    people[best].take(piece, own, best)
    return True


def _is_like_its_track(piece: Piece, people: Sequence[_Person], pieces: Sequence[Piece], own: F32) -> bool:
    """Whether a piece that is not quite like anybody is like enough to who its track is otherwise: a turned head."""
    same = {p.person for p in pieces if p.track == piece.track and p.person >= 0}
    return any(cosine_similarity(people[k].signature, own) >= MAX_UNLIKE for k in same)


def _merge(people: Sequence[_Person], pieces: Sequence[Piece], least: float) -> None:
    """Join people whose similarity reaches `least` and who are never seen at once."""
    for a in range(len(people)):
        for b in range(a + 1, len(people)):
            if not people[b].frames or cosine_similarity(people[a].signature, people[b].signature) < least:
                continue
            if not {f for f, _ in people[a].frames} & {f for f, _ in people[b].frames}:
                people[a].total = people[a].total + people[b].total
                people[a].frames |= people[b].frames
                people[b].frames, people[b].total = set(), np.zeros(64, np.float32)
                for piece in pieces:
                    piece.person = a if piece.person == b else piece.person


def _continue(pieces: Sequence[Piece], signatures: dict[int, F32 | None], people: Sequence[_Person]) -> None:
    """Give the pieces that are left to who their track is before and after, unless they look like somebody else.

    At a crossing, only where both sides agree.
    """
    tracks: dict[int, list[Piece]] = defaultdict(list)
    for piece in pieces:
        tracks[piece.track].append(piece)
    for track in tracks.values():
        known = [piece.person for piece in track]
        for k, piece in enumerate(track):
            if known[k] >= 0:
                continue
            before = next((p for p in reversed(known[:k]) if p >= 0), None)
            after = next((p for p in known[k + 1 :] if p >= 0), None)
            sides = {p for p in (before, after) if p is not None}
            own = signatures[id(piece)]
            if len(sides) != 1 or (piece.crossing and (before is None or after is None)):
                continue
            (person,) = sides
            unlike = own is not None and cosine_similarity(people[person].signature, own) < MAX_UNLIKE
            if not (unlike and piece.count >= LIMITS.min_sure_frames) and not people[person].is_elsewhere(
                piece
            ):
                piece.person = person


def _people(
    found: SegmentFaces, numbers: Sequence[int], pieces: list[Piece], thumbnails: _Thumbnails, count: int
) -> VideoPeople:
    signatures = group(pieces, found.cuts.tolist())
    owner = {(piece.track, frame): piece.person for piece in pieces for frame in piece.frames}
    first = {piece.track: piece for piece in reversed(pieces)}
    rows = np.full(len(found.frame), -1)
    for row, (tracklet, frame) in enumerate(zip(found.tracklet, found.frame, strict=True)):
        track = numbers[int(tracklet)]
        begin = first.get(track)
        if (track, int(frame)) in owner:
            rows[row] = owner[track, int(frame)]
        elif begin is not None and frame < begin.frames[0] and not begin.crossing:
            rows[row] = begin.person  # frames to which it was tracked back
    _without_doubles(rows, found)
    enough = [p for p in range(len(signatures)) if (rows == p).sum() >= LIMITS.min_person_frames]
    tracks = np.array(numbers, np.intp)[found.tracklet]
    people = [
        _video_person(found, rows == p, signatures[p], {int(t) for t in tracks[rows == p]}, thumbnails)
        for p in enough
    ]
    people.sort(key=lambda person: (int(person.frames[0]), -person.width))
    kept = np.isin(rows, enough)
    numbered = tuple(_numbered(person, n) for n, person in enumerate(people, 1))
    return VideoPeople(numbered, _unknown(found, ~kept), tuple(map(int, found.cuts)), count)


def _without_doubles(rows: NDArray[np.int64], found: SegmentFaces) -> None:
    """Of two faces of one person in a frame neither is theirs for certain."""
    seen: dict[tuple[int, int], int] = {}
    for row, person in enumerate(rows):
        if person < 0:
            continue
        other = seen.setdefault((int(person), int(found.frame[row])), row)
        if other != row:
            rows[[row, other]] = -1


def _video_person(
    found: SegmentFaces, rows: Bool, signature: F32, tracks: set[int], thumbnails: _Thumbnails
) -> VideoPerson:
    index = np.flatnonzero(rows)
    index = index[np.argsort(found.frame[index], kind="stable")]
    return VideoPerson(
        0, found.frame[index], found.box[index], found.turn[index], found.points[index], found.confidence[index],
        signature, thumbnails.best(tracks),
    )  # fmt: skip


def _numbered(person: VideoPerson, number: int) -> VideoPerson:
    return VideoPerson(**{**vars(person), "number": number})


def _unknown(found: SegmentFaces, rows: Bool) -> UnknownFaces:
    frames = np.concatenate([found.frame[rows], found.bystander_frame])
    order = np.argsort(frames, kind="stable")
    boxes = np.concatenate([found.box[rows], found.bystander_box])
    scores = np.concatenate([found.confidence[rows], found.bystander_score])
    turns = np.concatenate([found.turn[rows], found.bystander_turn])
    return UnknownFaces(frames[order], boxes[order], scores[order], turns[order])


class _Thumbnails:
    """The clearest picture of each track."""

    def __init__(self) -> None:
        self._best: dict[int, tuple[float, U8]] = {}

    def see(self, track: int, frame: Frame, box: F32, confidence: float) -> None:
        """The track's face in another frame."""
        clearness = confidence * float(np.sqrt(max(box[2] - box[0], 1)))
        if clearness > 1.02 * self._best.get(track, (-1.0,))[0]:
            self._best[track] = clearness, head_picture(frame, box, THUMBNAIL_PIXELS)

    def best(self, tracks: set[int]) -> U8:
        """Of several tracks."""
        return max((self._best[track] for track in tracks), key=lambda one: one[0])[1]


def _meet(box: F32, other: F32) -> bool:
    """Whether two heads are so near that their tracks may mix."""
    a, b = (region(one, LIMITS.near_head_boxes) for one in (box, other))
    return bool((np.minimum(a[2:], b[2:]) > np.maximum(a[:2], b[:2])).all())


def people_followed(media: Iterable[Frame], points: F64) -> int:
    """How many people a clip shows in the place in which one face was followed.

    points : (n, 81, 2) of each frame; NaN where there is no face.  A piece ends at a cut and where the points jump.
    """
    collector, track, cuts, detector = PieceCollector(), 0, list[int](), CutDetector()
    for frame in media:
        if frame.index >= len(points):
            break  # too few landmarks, which enrolment says
        now, small = points[frame.index], cv2.resize(frame.luma, SMALL_SIZE, interpolation=cv2.INTER_AREA)
        if detector.update(np.asarray(small, np.uint8)):
            cuts.append(frame.index)
        last = points[frame.index - 1] if frame.index else now
        track += int(frame.index in cuts[-1:] or _jumped(last, now))
        if np.isfinite(now).all():
            collector.add(frame, track, now, 1.0, near=False)
    group(collector.pieces, cuts)
    return len({piece.person for piece in collector.pieces} - {-1})


def _jumped(last: F64, now: F64) -> bool:
    if not np.isfinite(last).all() or not np.isfinite(now).all():
        return True
    return not is_plausible_motion(last, now)


def people_sheet(found: VideoPeople) -> U8:
    """A picture (h, w, 3) of the people with their numbers."""
    pictures = [labelled(p.thumbnail, f"{p.number}: {len(p.frames)} frames") for p in found.people]
    return sheet([pictures[k : k + SHEET_COLUMNS] for k in range(0, len(pictures), SHEET_COLUMNS)])
