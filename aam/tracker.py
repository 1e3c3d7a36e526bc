"""Discriminative-iterative tracker: a cascade of linear regressors from texture to pose and shape.

Each stage samples the photometrically normalised grey texture under the current shape and predicts the correction of
pose and shape parameters (Saragih and Goecke 2007; supervised descent), as trained by `guise.aam.tracker_training`.
Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from guise.aam.appearance import Components
from guise.aam.landmarks.schemes import RIGID_WEIGHTS
from guise.aam.reference import POINTS, MeshSampler, ReferenceFrame
from guise.aam.similarity import Failed, PlanarSimilarity
from guise.aam.texture_match import TextureMatcher, normalised, residual
from guise.common.arrays import F32, F64, I32, U8, Bool, Floating, Int, side_by_side
from guise.common.kernels import kernel
from guise.common.small import mean

FEATURE_RESOLUTION = 48  # feature grid pixels across the face
POSE_ENTRIES = 4  # leading entries of a correction: scale, rotation, x, y


@dataclass(frozen=True)
class TrackerLimits:
    """Sizes and thresholds of the tracker."""

    crop_face_pixels: float = 96.0  # across the face in the working crop
    crop_reach_face_widths: float = 0.95  # half the working crop's side
    min_crop_pixels: int = 12  # of the picture, below which the face has left it
    max_crop_picture_sides: float = 4.0  # half the working crop's side, in the picture's longer side
    max_parameter_deviations: float = 3.5  # that a shape parameter may reach


LIMITS = TrackerLimits()
NO_CROP = Failed("the face is larger than the picture"), Failed("the face has left the picture")
_NO_TRIANGLES: I32 = np.zeros((0, 3), np.int32)


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the tracker finds the face.

    Parameters
    ----------
    shape : (81, 2) float64, frame pixels.
    parameters : (k,) float64, shape parameters in standard deviations.
    residual : float, root mean square of the normalised texture that the model doesn't explain.
    confidence : float in [0, 1], 0.5 at the lost threshold.
    carried : the shape is a landmarker's, and the person's texture isn't recognised there (light, turn, a hand).
    """

    shape: F64
    parameters: F64
    residual: float
    confidence: float
    carried: bool = False


@dataclass(frozen=True, eq=False)
class FaceMatch:
    """How well the texture under a known shape matches the person.

    Parameters
    ----------
    residual : root mean square of the normalised texture that the model doesn't explain.
    confidence : float in [0, 1] from it, 0.5 at the lost threshold.
    occluded_share : share of the face, of what isn't known to be hidden, whose texture isn't this person's: a hand, a
        microphone, another face.
    """

    residual: float
    confidence: float
    occluded_share: float


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the feature grid lies in a picture: x_picture = x_grid @ linear + offset."""

    linear: F64
    offset: F64


@dataclass(frozen=True, eq=False)
class Crop:
    """A copy of the face's surroundings, scaled so that the face is `crop_face_pixels` of the limits wide."""

    image: U8
    scale: F64
    corner: F64

    def to_crop(self, shape: F64) -> F64:
        """Frame pixels to crop pixels."""
        return (shape - self.corner + 0.5) * self.scale - 0.5

    def to_frame(self, shape: F64) -> F64:
        """Crop pixels to frame pixels."""
        return (shape + 0.5) / self.scale - 0.5 + self.corner


