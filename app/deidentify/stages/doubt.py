"""Frames in which no face is swapped, looked at again: may one be behind something there?

All glances are taken.  What is surely a face is found, and what the detector takes for one in several of them; where
less is seen, or skin between bars, wires or letters, nobody can tell.  Boxes ``x0 y0 x1 y1``, pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import cv2
import numpy as np

from guise.aam.landmarks import iou
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.glances import (
    CYCLE,
    Glancer,
    behind_lines,
    is_surely_face,
    likeness_through,
)
from guise.aam.landmarks.glances import LIMITS as GLANCES
from guise.aam.landmarks.rolls import RolledBoxes
from guise.common.arrays import F32, F64, U8


@dataclass(frozen=True)
class DoubtLimits:
    """When nobody can tell."""

    min_score: float = 0.7  # of a box that is not surely a face's,
    sights: int = 2  # and of which so many glances, of all, show that it is one
    sight_iou: float = 0.2  # at its place
    skin_sides: tuple[int, int] = (160, 80)  # pixels, longer sides of pictures in which skin is looked for
    min_skin_share: float = 0.012  # in one piece, that is skin
    skin_red: tuple[int, int] = (136, 180)  # Cr and
    skin_blue: tuple[int, int] = (77, 127)  # Cb of skin, and
    min_skin_warmth: int = 10  # by how much the one is larger


LIMITS = DoubtLimits()
_KNOWN_LEVEL = 112  # grey


@dataclass(frozen=True, eq=False)
class Doubt:
    """What a second look says: faces, and whether there may be others."""

    faces: RolledBoxes
    is_unclear: bool


class DoubtSearch:
    """Looks again at frames; for any number of threads.   landmarker : the judge."""

    def __init__(self, landmarker: BuiltinLandmarker) -> None:
        self._landmarker, self._glancer = landmarker, Glancer()

    def look(self, rgb: U8, places: Sequence[F64]) -> Doubt:
        """A frame, beyond the places (4,) that are known."""
        if places:
            rgb = rgb.copy()
            for x0, y0, x1, y1 in np.maximum(places, 0).astype(int):
                rgb[y0 : y1 + 1, x0 : x1 + 1] = _KNOWN_LEVEL
        glances = [self._glancer.faces(rgb, number) for number in range(CYCLE)]
        seen = reduce(RolledBoxes.and_others, glances).distinct()
        rows = zip(seen.boxes, seen.scores.tolist(), seen.turns.tolist(), strict=True)
        sure = [
            (score >= LIMITS.min_score and _sights(box, glances) >= LIMITS.sights)
            or is_surely_face(score, likeness_through(self._landmarker, rgb, box, turn))
            for box, score, turn in rows
        ]
        faces = seen[np.array(sure, bool)]
        unclear = not len(faces) and (bool((seen.scores >= LIMITS.min_score).any()) or _has_skin_behind(rgb))
        return Doubt(faces, unclear)


def _sights(box: F32, glances: Sequence[RolledBoxes]) -> int:
    """How many glances show a face at the place of a box (4,)."""
    return sum(any(iou(box, other) > LIMITS.sight_iou for other in glance.boxes) for glance in glances)


def _has_skin_behind(rgb: U8) -> bool:
    """Whether skin is seen between what stands before it."""
    for side in LIMITS.skin_sides:
        is_behind, views = behind_lines(rgb, side)
        if is_behind.mean() < GLANCES.lines_share:
            continue
        for view in views:
            ycc = cv2.cvtColor(view, cv2.COLOR_RGB2YCrCb).astype(np.int16)
            red, blue = ycc[..., 1], ycc[..., 2]
            skin = is_behind & (red - blue > LIMITS.min_skin_warmth)
            for part, (low, high) in ((red, LIMITS.skin_red), (blue, LIMITS.skin_blue)):
                skin &= (part >= low) & (part <= high)
            whole = cv2.morphologyEx(skin.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
            areas = cv2.connectedComponentsWithStats(whole)[2][1:, cv2.CC_STAT_AREA]
            if len(areas) and areas.max() >= LIMITS.min_skin_share * whole.size:
                return True
    return False
