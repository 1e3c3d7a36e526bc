"""What a turned head hides of its own face, where the drawn face fades towards it, and where it folds.

At the far wing of a nose and at a far cheek many texels of the face fall on one pixel, of which a warp shows one:
nostrils end in flecks.  So the texture's luma is smoothed where the mesh is squeezed, and a little beside it, before
anything finer is added.  Where the mesh turns over with more of the face behind it, one side ends from a pixel to the
next: that edge is blurred in the picture.
Pixels of the reference grid, or of the picture where it says so, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import EYES, LIPS, NOSE
from guise.aam.mask import soft_parts
from guise.aam.reference import MeshSampler
from guise.aam.relief import Relief
from guise.app.drawing.face import COARSE_CELL, FaceInFrame, Fold
from guise.app.drawing.memory import Memory
from guise.common.arrays import F32, F64, I32, U8, Bool, Floating, Int
from guise.common.kernels import kernel
from guise.common.tuned import tuned


@dataclass(frozen=True)
class SilhouetteLimits:
    """How the face fades; cosines between the camera's direction and the face's normal."""

    whole_cosine: float = tuned(0.18, "cosine", "picture.turned")  # from which all of it is,
    whole_share: float = tuned(0.5, "share", "picture.turned")  # or this of what it is from the front
    # around the nose, which hides what lies behind it, not itself
    nose_growth_face_widths: float = tuned(0.03, "face widths", "picture.turned")


@dataclass(frozen=True)
class FoldLimits:
    """What is squeezed and how it is smoothed."""

    # widths of a triangle over its own, from which and at which
    squeezed: tuple[float, float] = tuned((0.35, 0.15), "ratio", "picture.turned")
    # in the picture, were it not squeezed: of what is averaged, and beside
    reach_pixels: float = tuned(4.0, "pixels", "picture.turned")
    edge_blur_pixels: float = 1.0  # of the picture, where one side of a fold ends
    edge_box_pixels: int = tuned(5, "pixels", "picture.turned")  # about the edges, of what is blurred
    # from an edge to where the face must be seen behind it
    beyond_pixels: float = tuned(3.0, "pixels", "picture.turned")


LIMITS, FOLD = SilhouetteLimits(), FoldLimits()


class Silhouette:
    """The share of the face that faces the camera.

    Parameters
    ----------
    relief : of the face that is drawn.
    texels : (t,) indices into the reference frame's mask pixels, the places at which light is measured.
    """

    def __init__(self, relief: Relief, texels: Int) -> None:
        reference = relief.reference
        ys, xs = np.divmod(reference.pixels[texels], reference.size[1])
        self._texels = MeshSampler.build(relief.mesh, np.column_stack([xs, ys]).astype(np.float64))
        self._size = reference.size
        cell = COARSE_CELL * reference.resolution
        self._cells = tuple(max(2, round(length / cell)) for length in reference.size)
        axes = (
            (np.arange(n) + 0.5) * length / n - 0.5 for n, length in zip(self._cells, self._size, strict=True)
        )
        ys, xs = np.meshgrid(*axes, indexing="ij")
        self._sampler = MeshSampler.build(relief.mesh, np.column_stack([xs.ravel(), ys.ravel()]))
        columns = np.round(relief.points).astype(int).clip(0, np.array(reference.size[::-1]) - 1)
        nose = soft_parts(reference, (NOSE,), LIMITS.nose_growth_face_widths)
        self._nose = nose[columns[:, 1], columns[:, 0]]

    def hide_texels(self, face: FaceInFrame, memory: Memory) -> None:
        """Let texels count by what is seen of them."""
        if face.seen and face.sight.turned:
            hidden = np.minimum(np.maximum(_interpolated(face.sight.facing, self._texels), 0), 1)
            visible = face.seen.visible
            face.seen.visible = hidden if visible is None else np.asarray(visible * hidden, np.float32)

    def share(self, face: FaceInFrame, memory: Memory) -> None:
        """Leave undrawn what the head hides of its face."""
        points = np.maximum(face.sight.facing, self._nose)
        if np.minimum.reduce(points) < 1:
            cells = np.clip(_interpolated(points, self._sampler), 0, 1).reshape(self._cells)
            share = cv2.resize(cells, self._size[::-1], interpolation=cv2.INTER_LINEAR)
            face.canvas.cover(np.asarray(share, np.float32))


def whole_cosines(relief: Relief) -> F64:
    """(81 + k,) cosines between the camera's direction and a relief's normals, from which on all of a place is seen."""
    return np.minimum(LIMITS.whole_cosine, LIMITS.whole_share * relief.frontal_cosines)


def _interpolated(points: F32, sampler: MeshSampler) -> F32:
    """Values (n,) at a sampler's places, of values (81,) at the points."""
    return np.asarray((points[sampler.vertices] * sampler.weights).sum(0), np.float32)


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
        self._triangles = np.ascontiguousarray(relief.triangles, np.int32)
        self._closing = np.asarray(np.isin(relief.triangles, np.concatenate([EYES, LIPS])).any(axis=1))
        self._to_edges: F64 = np.linalg.inv(_edges(relief.points, relief.triangles)).astype(np.float64)
        corners = relief.points[relief.triangles]
        self._first, self._last = corners.min(1).astype(int), corners.max(1).astype(int) + 1
        self._ends, self._sides = _inner_edges(relief.triangles, self._closing)

    def find(self, face: FaceInFrame, memory: Memory) -> None:
        """Find what is squeezed of the drawn face."""
        if any(face.sight.across):
            face.canvas.fold = self.at(face.canvas.mesh, face.zoom)

    def smooth(self, face: FaceInFrame, memory: Memory) -> None:
        """Smooth the picture's luma there: flecks of other colours are not seen."""
        fold = face.canvas.fold
        if fold is not None:
            smooth(face.canvas.picture, fold)

    def soften_edges(self, face: FaceInFrame, memory: Memory) -> None:
        """Let the nearer side of each fold end within a pixel of the frame, not at once."""
        canvas = face.canvas
        if canvas.fold is not None and len(canvas.fold.edges):
            soften_edges(canvas.roi, canvas.fold.edges - canvas.corner)

    def at(self, mesh: F64, zoom: float) -> Fold | None:
        """What is squeezed of a texture on a mesh (81 + k, 2) in the picture; None if nothing is."""
        shares, edges = np.empty(len(self._triangles), np.float32), np.empty((len(self._ends), 2, 2))
        limits = np.array([zoom, *FOLD.squeezed, FOLD.beyond_pixels])
        meshed = mesh, self._triangles, self._to_edges, self._closing
        found = find_folds(*meshed, self._ends, self._sides, limits, shares, edges)
        if found < 0:
            return None
        squeezed, reach = shares > 0, round(FOLD.reach_pixels / zoom / 2)
        x, y = np.maximum(self._first[squeezed].min(0) - 4 * reach, 0)
        right, bottom = self._last[squeezed].max(0) + 4 * reach
        place, side = np.s_[y:bottom, x:right], 2 * reach + 1
        wide = cv2.dilate(shares.take(self._triangle[place]), np.ones((side, side), np.uint8))
        soft = np.asarray(cv2.blur(wide, (side, side)), np.float32)
        return Fold(place, soft, side, edges[:found])


