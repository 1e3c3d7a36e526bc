"""A donor who was enrolled turned: the far half of their face, seen aslant, is filled from the near one.

A texture of a turned head shows the far cheek squeezed and nothing of the nose's far side, and drawn on a head that
looks straight it is a ghost of a nose.  Where a place faces the camera much less than its mirror image does, that
image takes its place, in the light of the far half.  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.detail import FINE
from guise.aam.landmarks.schemes import MIRROR, NOSE_BASE
from guise.aam.mask import expressive_mask, skin_mask
from guise.aam.mirror import mirror_image
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.solid_shape import SolidPrior, facing
from guise.common.arrays import F32, F64


@dataclass(frozen=True)
class FillLimits:
    """When and how a half is filled."""

    turned_difference: float = (
        0.3  # of the cosines of mirror image and place, somewhere on a head that is turned
    )
    min_difference: float = -0.05  # from which the mirror image is mixed in there
    full_difference: float = 0.05  # from which it takes the place
    skin_movement: float = 0.5  # share of a texture's movement away from eyes and mouth that is shown
    light_face_widths: float = 0.12  # standard deviation, over which the far half's light is taken
    max_gain: float = 2.5  # of that light
    beside_face_widths: float = 0.12  # from the middle, where a shadow's edge that lay near it is compared
    edge_face_widths: float = 0.03  # standard deviation, over which that is done
    strip_face_widths: float = 0.06  # standard deviation of the strip that is lifted


LIMITS = FillLimits()


def completed(identity: Identity) -> Identity:
    """The same person with their neutral texture and detail filled where they were turned away."""
    reference = identity.reference
    share = mirrored_share(identity.appearance.neutral_shape, reference)
    if not share.any():
        return identity
    neutral = identity.appearance.neutral.copy()
    texture = reference.scatter(identity.appearance.neutral_texture)
    neutral[SHAPE_ENTRIES:] = _filled(texture, share, reference)[reference.mask].ravel()
    h, w = reference.size
    fine = cv2.resize(share, (FINE * w, FINE * h), interpolation=cv2.INTER_LINEAR)
    detail = identity.detail + fine * (mirror_image(identity.detail, reference, FINE) - identity.detail)
    return replace(
        identity,
        appearance=replace(identity.appearance, neutral=neutral),
        detail=np.asarray(detail, np.float32),
    )


def moving_share(identity: Identity) -> F32:
    """(h, w) share in [0, 1] of the movement of a person's texture that is shown.

    Away from eyes and mouth it is light and errors of registration as much as expression, and where a turned head's
    mirror image is shown it belongs to what is not.
    """
    features = expressive_mask(identity.reference)
    near = 1 - mirrored_share(identity.appearance.neutral_shape, identity.reference)
    return np.asarray(features + np.float32(LIMITS.skin_movement) * (1 - features) * near, np.float32)


def mirrored_share(shape: F64, reference: ReferenceFrame) -> F32:
    """(h, w) share in [0, 1] of its mirror image that each place of a face at a shape (81, 2) gets."""
    fit = SolidPrior.shipped().fit(shape)
    faces = facing(fit.rest, fit.pose.rotation)
    differences = faces[list(MIRROR)] - faces
    if differences.max() < LIMITS.turned_difference:
        return np.zeros(reference.size, np.float32)
    low, high = LIMITS.min_difference, LIMITS.full_difference
    points = np.clip((differences - low) / (high - low), 0, 1)
    sampler = reference.sampler
    share = (points[sampler.vertices] * sampler.weights).sum(0)
    return reference.scatter(np.asarray(np.clip(share, 0, 1), np.float32))


def _filled(texture: F32, share: F32, reference: ReferenceFrame) -> F32:
    """A texture (h, w, 3) with a share (h, w) of its mirror image, in the light of where it is put."""
    image = mirror_image(texture, reference, 1)
    sigma = LIMITS.light_face_widths * reference.resolution
    own, other = (cv2.GaussianBlur(picture, (0, 0), sigma) for picture in (texture, image))
    gain = np.clip((own + 1) / (other + 1), 1 / LIMITS.max_gain, LIMITS.max_gain)
    return _even_middle(
        np.asarray(texture + share[..., None] * (gain * image - texture), np.float32), reference
    )


def _even_middle(texture: F32, reference: ReferenceFrame) -> F32:
    """A texture (h, w, 3) whose skin along the middle is not darker than beside it.

    The near half ends where light fades, and its mirror image begins there: a shadow's edge would become a dark line.
    """
    skin = skin_mask(reference, growth=0).astype(np.float32)  # down to the lip
    sigma = LIMITS.edge_face_widths * reference.resolution
    weight = cv2.GaussianBlur(skin, (0, 0), sigma)[..., None]
    local = (cv2.GaussianBlur(texture * skin[..., None], (0, 0), sigma) + 1) / (weight + 1e-3)
    away = np.arange(reference.size[1]) - reference.points[NOSE_BASE, 0]
    beside = np.abs(np.abs(away) - LIMITS.beside_face_widths * reference.resolution).argsort(kind="stable")[
        :2
    ]
    lifted = np.clip(local[:, beside].mean(1, keepdims=True) / local, 1, LIMITS.max_gain)
    strip = np.exp(-0.5 * (away / (LIMITS.strip_face_widths * reference.resolution)) ** 2)
    share = strip[None, :, None] * cv2.GaussianBlur(skin, (0, 0), sigma / 2)[..., None] * skin[..., None]
    return np.asarray(texture * (1 + share * (lifted - 1)), np.float32)
