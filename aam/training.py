"""From frames with landmarks to a person's model: choice of frames, appearance, mask, tracker, rest frame.

Pixels, x right, y down; RGB 0..255.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np

from guise.aam.appearance import (
    SHAPE_ENTRIES,
    AppearanceModel,
    appearance_vectors,
    face_region,
    neutral_frames,
    openness,
    principal_components,
    rest_weights,
)
from guise.aam.detail import FineGrid, with_detail
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.light import equalised_light, skin_colours
from guise.aam.mask import FEATURE_PARTS, core_band, learn_mask, skin_mask, soft_parts
from guise.aam.model import KNOWN_REST, Identity, RestFrame
from guise.aam.parsing import FACE_CLASSES, FaceParser
from guise.aam.reference import DEFAULT_RESOLUTION, ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.solid_shape import SolidPrior, facing
from guise.aam.tracker import FEATURE_RESOLUTION, Crop, Fit, Tracker, cut
from guise.aam.tracker_training import TrackerOptions, train_tracker
from guise.aam.view_textures import learn_views
from guise.aam.views import Views
from guise.common.arrays import F32, F64, U8, Bool, Int
from guise.common.errors import GuiseError


@dataclass(frozen=True)
class TrainingLimits:
    """Thresholds of the choice of frames and of the parts of a model."""

    min_frames: int = 12  # below which no useful model comes out
    rest_frames: int = 8  # of which the sharpest give the neutral face its detail
    max_held_out_frames: int = 60
    training_share: float = 0.8  # of the usable frames, at most
    min_points_inside: float = 0.6  # share of the landmarks that must lie in the picture
    min_face_pixels: float = 20.0  # width
    jump_face_widths: float = 0.05  # mean way of a landmark, from which a single frame counts as an error ..
    jump_medians: float = 6.0  # .. and from which multiple of the clip's median
    lid_weight: float = 3.0  # of the lids' opening among the features by which frames differ
    mask_blur_face_widths: float = 0.02  # standard deviation, for the weights of texture variation
    hair_blur_face_widths: float = 0.012  # standard deviation, where smooth skin replaces hair
    shade_reach_face_widths: float = 0.04  # standard deviation, by which shade goes on there
    full_shade: float = 0.2  # share of the surroundings that must be plain skin for all of their shade
    # Cosines of normal and camera, from which a place is seen and from which it is seen well; the mean of that over the
    # frames, up to which turned frames don't count and from which all do.
    faced_cosines: tuple[float, float] = (0.15, 0.5)
    often_faced: tuple[float, float] = (0.6, 0.9)
    feature_mask_coverage: float = 0.3  # share of a feature pixel that must be face for the tracker to use it


LIMITS = TrainingLimits()


class TrainingError(GuiseError):
    """Frames that aren't enough for a model."""


@dataclass(frozen=True)
class TrainingOptions:
    """How a person's model is trained.

    Parameters
    ----------
    frames : number of frames to train on.
    resolution : texture grid pixels across the face; models that are mixed need the same.
    retain : share of appearance variance (float) or number of modes (int) to keep.
    max_modes : never more appearance modes than this.
    equalise_light : remove from each frame the smooth field by which its light differs from the mean light, so that a
        change of light doesn't become a mode of the face: for clips in which the light changes.
    rest_frame : index of a frame that shows the face at rest; None finds some.
    tracker : TrackerOptions.
    """

    frames: int = 120
    resolution: int = DEFAULT_RESOLUTION
    retain: float | int = 0.98
    max_modes: int = 40
    equalise_light: bool = False
    rest_frame: int | None = None
    tracker: TrackerOptions = field(default_factory=TrackerOptions)


@dataclass(frozen=True, eq=False)
class Observation:
    """What training keeps of a frame.

    Texture (n, 3), working crop, landmarks (81, 2), the face's region and the landmarks in its pixels, see
    `face_region`; of rest frames the picture; of parsed frames the share of the face (m,) in [0, 1] at the mask pixels
    of the tracker's feature grid.
    """

    texture: F32
    crop: Crop
    shape: F64
    region: tuple[U8, F64]
    picture: U8 | None = None
    face: F32 | None = None