def cut(luma: U8, shape: F64, reference: ReferenceFrame) -> Crop | Failed:
    """The working crop of a picture (h, w) around a shape (81, 2) in its pixels."""
    grid_pixel = reference.to_shape(shape).scale  # picture pixels
    ratio = LIMITS.crop_face_pixels / max(grid_pixel * reference.resolution, 1e-6)
    centre = mean(shape, 0)
    half = LIMITS.crop_reach_face_widths * LIMITS.crop_face_pixels / ratio
    if not (np.isfinite(half) and half < LIMITS.max_crop_picture_sides * max(luma.shape)):
        return NO_CROP[0]
    x0, y0 = np.maximum(np.floor(centre - half).astype(int), 0)
    x1, y1 = np.minimum(np.ceil(centre + half).astype(int) + 1, luma.shape[::-1])
    whole = max(1, int(1 / ratio))  # by area first: fast for whole factors, and free of aliasing
    if min(x1 - x0, y1 - y0) < max(LIMITS.min_crop_pixels, whole):
        return NO_CROP[1]
    w, h = int(x1 - x0) // whole * whole, int(y1 - y0) // whole * whole
    image = luma[y0 : y0 + h, x0 : x0 + w]
    if whole > 1:
        image = np.asarray(
            cv2.resize(image, (w // whole, h // whole), interpolation=cv2.INTER_AREA), np.uint8
        )
    size = max(8, round(w * ratio)), max(8, round(h * ratio))
    image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)
    scale = np.array([size[0] / w, size[1] / h])
    return Crop(image, scale, np.array([x0, y0], np.float64))


@dataclass(frozen=True, eq=False)
class Quality:
    """The tracker's held-out error distribution, which sets the residual from which a face counts as lost.

    Parameters
    ----------
    error : float, mean landmark error on held-out frames, inter-ocular distances.
    good : float, 95th percentile of the residual of right fits.
    bad : float, 10th percentile of the residual of wrong fits.
    """

    error: float
    good: float
    bad: float

    @cached_property
    def threshold(self) -> float:
        """Residual above which the face counts as lost."""
        return float(self.good**0.35 * max(self.bad, self.good) ** 0.65)

    def confidence(self, residual: float) -> float:
        """0.5 at the threshold, falling as the residual grows.

        >>> quality = Quality(0.01, 0.2, 0.8)
        >>> round(quality.confidence(quality.threshold), 6)
        0.5
        """
        spread = max(float(np.log(max(self.bad, 1.02 * self.good) / self.good)) / 6, 0.02)
        away = float(np.log(max(residual, 1e-6) / self.threshold)) / spread
        return float(1 / (1 + np.exp(min(max(away, -50.0), 50.0))))


@dataclass(frozen=True, eq=False)
class Tracker:
    """A trained cascade; `fit` refines a shape in a picture.

    Parameters
    ----------
    shapes : Components of aligned shapes (162 values on the feature grid).
    stages : each (1 + n, 4 + k) float32: bias row, then a row per feature.
    texture : Components of the normalised features (n) of right fits.
    pixels : (n,) indices into the feature grid's mask pixels that are used.
    quality : held-out error distribution.
    box_to_shape : (3,) float64: shape centre minus box centre (x, y) and face width, all in box widths.
    """

    shapes: Components
    stages: tuple[F32, ...]
    texture: Components
    pixels: Int
    quality: Quality
    box_to_shape: F64

    @cached_property
    def reference(self) -> ReferenceFrame:
        """The feature grid."""
        return ReferenceFrame.canonical(FEATURE_RESOLUTION)

    @cached_property
    def _sampler(self) -> MeshSampler:
        return self.reference.sampler[self.pixels]

    @cached_property
    def _cascade(self) -> Cascade:
        return Cascade.of(self)

    def fit(self, luma: U8, start: F64) -> Fit | Failed:
        """The face near a start shape.

        luma : (h, w) uint8.   start : (81, 2) float64, frame pixels.
        Failed when the face has left the picture or its texture is not this person's face.
        """
        fit = self._fitted(luma, start, self._cascade.stages)
        if isinstance(fit, Fit) and fit.carried:
            return Failed(f"the face is not recognised (residual {fit.residual:.2f})")
        return fit

    def acquire(self, luma: U8, boxes: Floating) -> Fit | Failed:
        """The best fit from detected face boxes (n, 4) x0 y0 x1 y1, tried in order from several starts."""
        best: Fit | Failed = Failed("no face box")
        for box in boxes:
            for start in self.starts(box):
                fit = self.fit(luma, start)
                if not isinstance(best, Fit) or (isinstance(fit, Fit) and fit.residual < best.residual):
                    best = fit
            if isinstance(best, Fit):
                return self._settled(luma, best)
        return best

    def acquire_from(self, luma: U8, shapes: Iterable[F64]) -> Fit | Failed:
        """The first good fit from landmarks (81, 2) of whole faces, which were found without knowing the person."""
        fit: Fit | Failed = Failed("no face")
        for shape in shapes:
            fit = self.fit(luma, shape)
            if isinstance(fit, Fit):
                return self._settled(luma, fit)
        return fit

    def _settled(self, luma: U8, fit: Fit) -> Fit:
        """The fit, or the fit that starts from it where that is better."""
        again = self.fit(luma, fit.shape)
        return again if isinstance(again, Fit) and again.residual < fit.residual else fit

    def measured(self, luma: U8, shape: F64) -> Fit | Failed:
        """A shape (81, 2) found by other means, with the residual of the person's texture there."""
        fit = self._fitted(luma, shape, self._cascade.stages[:0])
        return replace(fit, shape=shape) if isinstance(fit, Fit) else fit

    def _fitted(self, luma: U8, start: F64, stages: F32) -> Fit | Failed:
        """Where some stages take a start shape; it counts as carried where the person isn't recognised."""
        shape, parameters = np.empty((POINTS, 2)), np.empty(self.shapes.modes)
        known = self._cascade._replace(stages=stages)
        left = fit_cascade(
            side_by_side(luma), np.ascontiguousarray(start, np.float64), *known, shape, parameters
        )
        if left < 0:
            return NO_CROP[int(-1 - left)]
        carried = not left < self.quality.threshold
        return Fit(shape, parameters, left, self.quality.confidence(left), carried)

    def starts(self, box: Floating) -> list[F64]:
        """Start shapes (81, 2) for a box x0 y0 x1 y1: the mean shape at a few scales and shifts."""
        width = float(box[2] - box[0])
        centre = np.array([box[0] + box[2], box[1] + box[3]]) / 2 + self.box_to_shape[:2] * width
        mean = self.shapes.mean.reshape(POINTS, 2).astype(np.float64)
        mean = (mean - mean.mean(0)) / self.reference.resolution
        face = self.box_to_shape[2] * width
        shifts = ((0, 0), (0, -0.1), (0, 0.1), (-0.1, 0), (0.1, 0))
        tries = [(1.0, s) for s in shifts] + [(0.88, (0, 0)), (1.14, (0, 0))]
        return [mean * face * scale + centre + np.array(shift) * face for scale, shift in tries]

    def match(self, luma: U8, shape: F64, hidden: Bool | None = None) -> FaceMatch | Failed:
        """How well the face at a shape (81, 2), frame pixels, in luma (h, w) matches this person.

        hidden : (n,) which of the `places` don't count, as something is in front of them.
        """
        crop = cut(luma, shape, self.reference)
        if isinstance(crop, Failed):
            return crop
        found = self._matcher.match(self._sampler.sample(crop.image, crop.to_crop(shape)), hidden)
        return FaceMatch(found.residual, self.quality.confidence(found.residual), found.foreign_share)

    def places(self, shape: F64) -> F32:
        """Where (n, 2) the person's texture is compared when the face lies at a shape (81, 2), in its pixels."""
        return self._sampler.positions(shape)

    @cached_property
    def _matcher(self) -> TextureMatcher:
        return TextureMatcher(self.texture, self.pixels, self.reference, self.quality.good)


class Cascade(NamedTuple):
    """What `fit_cascade` is given of a tracker, as it says there."""

    points: F64
    rigid: F64
    vertices: Int
    weights: F32
    mean: F32
    basis: F32
    deviations: F32
    stages: F32
    texture_mean: F32
    texture_basis: F32
    limits: F64

    @classmethod
    def of(cls, tracker: Tracker) -> Cascade:
        """Of a tracker; its stages and its texture's basis transposed, so that sums are over what lies side by side."""
        shapes, texture, sampler = tracker.shapes, tracker.texture, tracker._sampler
        each = len(tracker.stages), POSE_ENTRIES + shapes.modes, 1 + len(tracker.pixels)
        return cls(
            tracker.reference.points, RIGID_WEIGHTS, sampler.vertices, sampler.weights,
            shapes.mean, shapes.basis, shapes.deviations,
            np.array([stage.T for stage in tracker.stages], np.float32, order="C").reshape(each),
            texture.mean, np.ascontiguousarray(texture.basis.T), np.array(astuple(LIMITS), np.float64),
        )  # fmt: skip


@kernel
def fit_cascade(
    luma: U8, start: F64, points: F64, rigid: F64, vertices: Int, weights: F32, mean: F32, basis: F32, deviations: F32,
    stages: F32, texture_mean: F32, texture_basis: F32, limits: F64, shape: F64, parameters: F64,
) -> float:  # fmt: skip
    """Refine a shape in a picture, stage by stage.

    Parameters
    ----------
    luma : (h, w).   start : (v, 2), pixels.
    points, rigid : (v, 2) of the feature grid, its pixels, and (v,) weights by which shapes are aligned with them.
    vertices, weights : (3, n), of the sampler of the features.
    mean, basis, deviations : (2 v,), (2 v, k) and (k,), components of shapes on the grid.
    stages : (s, 4 + k, 1 + n), each a bias and weights of the features for every entry of a correction.
    texture_mean, texture_basis : (n,) and (m, n), components of the features.
    limits : (5,) those of `TrackerLimits`, in order.
    shape, parameters : (v, 2), pixels, and (k,), standard deviations, which are written.

    Returns
    -------
    Root mean square of the features that the texture doesn't explain; -1 - k where there are none, see `NO_CROP`.
    """
    reference = ReferenceFrame(points, _NO_TRIANGLES, (0, 0))
    crop = cut(luma, start, reference)
    if isinstance(crop, Failed):
        return -1.0 - NO_CROP.index(crop)
    space = ShapeSpace(Components(mean, basis, deviations, 0.0), reference)
    sampler, seen = MeshSampler(vertices, weights), crop.to_crop(start)
    pose, found = space.encode(seen)
    for stage in stages:
        features = normalised(sampler.sample(crop.image, space.decode(pose, found)))
        pose, found = space.corrected(pose, found, stage[:, 0] + stage[:, 1:] @ features)
    if len(stages):
        seen = space.decode(pose, found)
    shape[:], parameters[:] = crop.to_frame(seen), found
    return residual(sampler.sample(crop.image, seen), texture_mean, texture_basis)


@dataclass(frozen=True, eq=False)
class ShapeSpace:
    """Encodes shapes as pose and shape parameters, and applies corrections to these."""

    shapes: Components
    reference: ReferenceFrame

    @cached_property
    def _centre(self) -> F64:
        return RIGID_WEIGHTS @ self.reference.points

    def encode(self, shape: F64) -> tuple[Pose, F64]:
        """Pose and parameters (k,), in standard deviations, of a shape (81, 2) in picture pixels."""
        fit = self.reference.to_grid(shape)
        vector = fit.apply(shape).ravel()
        parameters = ((vector - self.shapes.mean) @ self.shapes.basis) / self.shapes.deviations
        back = np.ascontiguousarray(fit.linear.T) / (fit.a * fit.a + fit.b * fit.b)
        return Pose(back, -np.array([fit.tx, fit.ty]) @ back), _clipped(parameters)

    def decode(self, pose: Pose, parameters: F64) -> F64:
        """The shape (81, 2) of a pose and parameters."""
        vector = self.shapes.mean + self.shapes.basis @ (parameters * self.shapes.deviations)
        return np.asarray(vector.reshape(POINTS, 2) @ pose.linear + pose.offset, np.float64)

    def corrected(self, pose: Pose, parameters: F64, correction: Floating) -> tuple[Pose, F64]:
        """A pose and parameters after a correction (4 + k,), which acts on the feature grid."""
        a, b = 1 + float(correction[0]), float(correction[1])
        turn = PlanarSimilarity(a, b, 0.0, 0.0).linear
        shift = self._centre - self._centre @ turn + correction[2:POSE_ENTRIES] * self.reference.resolution
        moved = Pose(turn @ pose.linear, shift @ pose.linear + pose.offset)
        return moved, _clipped(parameters + correction[POSE_ENTRIES:])

    def correction(self, pose: Pose, parameters: F64, true: tuple[Pose, F64]) -> F64:
        """The correction (4 + k,) that takes a pose and parameters to the true ones."""
        inverse = np.linalg.inv(pose.linear)
        turn = true[0].linear @ inverse
        shift = (true[0].offset - pose.offset) @ inverse - (self._centre - self._centre @ turn)
        head = [turn[0, 0] - 1, turn[0, 1], *(shift / self.reference.resolution)]
        return np.concatenate([head, true[1] - parameters])


def _clipped(parameters: F64) -> F64:
    most = LIMITS.max_parameter_deviations
    return np.minimum(np.maximum(parameters, -most), most)
