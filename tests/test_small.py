"""Functions for small arrays give NumPy's results, bit for bit, with fewer calls."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from guise.common.small import lengths, mean, ramp, ramps

FLOATS = pytest.mark.parametrize("dtype", [np.float32, np.float64])


def same(ours: Any, theirs: Any) -> bool:
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    return ours.shape == theirs.shape and ours.dtype == theirs.dtype and ours.tobytes() == theirs.tobytes()


def normal(shape: tuple[int, ...], dtype: type) -> NDArray[Any]:
    return np.random.default_rng(sum(shape)).normal(30, 100, shape).astype(dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.complex128, np.uint8, np.int64, np.bool_])
@pytest.mark.parametrize("axis", [None, 0, 1, -1, (0, 1), (1, 2)])
@pytest.mark.parametrize("shape", [(81, 2, 3), (1, 7, 1), (3, 513, 2)])
def test_a_mean_is_that_of_numpy(shape: tuple[int, ...], axis: Any, dtype: type) -> None:
    values = (normal(shape, np.float64) * (1 if dtype is not np.complex128 else 1 + 2j)).astype(dtype)
    assert same(mean(values, axis), values.mean(axis))
    assert same(mean(values.T, axis), values.T.mean(axis))


@FLOATS
@pytest.mark.parametrize("shape", [(2,), (81, 2), (4, 9, 3)])
def test_lengths_are_the_norms_of_numpy(shape: tuple[int, ...], dtype: type) -> None:
    vectors = normal(shape, dtype)
    assert same(lengths(vectors), np.linalg.norm(vectors, axis=-1))


@FLOATS
@pytest.mark.parametrize(("first", "last"), [(0.0, 1.0), (0.35, 0.75), (-0.1, 1 / 3), (12, 20), (10.0, 45.0)])
def test_ramps_are_those_of_numpy_at_their_ends_too(first: float, last: float, dtype: type) -> None:
    width = last - first
    values = np.random.default_rng(1).uniform(first - width, last + width, 500)
    ends = [np.nextafter(end, towards) for end in (first, last) for towards in (-np.inf, np.inf)]
    values = np.concatenate([values, ends, [first, last, np.inf, -np.inf, np.nan]]).astype(dtype)
    expected = np.interp(values, (first, last), (0, 1))
    assert same(ramps(values, first, last), expected)
    assert same([ramp(float(value), first, last) for value in values], expected)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (lambda: mean(POINTS, 0), lambda: POINTS.mean(0)),
        (lambda: lengths(POINTS), lambda: np.linalg.norm(POINTS, axis=1)),
        (lambda: ramp(0.3, 0.2, 0.4), lambda: np.interp(0.3, (0.2, 0.4), (0, 1))),
        (lambda: ramps(POINTS, 0.2, 0.4), lambda: np.interp(POINTS, (0.2, 0.4), (0, 1))),
    ],
    ids=["mean", "lengths", "ramp", "ramps"],
)
def test_each_takes_less_than_half_of_the_calls(ours: Callable[[], Any], theirs: Callable[[], Any]) -> None:
    assert 2 * calls(ours) < calls(theirs)


POINTS = normal((81, 2), np.float64)


def calls(of: Callable[[], Any]) -> int:
    """Python and C calls of a function, the profiler's own apart."""
    count = 0

    def note(_frame: object, event: str, _arg: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    previous = sys.getprofile()
    sys.setprofile(note)
    try:
        of()
    finally:
        sys.setprofile(previous)
    return count - 2  # of() itself and sys.setprofile
