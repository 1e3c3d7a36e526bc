"""Face trackers: the detector finds faces, and between its runs the landmarker refines them from frame to frame.

:class:`FaceTracker` tracks one face, :class:`MultiFaceTracker` all of them.

Frames RGB uint8 (h, w, 3); points face81, pixels, x right, y down, pixel centres at integers; IoU is the intersection
over union of two boxes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from guise.aam.landmarks.face import Face, Landmarker, iou
from guise.aam.landmarks.plausible import is_plausible_motion
from guise.aam.landmarks.rolls import RolledBoxes, nearest_quarter, turn_of
from guise.aam.landmarks.schemes import COUNT
from guise.common.arrays import F32, U8

Report = Callable[[str], None]
FaceInBox = Callable[[U8, F32, float], Face | None]


@dataclass(frozen=True)
class TrackingLimits:
    """Thresholds of the face trackers.

    Parameters
    ----------
    min_confidence : of a face's points, below which it is lost.
    min_start_confidence : below which a new face is not tracked; None for `min_confidence`.
    min_match_iou : above it a detection and a track are the same face.
    max_distinct_iou : above it two tracks have come to the same face.
    max_missed_frames : after so many without a face a track ends.
    max_undetected_frames, min_undetected_confidence : where every frame has detected boxes, a track ends after so many
        frames without one if its points are less confident.
    detection_frames : frames from one run of the detector to the next, at least 1, where it runs on demand.
    max_contradictions : so many runs of the detector in a row must disagree with a track to end it: the detector is
        wrong now and then, too.
    """

    min_confidence: float = 0.5
    min_start_confidence: float | None = None
    min_match_iou: float = 0.2
    max_distinct_iou: float = 0.5
    max_missed_frames: int = 30
    max_undetected_frames: int = 45
    min_undetected_confidence: float = 0.8
    detection_frames: int = 5
    max_contradictions: int = 3

    @property
    def start_confidence(self) -> float:
        """Confidence from which a new face is tracked."""
        return self.min_confidence if self.min_start_confidence is None else self.min_start_confidence


LIMITS = TrackingLimits()


class FaceTracker:
    """Tracks one face; one call per frame, in order.

    Parameters
    ----------
    landmarker : Landmarker
    min_confidence : float
        A face below it is not taken.
    recheck : int
        The detector runs again after so many frames; 0 for never. The track is given up when the detector finds faces
        only elsewhere in three runs in a row.
    report : callable, optional
        Called once with a sentence when a frame has several faces.
    """

    def __init__(
        self,
        landmarker: Landmarker,
        min_confidence: float = LIMITS.min_confidence,
        recheck: int = 30,
        report: Report | None = None,
    ) -> None:
        self._landmarker = landmarker
        self._min_confidence = min_confidence
        self._recheck = recheck
        self._report = report
        self._index = 0
        self._frames_since_detection = 0
        self._contradictions = 0
        self._before: Face | None = None
        self._previous: Face | None = None
        self._last: Face | None = None

    def update(self, rgb: U8) -> Face | None:
        """The face in the next frame; None when there is none."""
        face = self._refined(rgb)
        if face is None:
            face = self._reacquired(rgb)
        elif self._recheck and self._frames_since_detection >= self._recheck:
            face = self._rechecked(rgb, face)
        self._index += 1
        self._frames_since_detection += 1
        self._before, self._previous = self._previous, face
        self._last = face or self._last
        return face

    def _refined(self, rgb: U8) -> Face | None:
        if self._previous is None:
            return None
        return _refined(self._landmarker, rgb, self._previous, self._min_confidence, self._before)

    def _reacquired(self, rgb: U8) -> Face | None:
        """The detected face where the last one was, or the largest."""
        faces = self._detected(rgb)
        if self._last is not None:
            last = self._last.box
            near = [f for f in faces if iou(f.box, last) > LIMITS.min_match_iou]
            faces = sorted(near, key=lambda f: -iou(f.box, last)) or faces
        return faces[0] if faces else None

    def _rechecked(self, rgb: U8, face: Face) -> Face:
        """The tracked face, unless the detector finds faces and none of them there."""
        faces = self._detected(rgb)
        if not faces or _near_any(face, faces) or _is_rolled(face):
            self._contradictions = 0
            return face
        self._contradictions += 1
        if self._contradictions < LIMITS.max_contradictions:
            self._frames_since_detection = self._recheck
            return face
        self._contradictions = 0
        return faces[0]

    def _detected(self, rgb: U8) -> list[Face]:
        self._frames_since_detection = 0
        faces = [f for f in self._landmarker.detect(rgb) if f.confidence >= self._min_confidence]
        if len(faces) > 1 and self._report is not None:
            self._report(f"frame {self._index} has {len(faces)} faces; the largest one is taken")
            self._report = None
        return faces


@dataclass(eq=False)
class ActiveTrack:
    """A face that is being tracked.

    Parameters
    ----------
    number : never given to another face.
    face : where its points were last.   before : in the frame before that.   box : (4,) where it was last.
    current : the face in this frame, or None; its points are NaN where only a box was detected.
    moved_iou : IoU of its box with that of the frame before.
    missed_frames : in a row without it.   undetected_frames : in a row without a detected box.
    contradictions : runs of the detector that have not seen a new face again; None once one has.
    """

    number: int
    face: Face
    box: F32
    current: Face | None
    before: Face | None = None
    moved_iou: float = 1.0
    missed_frames: int = 0
    undetected_frames: int = 0
    contradictions: int | None = None


class MultiFaceTracker:
    """Tracks every face; one call per frame, in order.  Each face keeps its number, no other face ever has it.

    There are two ways to feed it.  With frames alone :meth:`update` runs the landmarker's detector on demand: where
    there is no face to track, every few frames, and in the frames after a face was lost.  Only the detector brings a
    lost face back, and a new face that its next runs do not see again is given up.  With the boxes of a detector that
    runs on every frame :meth:`update` uses these instead: a lost face is refined on from where it was or taken from a
    box there, and the caller decides, by :meth:`start`, which boxes become tracks.

    Parameters
    ----------
    landmarker : Landmarker
    limits : TrackingLimits
    face_in_box : callable, optional
        The face whose points fill a box (4,) of a picture and that is rolled clockwise by a turn, radians, or None;
        with boxes a lost face is found again by it.
    lookback_bytes : int
        Frames of so many bytes are kept, through which :meth:`look_back` tracks a new face backward.
    """

    def __init__(
        self,
        landmarker: Landmarker,
        limits: TrackingLimits = LIMITS,
        *,
        face_in_box: FaceInBox | None = None,
        lookback_bytes: int = 0,
    ) -> None:
        self._landmarker = landmarker
        self._limits = limits
        self._face_in_box = face_in_box
        self._lookback_bytes = lookback_bytes
        self._tracks: list[ActiveTrack] = []
        self._next = 0
        self._frames_since_detection = limits.detection_frames
        self._recent: deque[U8] = deque()

    @property
    def boxes(self) -> list[F32]:
        """Of the faces that are there in the current frame."""
        return [face.box for face in self.faces]

    @property
    def faces(self) -> list[Face]:
        """Those that are there in the current frame."""
        return [track.current for track in self._tracks if track.current is not None]

    def update(self, rgb: U8, boxes: RolledBoxes | None = None) -> dict[int, Face]:
        """The faces in the next frame by their numbers, which count from 0 as faces appear, larger ones first.

        boxes : of a detector that runs on every frame; without them the landmarker's own runs on demand.  With them, a
            face of which only a box was detected has NaN points and confidence 0.
        """
        self._frames_since_detection += 1
        self._remember(rgb)
        for track in self._tracks:
            track.current = (
                self._on_demand(track, rgb) if boxes is None else self._by_boxes(track, rgb, boxes)
            )
            track.moved_iou = 0.0 if track.current is None else iou(track.current.box, track.box)
        merged = self._separate()
        if boxes is not None:  # a box would bring them back at once
            self._tracks = [track for track in self._tracks if track not in merged]
        elif self._should_detect():
            self._detect(rgb)
        return self._settled(by_boxes=boxes is not None)

    def start(self, face: Face) -> int | None:
        """Track a face of the current frame from now on; its number, or None where one is tracked already."""
        if any(iou(face.box, box) > self._limits.min_match_iou for box in self.boxes):
            return None
        return self._start(face).number

    def look_back(self, face: Face) -> Iterator[Face]:
        """A face of the current frame in the frames before, newest first, until it is lost."""
        for rgb in list(self._recent)[-2::-1]:
            earlier = self._refined(rgb, face)
            if earlier is None:
                return
            yield (face := earlier)

    def restart(self) -> None:
        """Give up all tracks, as at a cut; numbers count on."""
        self._tracks.clear()
        self._recent.clear()

    # -- from one frame to the next ------------------------------------------------------------------------------

    def _on_demand(self, track: ActiveTrack, rgb: U8) -> Face | None:
        return None if track.missed_frames else self._refined(rgb, track.face, track.before)

    def _by_boxes(self, track: ActiveTrack, rgb: U8, found: RolledBoxes) -> Face | None:
        shares = [iou(track.box, box) for box in found.boxes]
        nearest = int(np.argmax(shares)) if shares else -1
        detected = nearest >= 0 and shares[nearest] > self._limits.min_match_iou
        track.undetected_frames = 0 if detected else track.undetected_frames + 1
        face = self._refined(rgb, track.face, track.before)
        if face is None and detected:
            best = self._best_roll(found, nearest)
            return self._in_box(rgb, found.boxes[best], float(found.turns[best]))
        return face

    def _best_roll(self, found: RolledBoxes, nearest: int) -> int:
        """Of the boxes of one face at several rolls the one with the highest score."""
        same = [iou(box, found.boxes[nearest]) > self._limits.min_match_iou for box in found.boxes]
        return int(np.argmax(np.where(same, found.scores, -1.0)))

    def _in_box(self, rgb: U8, box: F32, turn: float) -> Face:
        """The face in a detected box, without points where they are not clear."""
        face = self._face_in_box(rgb, box, turn) if self._face_in_box is not None else None
        if face is not None and face.confidence >= self._limits.min_confidence:
            return face
        return Face(np.full((COUNT, 2), np.nan, np.float32), 0.0, box)

    def _refined(self, rgb: U8, previous: Face, before: Face | None = None) -> Face | None:
        return _refined(self._landmarker, rgb, previous, self._limits.min_confidence, before)

    def _separate(self) -> list[ActiveTrack]:
        """Of two faces that have come to the same place the one that moved less stays; returns the others."""
        kept: list[F32] = []
        merged = []
        for track in sorted(self._tracks, key=lambda track: (-track.moved_iou, track.number)):
            if track.current is None:
                continue
            if any(iou(track.current.box, box) > self._limits.max_distinct_iou for box in kept):
                track.current = None
                merged.append(track)
            else:
                kept.append(track.current.box)
        return merged

    def _settled(self, *, by_boxes: bool) -> dict[int, Face]:
        """The faces of this frame; their tracks go on from them, and others end."""
        present = {}
        for track in self._tracks:
            if track.current is None:
                track.missed_frames += 1
                continue
            track.missed_frames, track.box = 0, track.current.box
            present[track.number] = track.current
            if np.isfinite(track.current.points).all():
                track.before, track.face = track.face, track.current
        self._tracks = [track for track in self._tracks if not self._is_over(track, by_boxes)]
        return dict(sorted(present.items()))

    def _is_over(self, track: ActiveTrack, by_boxes: bool) -> bool:
        if track.missed_frames > self._limits.max_missed_frames:
            return True
        confidence = 0.0 if track.current is None else track.current.confidence
        undetected = by_boxes and track.undetected_frames > self._limits.max_undetected_frames
        return undetected and confidence < self._limits.min_undetected_confidence

    # -- detection on demand -------------------------------------------------------------------------------------

    def _should_detect(self) -> bool:
        every = self._limits.detection_frames
        lost = any(track.current is None and track.missed_frames < every for track in self._tracks)
        return not self.boxes or lost or self._frames_since_detection >= every

    def _detect(self, rgb: U8) -> None:
        """Take the faces that are not tracked: with their number if they were lost nearby, else with a new one."""
        self._frames_since_detection = 0
        least = self._limits.start_confidence
        faces = [f for f in self._landmarker.detect(rgb) if f.confidence >= least]
        self._confirm(faces)
        tracked = self.boxes
        faces = [f for f in faces if all(iou(f.box, box) <= self._limits.min_match_iou for box in tracked)]
        lost = _matched(faces, [t for t in self._tracks if t.current is None], self._limits.min_match_iou)
        for index, face in enumerate(faces):
            if index in lost:
                lost[index].current = face
            else:
                self._start(face).contradictions = 0

    def _confirm(self, faces: list[Face]) -> None:
        """Trust the new faces that are detected again; give up those that too many runs have not seen again."""
        for track in list(self._tracks):
            if track.current is None or track.contradictions is None or _is_rolled(track.current):
                continue
            if _near_any(track.current, faces, self._limits.min_match_iou):
                track.contradictions = None
                continue
            track.contradictions += 1
            if track.contradictions == self._limits.max_contradictions:
                self._tracks.remove(track)

    def _start(self, face: Face) -> ActiveTrack:
        track = ActiveTrack(self._next, face, face.box, face)
        self._next += 1
        self._tracks.append(track)
        return track

    def _remember(self, rgb: U8) -> None:
        if not self._lookback_bytes:
            return
        self._recent.append(rgb)
        while (
            len(self._recent) > 2 and sum(picture.nbytes for picture in self._recent) > self._lookback_bytes
        ):
            self._recent.popleft()


def _matched(faces: list[Face], tracks: list[ActiveTrack], min_iou: float) -> dict[int, ActiveTrack]:
    """Which track each face continues, by the face's index; best matches first, each track once."""
    pairs = [(iou(face.box, track.box), index, track) for index, face in enumerate(faces) for track in tracks]
    matched: dict[int, ActiveTrack] = {}
    for share, index, track in sorted(pairs, key=lambda pair: -pair[0]):
        if share > min_iou and index not in matched and track not in matched.values():
            matched[index] = track
    return matched


