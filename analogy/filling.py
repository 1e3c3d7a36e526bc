"""Continues values of some vertices of a mesh smoothly over the others, fading to zero.

Any unit; `reach` is in that of the vertices.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from guise.analogy.solver import factorise
from guise.analogy.tents import Rings
from guise.common.arrays import F64, Bool


class BiharmonicFill:
    """Continues values of known vertices over the unknown ones; factorised once.

    The unknown values x minimise the sum of |L x|^2 + |x|^2 / reach^4, with L the Laplacian of the rings: values
    continue without a crease and vanish some reaches away.

    Parameters
    ----------
    vertices : (N, 3).   rings : of them.   known : (N,) bool.   reach : length.
    """

    def __init__(self, vertices: F64, rings: Rings, known: Bool, reach: float) -> None:
        self._unknown, self._known = np.flatnonzero(~known), np.flatnonzero(known)
        if not len(self._unknown):
            return
        laplacian = _laplacian(vertices, rings)
        system = sp.csr_array(laplacian.T @ laplacian + sp.eye_array(rings.count) / reach**4)
        rows = system[self._unknown]
        self._solve = factorise(rows[:, self._unknown])
        self._from = sp.csr_array(rows[:, self._known])

    def __call__(self, values: F64) -> F64:
        """Values (N, k), with those of the unknown vertices replaced."""
        if not len(self._unknown):
            return values
        out = values.copy()
        out[self._unknown] = self._solve(-(self._from @ values[self._known]))
        return out


def _laplacian(vertices: F64, rings: Rings) -> sp.csr_array:
    """(N, N): 4 / (mean squared edge) (mean of the ring - the vertex), which approximates the Laplacian."""
    edges = np.square(vertices[rings.end] - vertices[rings.start]).sum(1)
    degree = np.bincount(rings.start, minlength=rings.count).clip(1)
    square = np.bincount(rings.start, edges, rings.count) / degree
    square = np.maximum(square, 1e-6 * square.mean())
    weight = (4 / (square * degree))[rings.start]
    ring = sp.coo_array((weight, (rings.start, rings.end)), shape=(rings.count, rings.count))
    return sp.csr_array(ring - sp.diags_array(np.asarray(ring.sum(axis=1))))
