"""Small arrays, many times a frame: NumPy's results to the last bit, without the calls of its wrappers in Python.

`array.mean()` of 81 points is eleven calls and takes six times as long as the sum that it needs. What is one
operator or ufunc already, as np.minimum(np.maximum(values, low), high) for numpy.clip, has no function here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.common.arrays import F64, Floating


def mean(values: NDArray[Any], axis: int | tuple[int, ...] | None = None) -> Any:
    """numpy.mean of numbers of 32 bits and more, bytes or booleans, with at least one value in each mean.

    >>> mean(np.array([[1.0, 2.0], [5.0, 6.0]]), axis=0).tolist()
    [3.0, 4.0]
    """
    total = np.add.reduce(values, axis)
    return total / (values.size // total.size)


def lengths(vectors: Floating) -> Any:
    """numpy.linalg.norm(vectors, axis=-1): Euclidean lengths (...) of vectors (..., n).

    >>> lengths(np.array([[3.0, 4.0], [0.0, 2.0]])).tolist()
    [5.0, 2.0]
    """
    return np.sqrt(np.add.reduce(vectors * vectors, -1))


def ramp(value: float, first: float, last: float) -> float:
    """numpy.interp(value, (first, last), (0, 1)) of one number, first < last: 0 up to first, 1 from last on.

    >>> ramp(0.3, 0.2, 0.4), ramp(7.0, 0.2, 0.4)
    (0.4999999999999999, 1.0)
    """
    if value <= first:
        return 0.0
    if value >= last:
        return 1.0
    return float(1 / (last - first) * (value - first))


def ramps(values: Floating, first: float, last: float) -> F64:
    """numpy.interp(values, (first, last), (0, 1)) of an array, first < last: 0 up to first, 1 from last on.

    >>> ramps(np.array([0.0, 1.5, 3.0]), 1.0, 2.0).tolist()
    [0.0, 0.5, 1.0]
    """
    # all in float64, as there; the ends by comparison: the slope times the whole width needn't be one
    share = 1 / (last - first) * (values - np.float64(first))
    return np.where(values >= last, 1.0, np.where(values <= first, 0.0, share))