@kernel
def find_folds(
    points: F64, triangles: I32, to_edges: F64, closing: Bool, ends: Int, sides: Int, limits: F64,
    shares: F32, edges: F64,
) -> int:  # fmt: skip
    """Where a mesh is squeezed and turns over; the number of edges at which it does, -1 if nothing is squeezed.

    Parameters
    ----------
    points, triangles : (v, 2) in the picture, and (t, 3) of them.
    to_edges : (t, 2, 2) from the edges of a triangle on the grid, as columns.
    closing : (t,) those that are not smoothed.
    ends, sides : (e, 2) points and triangles of the edges within the mesh.
    limits : pixels a grid pixel, widths at which smoothing begins and is whole, and how far beyond an edge the face
        must be what is seen, pixels.
    shares : (t,) out, in [0, 1] by which each triangle is smoothed.
    edges : (e, 2, 2) out, ends of the edges at which the mesh turns over with the face beyond.
    """
    zoom, first, last, reach = limits
    narrow = _narrowest(_edges(points, triangles) @ to_edges) / zoom
    shares[:] = np.clip((first - narrow) / (first - last), 0, 1)
    shares[closing] = 0
    if not shares.any():
        return -1
    facing, (one, other) = narrow > 0, sides.T
    over = facing[one] != facing[other]
    turning, front = points[ends[over]], np.where(facing[one], one, other)[over]
    middle, along = turning.mean(1), turning[:, 1] - turning[:, 0]
    away = np.column_stack([along[:, 1], -along[:, 0]])
    away /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
    away *= np.sign(((middle - points[triangles[front]].mean(1)) * away).sum(1, keepdims=True))
    beyond = turning + reach * away[:, None]
    covered = _covered(beyond.reshape(-1, 2), points[triangles[facing]]).reshape(-1, 2).all(axis=1)
    found = int(covered.sum())
    edges[:found] = turning[covered]
    return found


