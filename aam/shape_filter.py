"""Temporal filter of tracked landmarks: removes jitter, adds no lag to what moves.

Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import EYES_AND_LIPS, OUTER_EYE_CORNERS
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.tracker import FEATURE_RESOLUTION
from guise.common.arrays import F64, Int
from guise.common.kernels import kernel


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
        self._last = self._last.copy()
        filter_shape(np.ascontiguousarray(shape), self._gain, OUTER_EYE_CORNERS, self._mean_step, self._last)
        return self._last


@kernel
def filter_shape(shape: F64, gain: F64, eyes: Int, steps: F64, filtered: F64) -> None:
    """Move filtered points towards where they are seen.

    Parameters
    ----------
    shape : (n, 2), pixels.
    gain : (n, n), by which points' squared steps count for each, over the noise, in squared inter-ocular distances.
    eyes : (2,) the outer eye corners.
    steps, filtered : (n, 2), pixels, the recent mean of the steps and the filtered points, which are changed.
    """
    step = shape - filtered
    steps[:] = (steps + step) / 2
    apart = max(float(np.add.reduce(np.subtract(*shape[eyes]) ** 2)), 1e-6)
    moved = gain @ np.add.reduce(steps**2, 1) / apart
    share = (moved / (1 + moved))[:, None]
    filtered += share * step
    steps *= 1 - share
