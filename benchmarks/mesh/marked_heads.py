"""Heads with known feature points, for the benchmark of the points: rendered people, ICT, two ARKit sets.

The truth of a head is (20, 3), in the order of `guise.analogy.feature_points.FEATURE_POINT_NAMES`, NaN where a point is
unknown.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.analogy.feature_points import FEATURE_POINT_NAMES, LANDMARK_INDICES
from guise.analogy.formats.files import read_mesh
from guise.analogy.mesh import Mesh
from guise.common.arrays import F64

REMESHED = ("", "t5k", "t12k", "t24k")


@dataclass(frozen=True, eq=False)
class Head:
    """A head and its feature points.

    Parameters
    ----------
    source : who defined the points: "people", "ICT", or "" where nobody did.   truth : (20, 3) or NaN.
    """

    name: str
    source: str
    mesh: Mesh
    truth: F64


def heads(shared: Path) -> Iterator[Head]:
    """All of them."""
    data = shared / "data"
    yield from people(data / "synthetic" / "mesh")
    yield from ict(data / "mesh")
    yield from arkit(data / "mesh")
    yield from unmarked(data / "mesh")


def people(folder: Path) -> Iterator[Head]:
    """Six rendered people, and three of them with other topologies."""
    for person in sorted(path for path in folder.iterdir() if path.is_dir()):
        for remeshed in REMESHED:
            place = person / remeshed
            if (place / "neutral.obj").is_file():
                file = read_mesh(place / "neutral.obj")
                marks = json.loads((place / "landmarks.json").read_text(encoding="utf-8"))["points"]
                truth = file.document.vertices[[marks[name] for name in FEATURE_POINT_NAMES]]
                yield Head(f"{person.name} {remeshed}".strip(), "people", file.mesh, truth)


def ict(folder: Path) -> Iterator[Head]:
    """The ICT head, its identities, two remeshes, and the target of pairs P and M, of which 19 points are known."""
    head = np.load(folder / "ict_head_dev.npz")
    marks = head["lm68"][LANDMARK_INDICES]
    neutral = head["V"].astype(np.float64)
    yield Head("ICT", "ICT", Mesh.of_triangles(neutral, head["T"]), neutral[marks])
    for number, identity in enumerate(head["ID"].astype(np.float64)):
        yield Head(
            f"ICT {number}",
            "ICT",
            Mesh.of_triangles(neutral + identity, head["T"]),
            (neutral + identity)[marks],
        )
    for name in ("ict_remesh_37500", "ict_remesh_7678"):
        remesh = np.load(folder / f"{name}.npz")
        yield Head(name.replace("_", " "), "ICT", Mesh.of_triangles(remesh["V"], remesh["T"]), neutral[marks])
    pair = np.load(folder / "pair_M_ict_to_37500.npz")
    yield Head("pair P, M target", "ICT", Mesh.of_triangles(pair["tV"], pair["tT"]), _carried(pair, marks))


def arkit(folder: Path) -> Iterator[Head]:
    """Pair X: the narrow ICT face, and another artist's on which markers say where the same points are."""
    marks = np.load(folder / "ict_head_dev.npz")["lm68"][LANDMARK_INDICES]
    pair = np.load(folder / "pair_X_KL_to_ICTnarrow.npz")
    narrow = Mesh.of_triangles(pair["tV"], pair["tT"])
    yield Head("ICT narrow", "ICT", narrow, narrow.vertices[marks])
    at = {target: source for source, target in pair["markers"].tolist()}
    places = [pair["sV"][at[mark]] if mark in at else [np.nan] * 3 for mark in marks.tolist()]
    yield Head("ARKit KL", "ICT", Mesh.of_triangles(pair["sV"], pair["sT"]), np.array(places, np.float64))


def unmarked(folder: Path) -> Iterator[Head]:
    """MakeHuman's identities, a scan and MediaPipe's mask, on which nobody marked points."""
    nothing = np.full((len(FEATURE_POINT_NAMES), 3), np.nan)
    human = np.load(folder / "makehuman_head_dev.npz")
    yield Head("MakeHuman", "", Mesh.of_triangles(human["V"], human["T"]), nothing)
    for name, identity in zip(human["ids"].tolist(), human["ID"], strict=True):
        yield Head(f"MakeHuman {name}", "", Mesh.of_triangles(human["V"] + identity, human["T"]), nothing)
    for name in ("sumner_head", "mediapipe_canonical"):
        other = np.load(folder / f"{name}.npz")
        yield Head(name.replace("_", " "), "", Mesh.of_triangles(other["V"], other["T"]), nothing)


def _carried(pair: Any, marks: NDArray[Any]) -> F64:
    """Where a pair's markers say that vertices of its source are on its target."""
    at = dict(pair["markers"].tolist())
    places = [pair["tV"][at[mark]] if mark in at else [np.nan] * 3 for mark in marks.tolist()]
    return np.array(places, np.float64)
