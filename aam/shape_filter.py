"""Temporal filter of tracked landmarks: removes jitter, adds no lag to what moves.

Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import EYES_AND_LIPS, LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.tracker import FEATURE_RESOLUTION
from guise.common.arrays import F64


@dataclass(frozen=True)
class ShapeFilterLimits:
    """Thresholds of the temporal filter."""

    head_jitter_interocular: float = 0.005  # smaller steps of the head count as jitter
    feature_jitter_interocular: float = 0.0025  # the same for lids and lips
    neighbour_face_widths: float = 0.06  # over which points jitter together


LIMITS = ShapeFilterLimits()


class ShapeFilter:
    """Removes the jitter of tracked points without delaying what moves.

    Each point goes k = m^2 / (m^2 + c^2) of the way to where it is seen.  m is the recent mean of the steps that it and
    its neighbours would take: jitter changes sign and cancels, motion persists.  c is the `head_jitter_interocular`
    of the limits for the head and `feature_jitter_interocular` for lids and lips.  So noise is averaged over many
    frames, while a blink or a syllable (many times c) passes at once and a slow drift is followed within about c.
    """

    def __init__(self, limits: ShapeFilterLimits = LIMITS) -> None:
        points = ReferenceFrame.canonical(FEATURE_RESOLUTION).points / FEATURE_RESOLUTION
        squared = ((points[:, None] - points) ** 2).sum(2)
        near = np.exp(-squared / (2 * limits.neighbour_face_widths**2))
        jitter = np.full(POINTS, limits.head_jitter_interocular)
        jitter[EYES_AND_LIPS] = limits.feature_jitter_interocular
        self._gain = near / near.sum(1, keepdims=True) / jitter[:, None] ** 2
        self.reset()

    def reset(self) -> None:
        """The next shape passes unfiltered."""
        self._last: F64 | None = None
        self._mean_step = np.zeros((POINTS, 2))

    def __call__(self, shape: F64) -> F64:
        """The filtered shape (81, 2), pixels."""
        if self._last is None:
            self._last = shape
            return shape
        step = shape - self._last
        self._mean_step = (self._mean_step + step) / 2
        moved = (
            self._gain
            @ np.add.reduce(self._mean_step**2, 1)
            / max(float(np.add.reduce((shape[LEFT_EYE_OUTER] - shape[RIGHT_EYE_OUTER]) ** 2)), 1e-6)
        )
        share = (moved / (1 + moved))[:, None]
        self._last = self._last + share * step
        self._mean_step *= 1 - share
        return self._last
