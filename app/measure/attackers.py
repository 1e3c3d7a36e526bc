"""Who is who in de-identified videos: attackers that know other pictures of the people, and how often they are right.

Embeddings are unit vectors (n, d).  The naive attacker compares published faces with pictures of the people, the
reverse one looks for a known picture among the published faces, and the parrot de-identifies the known pictures himself
and learns from them (Newton, Sweeney and Malin 2005, IEEE TKDE 17(2), sections 2 and 5; Hanisch et al. 2023, "A False
Sense of Privacy", for attackers that are trained on anonymised data).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from guise.app.measure.privacy import template
from guise.common.arrays import F32, F64

Attacker = Literal["naive", "reverse", "parrot"]
By = Literal["frame", "clip"]

RESAMPLES = 2000  # of the bootstrap, and shuffles of the guess
CONFIDENCE = 0.95
SHRINKAGE = 0.3  # of the covariance within people towards a multiple of the identity


@dataclass(frozen=True, eq=False)
class Evidence:
    """One person's embeddings (n, d), n > 0.

    Parameters
    ----------
    known : of pictures that the attacker has.   imitated : of the same, which he has de-identified.
    published : of de-identified pictures whose person he looks for.   hidden : of the same before, which he never sees.
    """

    known: F32
    imitated: F32
    published: F32
    hidden: F32


@dataclass(frozen=True, eq=False)
class Guesses:
    """How often each person is taken for each.

    shares : (people, people), each row's sum 1; the right ones are on the diagonal.
    """

    shares: F64

    @property
    def rank_one(self) -> float:
        """Share of right guesses; every person counts the same."""
        return float(np.diag(self.shares).mean())

    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of `rank_one` over people: bootstrap, percentiles (Efron and Tibshirani 1993).

        Where nobody is found at all, which no bootstrap can tell from luck, its end is 1 - 0.05 ** (1 / people).
        """
        own = np.diag(self.shares)
        if not own.any():
            return 0.0, 1 - (1 - CONFIDENCE) ** (1 / len(own))
        picks = np.random.default_rng(0).integers(0, len(own), (RESAMPLES, len(own)))
        tails = 100 * np.array([1 - CONFIDENCE, 1 + CONFIDENCE]) / 2
        low, high = np.percentile(own[picks].mean(1), tails)
        return float(low), float(high)


def attacks(people: Sequence[Evidence]) -> dict[tuple[Attacker, By], Guesses]:
    """What every attacker guesses, by single frames and by the mean of a clip."""
    published = [one.published for one in people]
    known = [one.known for one in people]
    head = Head.trained([one.imitated for one in people])
    imitated, seen = ([head(one) for one in rows] for rows in ([p.imitated for p in people], published))
    sides: dict[Attacker, tuple[list[F32], list[F32]]] = {
        "naive": (known, published), "reverse": (published, known), "parrot": (imitated, seen),
    }  # fmt: skip
    return {
        (name, by): guessed(gallery, probes, by)
        for name, (gallery, probes) in sides.items()
        for by in ("frame", "clip")
    }


def guessed(gallery: Sequence[F32], probes: Sequence[F32], by: By) -> Guesses:
    """Each person's probes (n, d) given to the person of the most similar template; ties are shared."""
    templates = np.stack([template(rows) for rows in gallery])
    sought = [rows if by == "frame" else template(rows)[None] for rows in probes]
    return Guesses(np.stack([_best(np.asarray(rows, np.float64) @ templates.T) for rows in sought]))


def _best(scores: F64) -> F64:
    """(people,) share of the rows of scores (n, people) in which each is the best."""
    best = scores >= scores.max(1, keepdims=True)
    return np.asarray((best / best.sum(1, keepdims=True)).mean(0))


@dataclass(frozen=True, eq=False)
class Head:
    """A layer that is retrained on a frozen embedding: Fisher's linear discriminants (1936), shrunk.

    mean : (d,).   whitening : (d, d), makes what varies within people alike in all directions.
    """

    mean: F64
    whitening: F64

    @classmethod
    def trained(cls, people: Sequence[F32]) -> Head:
        """From embeddings (n, d) of each person."""
        every = np.concatenate(people).astype(np.float64)
        within = np.concatenate([rows - rows.mean(0) for rows in people]).astype(np.float64)
        covariance = within.T @ within / len(within)
        level = max(float(np.trace(covariance)) / len(covariance), 1e-12)
        shrunk = (1 - SHRINKAGE) * covariance + SHRINKAGE * level * np.eye(len(covariance))
        values, vectors = np.linalg.eigh(shrunk)
        return cls(every.mean(0), vectors / np.sqrt(values))

    def __call__(self, embeddings: NDArray[Any]) -> F32:
        """Unit vectors (n, d) of embeddings (n, d)."""
        found = (embeddings - self.mean) @ self.whitening
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-12), np.float32)


def luck(guesses: Sequence[Guesses]) -> tuple[float, float]:
    """Mean and 95th percentile of the best of several attackers' shares when people are shuffled: they know nothing.

    The best of many guesses is above chance by luck alone.
    """
    people = len(guesses[0].shares)
    generator, rows = np.random.default_rng(0), np.arange(people)
    shuffles = np.array([generator.permutation(people) for _ in range(RESAMPLES)])
    best = np.max([one.shares[rows, shuffles].mean(1) for one in guesses], axis=0)
    return float(best.mean()), float(np.percentile(best, 100 * CONFIDENCE))
