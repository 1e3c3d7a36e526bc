"""Parts of a head beside its skin: eyes, teeth, tongue, lashes, and how the skin takes them along.

The skin are the large components (`analogy.register.skin_of`).  Of the other parts, those that are mostly open border
(cards: lashes, brows) follow the skin under them vertex by vertex; the others keep their form and move as most of the
skin around them does, so that an eye stays when its lid closes, and the lower teeth go with the chin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from analogy.geometry import Surface
from analogy.geometry import border as borders
from analogy.mesh import Mesh
from analogy.rigid import fit_most, moved

F64 = NDArray[np.float64]
Int = NDArray[np.intp]

OPEN = 1 / 3  # of a part's vertices on an open border, from which it is cards
AROUND = 64  # skin vertices that say how a part moves
FEWEST = 8  # of them that are different ones


def areas(mesh: Mesh) -> F64:
    """(N,) a third of the area of the faces at each vertex."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    face = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    return np.asarray(mesh.rings.around @ face)


def restricted(mesh: Mesh, kept: NDArray[np.bool_]) -> Mesh:
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

    def __init__(self, mesh: Mesh, skin: NDArray[np.bool_], still: bool) -> None:
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
            turn, shift = fit_most(
                self._vertices[self._around], out[self._around], np.ones(self._around.shape)
            )
            for part, r, t in zip(self._solid, turn, shift, strict=True):
                out[part] = moved(self._vertices[part], r, t)
        return out

    def _beneath(self, faces: Int) -> tuple[Int, F64]:
        """For each vertex of the cards the corners of the skin's place closest to it and their shares, (n, 3) each."""
        points = self._vertices[self._cards]
        if not len(points):
            return np.empty((0, 3), np.intp), np.empty((0, 3))
        places = Surface(self._vertices, faces, 0.0).closest(points, np.zeros_like(points))
        return faces[places.faces], places.weights

    def _surroundings(self, part: Int) -> Int:
        """AROUND skin vertices that lie no farther from the part than its own radius, evenly taken, or its nearest."""
        points = self._vertices[part]
        radius = np.linalg.norm(points - points.mean(0), axis=1).max()
        away, _ = cKDTree(points).query(self._vertices[self._skin])
        near = np.argsort(away, kind="stable")[: max(FEWEST, int((away <= radius).sum()))]
        return np.asarray(self._skin[near[np.linspace(0, len(near) - 1, AROUND).round().astype(int)]])
