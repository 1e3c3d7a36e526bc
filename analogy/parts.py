"""Parts of a head beside its skin: eyes, teeth, tongue, lashes, and how the skin takes them along.

The skin are the large components (`guise.analogy.register.skin_of`).  Of the other parts, those that are
mostly open border
(cards: lashes, brows) follow the skin under them vertex by vertex.  The others keep their form, and move with the skin
close to them as far as that moves as one body: the lower teeth go with the jaw, but no teeth with a smile, which
stretches the lips, and no eye with its lid.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from guise.analogy.geometry import Surface
from guise.analogy.geometry import border as borders
from guise.analogy.mesh import Mesh
from guise.analogy.rigid import fit, fit_most, moved
from guise.common.arrays import F64, Bool, Int

OPEN = 1 / 3  # of a part's vertices on an open border, from which it is cards
AROUND = 64  # skin vertices that say how a part moves
FEWEST = 8  # of them that are different ones
CLOSE = 0.25  # of a part's radius: skin from which it takes its motion
AS_ONE, APART = (
    0.1,
    0.25,
)  # of the skin's way, what is no motion of one body: a part goes all the way, or stays


def areas(mesh: Mesh) -> F64:
    """(N,) a third of the area of the faces at each vertex."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    face = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    return np.asarray(mesh.rings.around @ face)


def restricted(mesh: Mesh, kept: Bool) -> Mesh:
    """The mesh of whole components only: vertices in their order, those `kept` (N,) is False for left out."""
    if kept.all():
        return mesh
    number = np.cumsum(kept) - 1
    faces = (number[part[kept[part[:, 0]]]] for part in (mesh.triangles, mesh.quads))
    return Mesh(mesh.vertices[kept], *faces)


class Parts:
    """Moves what is not skin with the skin.

    Parameters
    ----------
    mesh : neutral.   skin : (N,) bool.   still : what is not skin stays where it is instead.
    """

    def __init__(self, mesh: Mesh, skin: Bool, still: bool) -> None:
        self._vertices = mesh.vertices
        self._skin = np.flatnonzero(skin)
        self._still = still or bool(skin.all())
        if self._still:
            return
        border = borders(mesh.faces, len(mesh.vertices))
        labels = [np.flatnonzero(mesh.components == label) for label in np.unique(mesh.components[~skin])]
        cards = [part for part in labels if border[part].mean() >= OPEN]
        self._solid = [part for part in labels if border[part].mean() < OPEN]
        self._cards = np.concatenate([np.empty(0, np.intp), *cards])
        self._under, self._shares = self._beneath(mesh.faces[skin[mesh.faces[:, 0]]])
        self._around = np.array([self._surroundings(part) for part in self._solid], np.intp)

    def __call__(self, skin: F64) -> F64:
        """All vertices (N, 3) for those of the skin (n, 3)."""
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
                out[part] = moved(self._vertices[part], turn, shift)
        return out

    def _motions(self, made: F64) -> tuple[F64, F64]:
        """R (c, 3, 3), t (c, 3) of each solid part, when the vertices of the skin are at `made` (N, 3)."""
        before, after = self._vertices[self._around], made[self._around]
        alike = np.ones(before.shape[:2])
        rigid = moved(before, *fit_most(before, after, alike))
        off = np.linalg.norm(after - rigid, axis=2).sum(1)
        way = np.linalg.norm(after - before, axis=2).sum(1)
        share = np.clip((APART - off / np.maximum(way, 1e-300)) / (APART - AS_ONE), 0, 1)[:, None, None]
        return fit(before, before + share * (rigid - before), alike)

    def _beneath(self, faces: Int) -> tuple[Int, F64]:
        """For each vertex of the cards the corners of the skin's place closest to it and their shares, (n, 3) each."""
        points = self._vertices[self._cards]
        if not len(points):
            return np.empty((0, 3), np.intp), np.empty((0, 3))
        places = Surface(self._vertices, faces, 0.0).closest(points, np.zeros_like(points))
        return faces[places.faces], places.weights

    def _surroundings(self, part: Int) -> Int:
        """AROUND of the skin vertices that are close to a part, evenly taken, or its nearest."""
        points = self._vertices[part]
        radius = np.linalg.norm(points - points.mean(0), axis=1).max()
        away, _ = cKDTree(points).query(self._vertices[self._skin])
        near = np.argsort(away, kind="stable")[: max(FEWEST, int((away <= CLOSE * radius).sum()))]
        return np.asarray(self._skin[near[np.linspace(0, len(near) - 1, AROUND).round().astype(int)]])
