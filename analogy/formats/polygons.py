"""The faces of a mesh file: polygons with any number of sides, stored one after another."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from guise.common.arrays import F64, Int


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons over the vertices of a file.

    Parameters
    ----------
    corners : (c,) 0-based vertex ids, polygon by polygon.   sizes : (p,) number of corners, at least 3.
    """

    corners: Int
    sizes: Int

    @classmethod
    def of(cls, faces: Int) -> Polygons:
        """From faces (p, s) with the same number of sides."""
        return cls(faces.ravel().astype(np.intp), np.full(len(faces), faces.shape[1], np.intp))

    @cached_property
    def starts(self) -> Int:
        """(p,) index of the first corner of each polygon."""
        return np.asarray(np.cumsum(self.sizes) - self.sizes, np.intp)

    @cached_property
    def next_corners(self) -> Int:
        """(c,) index of the next corner around the polygon."""
        after = np.arange(1, len(self.corners) + 1)
        after[self.starts + self.sizes - 1] = self.starts
        return after

    @cached_property
    def owners(self) -> Int:
        """(c,) the polygon of each corner."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    @cached_property
    def fans(self) -> Int:
        """(t, 3) indices into `corners`: every polygon as a fan of triangles around its first corner."""
        first = np.repeat(self.starts, self.sizes - 2)
        ends = np.cumsum(self.sizes - 2)
        step = np.arange(len(first)) - np.repeat(ends - (self.sizes - 2), self.sizes - 2)
        return np.stack([first, first + step + 1, first + step + 2], axis=1)

    def area_vectors(self, vertices: F64) -> F64:
        """(p, 3) vectors along the normal of each polygon with the length of its area; vertices (n, 3).

        >>> Polygons.of(np.array([[0, 1, 2]])).area_vectors(np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]])).tolist()
        [[0.0, 0.0, 2.0]]
        """
        a, b, c = (vertices.T[:, self.corners[self.fans[:, k]]] for k in range(3))
        (px, py, pz), (qx, qy, qz) = b - a, c - a
        halves = np.stack([py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx], axis=1) / 2
        if len(halves) == len(self.sizes):
            return halves
        return np.asarray(np.add.reduceat(halves, np.cumsum(self.sizes - 2) - (self.sizes - 2)))
