"""Faces that the left or right side of the picture cuts at about their middle, or beyond it.

A detector looks for the centres of faces, and theirs lie outside.  Beside its mirror image such a part looks like a
whole face, whose centre lies on the side.  Upright faces; pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.rolls import RolledBoxes, ScoredDetector
from guise.common.arrays import U8


@dataclass(frozen=True)
class SideLimits:
    """What is mirrored, and what of the found counts."""

    strip_share: float = 0.25  # of the picture's longer side, the width of what is mirrored
    max_offset_box_widths: float = 0.1  # of a box's centre from the side
    min_score: float = 0.5  # of the detector: other things look like faces, too, beside their mirror images


LIMITS = SideLimits()


def detect_at_sides(detector: ScoredDetector, image: U8) -> RolledBoxes:
    """Boxes of parts of faces with their mirror images, whose centres lie on the left or right side.

    image : (h, w, 3) RGB or (h, w) grey.
    """
    left = _at_left(detector, image)
    right = _at_left(detector, image[:, ::-1])
    right.boxes[:, [0, 2]] = image.shape[1] - 1 - right.boxes[:, [2, 0]]
    return left.and_others(right)


def _at_left(detector: ScoredDetector, image: U8) -> RolledBoxes:
    width = min(image.shape[1], int(np.ceil(LIMITS.strip_share * max(image.shape[:2]))))
    strip = image[:, :width]
    boxes, scores = detector.detect_scored(np.concatenate([strip[:, ::-1], strip], axis=1))
    boxes = boxes - np.array([width, 0, width, 0], np.float32)
    offset = np.abs((boxes[:, 0] + boxes[:, 2]) / 2)
    is_cut = offset <= LIMITS.max_offset_box_widths * (boxes[:, 2] - boxes[:, 0])
    turns = np.zeros(len(boxes), np.float32)
    return RolledBoxes(boxes, scores, turns)[is_cut & (scores >= LIMITS.min_score)]
