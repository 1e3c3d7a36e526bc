"""Soft edges where a turned head folds its own face: at the far wing of a nose, at a far cheek.

There many texels of the face fall on one pixel, of which a warp shows one: nostrils end in stair-steps and flecks.  So
the texture's luma is smoothed where the mesh is squeezed, and a little beside it, before anything finer is added.
Pixels of the reference grid, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import EYES, LIPS
from guise.aam.reference import MeshSampler
from guise.aam.relief import Relief
from guise.common.arrays import F32, F64, I32, U8, Floating, Int


@dataclass(frozen=True)
class FoldLimits:
    """What is squeezed and how it is smoothed."""

    squeezed: tuple[float, float] = (0.35, 0.15)  # widths of a triangle over its own, from which and at which
    reach_pixels: float = 4.0  # in the picture, were it not squeezed: of what is averaged, and beside


LIMITS = FoldLimits()


@dataclass(frozen=True, eq=False)
class Fold:
    """Where a texture is smoothed.

    Parameters
    ----------
    place : of the part (h, w) of the grid with all of it.
    share : (h, w) in [0, 1] by which it is smoothed.
    side : pixels of the box that is averaged, twice.
    """

    place: tuple[slice, slice]
    share: F32
    side: int

    def smooth(self, picture: U8) -> None:
        """Smooth the luma of a texture (h, w, 3) on the grid, in place: flecks of other colours are not seen."""
        part = picture[self.place]
        luma = cv2.extractChannel(part, 0)
        soft = cv2.blur(cv2.blur(luma, (self.side, self.side)), (self.side, self.side))
        cv2.insertChannel(cv2.blendLinear(luma, soft, 1 - self.share, self.share), part, 0)

    def without(self, detail: F32) -> F32:
        """What is added to the enlarged texture, twice as large as the grid, where it isn't smoothed."""
        place = tuple(slice(2 * part.start, 2 * part.stop) for part in self.place)
        left = detail.copy()
        part = left[place]
        part *= 1 - cv2.resize(self.share, part.shape[::-1])
        return left


class Folds:
    """Finds where the mesh is squeezed that textures are drawn on.

    Parameters
    ----------
    relief : of the face that is drawn.
    """

    def __init__(self, relief: Relief) -> None:
        h, w = relief.reference.size
        ys, xs = np.mgrid[:h, :w]
        sampler = MeshSampler.build(relief.mesh, np.column_stack([xs.ravel(), ys.ravel()]).astype(np.float64))
        here, every = (
            _codes(corners, len(relief.points)) for corners in (sampler.vertices.T, relief.triangles)
        )
        order = np.argsort(every)
        self._triangle = order[np.searchsorted(every, here, sorter=order)].reshape(h, w).astype(np.int32)
        self._triangles = relief.triangles
        self._closing = np.isin(relief.triangles, np.concatenate([EYES, LIPS])).any(1)
        self._to_edges = np.linalg.inv(_edges(relief.points, relief.triangles))
        corners = relief.points[relief.triangles]
        self._first, self._last = corners.min(1).astype(int), corners.max(1).astype(int) + 1

    def at(self, mesh: F64, zoom: float) -> Fold | None:
        """What is squeezed of a texture on a mesh (81 + k, 2) in the picture; None if nothing is."""
        shares = self._shares(mesh, zoom)
        squeezed = shares > 0
        if not squeezed.any():
            return None
        reach = round(LIMITS.reach_pixels / zoom / 2)
        x, y = np.maximum(self._first[squeezed].min(0) - 4 * reach, 0)
        right, bottom = self._last[squeezed].max(0) + 4 * reach
        place, side = np.s_[y:bottom, x:right], 2 * reach + 1
        wide = cv2.dilate(shares.take(self._triangle[place]), np.ones((side, side), np.uint8))
        return Fold(place, np.asarray(cv2.blur(wide, (side, side)), np.float32), side)

    def _shares(self, mesh: F64, zoom: float) -> F32:
        """(t,) in [0, 1] by which each triangle is smoothed."""
        narrow = _narrowest(_edges(mesh, self._triangles) @ self._to_edges) / zoom
        first, last = LIMITS.squeezed
        shares = np.clip((first - narrow) / (first - last), 0, 1).astype(np.float32)
        shares[self._closing] = 0
        return shares


def _codes(triangles: I32 | Int, points: int) -> Int:
    """(t,) a number for each of (t, 3) triangles of so many points, whatever the order of its corners."""
    return np.asarray(np.sort(triangles, axis=1).astype(np.intp) @ [points**2, points, 1])


def _edges(points: F64, triangles: np.ndarray) -> F64:
    """(t, 2, 2): two edges of each triangle, as columns."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.stack([b - a, c - a], axis=2)


def _narrowest(maps: Floating) -> F64:
    """(t,) the lesser singular value of each of (t, 2, 2) linear maps, negative where it turns over."""
    a, b, c, d = maps.reshape(-1, 4).T
    squares, area = a * a + b * b + c * c + d * d, a * d - b * c
    total, difference = (np.sqrt(np.maximum(squares + sign * 2 * area, 0)) for sign in (1, -1))
    return np.asarray((total - difference) / 2, np.float64)
