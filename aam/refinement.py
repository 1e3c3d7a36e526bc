"""Generic landmarks of one person's frames, refined together: a group-wise alignment to the person's own appearance.

A landmarker errs in every frame in another way; the person looks alike in all of them.  All frames are sampled under
their landmarks into one reference grid.  The person's appearance there, the mean and a few components learned from
*other* frames, tells how each frame should look if its landmarks were like everybody's; dense optical flow from that
picture to the frame tells where each landmark should have been.  Two rounds suffice.  Before the first, shapes are
reduced to the person's few modes of shape, which takes out what is independent from point to point.

What all frames have in common cannot be seen so, nor may it drift: over all frames the corrections are made to have no
mean and no linear dependence on how open mouth and eyes are.  So the mean shape, blinks and speech keep their size.
(A tracker trained on the landmarks and run on its own frames, held out or not, was tried instead: it repeats
the errors that depend on the picture and flattens blinks.)

Congealing: Learned-Miller, PAMI 2006; group-wise alignment by an appearance model: Baker, Matthews and Schneider, PAMI
2004.  Flow: Kroeger et al., ECCV 2016.  Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import openness
from guise.aam.landmarks.schemes import (
    LEFT_EYE_OUTER,
    LIPS,
    NOSE_BRIDGE,
    OUTLINE,
    RIGHT_EYE_OUTER,
)
from guise.aam.reference import POINTS, RIGID_WEIGHTS, MeshSampler, ReferenceFrame
from guise.aam.similarity import align_planar
from guise.aam.tracker import Crop
from guise.common.arrays import F32, F64

Bools = NDArray[np.bool_]

RESOLUTION = 96  # grid pixels across the face
ROUNDS = 2
SHAPE_MODES = 12
TEXTURE_MODES = 8
FOLDS = 4  # parts of the clip; each part's appearance is learned from the others
AROUND = 0.25  # how far the grid reaches beyond the outermost landmarks, so that there is flow on both sides of them
LIGHT = 0.08  # face widths over which brightness and contrast are evened out
SMOOTH = 0.02  # face widths over which the flow is averaged at a landmark
CONTRAST = 42.0  # grey levels for one standard deviation of texture
FLAT = 4.0  # grey levels of contrast below which there is nothing to see
# Share of the way that is gone in a round.  Teeth come and go between the lips, and beyond the outline lies what is not
# the face: there the picture tells less.  Chosen with a good and a poor landmarker on rendered people.
SHARES = np.full((81, 1), 0.8)
SHARES[LIPS] = 0.5
SHARES[OUTLINE] = 0.3
OUTLIER = 4.0  # robust standard deviations above the median residual


@dataclass(frozen=True, eq=False)
class Refined:
    """Refined shapes of n frames.

    Parameters
    ----------
    shapes : (n, 81, 2) float64, in the pixels of the shapes that were given.
    kept : (n,) bool, False for frames that do not look like the others under their landmarks.
    moved : float, mean way of a landmark, inter-ocular distances.
    residual : (2,) float, median over frames of the texture that the person's appearance does not explain,
        before and after, standard deviations.
    """

    shapes: F64
    kept: Bools
    moved: float
    residual: tuple[float, float]


def refine_shapes(
    crops: Sequence[Crop], shapes: F64, progress: Callable[[float], None] = lambda _: None
) -> Refined:
    """Refine the landmarks of one person's frames together.

    Parameters
    ----------
    crops : n working crops of the frames, in the order of time, see `guise.aam.tracker.cut`.
    shapes : (n, 81, 2) float64, generic landmarks, frame pixels.
    progress : called with the share done.
    """
    seen = np.stack([crop.to_crop(shape) for crop, shape in zip(crops, shapes, strict=True)])
    grid, flow = _Grid(), cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    before = _Look(grid, crops, seen).residuals
    now = _few_modes(seen)
    for k in range(ROUNDS):
        look = _Look(grid, crops, now)
        moved = []
        for i, places in enumerate(look.maps):
            moved.append(_at(places, grid.landmarks + SHARES * look.error(i, flow)))
            progress((k + (i + 1) / len(now)) / ROUNDS)
        now = np.stack(moved)
    after = _Look(grid, crops, now).residuals
    kept = after <= _limit(after)
    now[after > before] = seen[after > before]  # the picture says that these were better
    now = anchored(seen, now, kept)
    sizes = np.linalg.norm(seen[:, LEFT_EYE_OUTER] - seen[:, RIGHT_EYE_OUTER], axis=1)[:, None]
    return Refined(
        np.stack([crop.to_frame(shape) for crop, shape in zip(crops, now, strict=True)]),
        kept,
        float((np.linalg.norm(now - seen, axis=2) / sizes)[kept].mean()),
        (float(np.median(before)), float(np.median(after))),
    )


def anchored(before: F64, after: F64, kept: Bools) -> F64:
    """Shapes (n, 81, 2) whose changes have neither a mean nor a linear dependence on mouth and lid openings.

    Changes are counted in the head's frame, and over the frames (n,) that are kept.
    """
    openings = openness(before)[:, :2]
    known = np.column_stack([np.ones(len(before)), openings])
    turns = np.stack([_to_reference(shape) for shape in before])
    changes = ((after - before) @ turns).reshape(len(before), -1)
    common = np.linalg.lstsq(known[kept], changes[kept], rcond=None)[0]
    changes = (changes - known @ common).reshape(before.shape)
    return np.asarray(before + changes @ np.linalg.inv(turns))


def _to_reference(shape: F64) -> F64:
    """(2, 2) that turns and scales ways in a picture to ways in the reference frame."""
    a, b, _, _ = align_planar(shape, ReferenceFrame.canonical(RESOLUTION).points, RIGID_WEIGHTS)
    return np.array([[a, b], [-b, a]])


def _few_modes(shapes: F64) -> F64:
    """Shapes (n, 81, 2) reduced to their main modes in the head's frame."""
    reference = ReferenceFrame.canonical(RESOLUTION)
    aligned = np.stack([reference.align(s) for s in shapes]).reshape(len(shapes), -1)
    mean = aligned.mean(0)
    _, _, modes = np.linalg.svd(aligned - mean, full_matrices=False)
    off = (aligned - mean) - (aligned - mean) @ modes[:SHAPE_MODES].T @ modes[:SHAPE_MODES]
    back = np.linalg.inv(np.stack([_to_reference(s) for s in shapes]))
    return np.asarray(shapes - off.reshape(shapes.shape) @ back)