def observe(
    rgb: U8,
    shape: F64,
    reference: ReferenceFrame,
    parser: FaceParser | None = None,
    *,
    keep_picture: bool = False,
) -> Observation | Failed:
    """Reduce a frame (h, w, 3) with landmarks (81, 2) in its pixels to what training needs.

    parser : tells the face from hair and background, for frames that are trained on; None leaves that to the colours.
    """
    feature_frame = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    luma = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    crop = cut(np.asarray(luma, np.uint8), shape, feature_frame)
    if isinstance(crop, Failed):
        return crop
    inside = ((shape >= 0) & (shape < rgb.shape[1::-1])).all(axis=1).mean()
    if inside < LIMITS.min_points_inside:
        return Failed("most of the face lies outside the picture")
    picture, local = face_region(rgb, shape, reference)
    texture = reference.sampler.sample(picture, local)
    face = None
    if parser is not None:
        parsing = parser.parse(rgb, shape)
        face = parsing.at(feature_frame.sampler.positions(shape), parsing.share(*FACE_CLASSES))
    whole = rgb.copy() if keep_picture else None
    return Observation(texture, crop, shape, (picture.copy(), local), whole, face)


@dataclass(frozen=True, eq=False)
class Choice:
    """Which frames (indices) serve for what: training, the neutral face (best first), the held-out error."""

    training: Int
    neutral: list[int]
    held_out: Int

    @property
    def all(self) -> Int:
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
    Two thirds by farthest-point sampling over aligned shapes and openings, one third evenly in time.  Jumps that last a
    single frame are taken for landmark errors and left out.
    """
    usable = _without_jumps(shapes)
    if len(usable) < LIMITS.min_frames:
        raise TrainingError(
            f"a model needs at least {LIMITS.min_frames} frames with a face, got {len(usable)}; "
            "use a longer or clearer clip"
        )
    reference = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    count = min(options.frames, max(LIMITS.min_frames, int(LIMITS.training_share * len(usable))))
    described = _descriptors(shapes[usable], reference)
    spread = _evenly(np.arange(len(usable)), max(1, count // 3))
    training = np.sort(usable[_farthest(described, count, list(np.unique(spread)))])
    rest = np.setdiff1d(usable, training)
    held_out = _evenly(rest, min(len(rest), LIMITS.max_held_out_frames)) if len(rest) else rest
    chosen = _chosen_rest(shapes, options)
    found = neutral_frames(shapes[usable], reference, LIMITS.rest_frames, chosen)
    neutral = [int(usable[i]) for i in found]
    return Choice(training, neutral, np.unique(held_out))


def _chosen_rest(shapes: F64, options: TrainingOptions) -> F64 | None:
    """The shape (81, 2) of the frame in which the face is said to be at rest."""
    if options.rest_frame is None:
        return None
    if options.rest_frame >= len(shapes) or not np.isfinite(shapes[options.rest_frame]).all():
        raise TrainingError(
            "no face is found in the frame that should show it at rest (--rest): give a time at which it is seen"
        )
    return np.asarray(shapes[options.rest_frame])


def _evenly(items: Int, count: int) -> Int:
    """`count` of the items, evenly spread."""
    return np.asarray(items[np.linspace(0, len(items) - 1, count).round().astype(int)])


def _without_jumps(shapes: F64) -> Int:
    """Indices of the frames with landmarks that do not jump away from both their neighbours."""
    usable = np.flatnonzero(np.isfinite(shapes).all((1, 2)))
    if len(usable) < 5:
        return usable
    kept = shapes[usable]
    width = np.ptp(kept[:, :, 0], axis=1)
    middle = (kept[:-2] + kept[2:]) / 2
    jump = np.zeros(len(usable))
    jump[1:-1] = np.linalg.norm(kept[1:-1] - middle, axis=2).mean(1) / width[1:-1]
    limit = max(LIMITS.jump_face_widths, LIMITS.jump_medians * float(np.median(jump)))
    return np.asarray(usable[(jump < limit) & (width > LIMITS.min_face_pixels)])


def _descriptors(shapes: F64, reference: ReferenceFrame) -> F64:
    aligned = np.stack([reference.align(s) for s in shapes]).reshape(len(shapes), -1) / reference.resolution
    openings = openness(shapes) - openness(shapes).mean(0)
    return np.concatenate([aligned - aligned.mean(0), openings * [1.0, LIMITS.lid_weight, 1.0]], axis=1)


def _farthest(points: F64, count: int, chosen: list[int]) -> Int:
    """Indices of `count` points: the chosen ones, then one by one the farthest from all chosen so far."""
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
    facts : JSON-like, kept with the model.
    progress : called with the share done.

    Raises
    ------
    TrainingError
        When too few of the frames show the whole face, or none shows it at rest.
    """
    reference = ReferenceFrame.canonical(options.resolution)
    training = _seen(observations, choice.training)
    at_rest, rest_frame = _at_rest(observations, choice)
    textures = np.stack([o.texture for o in training])
    if options.equalise_light:
        textures = equalised_light(textures, skin_mask(reference)[reference.mask], reference)
    mask = learn_mask(textures, reference, parsed_face(training, reference))
    appearance = _appearance(training, textures, mask, observations, choice, reference, options)
    progress(0.2)
    tracker = train_tracker(
        [o.crop for o in training],
        [o.shape for o in training],
        face=feature_mask(mask),
        box_to_shape=box_to_shape,
        options=options.tracker,
        progress=lambda share: progress(0.2 + 0.75 * share),
    )
    tracker = _judged(tracker, [observations[i] for i in choice.held_out if i in observations])
    progress(1.0)
    appearance, detail = detailed(appearance, at_rest)
    views = learn_views([o.region for o in training], appearance.neutral_shape, reference)
    return Identity(
        name,
        appearance,
        tracker,
        detail,
        rest_frame,
        {
            "frames": len(training),
            "held_out_error": tracker.quality.error,
            "views": Views.of([o.shape for o in training]).as_facts(),
            KNOWN_REST: options.rest_frame is not None,
            **(facts or {}),
        },
        views,
    )


