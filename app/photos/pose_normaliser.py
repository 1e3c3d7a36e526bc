"""Landmarks of a face with the head pose of another picture, so that a turn does not count as expression.

Pixels, x right, y down.
"""

from __future__ import annotations

import numpy as np

from guise.aam.landmarks.schemes import RIGID_WEIGHTS
from guise.aam.similarity import align_planar
from guise.app.photos.faces import pose_remover
from guise.app.swapping.puppet import PINNED_POINTS
from guise.common.arrays import F64


class PoseNormaliser:
    """Normalises head poses to that of a neutral picture.

    Parameters
    ----------
    neutral : (81, 2) landmarks.
    """

    def __init__(self, neutral: F64) -> None:
        self._frame, self._remover = pose_remover()
        self._neutral, self._rest = neutral, self._frame.align(neutral)
        self._linear = align_planar(self._frame.points, neutral, RIGID_WEIGHTS).linear

    def __call__(self, points: F64) -> F64:
        """Landmarks (81, 2) of another picture, moved to the head pose of the neutral one; the skull does not move."""
        moved = self._remover.without(self._frame.align(points) - self._rest)
        moved[PINNED_POINTS] = 0
        return np.asarray(self._neutral + moved @ self._linear)