def _limit(residuals: F64) -> float:
    middle = float(np.median(residuals))
    return middle + OUTLIER * 1.4826 * float(np.median(np.abs(residuals - middle)))


class _Grid:
    """The reference grid, somewhat larger than the face, and how shapes carry it into pictures."""

    def __init__(self) -> None:
        points = _with_rim(ReferenceFrame.canonical(RESOLUTION).points)
        points -= points.min(0) - 1
        self.size = int(np.ceil(points[:, 1].max())) + 2, int(np.ceil(points[:, 0].max())) + 2
        self.landmarks = points[:POINTS]
        ys, xs = np.mgrid[: self.size[0], : self.size[1]]
        mesh = ReferenceFrame(points, _triangles(points), self.size)
        places = np.column_stack([xs.ravel(), ys.ravel()]).astype(np.float64)
        self._sampler = MeshSampler.build(mesh, places)
        hull = cv2.convexHull(np.round(self.landmarks).astype(np.int32))
        self.face = cv2.fillConvexPoly(np.zeros(self.size, np.uint8), hull, 1).astype(bool)

    def places(self, shape: F64) -> F32:
        """(h, w, 2) where each grid pixel lies in the picture of a shape (81, 2)."""
        return self._sampler.positions(_with_rim(shape)).reshape(*self.size, 2)


def _triangles(points: F64) -> NDArray[np.int32]:
    from scipy.spatial import Delaunay

    return np.asarray(Delaunay(points).simplices, np.int32)


def _with_rim(shape: F64) -> F64:
    """A shape (81, 2) and, beyond its outermost points, a rim."""
    rim = shape[OUTLINE]
    nose = shape[NOSE_BRIDGE].mean(0)
    return np.concatenate([shape, nose + (1 + AROUND) * (rim - nose)])


class _Look:
    """The frames in the grid under some shapes, and what the person's appearance makes of them."""

    def __init__(self, grid: _Grid, crops: Sequence[Crop], shapes: F64) -> None:
        self._grid = grid
        self.maps = [grid.places(shape) for shape in shapes]
        images = [cv2.remap(c.image, m, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
                  for c, m in zip(crops, self.maps, strict=True)]  # fmt: skip
        self._textures = np.stack([_evened(image.astype(np.float32)) for image in images])

    @cached_property
    def _expected(self) -> F32:
        """(n, h, w) the frames as the mean and a few components of other parts of the clip show them."""
        rows = self._textures.reshape(len(self._textures), -1)
        expected = np.empty_like(rows)
        part = np.arange(len(rows)) * 2 * FOLDS // len(rows) % FOLDS
        for k in range(FOLDS):
            others, here = rows[part != k], rows[part == k]
            mean = others.mean(0)
            values, vectors = np.linalg.eigh((others - mean) @ (others - mean).T)
            main = vectors[:, -TEXTURE_MODES:] / np.sqrt(np.maximum(values[-TEXTURE_MODES:], 1e-6))
            basis = (others - mean).T @ main
            expected[part == k] = mean + (here - mean) @ basis @ basis.T
        return expected.reshape(self._textures.shape)

    @property
    def residuals(self) -> F64:
        """(n,) root mean square of what is not expected in the face."""
        off = (self._textures - self._expected)[:, self._grid.face]
        return np.asarray(np.sqrt((off**2).mean(1)), np.float64)

    def error(self, i: int, flow: cv2.DISOpticalFlow) -> F32:
        """(81, 2) grid pixels from where frame i has its landmarks to where it should have them."""
        field = flow.calc(_grey(self._expected[i]), _grey(self._textures[i]), None)  # type: ignore[call-overload]
        return _at(cv2.GaussianBlur(field, (0, 0), SMOOTH * RESOLUTION), self._grid.landmarks)


def _evened(image: F32) -> F32:
    """A picture (h, w) with even brightness and contrast, in standard deviations."""
    width = LIGHT * RESOLUTION
    off = image - cv2.GaussianBlur(image, (0, 0), width)
    return np.asarray(off / np.sqrt(cv2.GaussianBlur(off * off, (0, 0), width) + FLAT**2), np.float32)


def _grey(texture: F32) -> NDArray[np.uint8]:
    return np.asarray(np.clip(128 + CONTRAST * texture, 0, 255), np.uint8)


def _at(field: F32, points: NDArray[np.floating]) -> F32:
    """A field (h, w, 2) at points (n, 2)."""
    places = np.ascontiguousarray(points, np.float32)[:, None]
    found = cv2.remap(field, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(found[:, 0], np.float32)
