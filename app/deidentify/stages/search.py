"""Searches pictures of the audit for faces, not in the way in which the first stage finds them.

By a network of another kind, at any roll and two sizes in turn, or by a detector of the user's choice; what it finds is
judged by how much it looks like a face.  Boxes ``x0 y0 x1 y1`` of the 68 iBUG points, pixels; turns in radians, by
which a face is rolled clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guise.aam.changes import Part
from guise.aam.landmarks.boxes import is_same
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.glances import is_surely_face, likeness_through
from guise.aam.landmarks.registry import DetectorPerThread
from guise.aam.landmarks.rolls import RolledBoxes, detect_at_rolls
from guise.aam.landmarks.voting import VotingDetector
from guise.app.deidentify.stages.doubt import Doubt, DoubtSearch
from guise.app.people.faces import LIMITS as FACES
from guise.app.people.faces import is_worn_below
from guise.app.people.skin import FaceShares
from guise.common.arrays import F32, F64, U8


@dataclass(frozen=True)
class SearchLimits:
    """What is searched for, and what is taken for a face."""

    smallest_face_pixels: tuple[float, float] = (30.0, 44.0)  # in turn
    min_score: float = 0.45  # of the detector, and
    min_likeness: float = 0.0  # of the landmarker, where the detector's is at least
    certain_score: float = 0.75  # and below that,
    min_likeness_uncertain: float = 2.0  # with points of at least
    min_confidence: float = 0.3  # this confidence,
    min_likeness_no_points: float = 4.0  # without, as of a profile, if it has skin or
    high_likeness: float = 6.0  # this likeness,
    min_likeness_negative: float = 8.0  # and without in the negative of what may be none
    max_beyond_share: float = 0.15  # of a box's width beyond a side, from which it is cut and
    min_likeness_cut: float = 3.0  # needs this: beside its mirror image much looks like a face


LIMITS = SearchLimits()
_OTHER_TURN = 2 * np.pi / 3  # radians: the landmarker knows faces that are turned by 60 degrees


class AuditSearch:
    """Searches pictures for faces by another detector than the first stage's.

    detector : as `guise.aam.landmarks.open_detector` takes it, or None.
    """

    def __init__(self, detector: str | None) -> None:
        self._given = DetectorPerThread(detector) if detector else None
        self._own = VotingDetector(LIMITS.min_score)
        self._landmarker, self._shares = BuiltinLandmarker(), FaceShares()
        self._doubts = DoubtSearch(self._landmarker)

    def doubt(self, rgb: U8, places: Sequence[F64]) -> Doubt:
        """What patterns may hide in a picture beyond places (4,)."""
        return self._doubts.look(rgb, places)

    def faces(
        self,
        rgb: U8,
        turn_to: int | None,
        within: Sequence[Part] | None = None,
        *,
        is_doubtful: bool = False,
    ) -> RolledBoxes:
        """Boxes that also look like a face to the landmarker.

        turn_to : which of the sizes is searched, counted on; None for all.
        within : the parts that are searched (left, top, right, bottom); None for all.
        is_doubtful : whether much that is no face looks like one, as in a negative of what may be none.
        """
        no_points = LIMITS.min_likeness_negative if is_doubtful else LIMITS.min_likeness_no_points
        parts = [(0, 0, *rgb.shape[1::-1])] if within is None else within
        found = RolledBoxes.none()
        for left, top, right, bottom in parts:
            here = self._boxes(np.ascontiguousarray(rgb[top:bottom, left:right]), turn_to)
            found = found.and_others(here.moved(left, top))
        turns = np.full(len(found), np.nan, np.float32)
        for k in np.argsort(-found.scores, kind="stable"):
            known = found.boxes[~np.isnan(turns)]
            if not any(is_same(found.boxes[k], box) for box in known):
                score, turn = float(found.scores[k]), float(found.turns[k])
                turns[k] = self._likely_turn(rgb, found.boxes[k], score, turn, no_points)
        turns[[self._is_print(rgb, k, found, turns) for k in range(len(found))]] = np.nan
        is_face = ~np.isnan(turns)
        return RolledBoxes(found.boxes[is_face], found.scores[is_face], turns[is_face]).distinct()

    def _is_print(self, rgb: U8, k: int, found: RolledBoxes, turns: F32) -> bool:
        """Whether the k-th box is on the clothes below a sure, upright face, uncertain and without points."""
        is_sure = (found.scores >= LIMITS.certain_score) & (np.abs(turns) < FACES.upright_radians)
        box, turn = found.boxes[k], float(turns[k])
        if np.isnan(turn) or found.scores[k] >= LIMITS.certain_score:
            return False
        if not any(is_worn_below(box, face) for face in found.boxes[is_sure]):
            return False
        return self._landmarker.look_in_box(rgb, box, turn)[0] is None

    def _likely_turn(self, rgb: U8, box: F32, score: float, turn: float, no_points: float) -> float:
        """The turn at which a box is a face's, NaN if at none; a sure one may be turned otherwise, or behind bars."""
        if self._has_face(rgb, box, score, turn, no_points):
            return turn
        if score < LIMITS.certain_score or _is_cut(box, rgb.shape[1]):
            return float(np.nan)
        for other in (turn + _OTHER_TURN, turn - _OTHER_TURN):
            if self._landmarker.likeness(rgb, box, other) >= LIMITS.min_likeness_no_points:
                return other
        likeness = likeness_through(self._landmarker, rgb, box, turn)
        return turn if is_surely_face(score, likeness) else float(np.nan)

    def _has_face(self, rgb: U8, box: F32, score: float, turn: float, no_points: float) -> bool:
        likeness = self._landmarker.likeness(rgb, box, turn)
        if score >= LIMITS.certain_score:
            cut = _is_cut(box, rgb.shape[1])
            return likeness >= (LIMITS.min_likeness_cut if cut else LIMITS.min_likeness)
        if likeness < LIMITS.min_likeness_uncertain:
            return False
        face, _ = self._landmarker.look_in_box(rgb, box, turn)
        if face is not None and face.confidence >= LIMITS.min_confidence:
            return is_same(box, face.box)  # or it is about another face beside it
        is_like = likeness >= no_points
        return is_like and (likeness >= LIMITS.high_likeness or self._shares.has_face(rgb, box, turn))

    def is_alike(self, luma: U8, box: NDArray[np.floating], turn: float) -> bool:
        """Whether a box of a grey picture (h, w) looks like a face, also behind bars."""
        grey, place = np.dstack([luma] * 3), np.asarray(box, np.float32)
        if self._landmarker.likeness(grey, place, turn) >= LIMITS.min_likeness:
            return True
        return likeness_through(self._landmarker, grey, place, turn) >= LIMITS.min_likeness

    def _boxes(self, rgb: U8, turn_to: int | None) -> RolledBoxes:
        if self._given is not None:
            given = self._given.own()
            found = detect_at_rolls(given, rgb)
            boxes = [given.fit.apply(b, float(t)) for b, t in zip(found.boxes, found.turns, strict=True)]
            placed = np.array(boxes, np.float32).reshape(-1, 4)
            return RolledBoxes(placed, found.scores, found.turns)[found.scores >= LIMITS.min_score]
        sizes = LIMITS.smallest_face_pixels
        found = RolledBoxes.none()
        for smallest in sizes if turn_to is None else (sizes[turn_to % len(sizes)],):
            found = found.and_others(self._own.search(rgb, smallest))
        return found


def _is_cut(box: F32, width: int) -> bool:
    """Whether a box reaches far beyond the left or right side."""
    reach = LIMITS.max_beyond_share * (box[2] - box[0])
    return bool(box[0] < -reach or box[2] > width + reach)
