"""Soft edges where a turned head folds its own face: at the far wing of a nose, at a far cheek.

There many texels of the face fall on one pixel, of which a warp shows one: nostrils end in stair-steps and flecks.  So
the texture is smoothed where the mesh is squeezed, and a little beside it.  Pixels of the reference grid, x right,
y down.
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


class Folds:
    """Smooths textures where the mesh that they are drawn on is squeezed.

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

    def smooth(self, picture: U8, mesh: F64, zoom: float) -> None:
        """Smooth a texture (h, w, 3), or one twice as large, for a mesh (81 + k, 2) in the picture; in place."""
        share = self._share(mesh, zoom)
        x, y, w, h = cv2.boundingRect((share > 0).view(np.uint8))
        if w == 0:
            return
        factor = picture.shape[0] // share.shape[0]
        part = picture[y * factor : (y + h) * factor, x * factor : (x + w) * factor]
        weights = cv2.resize(share[y : y + h, x : x + w], part.shape[1::-1])
        box = 2 * round(LIMITS.reach_pixels / zoom * factor / 2) + 1
        soft = cv2.blur(cv2.blur(part, (box, box)), (box, box))
        cv2.blendLinear(part, soft, 1 - weights, weights, dst=part)

    def _share(self, mesh: F64, zoom: float) -> F32:
        """(h, w) in [0, 1] by which a texture is smoothed."""
        narrow = _narrowest(_edges(mesh, self._triangles) @ self._to_edges) / zoom
        first, last = LIMITS.squeezed
        share = np.clip((first - narrow) / (first - last), 0, 1).astype(np.float32)
        share[self._closing] = 0
        side = 2 * round(LIMITS.reach_pixels / zoom / 2) + 1
        wide = cv2.dilate(share.take(self._triangle), np.ones((side, side), np.uint8))
        return np.asarray(cv2.blur(wide, (side, side)), np.float32)


def _codes(triangles: I32 | Int, points: int) -> Int:
    """(t,) a number for each of (t, 3) triangles of so many points, whatever the order of its corners."""
    return np.asarray(np.sort(triangles, axis=1).astype(np.intp) @ [points**2, points, 1])


def _edges(points: F64, triangles: np.ndarray) -> F64:
    """(t, 2, 2): two edges of each triangle, as columns."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.stack([b - a, c - a], axis=2)


def _narrowest(maps: Floating) -> F64:
    """(t,) the lesser singular value of each of (t, 2, 2) linear maps, negative where it turns over."""
    squares, area = np.square(maps).sum((1, 2)), np.linalg.det(maps)
    total, difference = (np.sqrt(np.maximum(squares + sign * 2 * area, 0)) for sign in (1, -1))
    return np.asarray((total - difference) / 2, np.float64)
