"""Things that are taken for faces: what shows in all its sights that it is none is not covered, but listed for review.

All of this must hold, otherwise it is covered: it is seen at one place for seconds; nothing in it changes, while
something else in the picture does; the landmarker never finds points in it; it looks only a little like a face; and
hardly any of it is parsed as one (`guise.app.people.skin`).  In a frame in which anything at its place has changed,
somebody may be before it, and the place is covered.  Pixels as shown; boxes ``x0 y0 x1 y1``; turns in radians.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face, iou
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.app.deidentify.stages.case import Case
from guise.app.media import Frame
from guise.app.people.cuts import SMALL_SIZE
from guise.app.people.looks import small_picture
from guise.app.people.skin import FaceShares
from guise.common.arrays import F32, I32, U8

THINGS = "things.json"  # in the work folder, of bystanders


@dataclass(frozen=True)
class ThingLimits:
    """What shows that something is no face."""

    min_seconds: float = 2.0  # from its first sight to its last
    min_sights: int = 6
    samples: int = 12  # of its sights, that are looked at
    best_sights: int = 4  # of what the audit found, that tell whether it is doubtful
    max_places: int = 24  # that are looked at, those seen longest
    min_iou: float = 0.6  # of each sight's box and the middle one
    min_pixels: float = 20.0  # of a box's side; of what is smaller nobody can tell
    max_score: float = 0.75  # of the detector, the middle one
    patch_pixels: int = 24  # side of its small picture,
    margin_sides: float = 0.2  # which reaches beyond the box by so much
    min_spread: float = 8.0  # grey levels, of the small picture, so that changes would show
    max_change: float = 5.0  # grey levels, of any pixel of it
    min_change_elsewhere: float = 8.0  # of the whole picture, as small as others
    max_confidence: float = 0.1  # of points
    max_likeness: float = 6.0  # the landmarker's logit, the middle one


LIMITS = ThingLimits()


@dataclass(frozen=True, eq=False)
class Sights:
    """Detections at one place: (n,) frames, ascending; (n, 4) boxes; (n,) turns; (n,) scores; number of the cover."""

    frames: I32
    boxes: F32
    turns: F32
    scores: F32
    number: int = 0


@dataclass(frozen=True, eq=False)
class Thing:
    """What is no face: its box (4,), its small picture, and the number of the cover that it would be."""

    box: F32
    patch: U8
    number: int = 0

    def is_at(self, box: NDArray[np.floating]) -> bool:
        """Whether a box (4,) is where the thing is."""
        return iou(self.box, np.asarray(box, np.float32)) >= LIMITS.min_iou

    def is_bare(self, luma: U8) -> bool:
        """Whether it looks in a frame (h, w) as it did, so that nobody is before it."""
        return _is_same(self.patch, _patch(luma, self.box))


def find_things(case: Case, places: Iterable[Sights]) -> list[Thing]:
    """Those of some places that are things."""
    likely = sorted((one for one in places if _is_at_rest(one, case.rate)), key=lambda one: -len(one.frames))
    if not likely:
        return []
    judge = _Judge()
    judged = (judge.thing(case, one) for one in likely[: LIMITS.max_places])
    return [thing for thing in judged if thing is not None]


def find_doubtful(case: Case, places: Iterable[Sights]) -> list[F32]:
    """The boxes of those of some places that may be no faces: without points or a high score in all sights."""
    likely = [one for one in places if len(one.frames) > 1 and one.scores.max() < LIMITS.max_score]
    judge = _Judge() if likely else None
    return [_middle_of(one) for one in likely if judge is not None and judge.is_doubtful(case, one)]


def save_things(things: Sequence[Thing]) -> list[dict[str, Any]]:
    """As JSON holds them."""
    return [{"number": t.number, "box": t.box.tolist(), "patch": t.patch.tolist()} for t in things]


def known_things(case: Case) -> list[Thing]:
    """The things among the bystanders of a case."""
    known = case.work.load_json(THINGS) if case.work.has(THINGS) else []
    return [Thing(np.array(t["box"], np.float32), np.array(t["patch"], np.uint8), t["number"]) for t in known]


def _is_at_rest(one: Sights, rate: float) -> bool:
    """Whether sights are many, long enough, uncertain, and all at one place."""
    box = _middle_of(one)
    return (
        len(one.frames) >= LIMITS.min_sights
        and one.frames[-1] - one.frames[0] >= LIMITS.min_seconds * rate
        and float(np.median(one.scores)) < LIMITS.max_score
        and float((box[2:] - box[:2]).min()) >= LIMITS.min_pixels
        and min(iou(box, other) for other in one.boxes) >= LIMITS.min_iou
    )


def _middle_of(one: Sights) -> F32:
    return np.asarray(np.median(one.boxes, axis=0), np.float32)


class _Judge:
    """Looks at some sights of a place, closely."""

    def __init__(self) -> None:
        self._landmarker, self._shares = BuiltinLandmarker(), FaceShares()

    def thing(self, case: Case, one: Sights) -> Thing | None:
        """The thing, or None where it may be a face."""
        box = _middle_of(one)
        chosen = np.unique(np.linspace(0, len(one.frames) - 1, LIMITS.samples).round().astype(int))
        frames = [frame for k in chosen for frame in case.frames(int(one.frames[k]), int(one.frames[k]) + 1)]
        patches = [_patch(frame.luma, box) for frame in frames]
        first = patches[0] if patches else None
        if first is None or first.std() < LIMITS.min_spread or not _moves(frames):
            return None
        if not all(_is_same(first, patch) for patch in patches):
            return None
        pairs = list(zip(frames, one.turns[chosen].tolist(), strict=False))
        likeness = [self._likeness(frame.rgb(), box, turn) for frame, turn in pairs]
        return Thing(box, first, one.number) if np.median(likeness) < LIMITS.max_likeness else None

    def is_doubtful(self, case: Case, one: Sights) -> bool:
        """Whether the best sights of a place have no points, and look only a little like a face."""
        best = np.argsort(-one.scores, kind="stable")[: LIMITS.best_sights].tolist()
        looks = [
            self._landmarker.look_in_box(frame.rgb(), one.boxes[k], float(one.turns[k]))
            for k in best
            for frame in case.frames(int(one.frames[k]), int(one.frames[k]) + 1)
        ]
        return all(not _has_points(face) and likeness < LIMITS.max_likeness for face, likeness in looks)

    def _likeness(self, rgb: U8, box: F32, turn: float) -> float:
        """How much it looks like a face; infinitely where it has points or skin."""
        face, likeness = self._landmarker.look_in_box(rgb, box, turn)
        return np.inf if _has_points(face) or self._shares.has_face(rgb, box, turn) else likeness


def _has_points(face: Face | None) -> bool:
    return face is not None and face.confidence > LIMITS.max_confidence


def _moves(frames: Sequence[Frame]) -> bool:
    """Whether something changes in the picture: in a still one nobody moves."""
    small = [cv2.resize(f.luma, SMALL_SIZE, interpolation=cv2.INTER_AREA).astype(np.float64) for f in frames]
    return bool(np.ptp(small, axis=0).max() >= LIMITS.min_change_elsewhere)


def _patch(luma: U8, box: F32) -> U8 | None:
    margin = LIMITS.margin_sides * (box[2:] - box[:2])
    return small_picture(luma, np.concatenate([box[:2] - margin, box[2:] + margin]), LIMITS.patch_pixels)


def _is_same(one: U8, other: U8 | None) -> bool:
    return other is not None and int(cv2.absdiff(one, other).max()) <= LIMITS.max_change
