"""Normals stored in a file, updated as its surface moves."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from guise.analogy.formats.polygons import Polygons
from guise.common.arrays import F64, Bool, Int

MAX_MAGNITUDE = 1e30  # of a number that can be meant; float32 holds it
STEPS_PER_UNIT = 1000  # of a normal's coordinate: normals in one step are equal


class StoredNormals:
    """The normals of a file, which follow its vertices.

    Each normal changes as much as the normal of the faces around it.  Hard edges and manual edits therefore stay, and
    nothing changes where nothing moves.  Those that point away from the normals of their faces, as in a mirrored file
    whose faces kept their winding, follow the faces' backs.

    Parameters
    ----------
    normals : (k, 3).   ids : (c,) the normal of each corner.   vertices : (n, 3).
    polygons : over the vertices.   places : (n,) the same number for vertices split by a seam.
    """

    def __init__(self, normals: F64, ids: Int, vertices: F64, polygons: Polygons, places: Int) -> None:
        self._normals, self._polygons = normals, polygons
        self._sizes = np.linalg.norm(normals, axis=1, keepdims=True)
        alike = np.unique(_quantised(normals), return_inverse=True)[1]
        both = places[polygons.corners] * len(normals) + alike[ids]
        fans = np.unique(both, return_inverse=True)[1]  # corners at one position with one normal
        self._fans = _summing_matrix(fans, polygons.owners, int(fans.max()) + 1, len(polygons.sizes))
        share = 1 / np.bincount(ids, minlength=len(normals)).clip(1)
        self._means = _summing_matrix(ids, fans, len(normals), int(fans.max()) + 1, share[ids])
        self._before = self._of_fans(vertices)
        self._side = -1.0 if float((normals * (self._means @ self._before)).sum()) < 0 else 1.0

    def updated(self, vertices: F64) -> F64:
        """The normals (k, 3) for other vertices (n, 3)."""
        change = self._side * np.asarray(self._means @ (self._of_fans(vertices) - self._before))
        turned = unit_vectors(self._normals + change * self._sizes) * self._sizes
        return np.where(any_coordinate(change != 0)[:, None], turned, self._normals)

    def _of_fans(self, vertices: F64) -> F64:
        return unit_vectors(np.asarray(self._fans @ self._polygons.area_vectors(vertices)))


def polygon_vertex_normals(vertices: F64, polygons: Polygons) -> F64:
    """(n, 3) unit normals of vertices (n, 3), weighted by the areas of their polygons; 0 where there is none."""
    sums = _summing_matrix(polygons.corners, polygons.owners, len(vertices), len(polygons.sizes))
    return unit_vectors(np.asarray(sums @ polygons.area_vectors(vertices)))


def finite_or_zero(values: F64) -> F64:
    """Values (n, d) of a file, with rows set to 0 that are NaN or exceed `MAX_MAGNITUDE`."""
    return np.where((np.abs(values) < MAX_MAGNITUDE).all(axis=1, keepdims=True), values, 0.0)


def any_coordinate(chosen: Bool) -> Bool:
    """(n,) whether any of three is chosen, (n, 3); several times faster than numpy's any."""
    return np.asarray(chosen[:, 0] | chosen[:, 1] | chosen[:, 2])


def unit_vectors(vectors: F64) -> F64:
    """Vectors (..., 3) scaled to length 1; 0 stays 0."""
    square = np.einsum("...i,...i->...", vectors, vectors)  # several times faster than numpy's norm
    return np.asarray(vectors / np.sqrt(square).clip(1e-300)[..., None])


def _summing_matrix(
    rows: Int, columns: Int, height: int, width: int, weights: F64 | None = None
) -> sp.csr_array:
    """The matrix that adds up weighted columns in rows."""
    held = np.ones(len(rows)) if weights is None else weights
    return sp.csr_array(sp.coo_array((held, (rows, columns)), shape=(height, width)))


def _quantised(normals: F64) -> Int:
    """(k,) one number per direction, equal within the rounding of files."""
    steps = np.rint(unit_vectors(normals) * STEPS_PER_UNIT).astype(np.intp) + STEPS_PER_UNIT
    side = 2 * STEPS_PER_UNIT + 1
    return np.asarray((steps[:, 0] * side + steps[:, 1]) * side + steps[:, 2], np.intp)
