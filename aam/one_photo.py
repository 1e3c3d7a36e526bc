"""A person's model from one photo, or a few: what they show, and how a face like it moves.

A photo shows one expression.  The prior of solid shapes tells the points of the face at rest; what the expression does
to the skin is that of other people, in the photo's tone, and is taken out of its texture.  The far half of a turned
face is filled from the near one, and what hair hides from the other half or from other people, as is its nose.  What no
photo shows is guessed: teeth and tongue, the face with lids shut, and turned views.

Pixels, x right, y down; RGB 0..255.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from guise.aam.appearance import (
    SHAPE_ENTRIES,
    AppearanceModel,
    Components,
    appearance_vectors,
    sample_texture,
)
from guise.aam.brows import BrowLift
from guise.aam.hidden_parts import hidden_share, uncovered
from guise.aam.light import equalised_light
from guise.aam.mask import learn_mask, skin_mask
from guise.aam.model import KNOWN_REST, Identity, RestFrame
from guise.aam.parsing import FaceParser
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.solid_shape import SolidPrior
from guise.aam.tracker import FEATURE_RESOLUTION, cut
from guise.aam.tracker_training import TrackerOptions, bent, train_tracker
from guise.aam.training import TrainingError, detailed, feature_mask, observe, parsed_face
from guise.aam.turned_texture import completed
from guise.aam.view_textures import changing
from guise.aam.views import Views
from guise.common.arrays import F32, F64, U8

# Grid pixels by which points are off from what the movements of other people explain.  With it the change of texture
# that is expected of 20 people's smiles has the size of the one that is seen.
MOVEMENT_NOISE = 3.8
# A tracker is trained on so many bent pictures, in which what is so near to a landmark moves with it.
BENT_PICTURES = 31
BENT_REACH_FACE_WIDTHS = 0.05
OPTIONS = TrackerOptions()
MAX_STILL_PIXELS, MIN_STILL_FACE_PIXELS = 1080, 320  # the longer side, unless the face is small


def person_in_photo(rgb: U8, points: F64, name: str, like: Identity) -> Identity:
    """The model of the person in a picture (h, w, 3) with the landmarks (81, 2); it has nothing to track them by.

    like : how faces move, such as the average of several people's models, of the resolution that is wanted.

    Raises TrainingError when most of the face lies outside the picture.
    """
    reference, parser, lift = like.reference, FaceParser(), BrowLift()
    parsing = parser.parse(rgb, points)
    lift.see(parsing, points)
    shape = lift(points)
    seen = observe(rgb, shape, reference, parser, keep_picture=True)
    if isinstance(seen, Failed):
        raise TrainingError(f"{name} cannot be learned from this photo: {seen.reason}")
    hidden = hidden_share(parsing, shape, reference)
    own, usual = (reference.scatter(one) for one in (seen.texture, like.appearance.neutral_texture))
    seen = replace(seen, texture=uncovered(own, hidden, usual, reference)[reference.mask])
    parsed = parsed_face([seen], reference)
    assert parsed is not None
    mask = learn_mask(seen.texture[None], reference, np.maximum(parsed, hidden))
    components = toned(like, seen.texture)
    shown, still = (
        appearance_vectors(one[None], seen.texture[None], reference)[0] for one in (shape, at_rest(shape))
    )
    neutral = still - _movement(components, (shown - still)[:SHAPE_ENTRIES], reference)
    appearance = AppearanceModel(reference, replace(components, mean=neutral), neutral, mask)
    appearance, detail = _kept(*detailed(appearance, [seen]), neutral, hidden)
    facts = {"frames": 1, "views": Views.of([shape]).as_facts(), KNOWN_REST: False}
    made = completed(Identity(name, appearance, like.tracker, detail, _still(rgb, shape), facts))
    seen_texture = made.appearance.neutral[SHAPE_ENTRIES:]
    np.maximum(seen_texture, 0, out=seen_texture)
    return made


def _kept(appearance: AppearanceModel, detail: F32, before: F32, hidden: F32) -> tuple[AppearanceModel, F32]:
    """An appearance and its detail without what was added to a neutral face (n,) where a share (h, w) is hidden."""
    reference = appearance.reference
    share = np.concatenate([np.zeros(SHAPE_ENTRIES, np.float32), np.repeat(hidden[reference.mask], 3)])
    neutral = np.asarray(appearance.neutral + share * (before - appearance.neutral), np.float32)
    fine = cv2.resize(hidden, detail.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return replace(appearance, neutral=neutral), np.asarray(detail * (1 - fine), np.float32)


def _still(rgb: U8, shape: F64) -> RestFrame:
    """The picture (h, w, 3) as a model keeps it, not larger than is ever shown."""
    factor = max(MAX_STILL_PIXELS / max(rgb.shape[:2]), MIN_STILL_FACE_PIXELS / float(np.ptp(shape[:, 0])))
    if factor >= 1:
        return RestFrame(rgb, shape)
    small = cv2.resize(rgb, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    scale = np.array(small.shape[1::-1]) / rgb.shape[1::-1]
    return RestFrame(np.asarray(small, np.uint8), (shape + 0.5) * scale - 0.5)


def at_rest(points: F64) -> F64:
    """Landmarks (81, 2) of a face without the likeliest expression, seen from the same side."""
    fit = SolidPrior.shipped().fit(points)
    rest: F64 = points - fit.points + fit.pose.apply(fit.rest)
    return rest


def toned(like: Identity, texture: F32) -> Components:
    """How somebody moves, on skin of another texture (n, 3): on a darker one the same shade is fewer grey levels."""
    reference, components = like.reference, like.appearance.components
    skin = skin_mask(reference)[reference.mask]
    own, theirs = (
        np.log(np.maximum(one[skin], 1)).mean(0) for one in (texture, like.appearance.neutral_texture)
    )
    basis = components.basis * components.deviations
    basis[SHAPE_ENTRIES:].reshape(-1, 3, components.modes)[:] *= np.exp(own - theirs)[:, None]
    return _orthonormal(basis, components.mean)


def _orthonormal(columns: F32, mean: F32) -> Components:
    """Components about a mean (n,), whose covariance is that of columns (n, k), largest first."""
    values, turned = np.linalg.eigh((columns.T @ columns).astype(np.float64))
    kept = np.flatnonzero(values > 1e-6 * values[-1])[::-1]
    deviations = np.sqrt(values[kept]).astype(np.float32)
    return Components(
        mean, columns @ turned[:, kept].astype(np.float32) / deviations, deviations, float(values.sum())
    )


def with_photos(person: Identity, others: Sequence[tuple[U8, F64]]) -> Identity:
    """Somebody who also moves as other pictures (h, w, 3) with landmarks (81, 2) show, in their light evened out."""
    if not others:
        return person
    reference, model = person.reference, person.appearance
    textures = np.stack([model.neutral_texture, *(sample_texture(*one, reference) for one in others)])
    textures = equalised_light(textures, skin_mask(reference)[reference.mask], reference)[1:]
    vectors = appearance_vectors(np.stack([shape for _, shape in others]), textures, reference)
    scaled = model.components.basis * model.components.deviations
    columns = np.concatenate([scaled, (vectors - model.neutral).T / np.sqrt(len(vectors))], axis=1)
    components = _orthonormal(columns, model.neutral)
    return replace(person, appearance=replace(model, components=components))


def tracked(person: Identity, options: TrackerOptions = OPTIONS) -> Identity:
    """Somebody with a tracker, trained on their picture at rest, bent as faces move."""
    feature_frame, rest = ReferenceFrame.canonical(FEATURE_RESOLUTION), person.rest_frame
    crop = cut(
        np.asarray(cv2.cvtColor(rest.picture, cv2.COLOR_RGB2GRAY), np.uint8), rest.shape, feature_frame
    )
    if isinstance(crop, Failed):
        raise TrainingError(f"{person.name} cannot be learned from this photo: {crop.reason}")
    components = person.appearance.components
    modes = (components.basis * components.deviations)[:SHAPE_ENTRIES] / person.reference.shape_weight
    linear, shape = person.reference.to_shape(rest.shape).linear, crop.to_crop(rest.shape)
    crops, shapes = [crop], [rest.shape]
    for amounts in np.random.default_rng(options.seed).normal(size=(BENT_PICTURES, components.modes)):
        moved = rest.shape + (modes @ amounts).reshape(-1, 2) @ linear
        image = bent(crop.image, shape, crop.to_crop(moved), feature_frame, BENT_REACH_FACE_WIDTHS)
        crops.append(replace(crop, image=image))
        shapes.append(moved)
    tracker = train_tracker(crops, shapes, face=feature_mask(person.appearance.mask), options=options)
    return replace(person, tracker=tracker, facts=person.facts | {"held_out_error": tracker.quality.error})


def _movement(components: Components, moved: F32, reference: ReferenceFrame) -> F32:
    """What of a movement of the points, as entries of an appearance vector, goes with it in the texture: (n,)."""
    basis = components.basis * components.deviations
    shape, noise = basis[:SHAPE_ENTRIES], MOVEMENT_NOISE * reference.shape_weight
    amounts = np.linalg.solve(
        shape.T @ shape / noise**2 + np.eye(components.modes), shape.T @ moved / noise**2
    )
    change = basis @ amounts.astype(np.float32)
    change[:SHAPE_ENTRIES] = 0
    change[SHAPE_ENTRIES:] *= np.repeat(changing(reference), 3)
    return np.asarray(change, np.float32)
