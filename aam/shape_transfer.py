"""Another face on a head: the donor's features in their own proportions, moved as far as the head's own move.

At rest the donor's face is laid over the source's, by the similarity and the turn that bring all points nearest: the
two were enrolled at different distances and turned differently, up and down above all.  Then it is drawn to the outline
of the head, less and less inwards, so that neither a second chin nor a squeezed face shows.  From there every point
goes as far as the source's tracked one.  Lids move by ratio, so that shut eyes are shut whatever the size of either
person's eyes; inner lips that touch touch.  Grid pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    LOWER_INNER_LIP,
    LOWER_LIDS,
    OUTLINE,
    SILHOUETTE,
    UPPER_INNER_LIP,
    UPPER_LIDS,
)
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F64

MAX_LID_RATIO = 1.7  # opening of the lids, of the neutral one
MIN_GAP_GRID_PIXELS = 1e-3  # by which openings are divided


@dataclass(frozen=True)
class LayingLimits:
    """How a face is laid over another and drawn to its outline; lengths in face widths."""

    turn_cost_per_degree: float = 0.0014  # as much as that mean distance of the points
    outline_reach: float = 0.28  # from the outline, over which points follow it
    outline_softness: float = 0.03  # added to distances from the outline's points


LIMITS = LayingLimits()


class ShapeTransfer:
    """Carries tracked shapes of a source person over to a target.

    What it makes lies where the source's face, aligned with the reference frame, lies.

    Parameters
    ----------
    source, target : (81, 2) the two faces at rest, aligned with the reference frame.
    reference : ReferenceFrame.
    """

    def __init__(self, source: F64, target: F64, reference: ReferenceFrame) -> None:
        self._reference, self._from = reference, source
        over = laid_over(target, source, reference)
        self._to = over + outline_pull(reference) @ (source - over)

    @property
    def rest(self) -> F64:
        """(81, 2) the target's face at rest on the source's head."""
        return self._to

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


def laid_over(face: F64, other: F64, reference: ReferenceFrame) -> F64:
    """A face (81, 2) moved, scaled, rolled and turned (yaw and pitch) to lie on another (81, 2).

    Least squares over all points, with the turn held back a little: what is left are the proportions of the face.
    """
    middle = face.mean(0)
    level = face - middle
    ways = np.stack(
        [
            level,
            np.column_stack([-level[:, 1], level[:, 0]]),
            np.tile([1.0, 0.0], (len(face), 1)),
            np.tile([0.0, 1.0], (len(face), 1)),
            reference.yaw_mode,
            reference.pitch_mode,
        ],
        axis=-1,
    )
    cost = len(face) * (LIMITS.turn_cost_per_degree * reference.resolution) ** 2
    flat = ways.reshape(-1, ways.shape[-1])
    normal = flat.T @ flat + np.diag([0, 0, 0, 0, cost, cost])
    return np.asarray(middle + ways @ np.linalg.solve(normal, flat.T @ (other - middle).ravel()))


def outline_pull(reference: ReferenceFrame) -> F64:
    """(81, 81) weights by which each point follows the outline's points, which follow fully."""
    points = reference.points / reference.resolution
    hull = points[SILHOUETTE].astype(np.float32)
    inside = np.array([cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in points]).clip(0)
    squared = ((points[:, None] - points[OUTLINE]) ** 2).sum(2) + LIMITS.outline_softness**2
    near = squared**-1.5
    pull = np.zeros((len(points), len(points)))
    pull[:, OUTLINE] = (
        np.exp(-((inside / LIMITS.outline_reach) ** 2))[:, None] * near / near.sum(1, keepdims=True)
    )
    pull[OUTLINE] = np.eye(len(points))[OUTLINE]
    return pull


def _gaps(shape: F64, upper: np.ndarray, lower: np.ndarray) -> F64:
    return np.asarray(shape[lower, 1] - shape[upper, 1])


def _divisor(gaps: F64) -> F64:
    return np.maximum(gaps, MIN_GAP_GRID_PIXELS)


def _open(shape: F64, upper: np.ndarray, lower: np.ndarray, gaps: F64) -> None:
    """Move points apart about their middles until the vectors from upper to lower are `gaps` (n, 2)."""
    middle = (shape[upper] + shape[lower]) / 2
    shape[upper], shape[lower] = middle - gaps / 2, middle + gaps / 2
