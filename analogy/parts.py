"""Parts of a head beside the skin (eyes, teeth, tongue, lashes) and how the skin moves them.

The skin consists of the large components (`guise.analogy.registration.skin_mask`).  Other parts that are mostly open
border (cards: lashes, brows) follow the skin under them vertex by vertex.  The rest keep their shape and follow the
skin close to them as far as it moves rigidly: the lower teeth move with the jaw, but teeth do not move with a smile,
which stretches the lips, nor eyes with their lids.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from guise.aam.similarity import align_rigid
from guise.analogy.geometry import Surface
from guise.analogy.geometry import border_mask as borders
from guise.analogy.mesh import Mesh
from guise.analogy.rigid import align_rigid_robust, apply_rigid
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True)
class PartLimits:
    """Thresholds of parts beside the skin."""

    min_border_share: float = 1 / 3  # of a part's vertices on an open border, from which it consists of cards
    skin_samples: int = 64  # skin vertices that say how a part moves
    min_skin_vertices: int = 8  # distinct ones among them
    max_skin_distance_radii: float = 0.25  # of the skin that moves a part, in the part's radii
    rigid_residual: float = 0.1  # non-rigid share of the skin's motion, up to which a part moves fully
    loose_residual: float = 0.25  # and from which it stays


PART_LIMITS = PartLimits()


def submesh(mesh: Mesh, kept: Bool) -> Mesh:
    """The mesh of the vertices in `kept` (N,), in their order; components must be kept or dropped as a whole."""
    if kept.all():
        return mesh
    number = np.cumsum(kept) - 1
    faces = (number[part[kept[part[:, 0]]]] for part in (mesh.triangles, mesh.quads))
    return Mesh(mesh.vertices[kept], *faces)


class PartMotion:
    """Moves the other parts with the skin.

    Parameters
    ----------
    mesh : neutral.   skin : (N,) bool.   still : the other parts stay where they are.
    """

    def __init__(self, mesh: Mesh, skin: Bool, still: bool) -> None:
        self._vertices = mesh.vertices
        self._skin = np.flatnonzero(skin)
        self._still = still or bool(skin.all())
        if self._still:
            return
        border = borders(mesh.faces, len(mesh.vertices))
        labels = [np.flatnonzero(mesh.components == label) for label in np.unique(mesh.components[~skin])]
        cards = [part for part in labels if border[part].mean() >= PART_LIMITS.min_border_share]
        self._solid = [part for part in labels if border[part].mean() < PART_LIMITS.min_border_share]
        self._cards = np.concatenate([np.empty(0, np.intp), *cards])
        self._under, self._shares = self._beneath(mesh.faces[skin[mesh.faces[:, 0]]])
        self._around = np.array([self._surroundings(part) for part in self._solid], np.intp)

    def __call__(self, skin: F64) -> F64:
        """All vertices (N, 3), given those of the skin (n, 3)."""
        if len(skin) == len(self._vertices):
            return skin
        out = self._vertices.copy()
        out[self._skin] = skin
        return out if self._still else self._brought_along(out)

    def _brought_along(self, out: F64) -> F64:
        way = out - self._vertices
        if len(self._cards):
            shift = np.einsum("nk,nki->ni", self._shares, way[self._under])
            out[self._cards] = self._vertices[self._cards] + shift
        if self._solid:
            for part, turn, shift in zip(self._solid, *self._motions(out), strict=True):
                out[part] = apply_rigid(self._vertices[part], turn, shift)
        return out

    def _motions(self, made: F64) -> tuple[F64, F64]:
        """R (c, 3, 3), t (c, 3) of each solid part when the skin vertices are at `made` (N, 3)."""
        before, after = self._vertices[self._around], made[self._around]
        alike = np.ones(before.shape[:2])
        rigid = apply_rigid(before, *align_rigid_robust(before, after, alike))
        off = np.linalg.norm(after - rigid, axis=2).sum(1)
        way = np.linalg.norm(after - before, axis=2).sum(1)
        share = np.clip(
            (PART_LIMITS.loose_residual - off / np.maximum(way, 1e-300))
            / (PART_LIMITS.loose_residual - PART_LIMITS.rigid_residual),
            0,
            1,
        )[:, None, None]
        return align_rigid(before, before + share * (rigid - before), alike)

    def _beneath(self, faces: Int) -> tuple[Int, F64]:
        """Corners and barycentric weights (n, 3) of the skin point closest to each vertex of the cards."""
        points = self._vertices[self._cards]
        if not len(points):
            return np.empty((0, 3), np.intp), np.empty((0, 3))
        places = Surface(self._vertices, faces, 0.0).closest_points(points, np.zeros_like(points))
        return faces[places.faces], places.weights

    def _surroundings(self, part: Int) -> Int:
        """An even sample of the skin vertices close to a part, or its nearest ones."""
        points = self._vertices[part]
        radius = np.linalg.norm(points - points.mean(0), axis=1).max()
        away, _ = cKDTree(points).query(self._vertices[self._skin])
        near = np.argsort(away, kind="stable")[
            : max(
                PART_LIMITS.min_skin_vertices,
                int((away <= PART_LIMITS.max_skin_distance_radii * radius).sum()),
            )
        ]
        return np.asarray(
            self._skin[near[np.linspace(0, len(near) - 1, PART_LIMITS.skin_samples).round().astype(int)]]
        )
