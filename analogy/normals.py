"""The normals that a file holds, turned with the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analogy.polygons import Polygons

F64 = NDArray[np.float64]
Int = NDArray[np.intp]

ALIKE = 1000  # steps of a coordinate of a normal within which two are one


class Normals:
    """The normals of a file, which follow its vertices.

    Each normal changes by as much as the normal of the faces around it, so that hard edges and what an artist changed
    stay, and nothing changes where nothing moves.

    Parameters
    ----------
    normals : (k, 3).   ids : (c,) the one of each corner.
    polygons : over the file's vertices.   places : (n,) the same for vertices that a seam splits.
    """

    def __init__(self, normals: F64, ids: Int, polygons: Polygons, places: Int) -> None:
        self._normals, self._ids, self._polygons = normals, ids, polygons
        steps = np.rint(unit(normals) * ALIKE).astype(np.int64) + ALIKE
        side = 2 * ALIKE + 1
        coded = np.unique((steps[:, 0] * side + steps[:, 1]) * side + steps[:, 2], return_inverse=True)[1]
        both = places[polygons.corners] * len(normals) + coded[ids]
        self._fan = np.unique(both, return_inverse=True)[1]  # corners at one place with one normal

    def moved(self, before: F64, after: F64) -> F64:
        """The normals (k, 3) for vertices `after` (n, 3), where they are those given for `before`."""
        turned = self._of_fans(after) - self._of_fans(before)
        used = np.bincount(self._ids, minlength=len(self._normals)).clip(1)
        change = _summed(self._ids, turned[self._fan], len(self._normals)) / used[:, None]
        still = ~change.any(axis=1, keepdims=True)
        size = np.linalg.norm(self._normals, axis=1, keepdims=True)
        return np.where(still, self._normals, unit(self._normals + change * size) * size)

    def _of_fans(self, vertices: F64) -> F64:
        areas = self._polygons.areas(vertices)[self._polygons.owners]
        return unit(_summed(self._fan, areas, int(self._fan.max()) + 1))


def smooth(vertices: F64, polygons: Polygons) -> F64:
    """(n, 3) the normal of each vertex (n, 3), of length 1, by the areas of its polygons; 0 where it has none."""
    areas = polygons.areas(vertices)[polygons.owners]
    return unit(_summed(polygons.corners, areas, len(vertices)))


def _summed(ids: Int, vectors: F64, count: int) -> F64:
    return np.stack([np.bincount(ids, vectors[:, axis], count) for axis in range(3)], axis=1)


def unit(vectors: F64) -> F64:
    """Vectors (n, 3) of length 1; 0 stays 0."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True).clip(1e-300))
