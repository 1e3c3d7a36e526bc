"""Face detection in a thread beside the tracker: finds bystanders and re-acquires a lost face.

While the one face that is certain is where it is followed, nobody can come in without changing the picture beside that
head: what has changed there since all of it was searched is searched, and all of it now and then.  Otherwise all of
every frame is.

Besides upright faces there are other looks, which take turns: the picture turned by quarters, and glances at what is
behind bars or letters (`guise.aam.landmarks.glances`).  One that shows somebody is taken again until it doesn't.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.landmarks import Face, iou
from guise.aam.landmarks.boxes import is_same
from guise.aam.landmarks.builtin import BuiltinLandmarker, distinct
from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.glances import CYCLE, Glancer, spans_any
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import TURNED, UPRIGHT, RolledBoxes, detect_at_rolls
from guise.app.media import Frame
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.closing import Closing

Part = tuple[int, int, int, int]


@dataclass(frozen=True)
class BackgroundLimits:
    """What the background detector finds and keeps."""

    picture_height_pixels: int = 240  # of the downscaled frame
    min_face_pixels: int = 12  # in the downscaled frame, a twentieth of its height
    min_score: float = 0.35  # of a box that is covered if it also looks like a face
    min_certain_score: float = 0.75  # of a box that is covered in any case
    min_likeness: float = 3.0  # see `BuiltinLandmarker.likeness`; fingertips, folds and hair have less
    min_landmark_score: float = 0.5  # of a box in which landmarks are sought
    look_interval_frames: int = 3  # from one other look to the next, beside a certain upright face
    whole_interval_frames: int = 6  # from one search of all to the next, while one of parts is enough
    max_parts_share: float = 0.25  # of the picture, up to which it is
    margin_cells: int = 3  # of a part, about what has changed
    min_still_iou: float = 0.5  # of the certain face with where it is followed
    cell_pixels: int = 8  # of the downscaled frame, over whose mean changes are noticed; more than noise and
    min_change: float = 5.0  # grey levels, of a change


LIMITS = BackgroundLimits()


@dataclass(frozen=True, eq=False)
class Search:
    """What has been found since all of a picture was searched.

    Parameters
    ----------
    found : upright, boxes in pixels of the downscaled frame.   cells : (h, w) grey levels when all was searched.
    only : box (4,) of the only face, which is certain, or None.   age : frames since all was searched.
    """

    found: RolledBoxes
    cells: F32
    only: F32 | None = None
    age: int = 0

    def changed(self, cells: F32, size: tuple[int, int]) -> list[Part] | None:
        """The parts x0 y0 x1 y1 of a picture (height, width) in which somebody may have come; None for all of it."""
        if (
            self.only is None
            or self.age + 1 >= LIMITS.whole_interval_frames
            or cells.shape != self.cells.shape
        ):
            return None
        changed = np.asarray(np.abs(cells - self.cells) >= LIMITS.min_change, np.uint8)
        x0, y0, x1, y1 = np.maximum(region(self.only) / LIMITS.cell_pixels, 0).tolist()
        changed[math.floor(y0) : math.ceil(y1), math.floor(x0) : math.ceil(x1)] = 0
        if not changed.any():
            return []
        kernel = np.ones((2 * LIMITS.margin_cells + 1,) * 2, np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(cv2.dilate(changed, kernel))
        high, wide = np.divide(size, cells.shape).tolist()
        if np.prod(stats[1:, 2:4], axis=1).sum() > LIMITS.max_parts_share * cells.size:
            return None
        return [
            (int(x * wide), int(y * high), math.ceil((x + w) * wide), math.ceil((y + h) * high))
            for x, y, w, h, _ in stats[1:].tolist()
        ]


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
        self._last: Search | None = None
        self._looks, self._since_look = 0, LIMITS.look_interval_frames  # taken, and frames since the last
        self._telling: set[int] = set()  # looks that have just shown somebody

    def submit(self, frame: Frame, followed: Sequence[F32] | None = None) -> None:
        """Start detection in a frame; the caller may draw into the frame as soon as this returns.

        followed : boxes (4,) where faces were in the frame before, for certain; None where nobody follows any.
        """
        self._frame = frame
        picture = downscaled(frame)
        scale = np.tile(np.divide((frame.width, frame.height), picture.shape[1::-1]), 2)
        self._found = self._pool.submit(self._found_in, picture, scale, followed)

    def _found_in(self, picture: U8, scale: F64, followed: Sequence[F32] | None) -> RolledBoxes:
        """Boxes in pixels of a frame, of which this is the downscaled picture, whose pixels are (4,) times as large."""
        known = [((box + 0.5) / scale - 0.5).astype(np.float32) for box in followed or ()]
        cells, size, last, parts = _cells(picture), picture.shape[:2], self._last, None
        if last is not None and last.only is not None:
            only = last.only
            if followed is None or any(iou(only, one) > LIMITS.min_still_iou for one in known):
                parts = last.changed(cells, (size[0], size[1]))
        if (
            last is None
            or parts is None
            or any(self._shows_others(picture, part, last.found, known) for part in parts)
        ):
            last = Search(
                self._faces(self._upright(picture), RolledBoxes.none(), picture, known), cells, age=-1
            )
        found = self._with_looks(last.found, picture, known)
        self._last = replace(last, only=None if self._telling else _only(last.found, known), age=last.age + 1)
        return replace(found, boxes=((found.boxes + 0.5) * scale - 0.5).astype(np.float32))

    def _upright(self, picture: U8) -> RolledBoxes:
        return detect_at_rolls(self._detector, picture, UPRIGHT)

    def _shows_others(self, picture: U8, part: Part, found: RolledBoxes, known: Sequence[F32]) -> bool:
        """Whether a part of a picture shows what may be a face and is not found yet."""
        x0, y0, x1, y1 = part
        seen = self._upright(picture[y0:y1, x0:x1]).moved(x0, y0)
        return len(self._faces(seen, found, picture, known)) > 0

    def _faces(self, seen: RolledBoxes, found: RolledBoxes, picture: U8, known: Sequence[F32]) -> RolledBoxes:
        """Of what is seen, the faces that were not found before: certain ones, and what looks like one."""
        sure = found.and_others(seen)
        seen = _beside(seen, sure[_are_certain(sure, known)].boxes, known)
        kept = [
            not any(is_same(box, one) for one in found.boxes)
            and (score >= LIMITS.min_certain_score or self._looks_like_face(picture, box, turn, known))
            for box, score, turn in zip(seen.boxes, seen.scores, seen.turns, strict=True)
        ]
        return seen[np.array(kept, bool)]

    def _with_looks(self, found: RolledBoxes, picture: U8, known: Sequence[F32]) -> RolledBoxes:
        """What is found, and what those looks show that are due, or have told of somebody in the frame before."""
        certain = found[_are_certain(found, known)]
        self._since_look += 1
        due = (
            0 if len(certain) and self._since_look < LIMITS.look_interval_frames else 1 if len(certain) else 2
        )
        looks = self._telling | {_look(self._looks + k) for k in range(due)}
        self._looks, self._since_look = self._looks + due, 0 if due else self._since_look
        shown = {look: self._shown(look, found, certain, picture, known) for look in sorted(looks)}
        for seen in shown.values():
            found = found.and_others(seen)
        boxes = found.distinct().boxes
        self._telling = {look for look, seen in shown.items() if (seen.boxes[:, None] == boxes).all(2).any()}
        return found

    def _shown(
        self, look: int, found: RolledBoxes, certain: RolledBoxes, picture: U8, known: Sequence[F32]
    ) -> RolledBoxes:
        """What a look other than upright shows beside what is found."""
        number, is_glance = divmod(look, 2)
        if is_glance:
            return self._glancer.likely(self._landmarker, picture, number, certain)
        return self._faces(
            detect_at_rolls(self._detector, picture, TURNED[number : number + 1]), found, picture, known
        )

    def _looks_like_face(self, picture: U8, box: F32, turn: float, known: Sequence[F32]) -> bool:
        is_known = turn == 0 and any(is_same(box, one) for one in known)
        return is_known or self._landmarker.likeness(picture, box, turn) >= LIMITS.min_likeness

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


def _look(count: int) -> int:
    """The look that is taken after so many others: twice the number of a roll, or that of a glance and one more."""
    return count % (2 * CYCLE if count % 2 else 2 * len(TURNED))


def _cells(picture: U8) -> F32:
    """Mean grey levels of small squares of a picture."""
    height, width = picture.shape[:2]
    size = (max(1, width // LIMITS.cell_pixels), max(1, height // LIMITS.cell_pixels))
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def _are_certain(found: RolledBoxes, known: Sequence[F32]) -> Bool:
    """(n,) which boxes are upright faces for certain, by their score or as they are followed."""
    followed = np.array([any(is_same(box, one) for one in known) for box in found.boxes], bool)
    certain: Bool = (found.turns == 0) & ((found.scores >= LIMITS.min_certain_score) | followed)
    return certain


def _beside(found: RolledBoxes, certain: F32, known: Sequence[F32]) -> RolledBoxes:
    """The boxes but those that are no certain face and lie, rolled or larger, on the head of an upright one (n, 4)."""
    heads = np.array([region(box) for box in certain]).reshape(-1, 4)
    centres = (found.boxes[:, :2] + found.boxes[:, 2:]) / 2
    within = (centres[:, None] > heads[:, :2]) & (centres[:, None] < heads[:, 2:])
    is_hair = np.any(np.all(within, axis=2), axis=1) & (found.turns != 0)
    is_certain = _are_certain(found, known) | (found.scores >= LIMITS.min_certain_score)
    return found[is_certain | ~(is_hair | spans_any(found.boxes, certain))]


def _only(found: RolledBoxes, known: Sequence[F32]) -> F32 | None:
    """The box (4,) of the only face; None unless there is one, upright and certain."""
    faces = found.distinct()
    return faces.boxes[0] if len(faces) == 1 and _are_certain(faces, known)[0] else None


def downscaled(frame: Frame) -> U8:
    """The detector's input, RGB (h, w, 3); a fast conversion whose grey levels may be slightly off."""
    height = LIMITS.picture_height_pixels
    if frame.height <= height:
        return frame.rgb()
    width = 2 * round(frame.width * height / frame.height / 2)  # an even one takes less time
    return frame.scaled_rgb(max(2, width), height)
