"""Two matched heads, ready to transfer expressions from one to the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from guise.aam.similarity import Failed, align
from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_points import FeaturePoints, find_feature_points
from guise.analogy.formats.files import MeshFile
from guise.analogy.lids import FacePair
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.registration import skin_mask
from guise.analogy.rigid import rotation_angle
from guise.analogy.suspicions import suspicions
from guise.analogy.tents import vertex_error
from guise.analogy.transfer import Transfer
from guise.app.meshes.context import RunContext
from guise.app.meshes.options import TransferOptions
from guise.app.meshes.parts import NamedPart, name_parts
from guise.app.meshes.points import AUTO, feature_points_of
from guise.common.arrays import F64

MISALIGNED_ANGLE_DEG, MISALIGNED_SCALE_RATIO = (
    30.0,
    1.5,
)  # from which a note says that heads are not roughly aligned
MATCHING, PREPARING = "matching", "preparing"


@dataclass(frozen=True, eq=False)
class MatchedPair:
    """Matched heads, whose meshes say what their parts are.

    points : feature points of both, None if none were needed.   facts : method and quality of the match, for reports.
    face : of both, None where none was seen.   parts : of the target; none where no face was seen.
    fitted : (N_s, 3) the source deformed onto the target, unless the match does without.
    """

    source: MeshFile
    target: MeshFile
    points: tuple[FeaturePoints, FeaturePoints] | None
    correspondence: Correspondence
    facts: Mapping[str, Any]
    face: FacePair | None
    parts: tuple[NamedPart, ...]
    fitted: F64 | None


@dataclass(frozen=True, eq=False)
class TransferPair:
    """Matched heads and the transfer from source to target."""

    heads: MatchedPair
    transfer: Transfer

    def motion_error(self, expressive: F64, made: F64) -> F64:
        """E of the appendix (N_t,): relative difference of each motion of the target to that of the source; NaN where
        nothing moves or there is no counterpart."""
        neutral, link = self.heads.target.mesh.vertices, self.heads.correspondence
        way = link.interpolate(expressive - self.heads.source.mesh.vertices) @ self.transfer.pose.linear.T
        return np.where(link.found, vertex_error(neutral, neutral + way, made), np.nan)


def prepare_pair(
    source: MeshFile, target: MeshFile, options: TransferOptions, context: RunContext
) -> TransferPair:
    """Match two heads and prepare the transfer.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError
    """
    pair = match_heads(source, target, options, context)
    with context.stage(PREPARING):
        meshes = pair.source.mesh, pair.target.mesh
        made = Transfer(
            *meshes, pair.correspondence, options.method, options.keep_rigid, pair.face, pair.fitted
        )
    return TransferPair(pair, made)


def match_heads(
    source: MeshFile, target: MeshFile, options: TransferOptions, context: RunContext
) -> MatchedPair:
    """Match two heads: vertex to vertex if their faces are the same, otherwise by the method of the options."""
    kind, landmarks = options.correspondence, options.landmarks
    if kind == "dense" and landmarks is None and have_same_faces(source.mesh, target.mesh):
        return _matched_by_vertices(source, target, options)
    points = feature_points_of_both(source, target, landmarks, context)
    with context.stage(MATCHING):
        placed = landmarks is not None and set(landmarks) != {AUTO}
        positions = points[0].positions, points[1].positions
        own = name_parts(source, positions[0])
        named = name_parts(target, positions[1], options.parts, own)
        source, target = own.file, named.file
        face = FacePair.of(source.mesh, target.mesh, positions, placed=placed)
        link, quality, fitted = _match(source.mesh, target.mesh, face, options)
        for sentence in suspicions(source.mesh, target.mesh, positions, link):
            context.say(sentence)
    facts = {"kind": kind, "found": round(float(link.found[skin_mask(target.mesh)].mean()), 4), **quality}
    return MatchedPair(source, target, points, link, facts, face, named.parts, fitted)


def _matched_by_vertices(source: MeshFile, target: MeshFile, options: TransferOptions) -> MatchedPair:
    """Heads with the same faces; without a face, what is skin is judged by size."""
    link = Correspondence.identity(len(target.mesh.vertices))
    facts = {"kind": "vertex to vertex", "found": 1.0}
    found = find_feature_points(source.mesh)
    if isinstance(found, Failed):
        return MatchedPair(source, target, None, link, facts, None, (), target.mesh.vertices)
    positions = source.mesh.vertices[found.vertices], target.mesh.vertices[found.vertices]
    own = name_parts(source, positions[0])
    named = name_parts(target, positions[1], options.parts, own)
    source, target = own.file, named.file
    face = FacePair.of(source.mesh, target.mesh, positions)
    return MatchedPair(source, target, None, link, facts, face, named.parts, target.mesh.vertices)


def feature_points_of_both(
    source: MeshFile, target: MeshFile, landmarks: tuple[str, str] | None, context: RunContext
) -> tuple[FeaturePoints, FeaturePoints]:
    """Feature points of both heads: from files, or detected for "auto" or None.

    A note says when the heads are not roughly aligned.
    """
    with context.stage("landmarks"):
        first, second = landmarks or (AUTO, AUTO)
        points = feature_points_of(source, first), feature_points_of(target, second)
    _note_misalignment(*points, context)
    return points


def have_same_faces(source: Mesh, target: Mesh) -> bool:
    """Whether two meshes have the same faces over as many vertices."""
    return (
        len(source.vertices) == len(target.vertices)
        and np.array_equal(source.triangles, target.triangles)
        and np.array_equal(source.quads, target.quads)
    )


def _match(
    source: Mesh, target: Mesh, face: FacePair, options: TransferOptions
) -> tuple[Correspondence, dict[str, Any], F64 | None]:
    if options.correspondence == "cylinder":
        from guise.analogy.cylinder import cylindrical_correspondence

        return cylindrical_correspondence(source, target, *face.points), {}, None
    from guise.analogy.registration import register

    contours = face.points if options.guides == "contours" else None
    done = register(source, target, face.with_margins(source, target), face.trust, contours)
    return done.correspondence(), {"quality": asdict(done.quality)}, done.fitted


def _note_misalignment(source: FeaturePoints, target: FeaturePoints, context: RunContext) -> None:
    """Note that the heads are not roughly aligned, and that their feature points align them."""
    pose = align(source.positions, target.positions)
    if isinstance(pose, Failed):
        raise MeshError(f"the feature points of the two heads do not match: {pose.reason}")
    turn = rotation_angle(pose.rotation)
    if turn > MISALIGNED_ANGLE_DEG or not 1 / MISALIGNED_SCALE_RATIO < pose.scale < MISALIGNED_SCALE_RATIO:
        context.say(
            f"the heads are not roughly aligned (the target is turned by {turn:.0f} degrees and {pose.scale:.3g} "
            "times as large): their feature points align them"
        )
