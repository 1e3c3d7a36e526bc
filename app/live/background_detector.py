"""Face detection in a thread beside the tracker: finds bystanders and re-acquires a lost face.

Upright faces are searched in every frame, and so is the roll at which a turned one was seen last.  The other rolls take
turns: one in every frame while no upright face is certain, otherwise one in every third.  Faces behind bars or letters
are searched at a glance (`guise.aam.landmarks.glances`), as often.

A frame isn't searched while there was one certain face, a moment ago, and the picture is as it was then except on that
head: nobody can come into it without changing it.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.landmarks import Face
from guise.aam.landmarks.builtin import BuiltinLandmarker, distinct
from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.glances import Glancer
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import TURNED, UPRIGHT, RolledBoxes, detect_at_rolls, nearest_quarter
from guise.app.media import Frame
from guise.common.arrays import F32, U8, Bool
from guise.common.closing import Closing


@dataclass(frozen=True)
class BackgroundLimits:
    """What the background detector finds and keeps."""

    picture_height_pixels: int = 240  # of the downscaled frame
    min_face_pixels: int = 12  # in the downscaled frame, a twentieth of its height
    min_score: float = 0.35  # of a box that is covered if it also looks like a face
    min_certain_score: float = 0.75  # of a box that is covered in any case
    min_likeness: float = 3.0  # see `BuiltinLandmarker.likeness`; fingertips, folds and hair have less
    min_landmark_score: float = 0.5  # of a box in which landmarks are sought
    turned_interval_frames: int = (
        3  # from one search at another roll to the next, beside a certain upright face
    )
    most_unsearched_frames: int = 2  # in a row
    cell_pixels: int = 8  # of the downscaled frame, over whose mean changes are noticed; more than noise and
    min_change: float = 5.0  # grey levels, of a change


LIMITS = BackgroundLimits()


@dataclass(frozen=True, eq=False)
class Search:
    """What a search has found.

    Parameters
    ----------
    found : boxes in pixels of the frame.   cells : (h, w) grey levels.
    apart : (h, w), the cells that must not change; None when the next frame is searched in any case.
    age : frames since then.
    """

    found: RolledBoxes
    cells: F32
    apart: Bool | None
    age: int = 0

    def holds(self, cells: F32) -> bool:
        """Whether a picture has nobody else in it."""
        if self.apart is None or self.age >= LIMITS.most_unsearched_frames or cells.shape != self.cells.shape:
            return False
        return bool((np.abs(cells - self.cells) < LIMITS.min_change)[self.apart].all())


class BackgroundDetector(Closing):
    """Detects faces in its own thread; `PersonTracker` uses it as a landmarker for the current frame."""

    name = "background detector"

    def __init__(self) -> None:
        self._detector = FaceDetector(smallest=LIMITS.min_face_pixels, min_score=LIMITS.min_score)
        self._landmarker = BuiltinLandmarker(self._detector)
        self._glancer = Glancer()
        self._pool = ThreadPoolExecutor(1, "guise-detector")
        self._frame: Frame | None = None
        self._found: Future[RolledBoxes] | None = None
        self._count = 0  # of frames
        self._turned_at, self._turned_count = -LIMITS.turned_interval_frames, 0  # searches at another roll
        self._last: Search | None = None
        self._seen_turned: tuple[int, ...] = ()  # quarter turns of the last search's faces

    def submit(self, frame: Frame) -> None:
        """Start detection in a frame; the caller may draw into the frame as soon as this returns."""
        self._frame = frame
        self._found = self._pool.submit(self._found_in, downscaled(frame), (frame.width, frame.height))

    def _found_in(self, picture: U8, size: tuple[int, int]) -> RolledBoxes:
        """Boxes in pixels of a frame (width, height), of which this is the downscaled picture."""
        cells, last = _cells(picture), self._last
        self._count += 1
        if last is not None and last.holds(cells):
            self._last = replace(last, age=last.age + 1)
        else:
            found = self._boxes_in(picture)
            scale = np.tile(np.divide(size, picture.shape[1::-1]), 2)
            boxes = ((found.boxes + 0.5) * scale - 0.5).astype(np.float32)
            self._last = Search(replace(found, boxes=boxes), cells, _apart(found, cells))
        return self._last.found

    def _boxes_in(self, picture: U8) -> RolledBoxes:
        found = self._detected(picture)
        kept = [
            score >= LIMITS.min_certain_score or self._looks_like_face(picture, box, turn)
            for box, score, turn in zip(found.boxes, found.scores, found.turns, strict=True)
        ]
        found = _without_hair(found[kept])
        return found.and_others(self._glimpsed(picture, found))

    def _glimpsed(self, picture: U8, found: RolledBoxes) -> RolledBoxes:
        """Faces behind bars or letters, where no upright one is certain, or in every third search."""
        is_sure = bool((found.scores[found.turns == 0] >= LIMITS.min_certain_score).any())
        number, rest = divmod(self._count, LIMITS.turned_interval_frames)
        if is_sure and rest:
            return RolledBoxes.none()
        number = number if is_sure else self._count
        return self._glancer.likely(self._landmarker, picture, number)

    def _detected(self, picture: U8) -> RolledBoxes:
        upright = detect_at_rolls(self._detector, picture, UPRIGHT)
        is_sure = bool((upright.scores >= LIMITS.min_certain_score).any())
        due = set(self._seen_turned)
        if self._count - self._turned_at >= (LIMITS.turned_interval_frames if is_sure else 1):
            due.add(TURNED[self._turned_count % len(TURNED)])
            self._turned_at, self._turned_count = self._count, self._turned_count + 1
        found = upright.and_others(detect_at_rolls(self._detector, picture, sorted(due)))
        likely = found[found.scores >= LIMITS.min_landmark_score].distinct()
        turns = {nearest_quarter(turn) for turn in likely.turns.tolist()}
        self._seen_turned = tuple(turns - set(UPRIGHT))
        return found

    def _looks_like_face(self, picture: U8, box: F32, turn: float) -> bool:
        return self._landmarker.likeness(picture, box, turn) >= LIMITS.min_likeness

    @property
    def found(self) -> RolledBoxes:
        """Boxes (n, 4) of the iBUG 68 points in the frame, each face once, largest first; waits for the detector."""
        return self._every_roll.distinct()

    @property
    def _every_roll(self) -> RolledBoxes:
        return RolledBoxes.none() if self._found is None else self._found.result()

    def detect(self, rgb: U8) -> list[Face]:
        """The faces in the current frame, which must not have been drawn into, largest first; `rgb` is not used."""
        found = self._every_roll
        found = found[found.scores >= LIMITS.min_landmark_score]
        if self._frame is None or not len(found):
            return []
        whole = self._frame.rgb()
        faces = (
            self._landmarker.points_in_box(whole, box, float(turn))
            for box, turn in zip(found.boxes, found.turns, strict=True)
        )
        return distinct([face for face in faces if face is not None])

    def refine(self, rgb: U8, previous: Face) -> Face | None:
        """The previous frame's face, located in the current frame."""
        return None if self._frame is None else self._landmarker.refine(self._frame.rgb(), previous)

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown()


