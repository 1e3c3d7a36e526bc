"""Guides of a registration along the cheeks, the jaw and the neck (the contours of Song et al. 2007, section III).

The edge of a jaw is no guide: seen from anywhere it runs over other skin on other people, a centimetre and more away.
What lies between places that match is surer.  Planes through both ears cut the skin through the corners of the mouth,
at the chin and below it; each cut is a curve on either head, and the source's may slide along the target's.  Where the
ears of the target are, the registration itself says after its first round.  Any unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.analogy.anatomy import FaceFrame
from guise.analogy.deform import CurveConstraints
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.geometry import Surface, vertex_normals
from guise.analogy.normals import unit_vectors
from guise.common.arrays import F64, Int


@dataclass(frozen=True)
class Contour:
    """A guide: where it is on a head.

    Parameters
    ----------
    ear : (up, forward) of the place at the ears through which its plane passes, in spans from the mouth.
    through : feature points, through whose middle it passes.   below : turn of the plane below them, of the angle at
        the ears from the root of the nose to the chin.   angles : degrees, from the ear towards the middle.
    """

    ear: tuple[float, float]
    through: tuple[str, ...]
    below: float
    angles: tuple[float, float]


TRAGUS, LOBE = (0.32, -0.82), (0.01, -0.87)
CONTOURS = {
    "cheek": Contour(TRAGUS, ("mouth_corner_right", "mouth_corner_left"), 0.0, (10.0, 60.0)),
    "jaw": Contour(TRAGUS, ("chin",), 0.0, (10.0, 90.0)),
    "neck": Contour(LOBE, ("chin",), 0.2, (10.0, 90.0)),
}
TRUST = 0.3  # of a place on a guide, of a feature point's
PLACES, FINER = 21, 10  # places on each guide, and on the target's for each
EAR_REACH_SPANS = 0.15  # around the place of an ear, within which its outermost vertex lies
MAX_EAR_DISTANCE_SPANS = 0.1  # of the ear of the deformed source from the target


def find_contours(
    source: tuple[F64, Int, F64], target: Surface, points: F64, fitted: F64
) -> CurveConstraints | None:
    """The guides of a source whose ears lie on the target already; None where it has no ears.

    Parameters
    ----------
    source : skin (n, 3), faces (m, 3) and feature points (20, 3).   points : (20, 3) of the target.
    fitted : (n, 3) the skin deformed onto the target, about.
    """
    vertices, faces, own_points = source
    own, other = FaceFrame.of(own_points), FaceFrame.of(points)
    corners, weights, number = [], [], []
    curves: list[F64] = []
    for contour in CONTOURS.values():
        ears = _ears(vertices, own, contour.ear)
        if ears is None:
            continue
        facing = vertex_normals(fitted, faces)[ears]
        there = target.closest_points(fitted[ears], facing).positions
        if np.linalg.norm(there - fitted[ears], axis=1).max() > MAX_EAR_DISTANCE_SPANS * other.span:
            continue
        first, last = np.deg2rad(contour.angles)
        for turns in ((first, last), (np.pi - first, np.pi - last)):
            angles = np.linspace(*turns, PLACES)
            at, share, _ = _cut(vertices, faces, vertices[ears], own_points, contour, own, angles)
            fine = np.linspace(*turns, FINER * PLACES)
            _, _, line = _cut(target.vertices, target.faces, there, points, contour, other, fine)
            if len(at) and len(line):
                number.append(np.full(len(at), len(curves)))
                corners.append(at)
                weights.append(share)
                curves.append(line)
    if not curves:
        return None
    each = np.concatenate(number)
    return CurveConstraints(
        np.concatenate(corners), np.concatenate(weights), np.full(len(each), TRUST), each, tuple(curves)
    )


def _ears(vertices: F64, face: FaceFrame, at: tuple[float, float]) -> Int | None:
    """The outermost vertices (2,) around a place (up, forward) at the left and the right ear; None without any."""
    side, up, forward = ((vertices - face.mouth) @ face.axes.T / face.span).T
    near = np.flatnonzero(np.hypot(up - at[0], forward - at[1]) < EAR_REACH_SPANS)
    chosen = [near[sign * side[near] > 0] for sign in (1, -1)]
    if not all(len(one) for one in chosen):
        return None
    return np.array([one[np.abs(side[one]).argmax()] for one in chosen])


def _cut(
    vertices: F64, faces: Int, ears: F64, points: F64, contour: Contour, face: FaceFrame, angles: F64
) -> tuple[Int, F64, F64]:
    """Corners (k, 3), weights (k, 3) and places (k, 3) of a contour at angles around the middle between the ears."""
    middle, across = ears.mean(0), unit_vectors(ears[0] - ears[1])
    place = dict(zip(FEATURE_POINT_NAMES, points, strict=True))

    def ahead(to: F64) -> F64:
        way = to - middle
        return unit_vectors(way - way @ across * across)

    way = ahead(np.mean([place[name] for name in contour.through], axis=0))
    down = np.cross(way, across)
    down *= -np.sign(down @ face.axes[1])
    full = np.arccos(np.clip(ahead(place["nose_bridge"]) @ ahead(place["chin"]), -1, 1))
    turn = contour.below * full
    return outline(
        vertices, faces, middle, np.stack([across, np.cos(turn) * way + np.sin(turn) * down]), angles
    )


def outline(vertices: F64, faces: Int, middle: F64, axes: F64, angles: F64) -> tuple[Int, F64, F64]:
    """The outermost places of a surface, cut by a plane, at angles (k,) around a place (3,) on it.

    What lies further in, such as a cavity of the mouth, does not matter.  Angles without any surface are left out.

    Parameters
    ----------
    axes : (2, 3) of the plane, orthonormal; an angle turns from the first to the second.

    Returns
    -------
    corners : (j, 3) vertices.   weights : (j, 3) barycentric.   places : (j, 3).
    """
    off = (vertices - middle) @ np.cross(*axes)
    above = off[faces] > 0
    crossing = above.any(1) & ~above.all(1)
    cut, above = faces[crossing], above[crossing]
    alone = np.where((above.sum(1) == 1)[:, None], above, ~above).argmax(1)
    cut = np.stack([cut[np.arange(len(cut)), (alone + k) % 3] for k in range(3)], axis=1)
    flat = (vertices[cut] - middle) @ axes.T  # (c, 3, 2)
    height = off[cut]
    share = height[:, :1] / (height[:, :1] - height[:, 1:])  # (c, 2), from the lone corner to the others
    start, end = (flat[:, 0] + share[:, k, None] * (flat[:, k + 1] - flat[:, 0]) for k in (0, 1))
    corners, weights = [], []
    for angle in angles:
        ray = np.array([np.cos(angle), np.sin(angle)])
        beside = np.array([-ray[1], ray[0]])
        first, last = start @ beside, end @ beside
        hit = np.flatnonzero((first > 0) != (last > 0))
        along = first[hit] / (first[hit] - last[hit])
        far = (start[hit] + along[:, None] * (end[hit] - start[hit])) @ ray
        if not len(far) or far.max() <= 0:
            continue
        best = far.argmax()
        face, part = hit[best], along[best]
        one, two = (1 - part) * share[face, 0], part * share[face, 1]
        corners.append(cut[face])
        weights.append((1 - one - two, one, two))
    at, of = np.array(corners, np.intp).reshape(-1, 3), np.array(weights, np.float64).reshape(-1, 3)
    return at, of, np.einsum("kc,kci->ki", of, vertices[at])
