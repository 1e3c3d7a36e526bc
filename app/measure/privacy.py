"""Figures of re-identification from embeddings and their cosines.

Embeddings are unit vectors (n, d); a template is the unit mean of a person's embeddings; a score is the cosine of an
embedding with a template.  A genuine score compares a face with its own person, an impostor score with another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.common.arrays import F64

FALSE_ACCEPT_RATE = 1e-3
BINS = np.linspace(-1.0, 1.0, 81)  # edges of the histograms of scores


def template(embeddings: NDArray[Any]) -> F64:
    """The unit mean (d,) of embeddings (n, d); their first axis when they cancel out."""
    mean = np.asarray(embeddings, np.float64).mean(0)
    return np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-12))


@dataclass(frozen=True)
class Threshold:
    """The score from which two faces are taken for one person.

    Parameters
    ----------
    score : at most `rate` of the impostor scores are above it.
    rate : the false-accept rate that it stands for.
    pairs : number of impostor scores it was taken from.
    """

    score: float
    rate: float
    pairs: int

    @property
    def enough(self) -> bool:
        """Whether there are so many impostor scores that one of them may be above the threshold."""
        return self.pairs * self.rate >= 1


def threshold(impostors: NDArray[Any], rate: float = FALSE_ACCEPT_RATE) -> Threshold:
    """The lowest score that at most a share `rate` of impostor scores (n,), n > 0, exceeds.

    >>> threshold(np.arange(1000) / 1000, 0.01).score
    0.989
    """
    ordered = np.sort(np.asarray(impostors, np.float64))
    above = math.floor(rate * len(ordered) + 1e-9)
    return Threshold(float(ordered[len(ordered) - 1 - above]), rate, len(ordered))


def accepted(scores: NDArray[Any], limit: Threshold) -> float:
    """Share of scores (n,) above the threshold; NaN without any.

    >>> accepted(np.array([0.1, 0.4, 0.6]), Threshold(0.4, 1e-3, 1000)) == 1 / 3
    True
    """
    return float((np.asarray(scores) > limit.score).mean()) if len(scores) else math.nan


def rank_one(scores: NDArray[Any], own: Sequence[int] | NDArray[Any]) -> float:
    """Share of faces whose best template is one of their own person; NaN without any.

    scores : (n, people).   own : (n,) the column of each face's person.  A tie counts by its chance.
    """
    values = np.asarray(scores, np.float64)
    if not len(values):
        return math.nan
    best = values == values.max(1, keepdims=True)
    return float((best[np.arange(len(values)), np.asarray(own, np.intp)] / best.sum(1)).mean())


def rank(scores: NDArray[Any], own: int) -> int:
    """Place, from 1, of one's own template among scores (people,); those that tie come before it."""
    values = np.asarray(scores, np.float64)
    return int((values >= values[own]).sum())


def equal_error_rate(genuine: NDArray[Any], impostors: NDArray[Any]) -> float:
    """The rate at which false accepts and false rejects are equally frequent; NaN when one side is empty.

    Both rates are steps in the threshold; where they cross between two scores the mean of the nearest pair is taken.

    >>> equal_error_rate(np.array([0.8, 0.9]), np.array([0.1, 0.2]))
    0.0
    >>> equal_error_rate(np.array([0.1, 0.9]), np.array([0.1, 0.9]))
    0.5
    """
    if not len(genuine) or not len(impostors):
        return math.nan
    right, wrong = np.sort(genuine), np.sort(impostors)
    limits = np.unique(np.concatenate([right, wrong]))
    rejects = np.searchsorted(right, limits, side="left") / len(right)
    accepts = 1 - np.searchsorted(wrong, limits, side="left") / len(wrong)
    nearest = int(np.argmin(np.abs(rejects - accepts)))
    return float((rejects[nearest] + accepts[nearest]) / 2)


@dataclass(frozen=True)
class Scores:
    """Some scores in short: how many, mean, 99th percentile, largest, and their histogram over BINS."""

    count: int
    mean: float
    p99: float
    largest: float
    histogram: tuple[int, ...]

    @classmethod
    def of(cls, scores: NDArray[Any]) -> Scores | None:
        """Scores (n,) in short; None without any."""
        values = np.asarray(scores, np.float64)
        if not len(values):
            return None
        counts = np.histogram(np.clip(values, -1, 1), BINS)[0]
        p99 = float(np.percentile(values, 99))
        return cls(len(values), float(values.mean()), p99, float(values.max()), tuple(map(int, counts)))
