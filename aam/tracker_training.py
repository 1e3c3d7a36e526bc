"""Training of the tracker's cascade by simulation.

Stages are trained on perturbed copies of the training frames under random slopes of light; stage k + 1 sees the
residuals that stage k leaves on frames it was not trained with.  Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.appearance import Components, principal_components
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.reference import ReferenceFrame
from guise.aam.texture_match import normalised
from guise.aam.tracker import FEATURE_RESOLUTION, Crop, Pose, Quality, ShapeSpace, Tracker
from guise.common.arrays import F32, F64, U8, Bool

SOLVED_BLOCK = 128  # rows of a system of equations that are eliminated at once
FRONTAL_BOX_TO_SHAPE = 0.0, 0.08, 0.83  # of a typical detector of frontal faces, see `Tracker`


@dataclass(frozen=True)
class TrackerTrainingLimits:
    """What counts as right and wrong, and how much texture is learned."""

    max_good_error_interocular: float = 0.05  # up to which a simulated fit counts as right
    good_quantile: float = 0.95  # of the residuals of right fits
    bad_quantile: float = 0.1  # of the residuals of wrong fits
    max_texture_samples: int = 400  # right fits from which texture components are learned
    texture_retain: float = 0.95  # share of their variance


LIMITS = TrackerTrainingLimits()


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
        turned_from = np.linspace(0, len(images) - 1, count).round().astype(int)
        turned = []
        for i in turned_from:
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
        kernel = features @ features.T
        predicted = np.empty_like(targets)
        for k in range(self.options.folds):
            held = self.fold[self.owner] == k
            seen = kernel[np.ix_(~held, ~held)]
            weights = _ridge(seen, targets[~held], ridge, features.shape[1])
            predicted[held] = kernel[np.ix_(held, ~held)] @ weights
        self.state = [self.space.corrected(*s, p) for s, p in zip(self.state, predicted, strict=True)]
        return np.asarray(features.T @ _ridge(kernel, targets, ridge, features.shape[1]), np.float32)

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
    moved = shape + degrees * reference.yaw_mode @ reference.to_shape(shape).linear
    return bent(image, shape, moved, reference, 0.12), moved


def bent(image: U8, shape: F64, moved: F64, reference: ReferenceFrame, reach_face_widths: float) -> U8:
    """A picture (h, w) whose face's landmarks (81, 2) are moved, and what is near them with them, smoothly."""
    step, reach = 6, reach_face_widths * reference.to_shape(shape).scale * reference.resolution
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
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def _shape_components(
    shapes: Sequence[F64], reference: ReferenceFrame, options: TrackerOptions
) -> Components:
    vectors = np.stack([reference.align(s).ravel() for s in shapes]).astype(np.float32)
    kept = principal_components(vectors, options.retain)
    k = min(kept.modes, options.max_modes)
    return Components(
        kept.mean, kept.basis[:, :k], np.maximum(kept.deviations[:k], 1e-3), kept.total_variance
    )


def _ridge(kernel: F32, targets: F32, ridge: float, features: int) -> F32:
    """Weights (m, k) of the samples, with which features.T @ weights is the ridge regression of targets (m, k).

    kernel : (m, m) products of the samples' features; there are about as many samples as features, or fewer.
    ridge : damping as a share of the mean variance of the features, of which there are so many.
    """
    damped = kernel + np.eye(len(kernel), dtype=np.float32) * np.float32(ridge * np.trace(kernel) / features)
    return _solved(damped, targets)


def _solved(matrix: F32, right: F32) -> F32:
    """The x (m, k) for which matrix @ x is `right` (m, k).

    matrix : (m, m) symmetric and positive definite, so that nothing need be pivoted; what is above its diagonal is
        overwritten.  Eliminated block by block, it takes a third of the time of NumPy's general solver.
    """
    x, inverses = right.copy(), list[F32]()
    blocks = [slice(k, min(k + SOLVED_BLOCK, len(x))) for k in range(0, len(x), SOLVED_BLOCK)]
    for n, block in enumerate(blocks):
        inverses.append(np.linalg.inv(matrix[block, block]))
        share = inverses[n] @ matrix[block, block.stop :]
        for rows in blocks[n + 1 :]:
            matrix[rows, rows.start :] -= matrix[block, rows].T @ share[:, rows.start - block.stop :]
        x[block.stop :] -= share.T @ x[block]
    for block, inverse in zip(reversed(blocks), reversed(inverses), strict=True):
        x[block] = inverse @ (x[block] - matrix[block, block.stop :] @ x[block.stop :])
    return x


def _texture_components(features: F32) -> Components:
    """Components of the features (m, n) of right fits, of some when there are many."""
    some = features[:: max(1, len(features) // LIMITS.max_texture_samples)]
    return principal_components(some, LIMITS.texture_retain)


def _residuals(features: F32, pca: Components) -> F64:
    centred = features - pca.mean
    explained = centred @ pca.basis
    energy = (centred**2).sum(1) - (explained**2).sum(1)
    return np.asarray(np.sqrt(np.maximum(energy, 0) / features.shape[1]), np.float64)