def _cells(picture: U8) -> F32:
    """Mean grey levels of small squares of a picture."""
    height, width = picture.shape[:2]
    size = (max(1, width // LIMITS.cell_pixels), max(1, height // LIMITS.cell_pixels))
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def _without_hair(found: RolledBoxes) -> RolledBoxes:
    """The boxes but those that are no certain face and lie, rolled, on the head of an upright one that is."""
    sure = found.boxes[(found.scores >= LIMITS.min_certain_score) & (found.turns == 0)]
    heads = np.array([region(box) for box in sure]).reshape(-1, 4)
    centres = (found.boxes[:, :2] + found.boxes[:, 2:]) / 2
    within = (centres[:, None] > heads[:, :2]) & (centres[:, None] < heads[:, 2:])
    on_head = np.any(np.all(within, axis=2), axis=1)
    return found[~(on_head & (found.turns != 0) & (found.scores < LIMITS.min_certain_score))]


def _apart(found: RolledBoxes, cells: F32) -> Bool | None:
    """The cells that are not of the only face's head; None unless there is one face, upright and certain."""
    faces = found.distinct()
    if len(faces) != 1 or faces.turns[0] != 0 or faces.scores[0] < LIMITS.min_certain_score:
        return None
    x0, y0, x1, y1 = region(faces.boxes[0]) / LIMITS.cell_pixels
    rows, columns = np.arange(cells.shape[0])[:, None], np.arange(cells.shape[1])
    return np.asarray((columns + 1 <= x0) | (columns >= x1) | (rows + 1 <= y0) | (rows >= y1))


def downscaled(frame: Frame) -> U8:
    """The detector's input, RGB (h, w, 3); a fast conversion whose grey levels may be slightly off."""
    height = LIMITS.picture_height_pixels
    width = round(frame.width * height / frame.height)
    if frame.height <= height:
        return frame.rgb()
    return frame.scaled_rgb(width, height)
