"""Another face on a head: the donor's features in their own proportions, moved as far as the head's own move.

At rest and in 3-D the donor's face is laid over the source's, by the similarity that brings all points nearest.  Then
it is drawn to the outline of the head, less and less inwards, so that no second chin shows; by a share, the jaw line
keeps the donor's form, if the frame is to follow it (`app/drawing/passes/place.py`).  What is left of their difference
may be exaggerated, so that less of the source remains.  How the two differ is seen as the head is turned in the frame,
and added to the source's tracked points, so that every point goes as far as the source's; a small network corrects the
features' places.  Lids move by ratio, so that shut eyes are shut whatever the size of either person's eyes; inner lips
that touch touch.  Grid pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from guise.aam.hull import beyond_hull
from guise.aam.landmarks.schemes import (
    BROWS,
    BROWS_AND_EYES,
    EYES,
    JAW,
    LEFT_BROW,
    LEFT_EYE,
    LIPS,
    LOWER_INNER_LIP,
    LOWER_LIDS,
    NOSE,
    OUTLINE,
    RIGHT_BROW,
    RIGHT_EYE,
    SILHOUETTE,
    UPPER_INNER_LIP,
    UPPER_LIDS,
)
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Failed, align
from guise.aam.solid_shape import HeadPose, SolidFit
from guise.common.arrays import F64
from guise.common.small import mean

FEATURES = np.concatenate([BROWS, NOSE, EYES, LIPS])  # whose places are learned
DATA = Path(__file__).parent / "data" / "placement.npz"
MAX_INPUT = 3.0  # standard deviations
MAX_LID_RATIO = 1.7  # opening of the lids, of the neutral one
INSIDE_FACE_WIDTHS = (
    0.012  # of the head's silhouette, where brows and eyes end: the hull is not exact, nor hollow
)
MIN_GAP_GRID_PIXELS = 1e-3  # by which openings are divided


@dataclass(frozen=True)
class LayingLimits:
    """How a face is laid over another and drawn to its outline; lengths in face widths."""

    outline_reach: float = 0.28  # from the outline, over which points follow it
    outline_softness: float = 0.03  # added to distances from the outline's points
    max_jaw_move: float = 0.06  # of a jaw point, away from the head's outline
    still_jaw_points: float = 3.0  # at either end, over which the moves of the others fade: ears stay


LIMITS = LayingLimits()


class ShapeTransfer:
    """Carries tracked shapes of a source person over to a target.

    What it makes lies where the source's face, aligned with the reference frame, lies.

    Parameters
    ----------
    source, target : SolidFit of the two faces at rest.
    reference : ReferenceFrame.
    outline : share in [0, 1] by which the jaw line has the target's form instead of the head's.
    apart : share by which the two faces differ more at rest than they do, but for the forms of features.
    learned : whether the features' places are corrected by what was learned from rendered swaps.

    Attributes
    ----------
    source, target : SolidFit of the two at rest.
    solid : (81, 3) the target's face at rest on the source's head.
    """

    def __init__(
        self, source: SolidFit, target: SolidFit, reference: ReferenceFrame, *, outline: float = 0.0,
        apart: float = 0.0, learned: bool = True,
    ) -> None:  # fmt: skip
        self.source, self.target = source, target
        self._reference, self._learned = reference, learned
        self._from = source.rest
        over = laid_over(target.rest, self._from)
        goal = self._from.copy()
        goal[JAW, :2] += jaw_moves(goal[JAW, :2], over[JAW, :2], outline)
        fitted = over + outline_pull(reference) @ (goal - over)
        self.solid = _farther(fitted, self._from, apart) if apart else fitted

    def apply(self, shape: F64, pose: HeadPose) -> F64:
        """The target's shape (81, 2) on the grid for a tracked one (81, 2) in frame pixels, of a head in that pose."""
        seen, own, target = self._seen(shape, pose)
        made = seen + target - own
        if self._learned:
            made[FEATURES] += self._reference.resolution * self._corrections(seen, own, target)
        opening = _gaps(seen, UPPER_LIDS, LOWER_LIDS) / _divisor(_gaps(own, UPPER_LIDS, LOWER_LIDS))
        opening = np.minimum(np.maximum(opening, 0), MAX_LID_RATIO)
        lids = opening[:, None] * (target[LOWER_LIDS] - target[UPPER_LIDS])
        _open(made, UPPER_LIDS, LOWER_LIDS, lids)
        _open(made, UPPER_INNER_LIP, LOWER_INNER_LIP, _lip_gaps(seen, own, target))
        _draw_in(made, seen, INSIDE_FACE_WIDTHS * self._reference.resolution)
        return np.asarray(made)

    def at_rest(self, shape: F64, pose: HeadPose) -> F64:
        """The target's shape (81, 2) at rest, anywhere on the grid, as it is seen where a tracked one (81, 2) lies."""
        return np.asarray(self.solid @ (pose.linear @ self._reference.to_grid(shape).linear))

    def _corrections(self, seen: F64, own: F64, target: F64) -> F64:
        """(features, 2) face widths; of brows as at rest, as the network takes a part of their way for an error."""
        inputs = self._inputs(seen, own, target)
        at_rest = np.array([np.zeros_like(inputs[0]), inputs[1]])
        moved, still = placement()(np.array([inputs, at_rest]))
        moved[: len(BROWS)] = still[: len(BROWS)]
        return np.asarray(moved)

    def inputs(self, shape: F64, pose: HeadPose) -> F64:
        """(2, 81, 2) what `Placement` sees, face widths: the source's movement, and how the target differs at rest.

        Differences only: what rendered faces have in common differs a little from what real ones have.
        """
        return self._inputs(*self._seen(shape, pose))

    def _inputs(self, seen: F64, own: F64, target: F64) -> F64:
        movement = seen - own
        return np.array([movement - mean(movement, 0), target - own]) / self._reference.resolution

    def _seen(self, shape: F64, pose: HeadPose) -> tuple[F64, F64, F64]:
        """(81, 2) on the grid: the tracked shape; source and target at rest as they are turned, anywhere."""
        to_grid = self._reference.to_grid(shape)
        view = pose.linear @ to_grid.linear
        return to_grid.apply(shape), self._from @ view, self.solid @ view


