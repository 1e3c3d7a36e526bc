"""Where a turned head hides its own face: nothing is drawn or measured there, and the drawn face fades towards it.

Pixels of the reference grid, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import NOSE
from guise.aam.mask import soft_parts
from guise.aam.reference import MeshSampler
from guise.aam.relief import STRAIGHT, Relief
from guise.aam.solid_shape import HeadPose, SolidPrior, depth_across, turned_share
from guise.common.arrays import F32, F64, I32


@dataclass(frozen=True)
class SilhouetteLimits:
    """How the face fades; cosines between the camera's direction and the face's normal."""

    hidden_cosine: float = 0.0  # at which nothing of the face is drawn
    whole_cosine: float = 0.18  # from which all of it is,
    whole_share: float = 0.5  # or this share of what it is from the front
    cell_face_widths: float = 0.03
    nose_growth_face_widths: float = 0.03  # around the nose, which hides what lies behind it, not itself


LIMITS = SilhouetteLimits()


@dataclass(frozen=True, eq=False)
class View:
    """How a face is seen.

    Parameters
    ----------
    across : (2,) pixels of the picture by which what lies one face width farther back is seen elsewhere.
    cosines : (81 + k,) between the camera's direction and the normals of the relief's points; of a head that is hardly
        turned, of which nothing is hidden, they are larger.
    at_rest : (81, 2) the face's shape at rest as it is seen, grid pixels, anywhere; None if that isn't known.
    """

    across: F64
    cosines: F64
    at_rest: F64 | None = None

    @classmethod
    def of(cls, normals: F64, pose: HeadPose, enrolled: F64 = STRAIGHT, at_rest: F64 | None = None) -> View:
        """The view of a face with normals (81 + k, 3) at its relief's points, in a pose.

        enrolled : (2,) pixels, `across` of a head in that place that is turned as its texture was enrolled.
        """
        cosines = (1 - turned_share(pose)) - normals @ pose.rotation[2]
        return cls(depth_across(pose, enrolled), cosines, at_rest)


class Silhouette:
    """The share of the face that faces the camera.

    Parameters
    ----------
    relief : of the face that is drawn.
    texels : (t, 2) grid pixels, the places at which light is measured.
    """

    def __init__(self, relief: Relief, texels: F64) -> None:
        reference = relief.reference
        self._size, self._texels = reference.size, MeshSampler.build(relief.mesh, texels)
        cell = LIMITS.cell_face_widths * reference.resolution
        self._cells = tuple(max(2, round(length / cell)) for length in reference.size)
        axes = (
            (np.arange(n) + 0.5) * length / n - 0.5 for n, length in zip(self._cells, self._size, strict=True)
        )
        ys, xs = np.meshgrid(*axes, indexing="ij")
        self._sampler = MeshSampler.build(relief.mesh, np.column_stack([xs.ravel(), ys.ravel()]))
        columns = np.round(relief.points).astype(int).clip(0, np.array(reference.size[::-1]) - 1)
        nose = soft_parts(reference, (NOSE,), LIMITS.nose_growth_face_widths)
        self._nose = nose[columns[:, 1], columns[:, 0]]
        frontal = -relief.normals(SolidPrior.shipped().mean)[:, 2]
        self._whole = np.minimum(LIMITS.whole_cosine, LIMITS.whole_share * frontal)

    def share(self, cosines: F64) -> F32 | None:
        """(h, w) share in [0, 1] that is drawn of a face with cosines (81 + k,) at its points; None is all of it."""
        points = np.maximum(self.points(cosines), self._nose)
        if points.min() >= 1:
            return None
        cells = np.clip(_interpolated(points, self._sampler), 0, 1).reshape(self._cells)
        return np.asarray(cv2.resize(cells, self._size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)

    def visible(self, cosines: F64) -> F32:
        """(t,) the same at the texels."""
        return np.clip(_interpolated(self.points(cosines), self._texels), 0, 1)

    def points(self, cosines: F64) -> F32:
        """(81 + k,) share in [0, 1] of what is seen of a face from the front that is seen at its points."""
        ramp = (cosines - LIMITS.hidden_cosine) / (self._whole - LIMITS.hidden_cosine)
        return np.asarray(np.clip(ramp, 0, 1), np.float32)


def front_last(relief: Relief) -> I32:
    """A relief's triangles (t, 3) as they are drawn: what lies farther forward on a face is in front.

    So the nose hides the far cheek of a turned head, and the cheek what lies behind the silhouette.
    """
    depth = relief.solid(SolidPrior.shipped().mean)[relief.triangles, 2].mean(1)
    return np.ascontiguousarray(relief.triangles[np.argsort(-depth, kind="stable")])


def _interpolated(points: F32, sampler: MeshSampler) -> F32:
    """Values (n,) at a sampler's places, of values (81,) at the points."""
    return np.asarray((points[sampler.vertices] * sampler.weights).sum(0), np.float32)
