"""The reference frame: the canonical face in which all textures are sampled and all models are mixed.

Grid pixels, x right, y down, pixel centres at integers.  Landmarks in scheme face81 (aam/data/face81.json, made by
training/make_reference.py from the CC0 sample clips).
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import resources

import cv2
import numpy as np

from guise.aam.landmarks.schemes import MIRROR, NOSE_ROOT, RIGID_WEIGHTS
from guise.aam.similarity import PlanarSimilarity, align_planar
from guise.common.arrays import F32, F64, I32, U8, Bool, Floating, Int
from guise.common.errors import GuiseError
from guise.common.kernels import kernel
from guise.common.sampling import remap_points as remap_points

DEFAULT_RESOLUTION = 160
POINTS = 81
MARGIN_GRID_PIXELS = 2  # kept free around the hull

# Root-mean-square texture variation that weighs as much as one face width of shape variation.
GREY_LEVELS_PER_FACE_WIDTH = 400.0


@dataclass(frozen=True, eq=False)
class ReferenceFrame:
    """Landmark scheme, triangulation, texture grid and mask that models share when they are mixed.

    Parameters
    ----------
    points : (81, 2) float64, grid pixels.
    triangles : (t, 3) int32, indices into the points.
    size : (height, width) of the texture grid.
    """

    points: F64
    triangles: I32
    size: tuple[int, int]

    @classmethod
    def canonical(cls, resolution: int = DEFAULT_RESOLUTION) -> ReferenceFrame:
        """The frame that ships with the package, `resolution` grid pixels across the face.

        >>> ReferenceFrame.canonical(64).size
        (80, 68)
        """
        return _canonical(int(resolution))

    @cached_property
    def yaw_mode(self) -> F64:
        """(81, 2) displacement of the points, grid pixels, per degree that a head turns to the image right."""
        return np.array(_data()["yaw_per_degree"]) * self.resolution

    @cached_property
    def pitch_mode(self) -> F64:
        """(81, 2) displacement of the points, grid pixels, per degree that a head turns up."""
        return np.array(_data()["pitch_per_degree"]) * self.resolution

    def yaw(self, aligned: F64) -> float:
        """Degrees by which the head of an aligned shape (81, 2) is turned to the image right.

        Read off the asymmetric part of the shape, so that a broad face isn't taken for a turned one.
        """
        flipped = aligned[list(MIRROR)] * [-1, 1] + [2 * float(self.points[NOSE_ROOT, 0]), 0]
        skewed = (aligned - self.align(flipped)) / 2
        mode = self.yaw_mode
        return float((skewed * mode).sum() / (mode * mode).sum())

    @cached_property
    def resolution(self) -> int:
        """Grid pixels across the face."""
        return round(float(np.ptp(self.points[:, 0])))

    @cached_property
    def id(self) -> str:
        """Twelve hex digits that differ whenever scheme, geometry, triangulation or grid differ."""
        digest = hashlib.sha256(b"face81")
        digest.update(self.points.round(3).astype("<f8").tobytes())
        digest.update(self.triangles.astype("<i4").tobytes())
        digest.update(repr(self.size).encode())
        return digest.hexdigest()[:12]

    @cached_property
    def triangle_map(self) -> I32:
        """(h, w) int32: the triangle under each grid pixel, -1 outside the hull."""
        canvas = np.full(self.size, -1, np.int32)
        for i, triangle in enumerate(self.points[self.triangles]):
            corners = np.round(triangle * 16).astype(np.int32)
            cv2.fillConvexPoly(canvas, corners, i, cv2.LINE_8, 4)
        return canvas

    @cached_property
    def mask(self) -> Bool:
        """(h, w) bool: grid pixels inside the hull of the landmarks."""
        return np.asarray(self.triangle_map >= 0)

    @cached_property
    def pixels(self) -> Int:
        """(n,) flat indices of the mask's pixels, in the order of every texture vector."""
        return np.flatnonzero(self.mask)

    @cached_property
    def sampler(self) -> MeshSampler:
        """Maps every mask pixel from the grid to a shape."""
        ys, xs = np.divmod(self.pixels, self.size[1])
        return MeshSampler.build(self, np.column_stack([xs, ys]).astype(np.float64))

    @cached_property
    def shape_weight(self) -> float:
        """w_s of the appearance vector: gives one grid pixel of shape the weight of its share of texture."""
        per_pixel = GREY_LEVELS_PER_FACE_WIDTH / self.resolution
        return per_pixel * float(np.sqrt(3 * len(self.pixels) / (2 * POINTS)))

    def align(self, shape: F64) -> F64:
        """A shape (81, 2) in pixels, aligned with the grid by its rigid landmarks."""
        return self.to_grid(shape).apply(shape)

    def to_grid(self, shape: F64) -> PlanarSimilarity:
        """The similarity that aligns a shape (81, 2) in pixels with the grid by its rigid landmarks."""
        return align_planar(shape, self.points, RIGID_WEIGHTS)

    def to_shape(self, shape: F64) -> PlanarSimilarity:
        """The similarity that aligns the grid with a shape (81, 2) in pixels by its rigid landmarks."""
        return align_planar(self.points, shape, RIGID_WEIGHTS)

    def scatter(self, texture: F32, fill: float = 0.0) -> F32:
        """A texture (n,) or (n, c) laid out as a picture (h, w) or (h, w, c)."""
        picture = np.full((self.size[0] * self.size[1], *texture.shape[1:]), fill, np.float32)
        picture[self.pixels] = texture
        return picture.reshape(*self.size, *texture.shape[1:])


