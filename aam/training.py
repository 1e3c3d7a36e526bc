"""From frames with landmarks to a person's model: choice of frames, appearance, mask, tracker, still.

Pixels, x right, y down; RGB 0..255.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import (
    SHAPE,
    AppearanceModel,
    appearance_vectors,
    neutral_frames,
    openness,
    principal_components,
    rest_weights,
    sample_texture,
)
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.mask import core_band, learn_mask, skin_mask, smooth_skin
from guise.aam.model import Identity, RestFrame
from guise.aam.reference import DEFAULT_RESOLUTION, MeshSampler, ReferenceFrame, remap_points
from guise.aam.similarity import Failed
from guise.aam.tracker import FEATURE_RESOLUTION, Crop, Fit, Tracker, TrackerOptions, cut, train_tracker
from guise.common.arrays import F32, F64
from guise.common.errors import GuiseError

Picture = NDArray[np.uint8]

FEWEST = 12  # frames below which no useful model comes out
STILLS = 3  # frames averaged into the neutral face
LEAST_INSIDE = 0.6  # share of the points that must lie in the picture
DARK = 8.0  # grey levels that do not count as light
GAIN = (0.25, 4.0)  # range of the ratio of two lights
LUMA = np.array([0.299, 0.587, 0.114], np.float32)


class TrainingError(GuiseError):
    """The frames do not suffice for a model."""


@dataclass(frozen=True)
class TrainingOptions:
    """How a person's model is trained.

    Parameters
    ----------
    frames : number of frames to train on.
    resolution : texture grid pixels across the face; models that are mixed need the same.
    retain : share of appearance variance (float) or number of modes (int) to keep.
    max_modes : never more appearance modes than this.
    even_light : take from each frame the smooth part by which its light differs from the others', so that a change of
        light is no mode of the face: for clips in which the light changes.
    tracker : TrackerOptions.
    """

    frames: int = 120
    resolution: int = DEFAULT_RESOLUTION
    retain: float | int = 0.98
    max_modes: int = 40
    even_light: bool = False
    tracker: TrackerOptions = field(default_factory=TrackerOptions)


@dataclass(frozen=True, eq=False)
class Observation:
    """What training keeps of a frame: texture (n, 3), working crop, landmarks (81, 2); a picture only of stills."""

    texture: F32
    crop: Crop
    shape: F64
    picture: Picture | None = None


def observe(
    rgb: Picture, shape: F64, reference: ReferenceFrame, *, keep_picture: bool = False
) -> Observation | Failed:
    """Reduce a frame (h, w, 3) with landmarks (81, 2) in its pixels to what training needs."""
    feature_frame = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    luma = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    crop = cut(np.asarray(luma, np.uint8), shape, feature_frame)
    if isinstance(crop, Failed):
        return crop
    inside = ((shape >= 0) & (shape < rgb.shape[1::-1])).all(axis=1).mean()
    if inside < LEAST_INSIDE:
        return Failed("most of the face lies outside the picture")
    texture = sample_texture(rgb, shape, reference)
    return Observation(texture, crop, shape, rgb.copy() if keep_picture else None)


@dataclass(frozen=True, eq=False)
class Choice:
    """Which frames (indices) serve what: training, neutral face (best first), held-out error."""

    training: NDArray[np.intp]
    neutral: list[int]
    held_out: NDArray[np.intp]

    @property
    def all(self) -> NDArray[np.intp]:
        """Every frame that must be read, in order."""
        return np.unique(np.concatenate([self.training, np.array(self.neutral, np.intp), self.held_out]))


def choose_frames(shapes: F64, options: TrainingOptions) -> Choice:
    """Pick frames that differ in pose, mouth and lids.

    Parameters
    ----------
    shapes : (t, 81, 2) pixels; NaN where no face is known.

    Raises
    ------
    TrainingError
        When fewer than 12 frames have landmarks.

    Notes
    -----
    Two thirds by farthest-point sampling over aligned shape and openings, one third even in time; jumps that
    last a single frame are taken for slips of the landmarks and left out.
    """
    usable = _steady(shapes)
    if len(usable) < FEWEST:
        raise TrainingError(
            f"a model needs at least {FEWEST} frames with a face, got {len(usable)}; use a longer or clearer clip"
        )
    reference = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    count = min(options.frames, max(FEWEST, int(0.8 * len(usable))))
    described = _descriptors(shapes[usable], reference)
    even = np.linspace(0, len(usable) - 1, max(1, count // 3)).round().astype(int)
    training = np.sort(usable[_farthest(described, count, list(np.unique(even)))])
    rest = np.setdiff1d(usable, training)
    held_out = (
        rest[np.linspace(0, len(rest) - 1, min(len(rest), 60)).round().astype(int)] if len(rest) else rest
    )
    neutral = [int(usable[i]) for i in neutral_frames(shapes[usable], reference, STILLS)]
    return Choice(training, neutral, np.unique(held_out))


def _steady(shapes: F64) -> NDArray[np.intp]:
    """Indices of finite frames that do not jump away from both their neighbours."""
    usable = np.flatnonzero(np.isfinite(shapes).all((1, 2)))
    if len(usable) < 5:
        return usable
    kept = shapes[usable]
    width = np.ptp(kept[:, :, 0], axis=1)
    middle = (kept[:-2] + kept[2:]) / 2
    jump = np.zeros(len(usable))
    jump[1:-1] = np.linalg.norm(kept[1:-1] - middle, axis=2).mean(1) / width[1:-1]
    return np.asarray(usable[(jump < max(0.05, 6 * float(np.median(jump)))) & (width > 20)])


def _descriptors(shapes: F64, reference: ReferenceFrame) -> F64:
    aligned = np.stack([reference.align(s) for s in shapes]).reshape(len(shapes), -1) / reference.resolution
    openings = openness(shapes) - openness(shapes).mean(0)
    return np.concatenate([aligned - aligned.mean(0), openings * [1.0, 3.0, 1.0]], axis=1)


def _farthest(points: F64, count: int, chosen: list[int]) -> NDArray[np.intp]:
    """Indices of `count` points: the chosen ones, then always the one farthest from all so far."""
    distance = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def train_identity(
    name: str,
    observations: dict[int, Observation],
    choice: Choice,
    *,
    options: TrainingOptions = TrainingOptions(),
    box_to_shape: F64 | None = None,
    facts: dict[str, Any] | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Identity:
    """Train a person's model from observed frames.

    Parameters
    ----------
    observations : frame index -> Observation, for (nearly) every index of `choice.all`.
    box_to_shape : how this person's face lies in a detector's box, see `Tracker`.
    facts : what the caller wants to be kept with the model.
    progress : called with the share done.
    """
    reference = ReferenceFrame.canonical(options.resolution)
    training = [observations[i] for i in choice.training if i in observations]
    if len(training) < FEWEST:
        raise TrainingError(
            f"only {len(training)} of the chosen frames show the whole face; use another clip"
        )
    textures = np.stack([o.texture for o in training])
    if options.even_light:
        textures = in_even_light(textures, reference)
    mask = learn_mask(textures, reference)
    appearance = _appearance(training, textures, mask, observations, choice, reference, options)
    progress(0.2)
    tracker = train_tracker(
        [o.crop for o in training],
        [o.shape for o in training],
        face=_feature_mask(mask),
        box_to_shape=box_to_shape,
        options=options.tracker,
        progress=lambda share: progress(0.2 + 0.75 * share),
    )
    error = held_out_error(tracker, [observations[i] for i in choice.held_out if i in observations])
    if np.isfinite(error):
        tracker = replace(tracker, quality=replace(tracker.quality, error=error))
    stills = [
        observations[i] for i in choice.neutral if i in observations and observations[i].picture is not None
    ]
    if not stills:
        raise TrainingError("no frame shows the face at rest; use a clip with a closed mouth in it")
    progress(1.0)
    assert stills[0].picture is not None
    return Identity(
        name,
        appearance,
        tracker,
        _detail(stills, appearance),
        RestFrame(stills[0].picture, stills[0].shape),
        {"frames": len(training), "held_out_error": tracker.quality.error, **(facts or {})},
    )


def _appearance(
    training: Sequence[Observation],
    textures: F32,
    mask: NDArray[np.bool_],
    observations: dict[int, Observation],
    choice: Choice,
    reference: ReferenceFrame,
    options: TrainingOptions,
) -> AppearanceModel:
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 0.02 * options.resolution)
    weights = np.asarray(soft[reference.mask], np.float32)
    shapes = np.stack([o.shape for o in training])
    vectors = appearance_vectors(shapes, textures, reference, weights)
    components = principal_components(vectors, options.retain)
    if components.modes > options.max_modes:
        k = options.max_modes
        components = replace(components, basis=components.basis[:, :k], deviations=components.deviations[:k])
    raw = appearance_vectors(shapes, textures, reference)
    neutral = rest_weights(shapes, reference).astype(np.float32) @ raw
    neutral[SHAPE:] = _bare(neutral[SHAPE:].reshape(-1, 3), mask, reference).ravel()
    return AppearanceModel(reference, components, neutral, mask)


def in_even_light(textures: F32, reference: ReferenceFrame) -> F32:
    """Textures (t, n, 3) as if all were taken in the mean light.

    Light scales what it falls on; for each channel it is a quadratic in the place on the grid, fitted to the skin.
    """
    ys, xs = np.divmod(reference.pixels, reference.size[1])
    x = (xs - reference.size[1] / 2) / reference.resolution
    y = (ys - reference.size[0] / 2) / reference.resolution
    skin = skin_mask(reference)[reference.mask]
    fields = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    solve = np.linalg.pinv(fields[skin])
    mean = fields @ (solve @ textures[:, skin].mean(0))
    even = np.empty_like(textures)
    for texture, out in zip(textures, even, strict=True):
        light = fields @ (solve @ texture[skin])
        out[:] = texture * np.clip((mean + DARK) / np.maximum(light + DARK, 1), *GAIN)
    return even


def _bare(texture: F32, mask: NDArray[np.bool_], reference: ReferenceFrame) -> F32:
    """A texture (n, 3) with smooth skin where it shows hair or background, so that it can be shown there too."""
    known = skin_mask(reference) & core_band(reference) & mask
    skin = smooth_skin(reference.scatter(texture), known, reference)[reference.mask]
    hair = cv2.dilate((reference.mask & ~mask).astype(np.float32), np.ones((3, 3), np.uint8), iterations=2)
    share = 1 - cv2.GaussianBlur(hair, (0, 0), 0.012 * reference.resolution)[reference.mask][:, None]
    return np.asarray(share * texture + (1 - share) * skin, np.float32)


def _feature_mask(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    reference = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    small = cv2.resize(mask.astype(np.float32), reference.size[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(small[reference.mask] > 0.3)


def held_out_error(tracker: Tracker, held_out: Sequence[Observation]) -> float:
    """Mean landmark error on frames not trained with, in inter-ocular distances; each starts from the frame before."""
    errors = []
    for before, now in pairwise(held_out):
        truth = now.crop.to_crop(now.shape)
        start = before.shape - before.shape.mean(0) + now.shape.mean(0)
        fit = tracker.fit(now.crop.image, now.crop.to_crop(start))
        if isinstance(fit, Fit):
            miss = np.linalg.norm(fit.shape - truth, axis=1).mean()
            errors.append(miss / np.linalg.norm(truth[LEFT_EYE_OUTER] - truth[RIGHT_EYE_OUTER]))
    return float(np.mean(errors)) if errors else float("nan")


def _detail(stills: Sequence[Observation], appearance: AppearanceModel) -> F32:
    """Luma (2 h, 2 w) of the neutral face that the texture grid is too coarse for."""
    reference = appearance.reference
    h, w = reference.size
    ys, xs = np.mgrid[: 2 * h, : 2 * w]
    places = (np.column_stack([xs.ravel(), ys.ravel()]) + 0.5) / 2 - 0.5
    sampler = MeshSampler.build(reference, places)
    fine = []
    for still in stills:
        assert still.picture is not None
        luma = (still.picture @ LUMA).astype(np.float32)
        picture = remap_points(luma, sampler.positions(still.shape)).reshape(2 * h, 2 * w)
        coarse = cv2.resize(picture, (w, h), interpolation=cv2.INTER_AREA)
        fine.append(picture - cv2.resize(coarse, (2 * w, 2 * h), interpolation=cv2.INTER_LINEAR))
    return np.asarray(np.mean(fine, axis=0), np.float32)