def _seen(observations: dict[int, Observation], frames: Int) -> list[Observation]:
    """The observations of the frames that show the whole face.  TrainingError when they are too few."""
    seen = [observations[i] for i in frames.tolist() if i in observations]
    if len(seen) < LIMITS.min_frames:
        raise TrainingError(
            f"only {len(seen)} of the chosen frames show the whole face, {LIMITS.min_frames} are needed; "
            "use another clip"
        )
    return seen


def _judged(tracker: Tracker, held_out: Sequence[Observation]) -> Tracker:
    """A tracker that knows its error on frames that it was not trained on, if there are any."""
    error = held_out_error(tracker, held_out)
    return replace(tracker, quality=replace(tracker.quality, error=error)) if np.isfinite(error) else tracker


def _at_rest(observations: dict[int, Observation], choice: Choice) -> tuple[list[Observation], RestFrame]:
    """The observed frames at rest whose pictures are known, and the first of them as it is kept with a model."""
    seen = [observations[i] for i in choice.neutral if i in observations]
    kept = [(o, RestFrame(o.picture, o.shape)) for o in seen if o.picture is not None]
    if not kept:
        raise TrainingError("no frame shows the face at rest; use a clip with a closed mouth in it")
    return [o for o, _ in kept], kept[0][1]