@dataclass(frozen=True, eq=False)
class MeshSampler:
    """Barycentric interpolation from the mesh to fixed places of the reference frame.

    Parameters
    ----------
    vertices : (3, n) int, the corners of the triangle around each place.
    weights : (3, n) float32, barycentric, summing to 1.
    """

    vertices: Int
    weights: F32

    @classmethod
    def build(cls, reference: ReferenceFrame, places: F64) -> MeshSampler:
        """Places (n, 2) in grid pixels; one outside the hull takes the nearest triangle."""
        columns = np.clip(np.round(places).astype(int), 0, np.array(reference.size[::-1]) - 1)
        triangle = reference.triangle_map[columns[:, 1], columns[:, 0]]
        if (triangle < 0).any():
            triangle = _filled(reference.triangle_map)[columns[:, 1], columns[:, 0]]
        vertices = reference.triangles[triangle]
        a, b, c = (reference.points[vertices[:, k]] for k in range(3))
        u, v, w = b - a, c - a, places - a
        det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        wb = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / det
        wc = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / det
        weights = np.stack([1 - wb - wc, wb, wc]).astype(np.float32)
        return cls(np.ascontiguousarray(vertices.T.astype(np.intp)), weights)

    def __getitem__(self, subset: Int) -> MeshSampler:
        """The sampler of some of the places."""
        return MeshSampler(
            np.ascontiguousarray(self.vertices[:, subset]), np.ascontiguousarray(self.weights[:, subset])
        )

    def positions(self, shape: Floating) -> F32:
        """Where the places (n, 2) lie on a shape (81, 2), in the shape's pixels; piecewise affine."""
        places = np.empty((self.weights.shape[1], 2), np.float32)
        mesh_positions(shape, self.vertices, self.weights, places)
        return places

    def sample(self, image: U8 | F32, shape: Floating) -> F32:
        """Bilinear samples of an image (h, w) or (h, w, c) under the shape: (n,) or (n, c) float32."""
        return remap_points(image, self.positions(shape))


@kernel
def mesh_positions(points: Floating, vertices: Int, weights: F32, places: F32) -> None:
    """Where places of a mesh lie.

    Parameters
    ----------
    points : (v, 2), pixels.
    vertices, weights : (3, n), see `MeshSampler`.
    places : (n, 2), pixels, which is written.
    """
    plane = np.ascontiguousarray(points, np.float32).view(np.complex64)[:, 0]  # x + i y: one gather for both
    terms = plane[vertices]
    terms *= weights
    terms[0] += terms[1]
    terms[0] += terms[2]
    places[:] = terms[0, :, None].view(np.float32)


def _filled(triangle_map: I32) -> I32:
    """The triangle map with every outside pixel given the nearest inside pixel's triangle."""
    inside = triangle_map >= 0
    _, nearest = cv2.distanceTransformWithLabels(
        (~inside).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    triangles = np.zeros(int(nearest.max()) + 1, np.int32)
    triangles[nearest[inside]] = triangle_map[inside]
    return np.asarray(triangles[nearest])


@lru_cache(maxsize=1)
def _data() -> dict[str, list[list[float]]]:
    content: dict[str, list[list[float]]] = json.loads(
        resources.files("guise.aam").joinpath("data/face81.json").read_text()
    )
    return content


@lru_cache(maxsize=4)
def _canonical(resolution: int) -> ReferenceFrame:
    if not 32 <= resolution <= 512:
        raise GuiseError(f"the texture resolution must be 32 to 512 pixels across the face, got {resolution}")
    unit = np.array(_data()["points"])
    points = (unit - unit.min(0)) * resolution + MARGIN_GRID_PIXELS
    width, height = np.ceil(points.max(0)).astype(int) + MARGIN_GRID_PIXELS
    triangles = np.array(_data()["triangles"], np.int32)
    for array in (points, triangles):
        array.setflags(write=False)
    return ReferenceFrame(points, triangles, (int(height), int(width)))
