"""The surface between the 81 points: flat triangles hide what a cheek or a nose does when a head turns.

A triangle from the nose to the jaw lies far inside the cheek, so that on a turned head it misses the silhouette.  More
places, with the depth that rendered people have there on average beyond the flat triangle (`training/relief.py`),
follow the surface.  Seen from the front they lie on the flat triangles and change nothing.
Grid pixels, x right, y down; depths in face widths, away from the viewer.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from guise.aam.hull import beyond_hull
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.solid_shape import STRAIGHT as STRAIGHT
from guise.aam.solid_shape import SolidPrior, normals
from guise.common.arrays import F32, F64, I32, Int
from guise.common.kernels import kernel

BEYOND_HULL = 0.01  # of the face's height, by which a place may lie beyond the hull of the points
DATA = Path(__file__).parent / "data" / "relief.npz"


@dataclass(frozen=True, eq=False)
class Relief:
    """The reference frame's mesh with more places, and how deep they lie.

    Parameters
    ----------
    reference : the frame whose triangles are divided.
    points : (81 + k, 2) grid pixels: the frame's, then the places.
    triangles : (t, 3) indices into them.
    depth : (81 + k,) face widths beyond the flat triangles, 0 for the first 81.
    """

    reference: ReferenceFrame
    points: F64
    triangles: I32
    depth: F64

    @classmethod
    def shipped(cls, reference: ReferenceFrame) -> Relief:
        """The relief that ships with the package."""
        return _shipped(reference.resolution)

    @classmethod
    def flat(cls, reference: ReferenceFrame) -> Relief:
        """A relief without more places."""
        return cls(reference, reference.points, reference.triangles, np.zeros(len(reference.points)))

    @cached_property
    def mesh(self) -> ReferenceFrame:
        """The divided triangles as a frame of their own, for samplers."""
        return ReferenceFrame(self.points, self.triangles, self.reference.size)

    @cached_property
    def _on_flat(self) -> MeshSampler:
        """Of the places (k)."""
        return MeshSampler.build(self.reference, self.points[len(self.reference.points) :])

    def solid(self, points: F64) -> F64:
        """(81 + k, 3) face widths: solid points (81, 3), and the places between them."""
        flat = _laid(points, self._on_flat.vertices, self._on_flat.weights)
        flat[:, 2] += self.depth[len(points) :]
        return np.concatenate([points, flat])

    def normals(self, points: F64) -> F64:
        """(81 + k, 3) unit normals of the surface of solid points (81, 3), out of the face."""
        return normals(self.solid(points), self.triangles)

    def seen(self, points: F64, across: F64) -> F64:
        """(81 + k, 2) pixels: the points (81, 2) of a mesh in a picture, and the places between them.

        Cheeks differ: no place goes far beyond the hull of the points, where a lean face ends.

        across : (2,) pixels by which a point one face width farther away is seen elsewhere.
        """
        flat, seen = self._on_flat, np.empty(self.points.shape)
        depth = self.depth[len(points) :]
        relief_seen(points, flat.vertices, flat.weights, depth, across, BEYOND_HULL, seen)
        return seen

    @cached_property
    def front_last(self) -> I32:
        """The triangles (t, 3) as they are drawn: what lies farther forward on a face is in front.

        So the nose hides the far cheek of a turned head, and the cheek what lies behind the silhouette.
        """
        depth = self.solid(SolidPrior.shipped().mean)[self.triangles, 2].mean(1)
        return np.ascontiguousarray(self.triangles[np.argsort(-depth, kind="stable")])

    @cached_property
    def frontal_cosines(self) -> F64:
        """(81 + k,) cosines between the camera's direction and the normals of a mean face that looks straight at it."""
        return np.asarray(-self.normals(SolidPrior.shipped().mean)[:, 2])

    def at(self, places: F64) -> F32:
        """(n,) depth at places (n, 2), face widths."""
        sampler = MeshSampler.build(self.mesh, places)
        return np.asarray((self.depth[sampler.vertices] * sampler.weights).sum(0), np.float32)


@kernel
def relief_seen(
    points: F64, vertices: Int, weights: F32, depth: F64, across: F64, beyond: float, seen: F64
) -> None:
    """Where the points of a mesh and the places between them are seen.

    Parameters
    ----------
    points : (v, 2), pixels.
    vertices, weights : (3, k), of the sampler of the places.
    depth, across : (k,) and (2,), see `Relief`.
    beyond : by which a place may lie beyond the points' convex hull, of its height; anywhere where nothing is across.
    seen : (v + k, 2), pixels, which is written.
    """
    places = _laid(points, vertices, weights) + depth[:, None] * across
    if any(across):
        away, out = beyond_hull(places, points)
        height = np.maximum.reduce(points[:, 1]) - np.minimum.reduce(points[:, 1])
        places -= np.maximum(away - beyond * height, 0)[:, None] * out
    seen[: len(points)], seen[len(points) :] = points, places


def _laid(points: F64, vertices: Int, weights: F32) -> F64:
    """Where places (k, d) of a mesh lie, whose points are (v, d)."""
    return np.asarray(np.add.reduce(points[vertices] * weights[..., None]))


@lru_cache(maxsize=4)
def _shipped(resolution: int) -> Relief:
    reference = ReferenceFrame.canonical(resolution)
    with np.load(DATA) as stored:
        places = reference.points.min(0) + resolution * stored["places"].astype(np.float64)
        depth = np.concatenate([np.zeros(len(reference.points)), stored["depth"]])
        return Relief(
            reference, np.vstack([reference.points, places]), stored["triangles"].astype(np.int32), depth
        )
