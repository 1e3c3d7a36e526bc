"""Is this still a face? Checks on points alone, for confidence and for losing a track.

Points (81, 2), pixels, scheme ``face81``. Nothing here looks at the picture: the checks catch a landmarker
that went astray, not one that is slightly wrong.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import OUTER_EYE_CORNERS, interocular, mean_geometry
from guise.aam.similarity import align_complex
from guise.common.arrays import F64, Int
from guise.common.kernels import kernel
from guise.common.small import lengths, mean


@dataclass(frozen=True)
class PlausibilityLimits:
    """Thresholds of what is a face and how it moves; lengths in inter-ocular distances.

    Residuals to the mean face in real clips: median 0.08, extreme expressions 0.17, a head turned by about 45 degrees
    0.26.  Mean shifts between the last two of three passes: on faces under 0.03, elsewhere over 0.055 (99 in 100).
    """

    half_confidence_residual: float = 0.36  # to the mean face, at which the confidence is one half
    residual_width: float = 0.025  # over which it falls
    half_confidence_shift: float = 0.06  # of the last pass, at which the confidence is one half
    shift_width: float = 0.009
    min_interocular_pixels: float = 6.0
    max_growth: float = 1.35  # of the inter-ocular distance, from one frame to the next
    max_motion: float = 0.9  # of the head, from one frame to the next
    max_bend: float = 0.20  # root mean square change of shape, from one frame to the next


LIMITS = PlausibilityLimits()
_MOTION: F64 = np.array(astuple(LIMITS)[-4:])


def shape_confidence(points: NDArray[Any]) -> float:
    """Confidence in [0, 1] from the points' likeness to the mean face; 0 when not finite or tiny.

    Examples
    --------
    >>> mean = mean_geometry().mean
    >>> shape_confidence(100 * np.stack([mean.real, mean.imag], axis=-1)) > 0.99
    True
    >>> shape_confidence(np.random.default_rng(0).random((81, 2)) * 100) < 0.01
    True
    """
    if not np.isfinite(points).all() or interocular(points) < LIMITS.min_interocular_pixels:
        return 0.0
    residual = float(mean_geometry().residual(points))
    return float(
        1 / (1 + np.exp(min((residual - LIMITS.half_confidence_residual) / LIMITS.residual_width, 500.0)))
    )


def visible_share(points: NDArray[Any], width: float, height: float) -> float:
    """Share of the points that lie inside a picture of that size."""
    x, y = points.T
    inside = (x >= -0.5) & (y >= -0.5) & (x <= width - 0.5) & (y <= height - 0.5)
    return float(mean(inside))


def is_plausible_motion(previous: NDArray[Any], current: NDArray[Any]) -> bool:
    """Whether a face can have got from ``previous`` to ``current`` (81, 2) within one frame."""
    before, after = (np.ascontiguousarray(points, np.float64) for points in (previous, current))
    return bool(plausible_motion(before, after, OUTER_EYE_CORNERS, _MOTION))


@kernel
def plausible_motion(previous: F64, current: F64, eyes: Int, limits: F64) -> int:
    """Whether points (n, 2) can have moved so.

    eyes : (2,) of them, the outer eye corners.   limits : (4,) the last ones of `PlausibilityLimits`, in order.
    """
    least, growth, motion, most_bend = limits.tolist()
    before, after = (float(lengths(np.subtract(*points[eyes]))) for points in (previous, current))
    if not (before > 0 and after >= least and 1 / growth < after / before < growth):
        return 0
    moved = lengths(mean(current, 0) - mean(previous, 0)) / before
    return int(moved < motion and bend(previous, current) < most_bend)


def bend(previous: NDArray[Any], current: NDArray[Any]) -> float:
    """Root mean square change of shape after the best similarity, inter-ocular distances of ``previous``."""
    source = previous[:, 0].astype(np.float64) + 1j * previous[:, 1]
    target = current[:, 0].astype(np.float64) + 1j * current[:, 1]
    scale, shift = align_complex(target, source)
    return float(np.sqrt(mean(np.abs(scale * target + shift - source) ** 2)) / interocular(previous))


def settled_confidence(shift: float) -> float:
    """Confidence in [0, 1] from :func:`pass_shift` of the last two passes; one half at 0.06.

    Examples
    --------
    >>> settled_confidence(0.02) > 0.98, settled_confidence(0.12) < 0.02
    (True, True)
    """
    return float(
        1 / (1 + np.exp(np.clip((shift - LIMITS.half_confidence_shift) / LIMITS.shift_width, -500, 500)))
    )


def pass_shift(previous: NDArray[Any], current: NDArray[Any]) -> float:
    """Mean distance between two passes over the same picture, inter-ocular distances of ``current``."""
    size = max(float(interocular(current)), 1e-6)
    return float(np.linalg.norm(current - previous, axis=-1).mean() / size)
