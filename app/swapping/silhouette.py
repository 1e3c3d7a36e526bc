"""Where a turned head hides its own face: nothing is drawn or measured there, and the drawn face fades towards it.

Pixels of the reference grid, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.solid_shape import SolidPrior
from guise.common.arrays import F32, F64, I32


@dataclass(frozen=True)
class SilhouetteLimits:
    """How the face fades; cosines between the camera's direction and the face's normal."""

    hidden_cosine: float = 0.0  # at which nothing of the face is drawn
    whole_cosine: float = 0.18  # from which all of it is; seen from the front the whole face lies above
    cell_face_widths: float = 0.03


LIMITS = SilhouetteLimits()


class Silhouette:
    """The share of the face that faces the camera.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : sampler of the places at which light is measured.
    """

    def __init__(self, reference: ReferenceFrame, texels: MeshSampler) -> None:
        self._size, self._texels = reference.size, texels
        cell = LIMITS.cell_face_widths * reference.resolution
        self._cells = tuple(max(2, round(length / cell)) for length in reference.size)
        axes = (
            (np.arange(n) + 0.5) * length / n - 0.5 for n, length in zip(self._cells, self._size, strict=True)
        )
        ys, xs = np.meshgrid(*axes, indexing="ij")
        self._sampler = MeshSampler.build(reference, np.column_stack([xs.ravel(), ys.ravel()]))

    def share(self, cosines: F64) -> F32 | None:
        """(h, w) share in [0, 1] that is drawn of a face with cosines (81,) at its points; None is all of it."""
        points = _share(cosines)
        if points.min() >= 1:
            return None
        cells = np.clip(_interpolated(points, self._sampler), 0, 1).reshape(self._cells)
        return np.asarray(cv2.resize(cells, self._size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)

    def visible(self, cosines: F64) -> F32:
        """(t,) the same at the texels."""
        return np.clip(_interpolated(_share(cosines), self._texels), 0, 1)


def front_last(triangles: I32) -> I32:
    """Triangles (t, 3) in the order in which they are drawn: what lies farther forward on a face is in front.

    So the nose hides the far cheek of a turned head, and the cheek what lies behind the silhouette.
    """
    depth = SolidPrior.shipped().mean[triangles, 2].mean(1)
    return np.ascontiguousarray(triangles[np.argsort(-depth, kind="stable")])


def _share(cosines: F64) -> F32:
    ramp = (cosines - LIMITS.hidden_cosine) / (LIMITS.whole_cosine - LIMITS.hidden_cosine)
    return np.asarray(np.clip(ramp, 0, 1), np.float32)


def _interpolated(points: F32, sampler: MeshSampler) -> F32:
    """Values (n,) at a sampler's places, of values (81,) at the points."""
    return np.asarray((points[sampler.vertices] * sampler.weights).sum(0), np.float32)
