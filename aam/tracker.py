"""Discriminative-iterative tracker: a cascade of linear regressors from texture to pose and shape.

Each stage samples the photometrically normalised grey texture under the current shape and predicts the correction of
pose and shape parameters (Saragih and Goecke 2007; supervised descent).  Stages are trained by simulation on
perturbed copies of the training frames; stage k + 1 sees the residuals that stage k leaves on frames it was not
trained with.  Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from guise.aam.appearance import Components, principal_components
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER, RIGID_WEIGHTS
from guise.aam.reference import POINTS, MeshSampler, ReferenceFrame
from guise.aam.similarity import Failed, PlanarSimilarity, align_planar
from guise.aam.texture_match import TextureMatcher, normalised
from guise.common.arrays import F32, F64, U8, Bool, Floating, Int

FEATURE_RESOLUTION = 48  # feature grid pixels across the face
POSE_ENTRIES = 4  # leading entries of a correction: scale, rotation, x, y
FRONTAL_BOX_TO_SHAPE = (
    0.0,
    0.08,
    0.83,
)  # how a face lies in the box of a typical frontal-face detector, see `Tracker`


@dataclass(frozen=True)
class TrackerLimits:
    """Sizes and thresholds of the tracker."""

    crop_face_pixels: float = 96.0  # across the face in the working crop
    crop_reach_face_widths: float = 0.95  # half the working crop's side
    min_crop_pixels: int = 12  # of the picture, below which the face has left it
    max_crop_picture_sides: float = 4.0  # half the working crop's side, in the picture's longer side
    max_parameter_deviations: float = 3.5  # that a shape parameter may reach
    max_good_error_interocular: float = 0.05  # up to which a simulated fit counts as right
    good_quantile: float = 0.95  # of the residuals of right fits
    bad_quantile: float = 0.1  # of the residuals of wrong fits
    max_texture_samples: int = 400  # right fits from which texture components are learned
    texture_retain: float = 0.95  # share of their variance


LIMITS = TrackerLimits()


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
    grid_pixel = align_planar(reference.points, shape, RIGID_WEIGHTS).scale  # picture pixels
    ratio = LIMITS.crop_face_pixels / max(grid_pixel * reference.resolution, 1e-6)
    centre = shape.mean(0)
    half = LIMITS.crop_reach_face_widths * LIMITS.crop_face_pixels / ratio
    if not (np.isfinite(half) and half < LIMITS.max_crop_picture_sides * max(luma.shape)):
        return Failed("the face is larger than the picture")
    x0, y0 = np.maximum(np.floor(centre - half).astype(int), 0)
    x1, y1 = np.minimum(np.ceil(centre + half).astype(int) + 1, luma.shape[::-1])
    if min(x1 - x0, y1 - y0) < LIMITS.min_crop_pixels:
        return Failed("the face has left the picture")
    whole = max(1, int(1 / ratio))  # by area first: fast for whole factors, and free of aliasing
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

    @property
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
        return float(
            1 / (1 + np.exp(np.clip((np.log(max(residual, 1e-6) / self.threshold)) / spread, -50, 50)))
        )


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
    def _shape_space(self) -> ShapeSpace:
        return ShapeSpace(self.shapes, self.reference)

    def fit(self, luma: U8, start: F64) -> Fit | Failed:
        """The face near a start shape.

        luma : (h, w) uint8.   start : (81, 2) float64, frame pixels.
        Failed when the face has left the picture or its texture is not this person's face.
        """
        crop = cut(luma, start, self.reference)
        if isinstance(crop, Failed):
            return crop
        space = self._shape_space
        pose, parameters = space.encode(crop.to_crop(start))
        for stage in self.stages:
            features = normalised(self._sampler.sample(crop.image, space.decode(pose, parameters)))
            correction = stage[0] + features @ stage[1:]
            pose, parameters = space.corrected(pose, parameters, correction)
        shape = space.decode(pose, parameters)
        residual = self._matcher.residual(self._sampler.sample(crop.image, shape))
        if not residual < self.quality.threshold:
            return Failed(f"the face is not recognised (residual {residual:.2f})")
        return Fit(crop.to_frame(shape), parameters, residual, self.quality.confidence(residual))

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
        match = self.match(luma, shape)
        if isinstance(match, Failed):
            return match
        _, parameters = self._shape_space.encode(shape)
        carried = not match.residual < self.quality.threshold
        return Fit(shape, parameters, match.residual, match.confidence, carried)

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
        fit = align_planar(shape, self.reference.points, RIGID_WEIGHTS)
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
    return np.clip(parameters, -most, most)


@dataclass(frozen=True)
class TrackerOptions:
    """How a tracker is trained.

    Parameters
    ----------
    stages : regressors in the cascade.
    copies : perturbed copies of each training frame.
    retain, max_modes : share of shape variance to keep, and the most modes.
    ridge, ridge_growth : damping relative to the mean feature variance, and its growth from stage to stage.
    folds : parts of the clip, for predictions on frames not trained with.
    light : standard deviation of random slopes of light.
    turned, turn : share of extra frames made by turning the head, and the largest angle in degrees; one clip seldom
        shows every turn of the next.
    seed : of all random numbers.
    """

    stages: int = 4
    copies: int = 16
    retain: float = 0.995
    max_modes: int = 30
    ridge: float = 0.3
    ridge_growth: float = 2.0
    folds: int = 3
    light: float = 0.15
    turned: float = 0.5
    turn: float = 22.0
    seed: int = 0


def train_tracker(
    crops: Sequence[Crop],
    shapes: Sequence[F64],
    *,
    face: Bool | None = None,
    box_to_shape: F64 | None = None,
    options: TrackerOptions = TrackerOptions(),
    progress: Callable[[float], None] = lambda _: None,
) -> Tracker:
    """Train a cascade on working crops and their shapes.

    Parameters
    ----------
    crops : one `cut` for each training frame, in the order of time.
    shapes : (81, 2) each, frame pixels.
    face : (n,) bool over the feature frame's mask pixels, which of them to use; all when None.
    box_to_shape : see `Tracker`; that of a typical frontal-face detector when None.
    progress : called with the share done.
    """
    training = _Training(crops, shapes, face, options)
    stages = []
    for k in range(options.stages):
        stages.append(training.advance(options.ridge * options.ridge_growth**k))
        progress((k + 1) / options.stages)
    texture, quality = training.quality(stages)
    box = np.array(FRONTAL_BOX_TO_SHAPE) if box_to_shape is None else box_to_shape
    return Tracker(training.space.shapes, tuple(stages), texture, training.pixels, quality, box)


class _Training:
    """Perturbed copies of the training frames, and how far the cascade has brought them."""

    def __init__(
        self,
        crops: Sequence[Crop],
        shapes: Sequence[F64],
        face: Bool | None,
        options: TrackerOptions,
    ) -> None:
        self.options, self.crops = options, crops
        self.rng = np.random.default_rng(options.seed)
        self.reference = ReferenceFrame.canonical(FEATURE_RESOLUTION)
        self.pixels = np.flatnonzero(np.ones(len(self.reference.pixels), bool) if face is None else face)
        self.sampler = self.reference.sampler[self.pixels]
        self.true_shapes = [c.to_crop(s) for c, s in zip(crops, shapes, strict=True)]
        images = [c.image for c in crops]
        self.images, self.true_shapes = self._with_turned(images, self.true_shapes)
        self.space = ShapeSpace(_shape_components(self.true_shapes, self.reference, options), self.reference)
        self.true = [self.space.encode(s) for s in self.true_shapes]
        self.owner = [i for i in range(len(crops)) for _ in range(options.copies)]
        self.fold = (np.arange(len(crops)) * 2 * options.folds // len(crops)) % options.folds
        self.state = [self._perturbed(i) for i in self.owner]

    def _with_turned(self, images: list[U8], shapes: list[F64]) -> tuple[list[U8], list[F64]]:
        """The frames, then copies of some with the head turned to either side."""
        count = round(self.options.turned * len(images))
        self.turned_from = np.linspace(0, len(images) - 1, count).round().astype(int)
        turned = []
        for i in self.turned_from:
            degrees = self.options.turn * self.rng.uniform(0.3, 1) * self.rng.choice([-1, 1])
            turned.append(turn_head(images[i], shapes[i], self.reference, degrees))
        return images + [t[0] for t in turned], shapes + [t[1] for t in turned]

    def _perturbed(self, i: int) -> tuple[Pose, F64]:
        rng, (pose, parameters) = self.rng, self.true[i]
        wide = rng.choice([0.3, 1.0, 1.6])
        angle, scale = np.deg2rad(4) * wide * rng.normal(), np.exp(0.04 * wide * rng.normal())
        jump = [scale * np.cos(angle) - 1, scale * np.sin(angle), *(0.05 * wide * rng.normal(size=2))]
        if (kind := rng.random()) < 0.4:
            parameters = self.true[rng.integers(len(self.true))][1]
        noise = rng.normal(size=len(parameters)) * (0.4 if kind < 0.8 else 0.8)
        return self.space.corrected(pose, parameters, np.concatenate([jump, noise]))

    def _ramps(self) -> F32:
        ys, xs = np.divmod(self.reference.pixels[self.pixels], self.reference.size[1])
        ramps = np.stack([xs, ys]).astype(np.float32)
        return np.asarray((ramps - ramps.mean(1, keepdims=True)) / ramps.std(1, keepdims=True), np.float32)

    def features(self, light: float) -> F32:
        """(m, 1 + n): a one, then the normalised features, under random slopes of light."""
        ramps = self._ramps()
        out = np.ones((len(self.state), 1 + len(self.pixels)), np.float32)
        for row, i, state in zip(out, self.owner, self.state, strict=True):
            grey = self.sampler.sample(self.images[i], self.space.decode(*state))
            slope = self.rng.normal(size=2).astype(np.float32) * light
            row[1:] = normalised(grey * (1 + slope @ ramps).astype(np.float32))
        return out

    def advance(self, ridge: float) -> F32:
        """Train one stage and move every copy by what it predicts on folds it has not seen."""
        features = self.features(self.options.light)
        targets = np.stack(
            [self.space.correction(*s, self.true[i]) for i, s in zip(self.owner, self.state, strict=True)]
        ).astype(np.float32)
        gram, cross = features.T @ features, features.T @ targets
        predicted = np.empty_like(targets)
        for k in range(self.options.folds):
            held = self.fold[self.owner] == k
            g = gram - features[held].T @ features[held]
            c = cross - features[held].T @ targets[held]
            predicted[held] = features[held] @ _ridge(g, c, ridge)
        self.state = [self.space.corrected(*s, p) for s, p in zip(self.state, predicted, strict=True)]
        return _ridge(gram, cross, ridge)

    def errors(self) -> F64:
        """(m,) mean landmark error of every copy, in inter-ocular distances."""
        out = np.empty(len(self.state))
        for j, (i, state) in enumerate(zip(self.owner, self.state, strict=True)):
            truth = self.true_shapes[i]
            miss = np.linalg.norm(self.space.decode(*state) - truth, axis=1).mean()
            out[j] = miss / np.linalg.norm(truth[LEFT_EYE_OUTER] - truth[RIGHT_EYE_OUTER])
        return out

    def quality(self, stages: list[F32]) -> tuple[Components, Quality]:
        """Texture components of right fits, and the residuals of held-out right and of wrong fits."""
        right, features = self.errors() < LIMITS.max_good_error_interocular, self.features(0.0)[:, 1:]
        held, residuals = float(self.errors().mean()), np.empty(len(features))
        for k in range(self.options.folds):
            inside = self.fold[self.owner] == k
            pca = _texture_components(features[right & ~inside])
            residuals[inside] = _residuals(features[inside], pca)
        texture = _texture_components(features[right])
        wrong = self._wrong(stages, texture)
        good = np.quantile(residuals[right], LIMITS.good_quantile) if right.any() else np.median(residuals)
        return texture, Quality(held, float(good), float(np.quantile(wrong, LIMITS.bad_quantile)))

    def _wrong(self, stages: list[F32], texture: Components) -> F64:
        """Residuals where there is no face: the cascade started half a face away."""
        out = []
        for i in range(0, len(self.images), max(1, len(self.images) // 60)):
            angle = self.rng.uniform(0, 2 * np.pi)
            far = np.array([0.0, 0.0, 0.55 * np.cos(angle), 0.55 * np.sin(angle)])
            state = self.space.corrected(*self.true[i], np.concatenate([far, 0 * self.true[i][1]]))
            for stage in stages:
                f = normalised(self.sampler.sample(self.images[i], self.space.decode(*state)))
                state = self.space.corrected(*state, stage[0] + f @ stage[1:])
            shape = self.space.decode(*state)
            truth = self.true_shapes[i]
            eyes = np.linalg.norm(truth[LEFT_EYE_OUTER] - truth[RIGHT_EYE_OUTER])
            if np.linalg.norm(shape - truth, axis=1).mean() > 0.1 * eyes:
                out.append(normalised(self.sampler.sample(self.images[i], shape)))
        return _residuals(np.stack(out), texture) if out else np.array([0.9])


def turn_head(image: U8, shape: F64, reference: ReferenceFrame, degrees: float) -> tuple[U8, F64]:
    """A picture (h, w) and shape (81, 2) with the head turned to the image right by some degrees.

    The reference frame's yaw mode moves the landmarks; the picture follows by a smooth field (a Gaussian mean of their
    displacements), which is good enough for turns of up to about 20 degrees.
    """
    fit = align_planar(reference.points, shape, RIGID_WEIGHTS)
    moved = shape + degrees * reference.yaw_mode @ fit.linear
    step, reach = 6, 0.12 * fit.scale * reference.resolution
    h, w = image.shape
    ys, xs = np.mgrid[0 : h + step : step, 0 : w + step : step].astype(np.float64)
    places = np.stack([xs, ys], axis=-1)
    squared = ((places[:, :, None] - moved) ** 2).sum(-1) / (2 * reach**2)
    weights = np.exp(-squared) + 1e-12
    field = (weights / (weights.sum(-1, keepdims=True) + 1e-3)) @ (shape - moved)
    size = places.shape[1] * step, places.shape[0] * step
    coarse = cv2.warpAffine(
        field.astype(np.float32),
        np.array([[step, 0, 0], [0, step, 0]], np.float32),
        size,
        flags=cv2.INTER_LINEAR,
    )[:h, :w]
    grid = np.mgrid[:h, :w].astype(np.float32)
    x, y = grid[1] + coarse[..., 0], grid[0] + coarse[..., 1]
    bent = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(bent, np.uint8), moved


def _shape_components(
    shapes: Sequence[F64], reference: ReferenceFrame, options: TrackerOptions
) -> Components:
    vectors = np.stack([reference.align(s).ravel() for s in shapes]).astype(np.float32)
    kept = principal_components(vectors, options.retain)
    k = min(kept.modes, options.max_modes)
    return Components(
        kept.mean, kept.basis[:, :k], np.maximum(kept.deviations[:k], 1e-3), kept.total_variance
    )


def _ridge(gram: F32, cross: F32, ridge: float) -> F32:
    from scipy.linalg import cho_factor, cho_solve

    damped = gram + np.eye(len(gram), dtype=np.float32) * np.float32(ridge * np.trace(gram) / len(gram))
    return np.asarray(cho_solve(cho_factor(damped, overwrite_a=True, check_finite=False), cross), np.float32)


def _texture_components(features: F32) -> Components:
    """Components of the features (m, n) of right fits, of some when there are many."""
    some = features[:: max(1, len(features) // LIMITS.max_texture_samples)]
    return principal_components(some, LIMITS.texture_retain)


def _residuals(features: F32, pca: Components) -> F64:
    centred = features - pca.mean
    explained = centred @ pca.basis
    energy = (centred**2).sum(1) - (explained**2).sum(1)
    return np.asarray(np.sqrt(np.maximum(energy, 0) / features.shape[1]), np.float64)