class Placement:
    """A small network that tells how far features lie from where they belong (`training/placement.py`).

    How expression and turn move another's features isn't known from points at rest; rendered swaps show it.
    """

    def __init__(self, path: Path) -> None:
        with np.load(path) as stored:
            arrays = {name: stored[name].astype(np.float32) for name in stored.files}
        self._centre, self._scale = arrays["centre"], arrays["scale"]
        self._layers = [(arrays[f"weight_{i}"], arrays[f"bias_{i}"]) for i in range(len(arrays) // 2 - 1)]

    def __call__(self, inputs: F64) -> F64:
        """(.., features, 2) in face widths for inputs (.., 2, 81, 2) of `ShapeTransfer`; more than usual is cut."""
        values = (inputs.reshape(*inputs.shape[:-3], -1) - self._centre) / self._scale
        values = np.minimum(np.maximum(values, -MAX_INPUT), MAX_INPUT)
        for number, (weight, bias) in enumerate(self._layers):
            if number:
                values = values / (1 + np.exp(-values))
            values = values @ weight + bias
        return np.asarray(values, np.float64).reshape(*inputs.shape[:-3], -1, 2)


@cache
def placement() -> Placement:
    """The network that ships with the package."""
    return Placement(DATA)


def _lip_gaps(seen: F64, own: F64, target: F64) -> F64:
    """(3, 2) from upper to lower inner lips: the source's, plus the difference of the two neutral ones.

    That difference fades as the source's lips close, so that they touch when the source's do.
    """
    gaps, usual, other = [s[LOWER_INNER_LIP] - s[UPPER_INNER_LIP] for s in (seen, own, target)]
    opening = np.minimum(np.maximum(gaps[:, 1] / _divisor(usual[:, 1]), 0), 1)
    return np.asarray(gaps + opening[:, None] * (other - usual))


def _draw_in(made: F64, seen: F64, inside: float) -> None:
    """Move brows and eyes that stick out of the head (81, 2), which is turned then, to inside its silhouette."""
    features = made[BROWS_AND_EYES]
    beyond, out = beyond_hull(features, seen)
    made[BROWS_AND_EYES] = features - np.maximum(beyond + inside, 0)[:, None] * out


def laid_over(face: F64, other: F64) -> F64:
    """A solid face (81, 3) moved, scaled and turned to lie on another (81, 3): what is left are its proportions."""
    placed = align(face, other)
    return face if isinstance(placed, Failed) else placed.apply(face)


def _farther(face: F64, other: F64, share: float) -> F64:
    """A solid face (81, 3), by a share farther from another (81, 3); eyes with brows, and the mouth, move as wholes.

    A brow that went its own way would frown, or be surprised.
    """
    moves = share * (face - other)
    for part in (np.r_[RIGHT_BROW, RIGHT_EYE], np.r_[LEFT_BROW, LEFT_EYE], LIPS):
        moves[part] = moves[part].mean(0)
    return np.asarray(face + moves)


def jaw_moves(jaw: F64, other: F64, share: float) -> F64:
    """(17, 2) by which a jaw line (17, 2) goes a share in [0, 1] of the way to another one, within the limits.

    Across itself only: where along the line its points lie says nothing of its form.
    """
    across = np.gradient(jaw, axis=0)[:, ::-1] * [1, -1]
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    limit = LIMITS.max_jaw_move * float(np.ptp(jaw[:, 0]))
    lengths = limit * np.tanh(share * ((other - jaw) * across).sum(1) / limit)
    from_end = np.arange(len(jaw)) / LIMITS.still_jaw_points
    movable = np.minimum(np.minimum(from_end, from_end[::-1]), 1)
    return np.asarray(across * (lengths * movable)[:, None])


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
