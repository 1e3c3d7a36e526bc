"""Cylindrical correspondence (Song et al.) beside the registration: time, true error, and what a transfer makes of it.

The same points for both.  True error: distance on the source, at each vertex of the target's skin, from the place found
to the true one.  err as in `mesh.transfer`, by tents.  Processor time of one thread on meshes whose faces are known, in
units of the reference's solve, with which it alternates (`mesh.speed`).
"""

from __future__ import annotations

from benchmarks.threads import one_thread

if __name__ == "__main__":
    one_thread("benchmarks.mesh.cylinder")

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.mesh.people import CENTIMETRE, load_person, open_mouth_head, true_link
from benchmarks.mesh.speed import REFERENCE_SOLVE_SECONDS, Reference, side_by_side
from benchmarks.mesh.transfer import OTHER_POSE, Pair, errors, load_pair, true_correspondence
from guise.analogy.correspondence import Correspondence
from guise.analogy.cylinder import cylindrical_correspondence
from guise.analogy.registration import register, skin_mask
from guise.analogy.transfer import Transfer
from guise.common.arrays import F64

NAME, TITLE = "mesh.cylinder", "Cylindrical correspondence between heads"
MAX_CYLINDER_SECONDS = 0.3
PAIRS = ("P", "M")
REMESHED_PAIRS = (("p01", "p02", "t12k"), ("p05", "p04", "t24k"), ("p07", "p10", "t5k"))


@dataclass(frozen=True, eq=False)
class Case:
    """A pair of heads and the true correspondence; centimetre: in the source's unit."""

    name: str
    pair: Pair
    true: Correspondence
    centimetre: float = 1.0

    def error(self, found: Correspondence) -> F64:
        """True errors of the target's skin, cm."""
        places = self.pair.source.vertices
        apart = np.linalg.norm(found.interpolate(places) - self.true.interpolate(places), axis=1)
        return np.asarray(apart[skin_mask(self.pair.target)] / self.centimetre)

    def err(self, found: Correspondence) -> float:
        """Mean err of a transfer by tents."""
        return float(errors(self.pair, Transfer(self.pair.source, self.pair.target, found)).mean())


def cases(shared: Path, quick: bool) -> Iterator[Case]:
    """Those of the table."""
    for name in PAIRS:
        pair, true = load_pair(shared, name), true_correspondence(shared, name)
        yield Case(name, pair, true)
        if not quick:
            yield Case(f"{name}, turned, scaled", pair.placed(OTHER_POSE), true)
    for names in REMESHED_PAIRS[: 1 if quick else None]:
        yield people(shared / "data" / "synthetic" / "mesh", *names)


def people(folder: Path, first: str, second: str, topology: str) -> Case:
    """Two people, the second remeshed."""
    head = open_mouth_head(folder / "p01")
    source, target = load_person(folder, first, head), load_person(folder, second, head, topology)
    pair = Pair(
        source.mesh, source.expressions, target.mesh, target.expressions, (source.points, target.points), (),
        CENTIMETRE,
    )  # fmt: skip
    return Case(f"{source.name} to {target.name}", pair, true_link(source, target), CENTIMETRE)


def measure(options: argparse.Namespace) -> Report:
    """All cases."""
    reference = Reference(options.shared)
    rows, criteria = [], []
    for case in cases(options.shared, options.quick):
        common.say(case.name)
        row, seconds = measure_case(case, reference)
        rows.append(row)
        if case.name in PAIRS:
            what = (
                f"pair {case.name}, {len(case.pair.source.faces)} to {len(case.pair.target.faces)} triangles"
            )
            criteria.append(Criterion(what, seconds, "<=", MAX_CYLINDER_SECONDS, "s"))
    columns = (
        "heads", "vertices", "points", "seconds", "on the reference", "found, %", "error, cm", "median, cm", "err",
        "registered: error, cm", "median, cm", "err",
    )  # fmt: skip
    return Report(NAME, TITLE, criteria, [Table("Each pair", columns, rows)])


def measure_case(case: Case, reference: Reference) -> tuple[tuple[object, ...], float]:
    """A row, and the seconds on the reference."""
    source, target, points = case.pair.source, case.pair.target, case.pair.points
    each, solved = side_by_side(lambda: cylindrical_correspondence(source, target, *points), reference.solve)
    found = cylindrical_correspondence(source, target, *points)
    other = register(source, target, points).correspondence()
    figures = [(float(e.mean()), float(np.median(e))) for e in (case.error(found), case.error(other))]
    seconds = each * REFERENCE_SOLVE_SECONDS / solved
    return (
        case.name, len(target.vertices), len(points[0]), each, seconds, 100 * float(found.found.mean()),
        *figures[0], case.err(found), *figures[1], case.err(other),
    ), seconds  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