def parsed_face(training: Sequence[Observation], reference: ReferenceFrame) -> F32 | None:
    """(h, w) mean share of the face in the parsed frames, on a reference frame's grid; None without such frames."""
    parsed = [o.face for o in training if o.face is not None]
    if not parsed:
        return None
    small = ReferenceFrame.canonical(FEATURE_RESOLUTION).scatter(np.mean(parsed, axis=0))
    return np.asarray(cv2.resize(small, reference.size[::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def _appearance(
    training: Sequence[Observation],
    textures: F32,
    mask: Bool,
    observations: dict[int, Observation],
    choice: Choice,
    reference: ReferenceFrame,
    options: TrainingOptions,
) -> AppearanceModel:
    soft = cv2.GaussianBlur(
        mask.astype(np.float32), (0, 0), LIMITS.mask_blur_face_widths * options.resolution
    )
    weights = np.asarray(soft[reference.mask], np.float32)
    shapes = np.stack([o.shape for o in training])
    vectors = appearance_vectors(shapes, textures, reference, weights)
    components = principal_components(vectors, options.retain)
    if components.modes > options.max_modes:
        k = options.max_modes
        components = replace(components, basis=components.basis[:, :k], deviations=components.deviations[:k])
    raw = appearance_vectors(shapes, textures, reference)
    known = [observations[i].shape for i in choice.neutral if i in observations]
    chosen = known[0] if known and options.rest_frame is not None else None
    neutral = rest_weights(shapes, reference, chosen).astype(np.float32) @ raw
    texture = with_what_faced(neutral[SHAPE_ENTRIES:].reshape(-1, 3), textures, shapes, reference)
    neutral[SHAPE_ENTRIES:] = texture.ravel()
    return AppearanceModel(reference, components, neutral, mask)


def detailed(appearance: AppearanceModel, at_rest: Sequence[Observation]) -> tuple[AppearanceModel, F32]:
    """The appearance with a sharp neutral face without hair, and the detail that is too fine for it, see `with_detail`.

    Hair goes last: frames that show it are not in register with a face without.
    """
    sample = FineGrid(appearance.reference)
    frames = [sample(o.picture, o.shape) for o in at_rest if o.picture is not None]
    texture, detail = with_detail(appearance.neutral_texture, frames, appearance.mask, appearance.reference)
    neutral = appearance.neutral.copy()
    neutral[SHAPE_ENTRIES:] = without_hair(texture, appearance.mask, appearance.reference).ravel()
    return replace(appearance, neutral=neutral), detail


def with_what_faced(texture: F32, textures: F32, shapes: F64, reference: ReferenceFrame) -> F32:
    """A texture at rest (n, 3) of frames (m, n, 3) with shapes (m, 81, 2), where many were turned away.

    What a turned head hides is smeared in its texture.  So a place that is often turned away is the mean of the frames
    in which it faced the camera.
    """
    prior = SolidPrior.shipped()
    fits = [prior.fit(shape) for shape in shapes]
    cosines = np.array([facing(fit.rest, fit.pose.rotation) for fit in fits])
    low, high = LIMITS.faced_cosines
    sampler = reference.sampler
    points = np.clip((cosines - low) / (high - low), 0, 1).astype(np.float32)
    seen = (points[:, sampler.vertices] * sampler.weights).sum(1)
    mean_seen = seen.mean(0)
    low, high = LIMITS.often_faced
    share = np.clip((high - mean_seen) / (high - low), 0, 1)[:, None]
    if not share.any():
        return texture
    weights = seen**2
    faced = np.einsum("mn,mnc->nc", weights, textures) / np.maximum(weights.sum(0), 1e-3)[:, None]
    return np.asarray(texture + share * (faced - texture), np.float32)


def without_hair(texture: F32, mask: Bool, reference: ReferenceFrame) -> F32:
    """A texture (n, 3) with smooth skin in place of hair and background, so that it can be drawn there too.

    What the face beside it differs by from the smooth field, such as the shade at its sides, goes on there and fades.
    """
    picture = reference.scatter(texture)
    skin = skin_colours(picture, skin_mask(reference) & core_band(reference) & mask, reference)
    hair = cv2.dilate((reference.mask & ~mask).astype(np.float32), np.ones((3, 3), np.uint8), iterations=2)
    sigma = LIMITS.shade_reach_face_widths * reference.resolution
    plain = (1 - hair) * (1 - soft_parts(reference, FEATURE_PARTS))
    plain[~reference.mask] = 0
    near = cv2.GaussianBlur(plain, (0, 0), sigma)[..., None]
    beside = cv2.GaussianBlur(plain[..., None] * (picture - skin), (0, 0), sigma)
    skin += beside / np.maximum(near, LIMITS.full_shade)  # in full up to the edge of what is plain
    share = 1 - cv2.GaussianBlur(hair, (0, 0), LIMITS.hair_blur_face_widths * reference.resolution)[..., None]
    return np.asarray((share * picture + (1 - share) * skin)[reference.mask], np.float32)


def feature_mask(mask: Bool) -> Bool:
    """Which pixels of the tracker's feature grid show the face."""
    reference = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    small = cv2.resize(mask.astype(np.float32), reference.size[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(small[reference.mask] > LIMITS.feature_mask_coverage)


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
