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
    RIGID_WEIGHTS,
    SILHOUETTE,
    UPPER_INNER_LIP,
    UPPER_LIDS,
)
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Failed, align, align_planar
from guise.aam.solid_shape import HeadPose, SolidFit
from guise.common.arrays import F32, F64, Int
from guise.common.kernels import kernel
from guise.common.small import mean

FEATURES = np.concatenate([BROWS, NOSE, EYES, LIPS])  # whose places are learned
DATA = Path(__file__).parent / "data" / "placement.npz"
MAX_INPUT = 3.0  # standard deviations
MAX_LID_RATIO = 1.7  # opening of the lids, of the neutral one
INSIDE_FACE_WIDTHS = (
    0.012  # of the head's silhouette, where brows and eyes end: the hull is not exact, nor hollow
)
MIN_GAP_GRID_PIXELS = 1e-3  # by which openings are divided
_LIDS: Int = np.array([UPPER_LIDS, LOWER_LIDS])
_LIPS: Int = np.array([UPPER_INNER_LIP, LOWER_INNER_LIP])


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
        resolution = reference.resolution
        self._limits = np.array(
            [MAX_INPUT, MAX_LID_RATIO, INSIDE_FACE_WIDTHS * resolution, MIN_GAP_GRID_PIXELS, resolution]
        )

    def apply(self, shape: F64, pose: HeadPose) -> F64:
        """The target's shape (81, 2) on the grid for a tracked one (81, 2) in frame pixels, of a head in that pose."""
        made, network, reference = np.empty(shape.shape), placement(), self._reference
        transfer_shape(
            np.ascontiguousarray(shape, np.float64), reference.points, RIGID_WEIGHTS, np.ascontiguousarray(pose.linear),
            self._from, self.solid, *network.numbers,
            FEATURES if self._learned else FEATURES[:0], len(BROWS), _LIDS, _LIPS, BROWS_AND_EYES, self._limits, made,
        )  # fmt: skip
        return made

    def at_rest(self, shape: F64, pose: HeadPose) -> F64:
        """The target's shape (81, 2) at rest, anywhere on the grid, as it is seen where a tracked one (81, 2) lies."""
        return np.asarray(self.solid @ (pose.linear @ self._reference.to_grid(shape).linear))

    def inputs(self, shape: F64, pose: HeadPose) -> F64:
        """(2, 81, 2) what `Placement` sees, face widths: the source's movement, and how the target differs at rest.

        Differences only: what rendered faces have in common differs a little from what real ones have.
        """
        reference = self._reference
        seen = _seen(shape, reference.points, RIGID_WEIGHTS, pose.linear, self._from, self.solid)
        return _inputs(*seen, reference.resolution)


@kernel
def transfer_shape(
    shape: F64, points: F64, rigid: F64, linear: F64, source: F64, target: F64, centre: F32, scale: F32, weight_0: F32,
    bias_0: F32, weight_1: F32, bias_1: F32, weight_2: F32, bias_2: F32, features: Int, held: int, lids: Int, lips: Int,
    drawn: Int, limits: F64, made: F64,
) -> None:  # fmt: skip
    """The target's shape on the grid for a tracked one.

    Parameters
    ----------
    shape : (v, 2) tracked, pixels of the frame.
    points, rigid : (v, 2) grid pixels, and (v,) weights by which the shape is aligned with them.
    linear : (3, 2), see `HeadPose`.
    source, target : (v, 3) face widths, both at rest on the source's head.
    centre .. bias_2 : of `Placement`.
    features, held : (f,) the points that it corrects, none if it doesn't, of which so many first ones as at rest.
    lids, lips : (2, n) upper and lower points.
    drawn : (d,) the points that stay inside the head's silhouette.
    limits : (5,) standard deviations of an input and ratio of lids at most; grid pixels within the silhouette, of the
        gap by which is divided, and across the face.
    made : (v, 2) grid pixels, which is written.
    """
    most, most_open, inside, gap, resolution = limits.tolist()
    seen, own, other = _seen(shape, points, rigid, linear, source, target)
    made[:] = seen + other - own
    if len(features):
        inputs = _inputs(seen, own, other, resolution)
        both = np.array([inputs, [np.zeros_like(inputs[0]), inputs[1]]]).reshape(2, -1)
        network = centre, scale, weight_0, bias_0, weight_1, bias_1, weight_2, bias_2
        moved, still = _through(both, most, *network).reshape(2, -1, 2)
        moved[:held] = still[:held]  # the network takes a part of their way for an error
        made[features] += resolution * moved
    (upper, lower), (seen_gaps, own_gaps) = lids, (s[lids[1], 1] - s[lids[0], 1] for s in (seen, own))
    opening = np.minimum(np.maximum(seen_gaps / np.maximum(own_gaps, gap), 0), most_open)
    _open(made, upper, lower, opening[:, None] * (other[lower] - other[upper]))
    _open(made, lips[0], lips[1], _lip_gaps(seen, own, other, lips, gap))
    beyond, out = beyond_hull(made[drawn], seen)
    made[drawn] -= np.maximum(beyond + inside, 0)[:, None] * out


