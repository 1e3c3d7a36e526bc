"""Second looks for faces in plain sight behind bars, wires, nets or letters, which a detector misses.

In a small picture fine lines fade, closing it fills dark ones with what is between them, and opening it fills light
ones.  A glance is one such picture at several scales.  What it shows is judged by how much the same place looks like a
face to the landmarker, filled and as it is.  Boxes ``x0 y0 x1 y1``, pixels; turns in radians, clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from guise.aam.landmarks.detector import MIN_FACE_PIXELS, FaceDetector
from guise.aam.landmarks.rolls import UPRIGHT, RolledBoxes, detect_at_rolls
from guise.common.arrays import F32, U8, Bool


@dataclass(frozen=True)
class GlanceLimits:
    """What is looked at, and what of the found counts."""

    longest_pixels: tuple[tuple[int, ...], ...] = ((320, 160, 80, 40), (452, 226, 113, 56))  # sides, in turn
    max_share: float = 0.8  # of the picture's longer side
    filled_finer: int = 2  # a picture is filled at a size larger by this than that in which it is searched,
    kernel_pixels: int = 9  # by a square of this side
    judged_face_pixels: int = 40  # of a face in a filled picture in which it is judged
    margin_faces: float = 1.5  # about a face, what is filled with it
    lines_levels: float = (
        50.0  # of 255, by which closed and opened differ where lines are before something, and
    )
    lines_share: float = 0.3  # of a picture, from which it is behind a pattern
    min_score: float = 0.5  # of the detector
    score_weight: float = 3.0  # of its logit beside the landmarker's:
    min_sum: float = 4.0  # from which it may be a face,
    sure_sum: float = 7.0  # and surely is one
    likely_score: float = 0.7  # from which it may be one whatever the landmarker says,
    certain_score: float = 0.9  # and surely is: it was not shown patterns


LIMITS = GlanceLimits()
_MAX_SCORE = 0.999
_FILLS = (None, cv2.MORPH_CLOSE, cv2.MORPH_OPEN)
CLOSED, OPENED = 1, 2
CYCLE = len(_FILLS) * len(LIMITS.longest_pixels)  # glances until all have been taken


class LikenessJudge(Protocol):
    """What tells how much a box looks like a face, as `BuiltinLandmarker.likeness` does."""

    def likeness(self, rgb: U8, box: F32, turn: float) -> float:
        """A logit."""


class Glancer:
    """Takes glances; for any number of threads."""

    def __init__(self) -> None:
        self._detector = FaceDetector(MIN_FACE_PIXELS, min_score=LIMITS.min_score)

    def faces(self, image: U8, number: int, quarter_turns: Sequence[int] = UPRIGHT) -> RolledBoxes:
        """What looks like a face.   number : of the glance; `CYCLE` in a row are all that there are."""
        number, fill = divmod(number, len(_FILLS))
        sides = LIMITS.longest_pixels[number % len(LIMITS.longest_pixels)]
        longest, found = max(image.shape), RolledBoxes.none()
        for side in (side for side in sides if side <= LIMITS.max_share * longest):
            finer = min(1.0, LIMITS.filled_finer * side / max(image.shape))
            image = filled(image, finer, 0) if finer < 1 else image  # each half as large as the one before
            small = filled(image, side / max(image.shape), fill)
            boxes = detect_at_rolls(self._detector, small, quarter_turns)
            found = found.and_others(boxes.scaled(longest / max(small.shape)))
        return found.distinct()

    def likely(
        self, judge: LikenessJudge, image: U8, number: int, certain: RolledBoxes | None = None
    ) -> RolledBoxes:
        """What may be an upright face, as a judge says, too.

        certain : faces that are known, which need no second look.
        """
        seen = self.faces(image, number)
        if certain is not None:
            seen = seen[~spans_any(seen.boxes, certain.boxes)]
        rows = zip(seen.boxes, seen.scores.tolist(), seen.turns.tolist(), strict=True)
        kept = [
            score >= LIMITS.likely_score or is_face(score, likeness_through(judge, image, box, turn))
            for box, score, turn in rows
        ]
        return seen[np.array(kept, bool)]


def spans_any(boxes: F32, others: F32) -> Bool:
    """(n,) whether boxes (n, 4) span the middle of any of others (m, 4).

    Such a box is the head of the other, seen coarsely, with its hair: the face of somebody nearer would hide the other.
    """
    middles = (others[:, :2] + others[:, 2:]) / 2
    spans = (boxes[:, None, :2] < middles) & (middles < boxes[:, None, 2:])
    return np.asarray(np.any(np.all(spans, axis=2), axis=1), bool)


def likeness_through(judge: LikenessJudge, rgb: U8, box: F32, turn: float) -> float:
    """How much a box looks like a face, filled or as it is: the largest logit."""
    side = float((box[2:] - box[:2]).max())
    factor = min(1.0, LIMITS.judged_face_pixels / max(side, 1.0))
    low = np.clip(box[:2] - LIMITS.margin_faces * side, 0, np.subtract(rgb.shape[1::-1], 1)).astype(int)
    high = np.clip(box[2:] + LIMITS.margin_faces * side, low + 1, rgb.shape[1::-1]).astype(int)
    part = rgb[low[1] : high[1], low[0] : high[0]]
    at = ((box - np.tile(low, 2) + 0.5) * factor - 0.5).astype(np.float32)
    views = [judge.likeness(filled(part, factor, fill), at, turn) for fill in range(len(_FILLS))]
    return max(judge.likeness(rgb, box, turn), *views)


def behind_lines(image: U8, longest_pixels: int) -> tuple[Bool, list[U8]]:
    """(h, w) where lines, or what is between them, are seen in a picture made small, and it with both filled."""
    views = [filled(image, min(1.0, longest_pixels / max(image.shape)), fill) for fill in (CLOSED, OPENED)]
    return cv2.absdiff(*views).max(2) >= LIMITS.lines_levels, views


def is_face(score: float, likeness: float) -> bool:
    """Whether detector and landmarker together say that a box seen at a glance may be a face's."""
    return score >= LIMITS.likely_score or _sum(score, likeness) >= LIMITS.min_sum


def is_surely_face(score: float, likeness: float) -> bool:
    """Whether they say that it is."""
    return score >= LIMITS.certain_score or _sum(score, likeness) >= LIMITS.sure_sum


def _sum(score: float, likeness: float) -> float:
    score = min(score, _MAX_SCORE)
    return LIMITS.score_weight * float(np.log(score / (1 - score))) + likeness


def filled(image: U8, factor: float, fill: int) -> U8:
    """A picture made smaller by a factor and filled in one of the ways."""
    how, size = _FILLS[fill], [max(1, round(side * factor)) for side in image.shape[1::-1]]
    if how is not None:
        if LIMITS.filled_finer * factor < 1:
            finer = [LIMITS.filled_finer * side for side in size]
            image = np.asarray(cv2.resize(image, finer, interpolation=cv2.INTER_AREA), np.uint8)
        kernel = np.ones((LIMITS.kernel_pixels,) * 2, np.uint8)
        image = np.asarray(cv2.morphologyEx(image, how, kernel), np.uint8)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
