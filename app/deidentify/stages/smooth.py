"""Tracked shapes without jitter and without lag: a whole track is known, so both directions of time count."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from guise.aam.shape_filter import ShapeFilter
from guise.common.arrays import F64

FILTER_CONTEXT_FRAMES = 45  # on either side, which still matter


def smooth(frames: NDArray[np.integer], shapes: NDArray[np.floating], cuts: Sequence[int]) -> F64:
    """Filtered shapes (n, 81, 2): the mean of a pass forward and a pass backward.

    frames : (n,) ascending; the filter restarts where one is missing and at a cut.
    """
    out = np.empty(shapes.shape)
    for run in _runs(frames, cuts):
        part = np.asarray(shapes[run], np.float64)
        out[run] = (_pass(part) + _pass(part[::-1])[::-1]) / 2
    return out


def _pass(shapes: F64) -> F64:
    temporal_filter = ShapeFilter()
    return np.stack([temporal_filter(shape) for shape in shapes])


def _runs(frames: NDArray[np.integer], cuts: Sequence[int]) -> Iterator[slice]:
    """Slices of consecutive frames of one shot."""
    breaks = np.diff(frames) != 1
    for cut in cuts:
        breaks |= (frames[:-1] < cut) & (cut <= frames[1:])
    edges = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(frames)]
    yield from (slice(a, b) for a, b in pairwise(edges) if b > a)
