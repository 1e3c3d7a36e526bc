"""A face in a photo with what isn't seen of it: from its other half where that is bare, else from other people.

Hair hides brows and cheeks.  Brows are whole or not there: one that hair covers in part is replaced.  A turned head
hides one side of its nose, and the other one with its mirror image is too narrow: it has an average nose, in the
form that its points tell.  What is put in gets the tone of the face's own bare skin around it.

Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, LEFT_EYE, LIPS, NOSE, RIGHT_BROW, RIGHT_EYE
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.mirror import mirror_image
from guise.aam.parsing import FaceClass, Parsing
from guise.aam.reference import ReferenceFrame
from guise.aam.skin_tone import local_mean
from guise.aam.solid_shape import SolidPrior
from guise.aam.without_glasses import disc
from guise.common.arrays import F32, F64
from guise.common.small import ramp, ramps


@dataclass(frozen=True)
class HiddenLimits:
    """What of a face is hidden."""

    share: tuple[float, float] = (
        0.15,
        0.4,
    )  # of hair in a cell, up to which skin is seen and from which hair is
    growth_face_widths: float = 0.03  # around it, where its shadow and single hairs lie
    edge_face_widths: float = 0.012  # standard deviation
    brow_growth_face_widths: float = 0.04  # around the points of a brow, within which all of it lies
    brow_share: float = 0.3  # hidden, from which all of a brow is replaced
    turned_degrees: tuple[float, float] = (
        6.0,
        14.0,
    )  # of yaw, at which a nose is seen and at which it is not
    nose_growth_face_widths: float = 0.03  # around the points of a nose
    tone_face_widths: float = 0.08  # standard deviation of the means of bare skin


LIMITS = HiddenLimits()


def hidden_share(parsing: Parsing, shape: F64, reference: ReferenceFrame) -> F32:
    """(h, w) share in [0, 1] by which a face at a shape (81, 2) of the parsed picture is hidden; not its eyes."""
    hair = parsing.at(reference.sampler.positions(shape), parsing.share(FaceClass.HAIR))
    over = reference.scatter(np.asarray(ramps(hair, *LIMITS.share), np.float32))
    share = np.asarray(cv2.dilate(over, disc(LIMITS.growth_face_widths * reference.resolution)), np.float32)
    share *= 1 - soft_parts(reference, (RIGHT_EYE, LEFT_EYE, LIPS), 0.0)
    for brow in (RIGHT_BROW, LEFT_BROW):
        place = soft_parts(reference, (brow,), 0.0)
        if float((place * over).sum()) > LIMITS.brow_share * float(place.sum()):
            np.maximum(share, soft_parts(reference, (brow,), LIMITS.brow_growth_face_widths), out=share)
    soft = cv2.GaussianBlur(share, (0, 0), LIMITS.edge_face_widths * reference.resolution)
    turned = ramp(abs(SolidPrior.shipped().fit(shape).pose.angles[0]), *LIMITS.turned_degrees)
    nose = soft_parts(reference, (NOSE,), LIMITS.nose_growth_face_widths)
    return np.asarray(np.maximum(soft, np.float32(turned) * nose) * reference.mask, np.float32)


def uncovered(texture: F32, hidden: F32, other: F32, reference: ReferenceFrame) -> F32:
    """A texture (h, w, 3) in which a hidden share (h, w) is that of the face's other half, or of another face."""
    image = mirror_image(np.dstack([texture, 1 - hidden]), reference, 1)
    bare = skin_mask(reference) * (1 - hidden)
    filling = _in_tone(other, texture, bare, reference)
    half = _in_tone(image[..., :3], texture, bare * image[..., 3], reference)
    filling += image[..., 3:] * (half - filling)
    return np.asarray(texture + hidden[..., None] * (filling - texture), np.float32)


def _in_tone(source: F32, texture: F32, bare: F32, reference: ReferenceFrame) -> F32:
    """A source (h, w, 3) with the smooth tone of a texture, compared where both are bare (h, w)."""
    own, theirs = (
        local_mean(one, bare, LIMITS.tone_face_widths * reference.resolution) for one in (texture, source)
    )
    return np.asarray(source * (own / theirs), np.float32)
