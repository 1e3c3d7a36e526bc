"""Brows set onto their hair: a landmarker that has seen few raised brows leaves its points below them.

The parsing (`parsing.py`) tells which pixels are hair of a brow.  How far its upper edge lies from the points differs
little between people; where it lies higher or lower, turned or arched otherwise, the points move along.  Lengths in
face widths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW, RIGID_WEIGHTS
from guise.aam.parsing import FaceClass, Parsing
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import align_planar
from guise.common.arrays import F64
from guise.common.interpolation import interpolation

# (12,) how far below the line through a brow's points its hair begins, from the outer end to the inner one: medians of
# the people of the sample clips (`training/brow_edges.py`).
USUAL_EDGE = np.array([-53, -42, -25, -11, -7, 0, 8, 13, 17, 4, -9, -19]) / 1000


@dataclass(frozen=True)
class BrowLiftLimits:
    """Where hair is looked for, and how much of what is found counts."""

    above: float = 0.11  # of the line through a brow's points
    below: float = 0.09
    row: float = 0.005  # between the places that are looked at
    edge: float = 0.1  # share of a column's hair that lies above its upper edge
    whole_column: float = 0.015  # of hair, from which a column counts fully
    believed: tuple[float, float] = (0.5, 0.8)  # share of such columns, at which not at all and fully
    stiffness: tuple[float, float, float] = (0.0, 0.75, 1.25)  # against a shift, a turn, an arch; columns
    strength: float = 0.75
    memory: float = 0.85  # share of the last frame's shifts that is kept


LIMITS = BrowLiftLimits()
BROW_PAIR = RIGHT_BROW, LEFT_BROW
_ROWS = np.arange(-LIMITS.above, LIMITS.below, LIMITS.row)
_ALONG = interpolation(np.linspace(0, 4, len(USUAL_EDGE)), np.arange(5.0))  # from a brow's points to columns
# Shift, turn and arch of columns and of points, and what they are held back by.
_COLUMNS, _POINTS = (
    np.vander(np.linspace(-1, 1, n), len(LIMITS.stiffness), increasing=True) for n in (len(USUAL_EDGE), 5)
)
_STIFF = np.diag(np.maximum(LIMITS.stiffness, 1e-6))


class BrowLift:
    """Sets the brows of one face onto their hair, frame by frame, steadily; a new one for a single picture."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin with the next face."""
        self._shifts: F64 | None = None  # (2, 5) of the points of both brows

    @property
    def has_seen(self) -> bool:
        """Whether a face was seen since the last reset."""
        return self._shifts is not None

    def see(self, parsing: Parsing, points: F64) -> None:
        """Look at the brows of a parsed face with points (81, 2), pixels, as they were found."""
        down = face_width_down(points)
        right, left = (edge_of_hair(parsing, points[brow], down) for brow in BROW_PAIR)
        found = np.array([_shifts(*right, USUAL_EDGE), _shifts(*left, USUAL_EDGE[::-1])])
        self._shifts = found if self._shifts is None else found + LIMITS.memory * (self._shifts - found)

    def __call__(self, points: F64) -> F64:
        """Points (81, 2) as they were found, pixels, with the brows on their hair as it was seen last."""
        lifted = points.copy()
        if self._shifts is not None:
            down = face_width_down(points)
            for brow, shifts in zip(BROW_PAIR, self._shifts, strict=True):
                lifted[brow] += shifts[:, None] * down
        return lifted


def face_width_down(points: F64) -> F64:
    """(2,) pixels, a face width down a face with points (81, 2)."""
    reference = ReferenceFrame.canonical()
    return np.asarray(reference.resolution * align_planar(reference.points, points, RIGID_WEIGHTS).linear[1])


def edge_of_hair(parsing: Parsing, brow: F64, down: F64) -> tuple[F64, F64]:
    """How far below the line through a brow's points (5, 2) its hair begins, in columns along it, and their weights.

    down : (2,) pixels, a face width down the face.
    """
    places = (_ALONG @ brow)[:, None] + _ROWS[:, None] * down
    hair = parsing.at(places.reshape(-1, 2), parsing.shares[FaceClass.BROWS]).reshape(places.shape[:2])
    amount = hair.sum(1)
    above = np.cumsum(hair, axis=1) / np.maximum(amount, 1e-6)[:, None]
    columns, after = np.arange(len(above)), (above > LIMITS.edge).argmax(1)
    low, high = above[columns, after - 1], above[columns, after]
    edges = _ROWS[after] - LIMITS.row * (high - LIMITS.edge) / np.maximum(high - low, 1e-6)
    edges = np.where(after > 0, edges, _ROWS[0])
    return edges, np.clip(amount * LIMITS.row / LIMITS.whole_column, 0, 1)


def _shifts(edges: F64, weights: F64, usual: F64) -> F64:
    """(5,) by how much a brow's points belong lower: a smooth fit to its edge."""
    weighted = _COLUMNS * weights[:, None]
    fit = np.linalg.solve(_COLUMNS.T @ weighted + _STIFF, weighted.T @ (edges - usual))
    believed = float(np.interp(weights.mean(), LIMITS.believed, (0, 1)))
    return np.asarray(LIMITS.strength * believed * (_POINTS @ fit))
