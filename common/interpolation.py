"""Linear interpolation as a matrix, for knots that are interpolated again and again."""

from __future__ import annotations

import numpy as np

from guise.common.arrays import F64


def interpolation(places: F64, knots: F64) -> F64:
    """(n, k) weights of ascending knots (k,) that interpolate at places (n,), constant beyond them.

    >>> interpolation(np.array([0.25, 3.0]), np.array([0.0, 1.0])).tolist()
    [[0.75, 0.25], [0.0, 1.0]]
    """
    return np.column_stack([np.interp(places, knots, one) for one in np.eye(len(knots))])
