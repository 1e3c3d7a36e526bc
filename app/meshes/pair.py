"""Two heads that are brought together: matched, and ready to carry expressions from one to the other."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from guise.aam.similarity import Failed, align
from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_points import FeaturePoints
from guise.analogy.formats.files import MeshFile
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.tents import vertex_error
from guise.analogy.transfer import Method, Transfer
from guise.app.meshes.points import AUTO, points_of
from guise.app.meshes.work import Work
from guise.common.arrays import F64

TURNED, SCALED = 30.0, 1.5  # degrees and ratio from which it is said that heads are not roughly aligned
MATCHING, PREPARING = "matching", "preparing"


@dataclass(frozen=True)
class How:
    """How expressions are carried over.

    method : tents, gradients or cloning.   correspondence : dense or cylinder.
    landmarks : files of the source's and the target's feature points, "auto" for those to be found; None: both.
    keep_rigid : parts of the target other than its skin stay where they are.
    """

    method: Method = "tents"
    correspondence: str = "dense"
    landmarks: tuple[str, str] | None = None
    keep_rigid: bool = False


@dataclass(frozen=True, eq=False)
class Pair:
    """Heads that are matched.

    points : feature points of both, None where none were needed.   facts : how and how well they are matched.
    """

    source: MeshFile
    target: MeshFile
    points: tuple[FeaturePoints, FeaturePoints] | None
    correspondence: Correspondence
    facts: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Carrier:
    """A pair, and what carries expressions from its source to its target."""

    pair: Pair
    transfer: Transfer

    def error(self, expressive: F64, made: F64) -> F64:
        """E of the appendix (N_t,): how far each vertex of the target moves, against the source's there; NaN where
        nothing moves or nothing was found."""
        neutral, link = self.pair.target.mesh.vertices, self.pair.correspondence
        way = link.carry(expressive - self.pair.source.mesh.vertices) @ self.transfer.pose.linear.T
        return np.where(link.found, vertex_error(neutral, neutral + way, made), np.nan)


def open_carrier(source: MeshFile, target: MeshFile, how: How, work: Work) -> Carrier:
    """Match two heads and factorise.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError
    """
    pair = matched(source, target, how.landmarks, how.correspondence, work)
    with work.stage(PREPARING):
        made = Transfer(source.mesh, target.mesh, pair.correspondence, how.method, how.keep_rigid)
    return Carrier(pair, made)


def matched(
    source: MeshFile, target: MeshFile, landmarks: tuple[str, str] | None, kind: str, work: Work
) -> Pair:
    """Match two heads: vertex to vertex where their faces are the same, otherwise as `kind` says."""
    if kind == "dense" and landmarks is None and same_faces(source.mesh, target.mesh):
        link = Correspondence.identity(len(target.mesh.vertices))
        return Pair(source, target, None, link, {"kind": "vertex to vertex", "found": 1.0})
    points = both_points(source, target, landmarks, work)
    with work.stage(MATCHING):
        link, quality = _match(source.mesh, target.mesh, (points[0].positions, points[1].positions), kind)
    facts = {"kind": kind, "found": round(float(link.found.mean()), 4), **quality}
    return Pair(source, target, points, link, facts)


def both_points(
    source: MeshFile, target: MeshFile, landmarks: tuple[str, str] | None, work: Work
) -> tuple[FeaturePoints, FeaturePoints]:
    """Feature points of both heads: from files, or found where those are "auto" or None.

    Says when the heads stand far from each other, as these points align them.
    """
    with work.stage("landmarks"):
        first, second = landmarks or (AUTO, AUTO)
        points = points_of(source, first), points_of(target, second)
    _say_how_aligned(*points, work)
    return points


def same_faces(source: Mesh, target: Mesh) -> bool:
    """Whether two meshes have the same faces over as many vertices."""
    return (
        len(source.vertices) == len(target.vertices)
        and np.array_equal(source.triangles, target.triangles)
        and np.array_equal(source.quads, target.quads)
    )


def _match(
    source: Mesh, target: Mesh, points: tuple[F64, F64], kind: str
) -> tuple[Correspondence, dict[str, Any]]:
    if kind == "cylinder":
        from guise.analogy.cylinder import cylindrical

        return cylindrical(source, target, *points), {}
    from guise.analogy.register import register

    done = register(source, target, points)
    return done.correspondence(), {"quality": asdict(done.quality)}


def _say_how_aligned(source: FeaturePoints, target: FeaturePoints, work: Work) -> None:
    """Say when the heads stand far from each other, and that their feature points align them."""
    pose = align(source.positions, target.positions)
    if isinstance(pose, Failed):
        raise MeshError(f"the feature points of the two heads do not fit each other: {pose.reason}")
    turn = math.degrees(math.acos(float(np.clip((np.trace(pose.rotation) - 1) / 2, -1, 1))))
    if turn > TURNED or not 1 / SCALED < pose.scale < SCALED:
        work.say(
            f"the heads are not roughly aligned (the target is turned by {turn:.0f} degrees and {pose.scale:.3g} "
            "times as large): they are aligned by their feature points"
        )
