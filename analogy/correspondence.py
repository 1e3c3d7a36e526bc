"""Dense correspondence between two meshes: for each vertex of the target, a point on the surface of the source.

A point is given by the three corners of a triangle of the source (or of half a quad) and barycentric weights, so that
any vertex attribute of the source can be interpolated: positions, displacements, colours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from guise.analogy.geometry import interpolation_matrix
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True, eq=False)
class Correspondence:
    """For each of N_t target vertices a point on a source with N_s vertices.

    Parameters
    ----------
    corners : (N_t, 3) source vertices.   weights : (N_t, 3) barycentric, >= 0, rows sum to 1.
    found : (N_t,) bool, False where the source has no counterpart (a hole, a neck cut elsewhere); corners and weights
        then hold the nearest point, so that interpolated values stay finite.
    """

    corners: Int
    weights: F64
    found: Bool

    def __post_init__(self) -> None:
        count = len(self.corners)
        for name, shape in (("corners", (count, 3)), ("weights", (count, 3)), ("found", (count,))):
            got = getattr(self, name).shape
            if got != shape:
                raise ValueError(f"{name} must be {shape}, got {got}")

    @classmethod
    def identity(cls, count: int) -> Correspondence:
        """The correspondence of a mesh with `count` vertices to itself.

        >>> Correspondence.identity(2).interpolate(np.array([[1.0], [5.0]])).ravel().tolist()
        [1.0, 5.0]
        """
        weights = np.zeros((count, 3))
        weights[:, 0] = 1
        return cls(np.repeat(np.arange(count)[:, None], 3, axis=1), weights, np.ones(count, bool))

    def interpolate(self, values: ArrayLike) -> F64:
        """Values (N_s, d) or (N_s,) of the source vertices, interpolated for the target: (N_t, d) or (N_t,)."""
        at_corners = np.asarray(values, np.float64)[self.corners]
        return np.asarray(np.einsum("nk,nk...->n...", self.weights, at_corners))

    def matrix(self, count: int) -> sp.csr_array:
        """The same as a matrix (N_t, count), count = N_s."""
        return interpolation_matrix(self.corners, self.weights, count)