def smooth(picture: U8, fold: Fold) -> None:
    """Smooth the luma of a texture (h, w, 3) on the grid where the mesh is folded, in place."""
    part, box = picture[fold.place], (fold.side, fold.side)
    luma = cv2.extractChannel(part, 0)
    soft = cv2.blur(cv2.blur(luma, box), box)
    cv2.insertChannel(cv2.blendLinear(luma, soft, 1 - fold.share, fold.share), part, 0)


def soften_edges(picture: U8, edges: F64) -> None:
    """Blur a picture (h, w, 3) along edges (e, 2, 2), in place."""
    h, w = picture.shape[:2]
    x, y = np.maximum(np.floor(edges.min((0, 1))).astype(int) - FOLD.edge_box_pixels, 0)
    right, bottom = np.minimum(np.ceil(edges.max((0, 1))).astype(int) + FOLD.edge_box_pixels, (w, h))
    if right <= x or bottom <= y:
        return
    share = np.zeros((bottom - y, right - x), np.uint8)
    cv2.polylines(share, np.round(16 * (edges - (x, y))).astype(np.int32), False, 255, 2, cv2.LINE_AA, 4)
    soft = cv2.blur(share, (3, 3)).astype(np.float32) / 255
    part = picture[y:bottom, x:right]
    blurred = cv2.GaussianBlur(part, (0, 0), FOLD.edge_blur_pixels)
    part[...] = cv2.blendLinear(part, blurred, 1 - soft, soft)


def _inner_edges(triangles: I32, closing: Bool) -> tuple[Int, Int]:
    """(e, 2) points and (e, 2) triangles of edges between two triangles, neither closing (t,) nor at the outline."""
    ends = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.intp), axis=1)
    order = np.lexsort(ends.T)
    ends, of = ends[order], order // 3
    same = (ends[1:] == ends[:-1]).all(1)
    alone = ~np.r_[same, False] & ~np.r_[False, same]
    apart = closing | np.asarray(np.isin(triangles, ends[alone]).any(axis=1))
    shared = np.flatnonzero(same)
    sides = np.column_stack([of[shared], of[shared + 1]])
    kept = ~apart[sides[:, 0]] & ~apart[sides[:, 1]]
    return ends[shared][kept], sides[kept]


def _covered(places: F64, triangles: F64) -> Bool:
    """(p,) whether each of (p, 2) lies in one of (t, 3, 2) triangles that turn clockwise on the screen."""
    ahead = np.roll(triangles, -1, axis=1) - triangles
    to = places[:, None, None] - triangles
    inside = (ahead[..., 0] * to[..., 1] >= ahead[..., 1] * to[..., 0]).all(axis=2)
    return np.asarray(np.logical_or.reduce(inside, axis=1))


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
