"""Generic landmarks of one person's frames, refined jointly: a group-wise alignment to the person's own appearance.

A landmarker's errors differ from frame to frame, while the person looks alike in all of them.  All frames are sampled
under their landmarks into one reference grid.  The person's appearance there, the mean and a few components learned
from *other* frames, predicts what each frame would look like if its landmarks agreed with the rest; dense optical flow
from that prediction to the frame shows where each landmark should have been.  Two rounds are enough.  Before the first,
shapes are reduced to the person's few modes of shape, which removes noise that is independent from point to point.

Errors common to all frames can't be seen this way, and the common part must not drift: over all frames the corrections
are constrained to have no mean and no linear dependence on how open mouth and eyes are, so that the mean shape, blinks
and speech keep their size.  (A tracker trained on the landmarks and run on its own frames, held out or not, was tried
instead: it repeats errors that depend on the picture and flattens blinks.)

Congealing: Learned-Miller, PAMI 2006; group-wise alignment by an appearance model: Baker, Matthews and Schneider, PAMI
2004.  Flow: Kroeger et al., ECCV 2016.  Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from guise.aam.appearance import openness
from guise.aam.landmarks.schemes import (
    LEFT_EYE_OUTER,
    LIPS,
    NOSE_BRIDGE,
    OUTLINE,
    RIGHT_EYE_OUTER,
)
from guise.aam.reference import POINTS, MeshSampler, ReferenceFrame
from guise.aam.tracker import Crop
from guise.common.arrays import F32, F64, I32, U8, Bool, Floating


@dataclass(frozen=True)
class RefinementOptions:
    """How landmarks are refined.  The shares were chosen with a good and a poor landmarker on rendered people."""

    resolution: int = 96  # grid pixels across the face
    rounds: int = 2
    shape_modes: int = 12
    texture_modes: int = 8
    folds: int = 4  # parts of the clip; each part's appearance is learned from the others
    rim_share: float = (
        0.25  # of the way from the nose, by which the grid extends beyond the outermost landmarks
    )
    light_face_widths: float = 0.08  # over which brightness and contrast are normalised
    flow_blur_face_widths: float = 0.02  # over which the flow is averaged at a landmark
    contrast_grey_levels: float = 42.0  # for one standard deviation of texture
    flat_grey_levels: float = 4.0  # of contrast, below which there is nothing to match
    max_residual_deviations: float = (
        4.0  # robust standard deviations above the median, for a frame to be kept
    )
    step_share: float = 0.8  # of the estimated correction that a round applies ..
    lip_step_share: float = 0.5  # .. at the lips, between which teeth appear and disappear ..
    outline_step_share: float = 0.3  # .. and at the outline, beyond which there is no face


OPTIONS = RefinementOptions()


@dataclass(frozen=True, eq=False)
class Refined:
    """Refined shapes of n frames.

    Parameters
    ----------
    shapes : (n, 81, 2) float64, in the pixels of the shapes that were given.
    kept : (n,) bool, False for frames that don't look like the others under their landmarks.
    moved : float, mean correction of a landmark, inter-ocular distances.
    residual : (2,) float, median over frames of the texture that the person's appearance doesn't explain,
        before and after, standard deviations.
    """

    shapes: F64
    kept: Bool
    moved: float
    residual: tuple[float, float]


def refine_shapes(
    crops: Sequence[Crop], shapes: F64, progress: Callable[[float], None] = lambda _: None
) -> Refined:
    """Refine the landmarks of one person's frames jointly.

    Parameters
    ----------
    crops : n working crops of the frames, in temporal order, see `guise.aam.tracker.cut`.
    shapes : (n, 81, 2) float64, generic landmarks, frame pixels.
    progress : called with the share done.
    """
    seen = np.stack([crop.to_crop(shape) for crop, shape in zip(crops, shapes, strict=True)])
    grid, flow = _Grid(), cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    before = _SampledFrames(grid, crops, seen).residuals
    shares = _step_shares()
    now = _few_modes(seen)
    for k in range(OPTIONS.rounds):
        sampled = _SampledFrames(grid, crops, now)
        moved = []
        for i, places in enumerate(sampled.maps):
            moved.append(_at(places, grid.landmarks + shares * sampled.error(i, flow)))
            progress((k + (i + 1) / len(now)) / OPTIONS.rounds)
        now = np.stack(moved)
    after = _SampledFrames(grid, crops, now).residuals
    kept = after <= _limit(after)
    now[after > before] = seen[after > before]  # these matched better
    now = anchored(seen, now, kept)
    sizes = np.linalg.norm(seen[:, LEFT_EYE_OUTER] - seen[:, RIGHT_EYE_OUTER], axis=1)[:, None]
    return Refined(
        np.stack([crop.to_frame(shape) for crop, shape in zip(crops, now, strict=True)]),
        kept,
        float((np.linalg.norm(now - seen, axis=2) / sizes)[kept].mean()),
        (float(np.median(before)), float(np.median(after))),
    )


def _step_shares() -> F64:
    """(81, 1) share of the estimated correction that a round applies to each landmark."""
    shares = np.full((POINTS, 1), OPTIONS.step_share)
    shares[LIPS] = OPTIONS.lip_step_share
    shares[OUTLINE] = OPTIONS.outline_step_share
    return shares


def anchored(before: F64, after: F64, kept: Bool) -> F64:
    """Shapes (n, 81, 2) whose changes have neither a mean nor a linear dependence on mouth and lid openings.

    Changes are measured in the head's coordinates, over the frames (n,) that are kept.
    """
    openings = openness(before)[:, :2]
    known = np.column_stack([np.ones(len(before)), openings])
    turns = np.stack([_to_reference(shape) for shape in before])
    changes = ((after - before) @ turns).reshape(len(before), -1)
    common = np.linalg.lstsq(known[kept], changes[kept], rcond=None)[0]
    changes = (changes - known @ common).reshape(before.shape)
    return np.asarray(before + changes @ np.linalg.inv(turns))


def _to_reference(shape: F64) -> F64:
    """(2, 2) that rotates and scales displacements in a picture to those in the reference frame."""
    return ReferenceFrame.canonical(OPTIONS.resolution).to_grid(shape).linear


def _few_modes(shapes: F64) -> F64:
    """Shapes (n, 81, 2) reduced to their main modes in the head's coordinates."""
    reference = ReferenceFrame.canonical(OPTIONS.resolution)
    aligned = np.stack([reference.align(s) for s in shapes]).reshape(len(shapes), -1)
    mean = aligned.mean(0)
    _, _, modes = np.linalg.svd(aligned - mean, full_matrices=False)
    off = (aligned - mean) - (aligned - mean) @ modes[: OPTIONS.shape_modes].T @ modes[: OPTIONS.shape_modes]
    back = np.linalg.inv(np.stack([_to_reference(s) for s in shapes]))
    return np.asarray(shapes - off.reshape(shapes.shape) @ back)


