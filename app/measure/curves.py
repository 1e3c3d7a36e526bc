"""What a face does, from its landmarks: expression curves, pose, jitter, and how much of it a second face keeps.

Landmarks (n, 81, 2) pixels, x right, y down.  Curves are in inter-ocular distances (lids in widths of the eye), so that
distance from the camera does not enter.  Angles in degrees: yaw to the right of the picture, pitch up, roll clockwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import (
    EYE_CORNERS,
    LEFT_BROW,
    LEFT_EYE_CORNERS,
    LEFT_EYE_OUTER,
    LEFT_LOWER_LID,
    LEFT_MOUTH_CORNER,
    LEFT_UPPER_LID,
    LOWER_LIP_INNER,
    NOSE,
    RIGHT_BROW,
    RIGHT_EYE_CORNERS,
    RIGHT_EYE_OUTER,
    RIGHT_LOWER_LID,
    RIGHT_MOUTH_CORNER,
    RIGHT_UPPER_LID,
    RIGID_WEIGHTS,
    UPPER_LIP_INNER,
    Group,
)
from guise.aam.similarity import align_planar
from guise.common.arrays import F64

MIN_CORRELATION_FRAMES = 10
MIN_DEVIATION_EYE_DISTANCES = 0.005  # standard deviation of a curve, below which it does not move
# Points that move with the skull, and where they lie in inter-ocular distances from the middle between the outer eye
# corners, x right, y down, z away: means over the clips of seven rendered people.
SKULL = (*EYE_CORNERS, *NOSE)
SKULL_3D = np.array(
    [
        [-0.500, 0.000, 0.000], [-0.221, 0.025, -0.039], [0.221, 0.025, -0.039], [0.500, 0.000, 0.000],
        [0.000, 0.020, -0.175], [0.000, 0.142, -0.232], [0.000, 0.299, -0.336], [0.000, 0.458, -0.399],
        [-0.183, 0.526, -0.164], [-0.109, 0.531, -0.211], [0.000, 0.552, -0.268], [0.109, 0.531, -0.211],
        [0.183, 0.526, -0.164],
    ]
)  # fmt: skip
ANGLES = ("yaw", "pitch", "roll")


def _distance(points: F64, a: int | np.intp, b: int | np.intp) -> F64:
    return np.asarray(np.linalg.norm(points[:, a] - points[:, b], axis=1))


def _lids(points: F64, corners: Group, upper: Group, lower: Group) -> F64:
    """Opening of an eye over its width."""
    opening = (_distance(points, upper[0], lower[0]) + _distance(points, upper[1], lower[1])) / 2
    return np.asarray(opening / np.maximum(_distance(points, corners[0], corners[1]), 1e-6))


def _brow(points: F64, brow: Group, eye: Group) -> F64:
    """Mean height of a brow over the line through the corners of its eye, in inter-ocular distances."""
    along = points[:, eye[1]] - points[:, eye[0]]
    up = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.maximum(
        np.linalg.norm(along, axis=1)[:, None], 1e-6
    )
    away = points[:, brow].mean(1) - (points[:, eye[0]] + points[:, eye[1]]) / 2
    return np.asarray((away * up).sum(1) / _eyes(points))


def _eyes(points: F64) -> F64:
    return np.maximum(np.asarray(interocular(points), np.float64), 1e-6)


# The person's right is the left of the picture.
CURVES: Mapping[str, Callable[[F64], F64]] = {
    "mouth opening": lambda p: _distance(p, UPPER_LIP_INNER, LOWER_LIP_INNER) / _eyes(p),
    "mouth width": lambda p: _distance(p, RIGHT_MOUTH_CORNER, LEFT_MOUTH_CORNER) / _eyes(p),
    "right lids": lambda p: _lids(p, RIGHT_EYE_CORNERS, RIGHT_UPPER_LID, RIGHT_LOWER_LID),
    "left lids": lambda p: _lids(p, LEFT_EYE_CORNERS, LEFT_UPPER_LID, LEFT_LOWER_LID),
    "right brow": lambda p: _brow(p, RIGHT_BROW, RIGHT_EYE_CORNERS),
    "left brow": lambda p: _brow(p, LEFT_BROW, LEFT_EYE_CORNERS),
}


def expression(points: NDArray[Any]) -> dict[str, F64]:
    """The curves (n,) of landmarks (n, 81, 2)."""
    shape = np.asarray(points, np.float64)
    return {name: curve(shape) for name, curve in CURVES.items()}


def correlation(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Pearson correlation of two curves (n,); NaN when there are few values or the first one does not move.

    0 when the second curve does not move where the first one does.
    """
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if len(x) < MIN_CORRELATION_FRAMES or x.std() < MIN_DEVIATION_EYE_DISTANCES:
        return math.nan
    return float(np.corrcoef(x, y)[0, 1]) if y.std() > 1e-9 else 0.0


