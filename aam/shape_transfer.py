"""Expressions of a shape carried over one to one: the donor's neutral shape plus what the source's face moves by.

Lids move by ratio, so that shut eyes are shut whatever the size of either person's eyes; inner lips that touch touch.
Grid pixels, x right, y down.
"""

from __future__ import annotations

import numpy as np

from guise.aam.appearance import AppearanceModel
from guise.aam.extrapolation import turned_neutral
from guise.aam.landmarks.schemes import LOWER_INNER_LIP, LOWER_LIDS, UPPER_INNER_LIP, UPPER_LIDS
from guise.common.arrays import F64

MAX_LID_RATIO = 1.7  # opening of the lids, of the neutral one
MIN_GAP_GRID_PIXELS = 1e-3  # by which openings are divided


class ShapeTransfer:
    """Carries tracked shapes of a source person over to a target; both models share their reference frame."""

    def __init__(self, source: AppearanceModel, target: AppearanceModel) -> None:
        self._reference = target.reference
        self._from = self._reference.align(source.neutral_shape)
        self._to = target.shape_of(turned_neutral(target, source))

    def apply(self, shape: F64) -> F64:
        """The target's shape (81, 2) on the grid for a tracked shape (81, 2) in frame pixels."""
        seen = self._reference.align(shape)
        made = self._to + seen - self._from
        opening = _gaps(seen, UPPER_LIDS, LOWER_LIDS) / _divisor(_gaps(self._from, UPPER_LIDS, LOWER_LIDS))
        lids = np.clip(opening, 0, MAX_LID_RATIO)[:, None] * (self._to[LOWER_LIDS] - self._to[UPPER_LIDS])
        _open(made, UPPER_LIDS, LOWER_LIDS, lids)
        _open(made, UPPER_INNER_LIP, LOWER_INNER_LIP, self._lip_gaps(seen))
        return np.asarray(made)

    def _lip_gaps(self, seen: F64) -> F64:
        """(3, 2) from upper to lower inner lips: the source's, plus the difference of the two neutral ones.

        That difference fades as the source's lips close, so that they touch when the source's do.
        """
        gaps, own, target = (s[LOWER_INNER_LIP] - s[UPPER_INNER_LIP] for s in (seen, self._from, self._to))
        opening = np.clip(gaps[:, 1] / _divisor(own[:, 1]), 0, 1)
        return np.asarray(gaps + opening[:, None] * (target - own))


def _gaps(shape: F64, upper: np.ndarray, lower: np.ndarray) -> F64:
    return np.asarray(shape[lower, 1] - shape[upper, 1])


def _divisor(gaps: F64) -> F64:
    return np.maximum(gaps, MIN_GAP_GRID_PIXELS)


def _open(shape: F64, upper: np.ndarray, lower: np.ndarray, gaps: F64) -> None:
    """Move points apart about their middles until the vectors from upper to lower are `gaps` (n, 2)."""
    middle = (shape[upper] + shape[lower]) / 2
    shape[upper], shape[lower] = middle - gaps / 2, middle + gaps / 2
