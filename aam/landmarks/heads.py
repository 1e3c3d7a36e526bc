"""The rectangle of a head: forehead, ears and chin of a face at any roll, from the box of its 68 iBUG points.

Pixels, x right, y down; boxes ``x0 y0 x1 y1``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.rolls import upward
from guise.common.arrays import F64, Floating

_OUTWARD = np.array([[-1, 0], [0, -1], [1, 0], [0, 1]])


@dataclass(frozen=True)
class HeadMargins:
    """By how much a head is larger than the box of its points."""

    side_box_widths: float = 0.30  # on either side
    above_box_heights: float = 0.60
    below_box_heights: float = 0.25


MARGINS = HeadMargins()


def region(box: Floating, growth: float = 1.0, turn: float = 0.0) -> F64:
    """The rectangle (4,) x0 y0 x1 y1 of the head of a face with a box (4,).

    growth : of the rectangle about its centre.   turn : radians, by which the face is rolled clockwise.

    >>> region(np.array([0, 0, 100, 100])).round(0).tolist()
    [-30.0, -60.0, 130.0, 125.0]
    >>> region(np.array([0, 0, 100, 100]), turn=np.pi).round(0).tolist()
    [-30.0, -25.0, 130.0, 160.0]
    """
    x0, y0, x1, y1 = (float(v) for v in box)
    along, across = np.cos(turn) ** 2, np.sin(turn) ** 2
    width, height = (x1 - x0) * along + (y1 - y0) * across, (x1 - x0) * across + (y1 - y0) * along
    rises = _OUTWARD @ upward(turn)  # of the left, upper, right and lower edge, towards the forehead
    beyond = np.where(rises > 0, MARGINS.above_box_heights, MARGINS.below_box_heights) * height
    margins = rises**2 * beyond + (1 - rises**2) * MARGINS.side_box_widths * width
    grown = np.array([x0, y0, x1, y1]) + margins * (-1, -1, 1, 1)
    centre, half = (grown[:2] + grown[2:]) / 2, growth * (grown[2:] - grown[:2]) / 2
    return np.concatenate([centre - half, centre + half])
