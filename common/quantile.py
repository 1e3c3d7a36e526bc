"""A quantile of few values, many times a second: `numpy.quantile` takes longer for its checks than for the work."""

from guise.common.arrays import Floating


def quantile(values: Floating, share: float) -> float:
    """The quantile at a share in [0, 1] of values (n,), n > 0, linear between them as that of NumPy."""
    last = len(values) - 1
    place = share * last
    low = int(place)
    high = min(low + 1, last)
    ordered = values.copy()
    ordered.partition((low, high))
    return float(ordered[low] + (place - low) * (ordered[high] - ordered[low]))
