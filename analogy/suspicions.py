"""What makes a match of two heads doubtful: little correspondence, lips or lids of one piece, a second head."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np
from scipy.spatial import cKDTree

from guise.aam.similarity import Failed
from guise.analogy.anatomy import FaceFrame
from guise.analogy.correspondence import Correspondence
from guise.analogy.face_views import face_views_along
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.geometry import geodesic_patch
from guise.analogy.lids import SIDES, find_lids
from guise.analogy.mesh import Mesh
from guise.analogy.registration import skin_mask
from guise.analogy.triangulation import triangulate_face
from guise.analogy.views import ViewedMesh
from guise.common.arrays import F64, Bool

MIN_MATCHED = 0.6  # of the face
FACE_SPANS = 1.0  # around the middle of the face; spans are between the outer corners of the eyes
SLIT_DETOUR = 1.6  # of the way on the skin from lip to lip to the straight one, from which there is a slit
SLIT_WIDTHS = 1.2  # of the mouth, around it, of the skin that is looked at
MAX_VIEWS = 2  # that look like a further face which are tried
HEAD_SPANS = 2.0  # around the eyes, beyond which a face is another's


def suspicions(source: Mesh, target: Mesh, points: tuple[F64, F64], link: Correspondence) -> Iterator[str]:
    """Sentences for the user, none when all is well.   points : feature points (20, 3) of both heads."""
    face = FaceFrame.of(points[1])
    near = (
        np.linalg.norm(target.vertices - (face.between_eyes + face.mouth) / 2, axis=1)
        < FACE_SPANS * face.span
    )
    found = link.found[near & skin_mask(target)]
    if len(found) and found.mean() < MIN_MATCHED:
        yield (
            f"only {found.mean():.0%} of the target's face has a counterpart on the source: check the feature points, "
            "with `guise analogy mesh landmarks --picture`"
        )
    if has_slit(source, points[0]) and not has_slit(target, points[1]):
        yield (
            "the target has no slit between its lips, as the source has: its mouth cannot open, and what the source's "
            "lips do stretches its skin"
        )
    lids = find_lids(source, points[0]), find_lids(target, points[1])
    shut = [side for side, own, other in zip(SIDES, *lids, strict=True) if own is not None and other is None]
    if shut:
        eyes = " and ".join(shut) + (" eyes are" if len(shut) > 1 else " eye is")
        yield f"the target's {eyes} shut or of one piece, unlike the source's: lids may move wrongly there"
    for name, mesh, own in (("source", source, points[0]), ("target", target, points[1])):
        if has_second_face(mesh, FaceFrame.of(own)):
            yield f"the {name} shows a second face: only the first is used; keep one head to a file"


def has_slit(mesh: Mesh, points: F64) -> bool:
    """Whether the way on the skin from the upper to the lower lip leads around something."""
    place = dict(zip(FEATURE_POINT_NAMES, points, strict=True))
    face = FaceFrame.of(points)
    near: Bool = skin_mask(mesh) & (
        np.linalg.norm(mesh.vertices - face.mouth, axis=1) < SLIT_WIDTHS * face.mouth_width
    )
    faces = mesh.faces[near[mesh.faces].all(1)]
    if not len(faces):
        return False
    used = np.unique(faces)
    lips = np.array([place["upper_lip_top"], place["lower_lip_bottom"]])
    first, last = used[cKDTree(mesh.vertices[used]).query(lips)[1]]
    straight = float(np.linalg.norm(mesh.vertices[first] - mesh.vertices[last]))
    return last not in geodesic_patch(mesh.vertices, faces, int(first), SLIT_DETOUR * straight)


def has_second_face(mesh: Mesh, face: FaceFrame) -> bool:
    """Whether somebody else looks the same way."""
    away = np.linalg.norm(mesh.vertices - face.between_eyes, axis=1) > HEAD_SPANS * face.span
    rest = away[mesh.faces].all(1)
    if not rest.any():
        return False
    seen = face_views_along(ViewedMesh.of(mesh).submesh(np.asarray(rest)), face.axes)
    return any(not isinstance(triangulate_face(view), Failed) for view in islice(seen, MAX_VIEWS))
