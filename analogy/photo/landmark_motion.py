"""Motion of the landmarks from S to S' without that of the head, transferred to T.  Pixels of each picture."""

from __future__ import annotations

import numpy as np

from guise.aam.landmarks.schemes import EYE_CORNERS, FOREHEAD, JAW, NOSE_BRIDGE
from guise.aam.similarity import Failed, PlanarSimilarity, Similarity, align, align_planar
from guise.analogy.photo.pictures import PhotoError
from guise.common.arrays import F64

SKULL_ENDS = [0, 1, -2, -1]  # of jaw and forehead, at the temples
# Landmarks that move with the skull.
SKULL_LANDMARKS = np.concatenate([EYE_CORNERS, NOSE_BRIDGE[:3], JAW[SKULL_ENDS], FOREHEAD[SKULL_ENDS]])
REWEIGHTING_ROUNDS = 8
STILL_FACE_WIDTHS = 0.002  # within which a landmark has not moved


class LandmarkMotion:
    """Transfers the motion of the landmarks of a source to those of a target.

    Parameters
    ----------
    source, target : (81, 2) landmarks of the neutral pictures.

    Raises
    ------
    PhotoError
        When the landmarks of either coincide.
    """

    def __init__(self, source: F64, target: F64) -> None:
        self.source, self.target = source, target
        self.to_target = _align(source, target, None)

    def pose(self, points: F64) -> Similarity:
        """The similarity from pixels of the expressive picture to the neutral source, from landmarks on the skull.

        Least absolute distances by reweighted least squares, as eye corners and temples move with some expressions.
        """
        skull = points[SKULL_LANDMARKS], self.source[SKULL_LANDMARKS]
        near = STILL_FACE_WIDTHS * float(np.ptp(self.source[:, 0]))
        weights = np.ones(len(SKULL_LANDMARKS))
        found: Similarity | PlanarSimilarity = _align(*skull, weights)
        for _ in range(REWEIGHTING_ROUNDS - 1):
            off = np.linalg.norm(found.apply(skull[0]) - skull[1], axis=1)
            weights = 1 / np.maximum(off, near)
            found = align_planar(*skull, weights / weights.sum())
        return _align(*skull, weights)

    def __call__(self, points: F64, strength: float) -> F64:
        """Landmarks (81, 2) of the target with the expression of the source landmarks (81, 2)."""
        moved = self.pose(points).apply(points) - self.source
        return np.asarray(self.target + strength * moved @ self.to_target.linear.T)


def _align(points: F64, to: F64, weights: F64 | None) -> Similarity:
    found = align(points, to, weights)
    if isinstance(found, Failed):
        raise PhotoError(f"the landmarks do not form a face ({found.reason}): check them, or give others")
    return found
