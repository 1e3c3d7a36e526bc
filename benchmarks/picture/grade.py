"""Does the grade of a swap predict what programs that have no part in it find in the result?

The result of a pair is the mean multiple of their targets (benchmarks/picture/identity.py) that the figures of
illusion.py reach, each at most MOST: tone, sharpness, the expressions together, likeness to the donor.  The grade's
weights are those of the fit that is printed; the correlation is that of fits which each leave the pair out.  Figures of
pairs that are in the working folder already are used.
"""

from __future__ import annotations

import argparse
import json
import math
from itertools import islice
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.landmarks.setting import skipped
from benchmarks.picture import identity
from benchmarks.picture.identity import EXPRESSIONS, PAIRS
from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.measure.figures import mean_of
from guise.app.swapping.grade import grade
from guise.app.swapping.report import SwapSettings
from guise.common.arrays import F64

NAME, TITLE = "picture.grade", "Picture: does the grade predict the swap"
MOST = 3.0
TARGETS = {"tone_chroma": 1.0, "tone_light": 1.2, "sharp": 0.25}
DONOR = 0.7  # likeness
RIDGE = 0.05


def result(figures: dict[str, Any]) -> float:
    """The mean multiple of their targets that a pair's figures reach."""
    expressions = [
        (1 - float(figures[name])) / (1 - target)
        for name, target in EXPRESSIONS.items()
        if figures[name] is not None and math.isfinite(figures[name])
    ]
    multiples = [abs(figures[name]) / target for name, target in TARGETS.items()]
    multiples += [mean_of([min(MOST, one) for one in expressions]), (1 - figures["donor"]) / (1 - DONOR)]
    return mean_of([min(MOST, one) for one in multiples])


def of_pair(source: str, donor: str, options: argparse.Namespace) -> dict[str, Any]:
    """What the grade predicts for a pair, of what, and what came of it."""
    judged = options.work / options.look / f"{source}__{donor}.json"
    if not judged.exists():
        identity.of_pair(source, donor, options)
    person, face = (Identity.load(options.work / "people" / f"{name}.guise") for name in (source, donor))
    with Engine(person, Donor.of(face), None, SwapSettings().drawn_look()) as engine:
        found = grade(engine)
    assert found is not None
    return {
        "source <- donor": f"{source} <- {donor}", "score": found.score, "predicted": found.predicted,
        "trial": found.trial, "result": result(json.loads(judged.read_text())), **vars(found),
    }  # fmt: skip


def design(rows: list[dict[str, Any]]) -> F64:
    """(n, 3) what the prediction is a weighted sum of."""
    return np.column_stack(
        [np.ones(len(rows)), *([row[name] for row in rows] for name in ("trial", "shape"))]
    )


def fitted(rows: list[dict[str, Any]]) -> F64:
    """The weights (3,) for some pairs, by ridge regression on standardised columns."""
    columns, wanted = design(rows), np.array([row["result"] for row in rows])
    middle, spread = columns[:, 1:].mean(0), columns[:, 1:].std(0)
    standard = np.column_stack([columns[:, 0], (columns[:, 1:] - middle) / spread])
    penalty = RIDGE * len(rows) * np.diag([0.0, 1, 1])
    weights = np.linalg.solve(standard.T @ standard + penalty, standard.T @ wanted)
    slopes = weights[1:] / spread
    return np.concatenate([[weights[0] - slopes @ middle], slopes])


def correlation(rows: list[dict[str, Any]], predicted: Any) -> float:
    """Spearman's rank correlation of a prediction with the results."""
    return float(spearmanr(predicted, [row["result"] for row in rows])[0])


def measure(options: argparse.Namespace) -> Report:
    """All pairs, and the fit on them."""
    reason = identity.missing(options)
    if reason is not None:
        return skipped(NAME, TITLE, reason)
    rows = [of_pair(*pair, options) for pair in islice(PAIRS, 4 if options.quick else None)]
    apart = [design([row]) @ fitted([one for one in rows if one is not row]) for row in rows]
    columns = ("score", "predicted", "result", "colour", "light", "sharpness", "shape")
    weights = ", ".join(f"{weight:.3f}" for weight in fitted(rows))
    return Report(
        NAME,
        TITLE,
        [
            Criterion(
                f"rank correlation, {len(rows)} pairs, each left out of the fit",
                correlation(rows, np.concatenate(apart)), ">=", 0.6,
            ),
        ],
        [
            Table(
                f"Pairs; weights fitted on them: {weights}",
                ("source <- donor", *columns),
                [(row["source <- donor"], *(row[name] for name in columns)) for row in rows],
            )
        ],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, identity.parser())
