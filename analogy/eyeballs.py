"""Eyeballs turn as those of the source do, about their own centres, and never leave them.  Any unit."""

from __future__ import annotations

import numpy as np

from guise.analogy.anatomy import FaceFrame, kind_mask
from guise.analogy.carriers import components_of
from guise.analogy.mesh import Mesh
from guise.analogy.rigid import align_rigid_robust, apply_rigid
from guise.common.arrays import F64, Int

MAX_RADIUS_WIDTHS = 0.8  # of the eye, of a sphere that is an eyeball
MAX_OFF_SPHERE = 0.15  # mean distance from it, in radii
MAX_BENT = 0.25  # share of the source's motion that is not rigid, beyond which nothing is known of it
FLAT_DEPTH_WIDTHS = 0.5  # of the eye, of the centre of one that is no ball behind its front


class EyeTurns:
    """Turns the eyeballs of a target.

    Parameters
    ----------
    source, target : neutral, with kinds.   frames : of their faces.   turn : (3, 3) from the source to the target.
    """

    def __init__(self, source: Mesh, target: Mesh, frames: tuple[FaceFrame, FaceFrame], turn: F64) -> None:
        own, other = (_eyeballs(mesh, frame) for mesh, frame in zip((source, target), frames, strict=True))
        self._turn, self._source, self._rest = turn, source.vertices, target.vertices
        self._pairs = [
            (
                own[side][0],
                np.concatenate(other[side]),
                _centre(target.vertices[other[side][0]], frames[1], side),
            )
            for side in (0, 1)
            if own[side] and other[side]
        ]

    def __call__(self, expressive: F64, made: F64) -> F64:
        """The target (N_t, 3) with its eyes turned, for a source (N_s, 3) without the motion of the head."""
        for own, rows, centre in self._pairs:
            before, after = self._source[own], expressive[own]
            turn, shift = align_rigid_robust(before, after, np.ones(len(own)))
            bent = np.linalg.norm(apply_rigid(before, turn, shift) - after, axis=1).sum()
            if bent > MAX_BENT * np.linalg.norm(after - before, axis=1).sum():
                turn = np.eye(3)
            here = self._turn @ turn @ self._turn.T
            made[rows] = centre + (self._rest[rows] - centre) @ here.T
        return made


def _eyeballs(mesh: Mesh, face: FaceFrame) -> tuple[list[Int], list[Int]]:
    """The components of the right and of the left eyeball, the largest first."""
    found: tuple[list[Int], list[Int]] = ([], [])
    chosen = kind_mask(mesh, ("eyeball",))
    for part in components_of(mesh):
        if chosen[part[0]]:
            left = (mesh.vertices[part].mean(0) - face.between_eyes) @ face.axes[0] > 0
            found[int(left)].append(part)
    for side in found:
        side.sort(key=lambda part: -float(np.ptp(mesh.vertices[part], axis=0).max()))
    return found


def _centre(at: F64, face: FaceFrame, side: int) -> F64:
    """The centre (3,) of the sphere that vertices (n, 3) lie on; of a disc, a place behind it."""
    middle = at.mean(0)
    width = face.eyes[side][1]
    columns = np.column_stack([2 * (at - middle), np.ones(len(at))])
    found = np.linalg.lstsq(columns, ((at - middle) ** 2).sum(1), rcond=None)[0]
    radius = float(np.sqrt(max(found[3] + found[:3] @ found[:3], 0)))
    off = np.abs(np.linalg.norm(at - middle - found[:3], axis=1) - radius).mean()
    if radius < MAX_RADIUS_WIDTHS * width and off < MAX_OFF_SPHERE * radius:
        return np.asarray(middle + found[:3])
    return np.asarray((at.min(0) + at.max(0)) / 2 - FLAT_DEPTH_WIDTHS * width * face.axes[2])
