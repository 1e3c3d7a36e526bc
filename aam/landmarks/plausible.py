"""Is this still a face? Checks on points alone, for confidence and for losing a track.

Points (81, 2), pixels, scheme ``face81``. Nothing here looks at the picture: the checks tell a landmarker
that went astray, not one that is a little wrong.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import interocular, mean_geometry

# Residual to the mean face (inter-ocular distances) where confidence is one half, and how fast it falls.
# Faces in real clips: median 0.08, extreme expressions 0.17, a head turned by about 45 degrees 0.26.
_RESIDUAL_HALF, _RESIDUAL_WIDTH = 0.36, 0.025
# Mean shift between the last two of three passes: on faces under 0.03, elsewhere over 0.055 (99 in 100).
_SHIFT_HALF, _SHIFT_WIDTH = 0.06, 0.009
_MIN_INTEROCULAR = 6.0  # pixels
_GROWTH = 1.35  # of the inter-ocular distance from one frame to the next
_STEP = 0.9  # inter-ocular distances that a head may move from one frame to the next
_BEND = 0.20  # root mean square change of shape from one frame to the next, inter-ocular distances


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
    if not np.isfinite(points).all() or interocular(points) < _MIN_INTEROCULAR:
        return 0.0
    residual = float(mean_geometry().residual(points))
    return float(1 / (1 + np.exp(min((residual - _RESIDUAL_HALF) / _RESIDUAL_WIDTH, 500.0))))


def visible_share(points: NDArray[Any], width: int, height: int) -> float:
    """Share of the points that lie inside a picture of that size."""
    inside = (points >= -0.5).all(axis=-1) & (points[:, 0] <= width - 0.5) & (points[:, 1] <= height - 0.5)
    return float(inside.mean())


def is_plausible_motion(previous: NDArray[Any], current: NDArray[Any]) -> bool:
    """Whether a face can have got from ``previous`` to ``current`` (81, 2) within one frame."""
    before, after = float(interocular(previous)), float(interocular(current))
    if not (before > 0 and after >= _MIN_INTEROCULAR and 1 / _GROWTH < after / before < _GROWTH):
        return False
    step = np.linalg.norm(current.mean(axis=0) - previous.mean(axis=0)) / before
    return bool(step < _STEP) and bend(previous, current) < _BEND


def bend(previous: NDArray[Any], current: NDArray[Any]) -> float:
    """Root mean square change of shape after the best similarity, inter-ocular distances of ``previous``."""
    source = previous[:, 0] + 1j * previous[:, 1]
    target = current[:, 0] + 1j * current[:, 1]
    source, target = source - source.mean(), target - target.mean()
    factor = np.vdot(target, source) / np.vdot(target, target)
    return float(np.sqrt(np.mean(np.abs(factor * target - source) ** 2)) / interocular(previous))


def settled_confidence(shift: float) -> float:
    """Confidence in [0, 1] from :func:`pass_shift` of the last two passes; one half at 0.06.

    Examples
    --------
    >>> settled_confidence(0.02) > 0.98, settled_confidence(0.12) < 0.02
    (True, True)
    """
    return float(1 / (1 + np.exp(np.clip((shift - _SHIFT_HALF) / _SHIFT_WIDTH, -500, 500))))


def pass_shift(previous: NDArray[Any], current: NDArray[Any]) -> float:
    """Mean distance between two passes over the same picture, inter-ocular distances of ``current``."""
    size = max(float(interocular(current)), 1e-6)
    return float(np.linalg.norm(current - previous, axis=-1).mean() / size)
