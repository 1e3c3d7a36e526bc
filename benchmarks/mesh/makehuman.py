"""Transfers between MakeHuman's people of other sex, age and ethnicity, whose own expressions are the truth.

The twelve people are made by ../shared/people/human.py: African, Asian and Caucasian, male and female, young and old,
each onto one of the next ethnicity, the other sex and the other age.  All have one topology, so that the place of every
vertex on the other head is known.  err as in benchmarks.mesh.transfer, with nothing given and with that exact
correspondence.  MakeHuman's units add nearly the same displacement, in centimetres, to everybody, so that whatever
adapts them to the size and shape of a head errs by that: by .14 to .23 with the exact correspondence.  Slide is the
mean distance of the deformed source's vertices from their true places, centimetres.  Both are measured with the guides
along cheeks, jaw and neck and without.
"""

from __future__ import annotations

from benchmarks.threads import one_thread

if __name__ == "__main__":
    one_thread("benchmarks.mesh.makehuman")

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.mesh.transfer import Pair, errors
from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_points import find_feature_points
from guise.analogy.lids import FacePair
from guise.analogy.mesh import Mesh
from guise.analogy.registration import register
from guise.analogy.transfer import Transfer
from guise.common.arrays import F64, Bool

NAME, TITLE = "mesh.makehuman", "Transfer across sex, age and ethnicity"
RACES = ("african", "asian", "caucasian")
UNITS = (
    "mouth-open", "mouth-corner-puller", "mouth-depression", "mouth-elevation", "mouth-retraction", "eye-left-closure",
    "eyebrows-left-up", "nose-left-elevation",
)  # fmt: skip
CENTIMETRES = 10.0  # in a decimetre
NECK_CM = 3.5  # below the first joint of the neck, where the heads end
MAX_ERROR = 0.15


class People:
    """The twelve, all with the same faces; (race, male, old) names one."""

    def __init__(self, folder: Path) -> None:
        sys.path.insert(0, str(folder))
        self._human: Any = importlib.import_module("human")
        base = self._human.base()
        whole = self._human.body_faces()
        faces = base.f[whole]
        first = self._person("caucasian", 1, 0)
        low = first.J["neck01"][1] - NECK_CM / CENTIMETRES
        faces = faces[(first.base[faces][:, :, 1] > low).all(1)]
        self._kept, quads = np.unique(faces, return_inverse=True)
        self._quads = quads.reshape(faces.shape).astype(np.intp)

    def head(self, race: str, male: int, old: int) -> tuple[Mesh, F64]:
        """A head and its expressions (k, N, 3)."""
        person = self._person(race, male, old)
        at = CENTIMETRES * person.base[self._kept]
        ways = [CENTIMETRES * person.E[self._human.UIX[unit]][self._kept] for unit in UNITS]
        return Mesh(at, np.empty((0, 3), np.intp), self._quads), at + np.array(ways, np.float64)

    def _person(self, race: str, male: int, old: int) -> Any:
        spec = {"name": race, "race": {race: 1.0}, "male": float(male), "age": float(old)}
        return self._human.Person(spec)


def lower_face(mesh: Mesh, points: F64) -> Bool:
    """(N,) what lies below the nose's tip: jaw, chin, neck."""
    return np.asarray(mesh.vertices[:, 1] < points[:, 1].mean())


def row(people: People, race: int, male: int, old: int) -> tuple[str, *tuple[float, ...]]:
    """Pair; err with nothing given and without guides, and with the exact correspondence; slide of all, of jaw and
    neck, and both without guides."""
    one, other = (RACES[race], male, old), (RACES[(race + 1) % 3], 1 - male, 1 - old)
    (source, expressions), (target, truths) = people.head(*one), people.head(*other)
    points = _points(source), _points(target)
    face = FacePair.of(source, target, points)
    pair = Pair(source, expressions, target, truths, points, UNITS)
    low = lower_face(target, points[1])
    links, slides = [], []
    for contours in (points, None):
        done = register(source, target, face.with_margins(source, target), face.trust, contours)
        slide = np.linalg.norm(done.fitted - target.vertices, axis=1)
        links.append(done.correspondence())
        slides += [float(slide.mean()), float(slide[low].mean())]
    links.append(Correspondence.identity(len(source.vertices)))
    found = [float(errors(pair, Transfer(source, target, link, face=face)).mean()) for link in links]
    names = " to ".join(
        f"{race} {'male' if male else 'female'} {'old' if old else 'young'}"
        for race, male, old in (one, other)
    )
    return names, *found, *slides


def _points(mesh: Mesh) -> F64:
    found = find_feature_points(mesh)
    assert hasattr(found, "positions"), found
    return np.asarray(found.positions)


def measure(options: argparse.Namespace) -> Report:
    """All pairs; three of them when quick."""
    report, people = Report(NAME, TITLE), People(options.shared / "people")
    kinds = [(race, male, old) for race in range(3) for male in (0, 1) for old in (0, 1)]
    rows = []
    for kind in kinds[::5] if options.quick else kinds:
        rows.append(row(people, *kind))
        common.say("{}: {:.3f} {:.3f} {:.3f}, slide {:.2f} {:.2f}, {:.2f} {:.2f}".format(*rows[-1]))
    columns = (
        "pair", "err, guides", "err", "err, exact correspondence", "slide, guides, cm",
        "of jaw and neck, guides, cm", "slide, cm", "of jaw and neck, cm",
    )  # fmt: skip
    mean = np.mean([one[1:] for one in rows], axis=0).tolist()
    rows.append(("mean", *mean))
    report.tables.append(Table("MakeHuman's people", columns, rows))
    report.criteria.append(Criterion("mean err, nothing given", mean[1], "<=", MAX_ERROR))
    report.criteria.append(
        Criterion("slide of jaw and neck, of that without guides", mean[4] / mean[6], "<", 1.0)
    )
    report.notes.append(f"The worst pair has {max(one[2] for one in rows):.3f}.")
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