def _near_any(face: Face, faces: Iterable[Face], min_iou: float = LIMITS.min_match_iou) -> bool:
    return any(iou(other.box, face.box) > min_iou for other in faces)


def _is_rolled(face: Face) -> bool:
    """Whether a detector that found upright faces elsewhere says nothing about this one."""
    return nearest_quarter(turn_of(face.points)) != 0


def _refined(
    landmarker: Landmarker, rgb: U8, previous: Face, min_confidence: float, before: Face | None = None
) -> Face | None:
    """The face of the frame before in this one; None when lost, not confident, or when no face can move like that.

    It is looked for midway between the last two frames, if it only moved from one to the other.  What is found depends
    a little on the crop, which lies where the last points were: after one frame alone both may swing to and fro for
    good on a face at rest.
    """
    start = previous
    if before is not None and is_plausible_motion(before.points, previous.points):
        start = replace(previous, points=np.float32(0.5) * (before.points + previous.points))
    face = landmarker.refine(rgb, start)
    if (
        face is None
        or face.confidence < min_confidence
        or not is_plausible_motion(previous.points, face.points)
    ):
        return None
    return face


def track_video(
    landmarker: Landmarker,
    frames: Iterable[U8],
    *,
    min_confidence: float = LIMITS.min_confidence,
    recheck: int = 30,
    report: Report | None = None,
) -> F32:
    """Landmarks of one face, the largest at first, through a video.

    Parameters
    ----------
    landmarker : Landmarker
    frames : iterable of (h, w, 3) uint8
    min_confidence, recheck, report
        As for :class:`FaceTracker`.

    Returns
    -------
    (T, 81, 2) float32
        Pixels; NaN for frames without a face.
    """
    tracker = FaceTracker(landmarker, min_confidence, recheck, report)
    faces = [tracker.update(frame) for frame in frames]
    missing = np.full((COUNT, 2), np.nan, np.float32)
    rows = [missing if face is None else face.points for face in faces]
    return np.array(rows, dtype=np.float32).reshape(len(rows), COUNT, 2)
