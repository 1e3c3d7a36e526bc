"""Continues values of some vertices of a mesh smoothly over the others, fading to zero.

Any unit; `reach` is in that of the vertices.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from guise.analogy.solver import factorise
from guise.analogy.tents import Rings
from guise.common.arrays import F64, Bool, Int

TENSION_REACHES = 0.35  # length beyond which continued values no longer follow their slope
MAX_RIM_RATIO = 1.25  # of a continued value to the longest beside its hole


class TensionFill:
    """Continues values of known vertices over the unknown ones; factorised once.

    The unknown values x minimise the sum of |L x|^2 + (|grad x|^2 + |x|^2 / reach^2) / tension^2, with L the Laplacian
    of the rings: they continue without a crease, soon become harmonic, and vanish some reaches away.  They are hardly
    longer than the longest of the known ones beside their hole: a mouth bag does not fly off where lips part.

    Parameters
    ----------
    vertices : (N, 3).   rings : of them.   known : (N,) bool.   reach : length.
    """

    def __init__(self, vertices: F64, rings: Rings, known: Bool, reach: float) -> None:
        self._unknown, self._known = np.flatnonzero(~known), np.flatnonzero(known)
        if not len(self._unknown):
            return
        weight = _laplacian_weights(vertices, rings)
        laplacian = _laplacian(weight, rings)
        stretching = _laplacian((weight + _reversed(weight, rings)) / 2, rings)
        fading = sp.eye_array(rings.count) / reach**2
        system = laplacian.T @ laplacian + (fading - stretching) / (TENSION_REACHES * reach) ** 2
        rows = sp.csr_array(system)[self._unknown]
        self._solve = factorise(rows[:, self._unknown])
        self._from = sp.csr_array(rows[:, self._known])
        self._hole, self._rim, self._hole_of_rim = holes(rings, known)

    def __call__(self, values: F64) -> F64:
        """Values (N, k), with those of the unknown vertices replaced."""
        if not len(self._unknown):
            return values
        out = values.copy()
        out[self._unknown] = self._bounded(self._solve(-(self._from @ values[self._known])), values)
        return out

    def _bounded(self, found: F64, values: F64) -> F64:
        """Values (u, k) of the unknown vertices, not much longer than the longest on the rim of their hole."""
        longest = np.zeros(int(self._hole.max()) + 1)
        np.maximum.at(longest, self._hole_of_rim, np.linalg.norm(values[self._rim], axis=1))
        size = np.linalg.norm(found, axis=1)
        limit = MAX_RIM_RATIO * longest[self._hole]
        return np.asarray(found * np.where(size > limit, limit / np.maximum(size, 1e-300), 1)[:, None])


def holes(rings: Rings, known: Bool) -> tuple[Int, Int, Int]:
    """The connected hole (u,) of each unknown vertex, known vertices (r,) beside holes, and the hole (r,) of each."""
    inside = ~known[rings.start] & ~known[rings.end]
    ones = np.ones(int(inside.sum()), np.int8)
    graph = sp.coo_array((ones, (rings.start[inside], rings.end[inside])), shape=(rings.count,) * 2)
    labels = connected_components(graph, directed=False)[1]
    rim = ~known[rings.start] & known[rings.end]
    return labels[~known], rings.end[rim], labels[rings.start[rim]]


def _laplacian_weights(vertices: F64, rings: Rings) -> F64:
    """(E,) of each directed edge: 4 / (mean squared edge of its start), shared by the ring."""
    edges = np.square(vertices[rings.end] - vertices[rings.start]).sum(1)
    degree = np.bincount(rings.start, minlength=rings.count).clip(1)
    square = np.bincount(rings.start, edges, rings.count) / degree
    square = np.maximum(square, 1e-6 * square.mean())
    return np.asarray((4 / (square * degree))[rings.start])


def _reversed(values: F64, rings: Rings) -> F64:
    """Values (E,) of the directed edges, each taken from the edge the other way."""
    return np.asarray(values[np.argsort(rings.end * rings.count + rings.start)])


def _laplacian(weights: F64, rings: Rings) -> sp.csr_array:
    """(N, N): weighted sums of the ring's differences, which approximate the Laplacian."""
    ring = sp.coo_array((weights, (rings.start, rings.end)), shape=(rings.count, rings.count))
    return sp.csr_array(ring - sp.diags_array(np.asarray(ring.sum(axis=1))))
