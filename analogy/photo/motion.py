"""How the landmarks move: S to S' measured without the head's motion, carried to T.  Pixels of each picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aam.reference import RIGID_WEIGHTS
from aam.similarity import Failed, Similarity, align
from analogy.photo.pictures import PhotoError

F64 = NDArray[np.float64]


class Motion:
    """Carries the motion of a source's landmarks to a target's.

    Parameters
    ----------
    source, target : (81, 2) landmarks of the neutral pictures.

    Raises
    ------
    PhotoError
        When either has no extent.
    """

    def __init__(self, source: F64, target: F64) -> None:
        self.source, self.target = source, target
        self.to_target = _aligned(source, target, None)

    def pose(self, points: F64) -> Similarity:
        """Takes the expressive picture's pixels to the neutral source's, by what moves with the skull."""
        return _aligned(points, self.source, RIGID_WEIGHTS)

    def __call__(self, points: F64, strength: float) -> F64:
        """The target's landmarks (81, 2) with the expression of the source's (81, 2)."""
        moved = self.pose(points).apply(points) - self.source
        return np.asarray(self.target + strength * moved @ self.to_target.linear.T)


def _aligned(points: F64, to: F64, weights: F64 | None) -> Similarity:
    found = align(points, to, weights)
    if isinstance(found, Failed):
        raise PhotoError(f"the landmarks make no face ({found.reason}): look at them, or give others")
    return found
