"""A landmarker that looks again only at what has changed, for faces that are looked at in every frame.

Whether something has changed is told from small pictures of it, in which a camera's noise averages out.  They are
compared with those of the last real look, so that slow changes add up.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face, iou, tight_box
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.rolls import halved
from guise.aam.landmarks.schemes import IBUG68
from guise.app.people.skin import FaceShares
from guise.common.arrays import F32, U8


@dataclass(frozen=True)
class LookLimits:
    """What counts as the same place, and as the same picture."""

    min_iou: float = 0.8  # of the boxes
    margin_sides: float = 0.15  # of a box, beyond it
    patch_pixels: int = 16  # side of the small picture
    halved_sides: int = 6  # of it, from which a picture is halved first
    max_grey_levels: int = 2  # by which any of its pixels may differ
    kept: int = 64  # looks
    refused_likeness: float = -6.0  # a logit, far below that of any face
    refused_looks: int = 3  # for which a place so refused is left alone, whatever changes there


LIMITS = LookLimits()


@dataclass(frozen=True, eq=False)
class _Look:
    """What was seen: box (4,), turn, or None of a face that was followed, small picture, face and likeness.

    rests : how often it may be taken for what is there now, though that has changed.
    """

    box: F32
    turn: float | None
    patch: U8
    face: Face | None
    likeness: float
    rests: int = 0


class Looks:
    """The built-in landmarker; its faces have the box of their 68 iBUG points, as the detector's boxes are."""

    name = BuiltinLandmarker.name

    def __init__(self, landmarker: BuiltinLandmarker) -> None:
        self._landmarker, self._shares = landmarker, FaceShares()
        self._kept: deque[_Look] = deque(maxlen=LIMITS.kept)
        self._skin: deque[_Look] = deque(maxlen=LIMITS.kept)  # of which only the likeness counts

    def detect(self, rgb: U8) -> list[Face]:
        """All faces."""
        return [_boxed(face) for face in self._landmarker.detect(rgb)]

    def refine(self, rgb: U8, previous: Face) -> Face | None:
        """The face of the frame before in this one."""
        if (kept := self._unchanged(rgb, previous.box, None)) is not None:
            return kept.face
        face = self._landmarker.refine(rgb, previous)
        if face is None:
            return None
        face = _boxed(face)
        self._keep(rgb, face.box, None, face, 0.0)
        return face

    def look_in_box(self, rgb: U8, box: F32, turn: float = 0.0) -> tuple[Face | None, float]:
        """The face in a box, and how much the box looks like one."""
        if (kept := self._unchanged(rgb, box, turn)) is not None:
            return kept.face, kept.likeness
        face, likeness = self._landmarker.look_in_box(rgb, box, turn)
        face = None if face is None else _boxed(face)
        self._keep(rgb, box, turn, face, likeness)
        return face, likeness

    def face_in_box(self, rgb: U8, box: F32, turn: float) -> Face | None:
        """The face in a box."""
        return self.look_in_box(rgb, box, turn)[0]

    def likeness(self, rgb: U8, box: F32, turn: float) -> float:
        """How much a box looks like a face."""
        return self._landmarker.likeness(rgb, box, turn)

    def has_skin(self, rgb: U8, box: F32, turn: float) -> bool:
        """Whether something in a box is parsed as a face."""
        if (known := self._unchanged(rgb, box, turn, self._skin)) is not None:
            return known.likeness > 0
        has = self._shares.has_face(rgb, box, turn)
        if (patch := _patch(rgb, box)) is not None:
            self._skin.append(_Look(box, turn, patch, None, float(has)))
        return has

    def _unchanged(
        self, rgb: U8, box: F32, turn: float | None, known: deque[_Look] | None = None
    ) -> _Look | None:
        """The last look at a box, if the picture has not changed there.   known : looks, the last one last."""
        for look in reversed(self._kept if known is None else known):
            if look.turn == turn and iou(look.box, box) >= LIMITS.min_iou:
                now = _patch(rgb, look.box)
                is_same = (
                    now is not None and int(cv2.absdiff(now, look.patch).max()) <= LIMITS.max_grey_levels
                )
                if is_same or not look.rests:
                    return look if is_same else None
                self._kept.append(replace(look, box=box, rests=look.rests - 1))
                return look
        return None

    def _keep(self, rgb: U8, box: F32, turn: float | None, face: Face | None, likeness: float) -> None:
        if (patch := _patch(rgb, box)) is not None:
            is_refused = turn is not None and face is None and likeness < LIMITS.refused_likeness
            rests = LIMITS.refused_looks if is_refused else 0
            self._kept.append(_Look(box, turn, patch, face, likeness, rests))


def _boxed(face: Face) -> Face:
    return replace(face, box=tight_box(face.points[IBUG68]))


def _patch(rgb: U8, box: F32) -> U8 | None:
    """The green of a box (4,) and of what is about it, small."""
    margin = LIMITS.margin_sides * (box[2:] - box[:2])
    return small_picture(rgb, np.concatenate([box[:2] - margin, box[2:] + margin]), LIMITS.patch_pixels)


def small_picture(picture: NDArray[Any], box: NDArray[np.floating], side: int) -> U8 | None:
    """A box (4,) of a picture (h, w), or of the green of one (h, w, 3), with so many pixels a side; None beside it."""
    limit = np.array(picture.shape[1::-1])
    x0, y0 = np.clip(np.floor(box[:2]), 0, limit).astype(int)
    x1, y1 = np.clip(np.ceil(box[2:]) + 1, 0, limit).astype(int)
    if x1 - x0 < 2 or y1 - y0 < 2:
        return None
    part = picture[y0:y1, x0:x1]
    part = np.ascontiguousarray(part) if part.ndim == 2 else np.asarray(cv2.extractChannel(part, 1))
    while min(part.shape) >= LIMITS.halved_sides * side:
        part = halved(part[: part.shape[0] // 2 * 2, : part.shape[1] // 2 * 2])
    return np.asarray(cv2.resize(part, (side, side), interpolation=cv2.INTER_AREA), np.uint8)