def _limit(residuals: F64) -> float:
    """The residual up to which frames are kept."""
    middle = float(np.median(residuals))
    deviation = 1.4826 * float(np.median(np.abs(residuals - middle)))
    return middle + OPTIONS.max_residual_deviations * deviation


class _Grid:
    """The reference grid, somewhat larger than the face, and its warp by a shape into a picture."""

    def __init__(self) -> None:
        points = _with_rim(ReferenceFrame.canonical(OPTIONS.resolution).points)
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


def _triangles(points: F64) -> I32:
    from scipy.spatial import Delaunay

    return np.asarray(Delaunay(points).simplices, np.int32)


def _with_rim(shape: F64) -> F64:
    """A shape (81, 2) and a rim beyond its outermost points, so that there is flow on both sides of these."""
    rim = shape[OUTLINE]
    nose = shape[NOSE_BRIDGE].mean(0)
    return np.concatenate([shape, nose + (1 + OPTIONS.rim_share) * (rim - nose)])


class _SampledFrames:
    """The frames sampled in the grid under some shapes, and their prediction by the person's appearance."""

    def __init__(self, grid: _Grid, crops: Sequence[Crop], shapes: F64) -> None:
        self._grid = grid
        self.maps = [grid.places(shape) for shape in shapes]
        images = [cv2.remap(c.image, m, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
                  for c, m in zip(crops, self.maps, strict=True)]  # fmt: skip
        self._textures = np.stack([_normalised(image.astype(np.float32)) for image in images])

    @cached_property
    def _expected(self) -> F32:
        """(n, h, w) the frames as predicted by the mean and a few components of other parts of the clip."""
        rows = self._textures.reshape(len(self._textures), -1)
        expected = np.empty_like(rows)
        part = np.arange(len(rows)) * 2 * OPTIONS.folds // len(rows) % OPTIONS.folds
        for k in range(OPTIONS.folds):
            others, here = rows[part != k], rows[part == k]
            mean = others.mean(0)
            values, vectors = np.linalg.eigh((others - mean) @ (others - mean).T)
            last = OPTIONS.texture_modes
            main = vectors[:, -last:] / np.sqrt(np.maximum(values[-last:], 1e-6))
            basis = (others - mean).T @ main
            expected[part == k] = mean + (here - mean) @ basis @ basis.T
        return expected.reshape(self._textures.shape)

    @property
    def residuals(self) -> F64:
        """(n,) root mean square of the unpredicted texture inside the face."""
        off = (self._textures - self._expected)[:, self._grid.face]
        return np.asarray(np.sqrt((off**2).mean(1)), np.float64)

    def error(self, i: int, flow: cv2.DISOpticalFlow) -> F32:
        """(81, 2) grid pixels from where frame i has its landmarks to where it should have them."""
        field = flow.calc(_grey(self._expected[i]), _grey(self._textures[i]), None)  # type: ignore[call-overload]
        sigma = OPTIONS.flow_blur_face_widths * OPTIONS.resolution
        return _at(cv2.GaussianBlur(field, (0, 0), sigma), self._grid.landmarks)


def _normalised(image: F32) -> F32:
    """A picture (h, w) with local brightness and contrast normalised, in standard deviations."""
    width = OPTIONS.light_face_widths * OPTIONS.resolution
    off = image - cv2.GaussianBlur(image, (0, 0), width)
    variance = cv2.GaussianBlur(off * off, (0, 0), width)
    return np.asarray(off / np.sqrt(variance + OPTIONS.flat_grey_levels**2), np.float32)


def _grey(texture: F32) -> U8:
    return np.asarray(np.clip(128 + OPTIONS.contrast_grey_levels * texture, 0, 255), np.uint8)


def _at(field: F32, points: Floating) -> F32:
    """A field (h, w, 2) at points (n, 2)."""
    places = np.ascontiguousarray(points, np.float32)[:, None]
    found = cv2.remap(field, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(found[:, 0], np.float32)
