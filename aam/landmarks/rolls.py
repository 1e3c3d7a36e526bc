"""Faces at any roll, by detectors of upright faces that search the picture turned by quarter turns.

A quarter turn is a whole number k: faces rolled clockwise by about 90 k degrees are upright in the picture turned back
by as much.  Faces between two of them (45 degrees) are found at either.  Pixels, x right, y down, pixel centres at
integers; turns in radians, by which a face is rolled clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.boxes import strongest_indices
from guise.aam.landmarks.schemes import mean_geometry
from guise.aam.similarity import align_complex
from guise.common.arrays import F32, F64, U8, Floating

UPRIGHT = (0,)
TURNED = (1, 2, 3)
HALF_TURN = 2
EVERY_ROLL = (*UPRIGHT, *TURNED)
_TURNED_INTERVAL = 3  # pictures from one search at another roll than upright to the next
SCHEDULE_FRAMES = _TURNED_INTERVAL * len(TURNED)
_TURNS = (0.0, np.pi / 2, np.pi, -np.pi / 2)
_TURN_BACK = {1: cv2.ROTATE_90_COUNTERCLOCKWISE, 2: cv2.ROTATE_180, 3: cv2.ROTATE_90_CLOCKWISE}


class ScoredDetector(Protocol):
    """A face detector that scores its boxes, as `guise.aam.landmarks.detector.FaceDetector` does."""

    def detect_scored(self, image: U8) -> tuple[F32, F32]:
        """Boxes (n, 4) and their scores (n,)."""


@dataclass(frozen=True, eq=False)
class RolledBoxes:
    """Boxes (n, 4) ``x0 y0 x1 y1`` of the picture, scores (n,), and turns (n,) by quarters."""

    boxes: F32
    scores: F32
    turns: F32

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.boxes)

    def __getitem__(self, chosen: Any) -> RolledBoxes:
        """Some of the boxes, by indices or flags."""
        return RolledBoxes(self.boxes[chosen], self.scores[chosen], self.turns[chosen])

    @classmethod
    def none(cls) -> RolledBoxes:
        """No boxes."""
        return cls(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), np.zeros(0, np.float32))

    def and_others(self, others: RolledBoxes) -> RolledBoxes:
        """Both together."""
        pairs = zip(vars(self).values(), vars(others).values(), strict=True)
        return RolledBoxes(*(np.concatenate(pair) for pair in pairs))

    def scaled(self, factor: float) -> RolledBoxes:
        """The boxes in a picture that is larger by a factor."""
        return RolledBoxes(
            (self.boxes + np.float32(0.5)) * np.float32(factor) - np.float32(0.5), self.scores, self.turns
        )

    def moved(self, right: float, down: float) -> RolledBoxes:
        """The boxes in a picture of which this one is a part whose corner is that far right and down."""
        return RolledBoxes(
            self.boxes + np.array([right, down, right, down], np.float32), self.scores, self.turns
        )

    def distinct(self) -> RolledBoxes:
        """Of boxes that overlap, the one with the highest score; largest first.

        What looks like a rolled face within a stronger box is a part of that face.
        """
        kept = self[strongest_indices(self.boxes, self.scores, 0.0)]
        centres = (kept.boxes[:, :2] + kept.boxes[:, 2:]) / 2
        above, below = centres[:, None] > kept.boxes[:, :2], centres[:, None] < kept.boxes[:, 2:]
        within = (above & below).all(2) & (kept.scores > kept.scores[:, None])  # of the first in the second
        return kept[~(within.any(1) & (kept.turns != 0))]


def detect_at_rolls(
    detector: ScoredDetector, image: U8, quarter_turns: Sequence[int] = EVERY_ROLL
) -> RolledBoxes:
    """Faces at some rolls.

    One face may have a box at several rolls, and the one with the highest score is not always the right one: the
    landmarker tells, by the confidence of the points.
    """
    found = RolledBoxes.none()
    for quarter_turn in quarter_turns:
        boxes, scores = detector.detect_scored(_turned_back(image, quarter_turn))
        boxes = _in_picture(boxes, quarter_turn, image.shape[1], image.shape[0])
        turns = np.full(len(boxes), _TURNS[quarter_turn], np.float32)
        found = found.and_others(RolledBoxes(boxes, scores, turns))
    return found


def detect_on_schedule(
    detector: ScoredDetector, image: U8, index: int, sure_score: float, *, small: bool = True
) -> RolledBoxes:
    """Faces upright, and at other rolls: all where no upright face is sure, otherwise one in every third picture.

    They are searched at half the size first, where large ones are surer.

    index : of the picture in a video; every roll is searched within `SCHEDULE_FRAMES`.
    sure_score : of an upright face.
    small : whether small faces are searched even beside one that is sure; they are in every third picture.
    """
    large = detect_at_rolls(detector, halved(image), UPRIGHT).scaled(2)
    sure = large[large.scores >= sure_score]
    count, rest = divmod(index, _TURNED_INTERVAL)
    one = () if rest else (TURNED[count % len(TURNED)],)
    if rest and not small and len(sure):
        return large
    upright = detect_at_rolls(detector, image, UPRIGHT).and_others(sure)
    upright = upright[strongest_indices(upright.boxes, upright.scores, 0.0)]
    is_sure = bool((upright.scores >= sure_score).any())
    return upright.and_others(detect_at_rolls(detector, image, one if is_sure else TURNED))


def halved(image: U8) -> U8:
    """A picture at half the size; of even sides many times faster than at another share of it."""
    size = [max(1, side // 2) for side in image.shape[1::-1]]
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def nearest_quarter(turn: float) -> int:
    """The quarter turn, 0 to 3, next to a turn.

    >>> [nearest_quarter(turn) for turn in (0.5, 1.5, -1.5, 3.1, -3.1)]
    [0, 1, 3, 2, 2]
    """
    return round(turn / (np.pi / 2)) % 4


def turn_of(points: NDArray[Any]) -> float:
    """The turn of a face with points (81, 2), from all of them: a profile's eyes alone would not tell.

    >>> mean = mean_geometry().mean
    >>> round(turn_of(np.stack([-mean.imag, mean.real], axis=-1)) / np.pi, 6)
    0.5
    """
    scale, _ = align_complex(mean_geometry().mean, points[:, 0] + 1j * points[:, 1])
    return float(np.angle(scale[0]))


def upward(turn: float) -> F64:
    """Unit vector (2,) from chin to forehead of a face with that turn."""
    return np.array([np.sin(turn), -np.cos(turn)])


def _turned_back(image: U8, quarter_turn: int) -> U8:
    return np.asarray(cv2.rotate(image, _TURN_BACK[quarter_turn]), np.uint8) if quarter_turn else image


def _in_picture(boxes: Floating, quarter_turn: int, width: int, height: int) -> F32:
    """Boxes (n, 4) of the picture turned back as boxes of the picture itself, of a size in pixels."""
    x0, y0, x1, y1 = np.asarray(boxes).T
    moved = {
        0: (x0, y0, x1, y1),
        1: (width - 1 - y1, x0, width - 1 - y0, x1),
        2: (width - 1 - x1, height - 1 - y1, width - 1 - x0, height - 1 - y0),
        3: (y0, height - 1 - x1, y1, height - 1 - x0),
    }[quarter_turn]
    return np.stack(moved, axis=1).astype(np.float32)
