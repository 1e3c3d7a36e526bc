"""The normals that a file holds, turned with the surface."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from guise.analogy.formats.polygons import Polygons
from guise.common.arrays import F64, Int

BEYOND = 1e30  # any number that is meant; float32 holds it
ALIKE = 1000  # steps of a coordinate of a normal within which two are one


class Normals:
    """The normals of a file, which follow its vertices.

    Each normal changes by as much as the normal of the faces around it, so that hard edges and what an artist changed
    stay, and nothing changes where nothing moves.

    Parameters
    ----------
    normals : (k, 3), of vertices (n, 3).   ids : (c,) the one of each corner.
    polygons : over the vertices.   places : (n,) the same for vertices that a seam splits.
    """

    def __init__(self, normals: F64, ids: Int, vertices: F64, polygons: Polygons, places: Int) -> None:
        self._normals, self._polygons = normals, polygons
        self._sizes = np.linalg.norm(normals, axis=1, keepdims=True)
        alike = np.unique(_coded(normals), return_inverse=True)[1]
        both = places[polygons.corners] * len(normals) + alike[ids]
        fans = np.unique(both, return_inverse=True)[1]  # corners at one place with one normal
        self._fans = _sums(fans, polygons.owners, int(fans.max()) + 1, len(polygons.sizes))
        share = 1 / np.bincount(ids, minlength=len(normals)).clip(1)
        self._means = _sums(ids, fans, len(normals), int(fans.max()) + 1, share[ids])
        self._before = self._of_fans(vertices)

    def moved(self, vertices: F64) -> F64:
        """The normals (k, 3) for other vertices (n, 3)."""
        change = np.asarray(self._means @ (self._of_fans(vertices) - self._before))
        turned = unit(self._normals + change * self._sizes) * self._sizes
        return np.where(change.any(axis=1, keepdims=True), turned, self._normals)

    def _of_fans(self, vertices: F64) -> F64:
        return unit(np.asarray(self._fans @ self._polygons.areas(vertices)))


def smooth(vertices: F64, polygons: Polygons) -> F64:
    """(n, 3) the normal of each vertex (n, 3), of length 1, by the areas of its polygons; 0 where it has none."""
    sums = _sums(polygons.corners, polygons.owners, len(vertices), len(polygons.sizes))
    return unit(np.asarray(sums @ polygons.areas(vertices)))


def sound(values: F64) -> F64:
    """Values (n, d) as a file gives them; 0 where they cannot be meant (NaN, or beyond what float32 holds)."""
    return np.where((np.abs(values) < BEYOND).all(axis=1, keepdims=True), values, 0.0)


def unit(vectors: F64) -> F64:
    """Vectors (..., 3) of length 1; 0 stays 0."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True).clip(1e-300))


def _sums(rows: Int, columns: Int, height: int, width: int, weights: F64 | None = None) -> sp.csr_array:
    """What adds up values of columns in rows, by weights."""
    held = np.ones(len(rows)) if weights is None else weights
    return sp.csr_array(sp.coo_array((held, (rows, columns)), shape=(height, width)))


def _coded(normals: F64) -> Int:
    """(k,) one number for each direction, the same within the rounding of files."""
    steps = np.rint(unit(normals) * ALIKE).astype(np.intp) + ALIKE
    side = 2 * ALIKE + 1
    return np.asarray((steps[:, 0] * side + steps[:, 1]) * side + steps[:, 2], np.intp)