def _seen(shape: F64, points: F64, rigid: F64, linear: F64, source: F64, target: F64) -> tuple[F64, F64, F64]:
    """(v, 2) on the grid: the tracked shape; source and target at rest as they are turned, anywhere."""
    to_grid = align_planar(shape, points, rigid)
    view = linear @ to_grid.linear
    return to_grid.apply(shape), source @ view, target @ view


def _inputs(seen: F64, own: F64, other: F64, resolution: float) -> F64:
    """See `ShapeTransfer.inputs`."""
    movement = seen - own
    return np.array([movement - mean(movement, 0), other - own]) / resolution


class Placement:
    """A small network that tells how far features lie from where they belong (`training/placement.py`).

    How expression and turn move another's features isn't known from points at rest; rendered swaps show it.
    """

    def __init__(self, path: Path) -> None:
        with np.load(path) as stored:
            arrays = {name: np.ascontiguousarray(stored[name], np.float32) for name in stored.files}
        self.numbers = (
            arrays["centre"], arrays["scale"], arrays["weight_0"], arrays["bias_0"],
            arrays["weight_1"], arrays["bias_1"], arrays["weight_2"], arrays["bias_2"],
        )  # fmt: skip

    def __call__(self, inputs: F64) -> F64:
        """(.., features, 2) in face widths for inputs (.., 2, 81, 2) of `ShapeTransfer`; more than usual is cut."""
        values = _through(inputs.reshape(*inputs.shape[:-3], -1), MAX_INPUT, *self.numbers)
        return np.asarray(values, np.float64).reshape(*inputs.shape[:-3], -1, 2)


def _through(values: F64, most: float, centre: F32, scale: F32, *layers: F32) -> F64:
    """What the network makes of inputs (.., n)."""
    values = np.minimum(np.maximum((values - centre) / scale, -most), most)
    for number, (weight, bias) in enumerate(zip(layers[::2], layers[1::2], strict=True)):
        if number:
            values = values / (1 + np.exp(-values))
        values = values @ weight + bias
    return values


@cache
def placement() -> Placement:
    """The network that ships with the package."""
    return Placement(DATA)


def _lip_gaps(seen: F64, own: F64, target: F64, lips: Int, gap: float) -> F64:
    """(3, 2) from upper to lower inner lips: the source's, plus the difference of the two neutral ones.

    That difference fades as the source's lips close, so that they touch when the source's do.
    """
    gaps, usual, other = [s[lips[1]] - s[lips[0]] for s in (seen, own, target)]
    opening = np.minimum(np.maximum(gaps[:, 1] / np.maximum(usual[:, 1], gap), 0), 1)
    return np.asarray(gaps + opening[:, None] * (other - usual))


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


def _open(shape: F64, upper: np.ndarray, lower: np.ndarray, gaps: F64) -> None:
    """Move points apart about their middles until the vectors from upper to lower are `gaps` (n, 2)."""
    middle = (shape[upper] + shape[lower]) / 2
    shape[upper], shape[lower] = middle - gaps / 2, middle + gaps / 2