def pose(points: NDArray[Any]) -> F64:
    """(n, 3) yaw, pitch and roll, degrees, of landmarks (n, 81, 2), by scaled orthography from the SKULL points."""
    seen = np.asarray(points, np.float64)[:, SKULL]
    known = SKULL_3D - SKULL_3D.mean(0)
    affine = np.einsum("nkd,ka->nda", seen - seen.mean(1, keepdims=True), np.linalg.pinv(known).T)
    u, _, vt = np.linalg.svd(affine, full_matrices=False)
    right, down = np.moveaxis(u @ vt, 1, 0)  # first two rows of the rotation
    ahead = np.cross(right, down)  # third row
    nose = -np.stack([right[:, 2], down[:, 2], ahead[:, 2]], axis=1)  # where it points, towards the camera
    yaw = np.arctan2(nose[:, 0], -nose[:, 2])
    pitch = np.arcsin(np.clip(-nose[:, 1], -1, 1))
    roll = np.arctan2(down[:, 0], right[:, 0])
    return np.asarray(np.degrees(np.stack([yaw, pitch, roll], axis=1)))


def angle_between(a: F64, b: F64) -> F64:
    """a - b, degrees, in [-180, 180)."""
    return np.asarray((a - b + 180) % 360 - 180)


def point_errors(before: NDArray[Any], after: NDArray[Any]) -> tuple[F64, F64]:
    """Mean distances (n,) of two faces' points, in % of the first one's inter-ocular distance: total, and of motion.

    For the second, the constant difference of the two faces (another nose, another chin) is removed, in the upright
    frame of the eyes.
    """
    first, second = _upright(before, before), _upright(after, before)
    offset = (second - first).mean(0)
    whole = np.linalg.norm(second - first, axis=2).mean(1)
    return 100 * whole, 100 * np.linalg.norm(second - first - offset, axis=2).mean(1)


def _upright(points: NDArray[Any], by: NDArray[Any]) -> F64:
    """Points (n, 81, 2) in inter-ocular distances of the faces `by`, about the middle of their eyes, turned level."""
    own, other = np.asarray(points, np.float64), np.asarray(by, np.float64)
    axis = other[:, LEFT_EYE_OUTER] - other[:, RIGHT_EYE_OUTER]
    unit = axis / np.maximum((axis**2).sum(1), 1e-12)[:, None]
    away = own - ((other[:, LEFT_EYE_OUTER] + other[:, RIGHT_EYE_OUTER]) / 2)[:, None]
    along = (away * unit[:, None]).sum(2)
    across = away[..., 1] * unit[:, None, 0] - away[..., 0] * unit[:, None, 1]
    return np.stack([along, across], axis=2)


def jitter(points: NDArray[Any], frames: NDArray[Any]) -> float:
    """Jitter of points: median over triples of consecutive frames of the mean second difference.

    points : (n, 81, 2), the rigid motion of the head between the frames is removed.   frames : (n,) ascending.
    In inter-ocular distances; NaN without a triple.
    """
    shape = np.asarray(points, np.float64)
    middle = np.flatnonzero((frames[2:] - frames[:-2]) == 2) + 1
    values = [_second_difference(*shape[i - 1 : i + 2]) for i in middle]
    return float(np.median(values)) if values else math.nan


def _second_difference(before: F64, now: F64, after: F64) -> float:
    """Mean distance of a shape (81, 2) from the middle of its neighbours in time, over the inter-ocular distance."""
    away = now - (_onto(before, now) + _onto(after, now)) / 2
    return float(np.linalg.norm(away, axis=1).mean() / max(float(interocular(now)), 1e-6))


def _onto(shape: F64, target: F64) -> F64:
    """A shape moved onto another by a similarity of the rigid points."""
    return align_planar(shape, target, RIGID_WEIGHTS).apply(shape)
