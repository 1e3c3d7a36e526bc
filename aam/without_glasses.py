"""A donor's glasses, taken out of their neutral face.

Half of a pair of glasses is worse than none: rims that lie on the face would be drawn, the temples beside it cannot be.
So if the person wears glasses at rest, thin lines between brows and nose are filled with the skin around them; eyes,
brows and the lower nose stay.  A reflection that hides the eye behind a lens takes the mirror image of the other one
where that is clear, and is skin elsewhere.  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.detail import FINE
from guise.aam.landmarks.schemes import (
    BROWS,
    LEFT_BROW,
    LEFT_EYE,
    NOSE_ROOT,
    NOSE_TIP,
    NOSE_WINGS,
    RIGHT_BROW,
    RIGHT_EYE,
    interocular,
)
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask
from guise.aam.mirror import mirror_image
from guise.aam.model import Identity
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.small import mean


@dataclass(frozen=True)
class GlassesLimits:
    """When glasses are seen, and what of a face are their rims."""

    min_share: float = 0.015  # about either eye
    min_bridge_share: float = 0.11  # somewhere above the nose: lashes and brows have no bridge
    min_face_pixels: float = 80.0  # of a face's width, below which glasses cannot be told
    line_face_widths: float = 0.04  # the widest thin line
    min_contrast: float = 0.05  # of a thin line with the skin around it
    rim_face_widths: float = 0.1  # the widest rim
    min_rim_contrast: float = 0.35  # of a dark one
    eye_growth_face_widths: float = 0.012  # around eyes and brows, where nothing is filled
    nose_growth_face_widths: float = 0.07  # around the tip and the wings of the nose
    filling_face_widths: tuple[float, float] = (
        0.02,
        0.1,
    )  # standard deviations, over which skin around is averaged
    far_share: float = 0.01  # of the second, which counts where the first finds nothing
    lens_face_widths: float = 0.1  # around an eye
    reflection: float = 1.35  # times as bright as skin is what no lens without a reflection shows
    reflection_face_widths: float = 0.05  # the least width of one: the white of an eye is lower
    reflection_edge_face_widths: float = 0.03  # around it, in which it fades


LIMITS = GlassesLimits()
# (n, 2) places about the middle of an eye, and (n, 1) up from the nose's root, in inter-ocular distances.
_AROUND_EYE = np.stack(
    np.meshgrid(np.linspace(-0.3, 0.3, 16), np.linspace(-0.22, 0.22, 12)), axis=-1
).reshape(-1, 2)
_ALONG_NOSE = np.linspace(-0.25, 0.15, 9)[:, None]
EYE_PAIR = np.stack([RIGHT_EYE, LEFT_EYE])  # (2, 6)


def wears_glasses(parsing: FaceParsing, shape: F64) -> bool:
    """Whether there are glasses about both eyes of a face (81, 2); hair and earrings are on one side or elsewhere."""
    if np.maximum.reduce(shape[:, 0]) - np.minimum.reduce(shape[:, 0]) < LIMITS.min_face_pixels:
        return False
    size, up = float(interocular(shape)), shape[NOSE_ROOT] - shape[NOSE_TIP]
    up *= size / max(math.hypot(*up), 1e-6)
    middles = mean(shape[EYE_PAIR], 1)
    places = np.concatenate([shape[NOSE_ROOT] + _ALONG_NOSE * up, *(middles[:, None] + size * _AROUND_EYE)])
    glasses = parsing.at(places, parsing.shares[FaceClass.GLASSES])
    bridge, eyes = glasses[: len(_ALONG_NOSE)], glasses[len(_ALONG_NOSE) :].reshape(2, -1)
    about_both = np.minimum.reduce(mean(eyes, 1)) > LIMITS.min_share
    return bool(about_both and np.maximum.reduce(bridge) > LIMITS.min_bridge_share)


def without_glasses(identity: Identity) -> Identity:
    """The same person with their neutral texture and detail without the glasses they wear at rest."""
    rest = identity.rest_frame
    if not wears_glasses(FaceParser().parse(rest.picture, rest.shape), rest.shape):
        return identity
    reference = identity.reference
    texture = reference.scatter(identity.appearance.neutral_texture)
    glare = reflections(texture, reference)
    other = mirror_image(np.dstack([texture, glare.astype(np.float32)]), reference, 1)
    texture[glare] = other[glare, :3]
    found = rims(texture, reference) | (glare & (other[..., 3] > 0))
    share = _soft(found | glare)
    neutral = identity.appearance.neutral.copy()
    neutral[SHAPE_ENTRIES:] = _filled(texture, found, _soft(found), reference)[reference.mask].ravel()
    h, w = reference.size
    fine = cv2.resize(share, (FINE * w, FINE * h), interpolation=cv2.INTER_LINEAR)
    detail = np.asarray(identity.detail * (1 - fine), np.float32)
    return replace(identity, appearance=replace(identity.appearance, neutral=neutral), detail=detail)


def reflections(texture: F32, reference: ReferenceFrame) -> Bool:
    """(h, w) where a texture (h, w, 3) shows a reflection on a lens: large, and far brighter than skin."""
    skin, width = skin_mask(reference), reference.resolution
    bright = (texture @ LUMA > LIMITS.reflection * float(np.median((texture @ LUMA)[skin]))).astype(np.uint8)
    eyes = _hulls(reference, [reference.points[part] for part in (RIGHT_EYE, LEFT_EYE)])
    lenses = np.asarray(cv2.dilate(eyes, disc(LIMITS.lens_face_widths * width)), np.uint8)
    large = cv2.morphologyEx(bright & lenses, cv2.MORPH_OPEN, disc(LIMITS.reflection_face_widths * width / 2))
    grown = cv2.dilate(large, disc(LIMITS.reflection_edge_face_widths * width))
    return np.asarray((grown > 0) & reference.mask)


def rims(texture: F32, reference: ReferenceFrame) -> Bool:
    """(h, w) thin lines and dark rims of a texture (h, w, 3) where glasses are worn, and the pixels beside them."""
    luma = np.maximum(texture @ LUMA, 1).astype(np.float32)
    thin, wide = (
        disc(width * reference.resolution / 2) for width in (LIMITS.line_face_widths, LIMITS.rim_face_widths)
    )
    line = np.maximum(*(cv2.morphologyEx(luma, how, thin) for how in (cv2.MORPH_TOPHAT, cv2.MORPH_BLACKHAT)))
    dark = cv2.morphologyEx(luma, cv2.MORPH_BLACKHAT, wide) > LIMITS.min_rim_contrast * (
        cv2.morphologyEx(luma, cv2.MORPH_CLOSE, wide)
    )
    zone = _zone(reference)
    found = ((line > LIMITS.min_contrast * luma) | dark) & zone
    return np.asarray((cv2.dilate(found.astype(np.uint8), disc(1)) > 0) & zone)


def _zone(reference: ReferenceFrame) -> Bool:
    """(h, w) where rims may lie: between brows and nose, but not on eyes and brows."""
    points, width = reference.points, reference.resolution
    eyes = _hulls(reference, [points[part] for part in (RIGHT_EYE, LEFT_EYE, RIGHT_BROW, LEFT_BROW)])
    nose = _hulls(reference, [points[[NOSE_TIP, *NOSE_WINGS]]])
    near_eyes = cv2.dilate(eyes, disc(LIMITS.eye_growth_face_widths * width)) > 0
    near_nose = cv2.dilate(nose, disc(LIMITS.nose_growth_face_widths * width)) > 0
    rows = np.arange(reference.size[0])[:, None]
    between = (rows > points[BROWS, 1].min()) & (rows < points[NOSE_TIP, 1])
    return np.asarray(reference.mask & between & ~near_eyes & ~near_nose)


def _filled(texture: F32, unknown: Bool, share: F32, reference: ReferenceFrame) -> F32:
    """A texture (h, w, 3) with a share (h, w) of the mean of what lies around the unknown places (h, w)."""
    known = (reference.mask & ~unknown).astype(np.float32)
    weighted = np.concatenate([texture * known[..., None], known[..., None]], axis=2)
    near, far = (
        cv2.GaussianBlur(weighted, (0, 0), width * reference.resolution)
        for width in LIMITS.filling_face_widths
    )
    sums = near + np.float32(LIMITS.far_share) * far
    around = sums[..., :3] / np.maximum(sums[..., 3:], 1e-6)
    return np.asarray(texture + share[..., None] * (around - texture), np.float32)


def _soft(places: Bool) -> F32:
    """(h, w) share of places, 1 there and fading over a pixel."""
    return np.asarray(np.clip(1.5 * cv2.GaussianBlur(places.astype(np.float32), (0, 0), 0.7), 0, 1))


def _hulls(reference: ReferenceFrame, groups: list[F64]) -> U8:
    canvas = np.zeros(reference.size, np.uint8)
    for points in groups:
        cv2.fillConvexPoly(canvas, cv2.convexHull(np.round(points).astype(np.int32)), 1)
    return canvas


def disc(radius: float) -> U8:
    """A structuring element of a radius in pixels, of at least one."""
    side = 2 * max(1, round(radius)) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)
