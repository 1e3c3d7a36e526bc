"""How the landmarks move: S to S' measured without the head's motion, carried to T.  Pixels of each picture."""

from __future__ import annotations

import numpy as np

from guise.aam.similarity import Failed, Similarity, align
from guise.analogy.photo.pictures import PhotoError
from guise.common.arrays import F64

STILL = (36, 39, 42, 45, 27, 28, 29, 0, 1, 15, 16, 68, 69, 79, 80)  # landmarks that move with the skull
ROUNDS = 8  # of reweighting
NEAR = 0.002  # of the face's width, within which a landmark has not moved


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
        """Takes the expressive picture's pixels to the neutral source's, by what moves with the skull.

        Least distances, by reweighted least squares: eye corners and temples move a little with some expressions.
        """
        still = list(STILL)
        near = NEAR * float(np.ptp(self.source[:, 0]))
        weights = np.ones(len(STILL))
        for _ in range(ROUNDS):
            found = _aligned(points[still], self.source[still], weights)
            off = np.linalg.norm(found.apply(points[still]) - self.source[still], axis=1)
            weights = 1 / np.maximum(off, near)
        return found

    def __call__(self, points: F64, strength: float) -> F64:
        """The target's landmarks (81, 2) with the expression of the source's (81, 2)."""
        moved = self.pose(points).apply(points) - self.source
        return np.asarray(self.target + strength * moved @ self.to_target.linear.T)


def _aligned(points: F64, to: F64, weights: F64 | None) -> Similarity:
    found = align(points, to, weights)
    if isinstance(found, Failed):
        raise PhotoError(f"the landmarks make no face ({found.reason}): look at them, or give others")
    return found
