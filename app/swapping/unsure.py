"""What is done to a frame in which the person's face cannot be swapped but may still be visible.

Pixels as shown, x right, y down; boxes x0 y0 x1 y1 of the 68 iBUG points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from guise.aam.landmarks import iou
from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import ScoredDetector, detect_on_schedule, turn_of
from guise.aam.landmarks.schemes import IBUG68
from guise.app.media import Frame
from guise.app.swapping.cover import CoverStyle, cover
from guise.common.arrays import F32, F64

Unsure = Literal["cover", "hold", "leave"]
UNSURE_HOLD_FRAMES = 30  # for which "hold" keeps the last face where it was


@dataclass(frozen=True)
class CoverLimits:
    """Thresholds for covering a lost face."""

    min_score: float = 0.15  # of a box where the person was
    min_first_score: float = 0.5  # of a box before the person was seen at all
    sure_score: float = 0.75  # of an upright box, beside which not all rolls are searched in each frame
    min_iou: float = 0.15  # of a box with where the person was
    blind_frames: int = 8  # for which the last region stays covered although nothing is detected there
    growth_per_frame: float = 0.02  # of the region meanwhile


LIMITS = CoverLimits()


class LostFaceCover:
    """Covers a lost person's face while it may be visible; one call of `seen` or `cover` per frame, in order.

    Parameters
    ----------
    detector : looks for the face in frames in which it is lost; the built-in one, made when it is first needed.
    style : of the cover.
    """

    def __init__(self, detector: ScoredDetector | None = None, style: CoverStyle = "mosaic") -> None:
        self._detector, self._style = detector, style
        self._box: F64 | None = None
        self._turn = 0.0  # radians, by which the face is rolled clockwise
        self._blind_frames = 0

    def seen(self, mesh: F64) -> None:
        """The face was drawn on a mesh (81, 2) in this frame."""
        inner = mesh[IBUG68]
        self._box, self._blind_frames = np.concatenate([inner.min(0), inner.max(0)]), 0
        self._turn = turn_of(mesh)

    def fade(self, frame: Frame, share: float) -> None:
        """Lay the cover over the face that `seen` was told of by a share in [0, 1], as a head turns away."""
        if share > 0 and self._box is not None:
            cover(frame, region(self._box, 1.0, self._turn), self._style, share)

    def cover(self, frame: Frame) -> bool:
        """Cover where the person's face may be, in place; whether anything was covered."""
        found = self._detected(frame)
        if found is not None:
            (self._box, self._turn), self._blind_frames = found, 0
        else:
            self._blind_frames += 1
        if self._box is None or self._blind_frames > LIMITS.blind_frames:
            return False
        growth = 1 + LIMITS.growth_per_frame * self._blind_frames
        return cover(frame, region(self._box, growth, self._turn), self._style) is not None

    def _detected(self, frame: Frame) -> tuple[F64, float] | None:
        """Box and turn of the face detected where the person was, or of the largest clear one before that."""
        if self._detector is None:
            self._detector = FaceDetector(min_score=LIMITS.min_score)
        found = detect_on_schedule(
            self._detector, frame.quick_rgb(), frame.index, LIMITS.sure_score
        ).distinct()
        if self._box is None:
            sizes = np.where(found.scores >= LIMITS.min_first_score, [_area(box) for box in found.boxes], 0.0)
            least = 0.0
        else:
            last = self._box.astype(np.float32)
            sizes = np.array([iou(box, last) for box in found.boxes])
            least = LIMITS.min_iou
        best = int(np.argmax(sizes)) if len(sizes) else -1
        if best < 0 or sizes[best] <= least:
            return None
        return found.boxes[best].astype(np.float64), float(found.turns[best])


def _area(box: F32) -> float:
    return float(np.prod(box[2:] - box[:2]))
