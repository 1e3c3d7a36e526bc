"""Composites what T does not show from S': the inside of an opening mouth, and closing lids."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.analogy.photo.height_field import LUMINANCE_OFFSET
from guise.analogy.photo.pictures import LUMINANCE
from guise.common.arrays import F32


@dataclass(frozen=True)
class CompositingSettings:
    """Settings of what is pasted from S'; faces are face widths."""

    skin_luminance_power: int = 3  # by which brighter skin counts more
    skin_sigma_faces: float = 0.03  # of the surroundings whose colours are taken
    lip_light_sigma_faces: float = 0.008  # of the lips' light, beyond which the mouth has that of the eyes
    light_weight: float = 0.1  # of the eyes' light against lips all around
    lid_margin_faces: float = 0.016  # by which lids are widened, for the lashes
    lid_opacity_gain: int = 2  # a lid is opaque from half its share, so that no eye shows through
    seam_sigma_faces: float = 0.004  # of blending


COMPOSITING = CompositingSettings()
MOUTH_MARGIN_FACES = 0.05  # around a mouth, beyond which compositing it changes nothing


def bounding_part(share: F32, margin: float) -> tuple[slice, slice]:
    """The rectangle of a field (h, w) that holds what is not 0, with a margin in pixels."""
    rows, columns = np.flatnonzero(share.any(1)), np.flatnonzero(share.any(0))
    reach = int(np.ceil(margin))
    return slice(max(rows[0] - reach, 0), rows[-1] + reach + 1), slice(
        max(columns[0] - reach, 0), columns[-1] + reach + 1
    )


def composite_lids(made: F32, shown: F32, lids: F32, width: float) -> F32:
    """A picture (h, w, 3) with the lids of another, by shares (h, w); width : of the face, pixels.

    The lids take the colours of the skin around the eye, and are nowhere brighter.
    """
    wide = _dilate(lids, COMPOSITING.lid_margin_faces * width)
    around = np.asarray(_dilate(wide, COMPOSITING.lid_margin_faces * width) == 0, np.float32)
    luminance = shown @ LUMINANCE
    shade = (luminance + LUMINANCE_OFFSET) / (
        _skin_average(luminance, luminance, around, width) + LUMINANCE_OFFSET
    )
    colours = _skin_average(made, made @ LUMINANCE, around, width)
    lid = (colours + LUMINANCE_OFFSET) * np.minimum(shade, 1)[:, :, None] - LUMINANCE_OFFSET
    alpha = cv2.GaussianBlur(
        np.minimum(COMPOSITING.lid_opacity_gain * wide, 1), (0, 0), COMPOSITING.lid_margin_faces / 2 * width
    )[:, :, None]
    return np.asarray(made + alpha * (lid - made), np.float32)


def _skin_average(picture: F32, luminance: F32, around: F32, width: float) -> F32:
    """Weighted average of the surroundings in a picture (h, w, ..); bright skin counts more than hair."""
    weight = around * luminance**COMPOSITING.skin_luminance_power
    every = weight if picture.ndim == 2 else weight[:, :, None]
    sigma = COMPOSITING.skin_sigma_faces * width
    spread = cv2.GaussianBlur(weight, (0, 0), sigma) + 1e-9
    return np.asarray(
        cv2.GaussianBlur(picture * every, (0, 0), sigma) / spread.reshape(every.shape), np.float32
    )


def composite_mouth(made: F32, shown: F32, mouth: F32, light: F32, width: float) -> F32:
    """A picture (h, w, 3) with the inside of another's mouth, by shares (h, w); width : of the face, pixels.

    light : gain (3,) of the target's light.  Near the lips the mouth takes their colours, as some of it is lips, but is
    never brighter than in that light.
    """
    wide = _dilate(mouth, COMPOSITING.seam_sigma_faces * width)
    outside = np.asarray(wide == 0, np.float32)
    gain = np.minimum(_light_gain(made, shown, outside, light, width), light)
    alpha = cv2.GaussianBlur(wide, (0, 0), max(COMPOSITING.seam_sigma_faces * width, 0.5))[:, :, None]
    return np.asarray(
        made + alpha * ((shown + LUMINANCE_OFFSET) * gain - LUMINANCE_OFFSET - made), np.float32
    )


def _light_gain(made: F32, shown: F32, known: F32, inside: F32, width: float) -> F32:
    """Gain (h, w, 3) of one picture over another, extended from known pixels (h, w); `inside` far from them."""
    sigma = COMPOSITING.lip_light_sigma_faces * width
    ratio = np.log((np.clip(made, 0, 1) + LUMINANCE_OFFSET) / (shown + LUMINANCE_OFFSET)) * known[:, :, None]
    total = cv2.GaussianBlur(known, (0, 0), sigma)[:, :, None] + COMPOSITING.light_weight
    return np.asarray(
        np.exp((cv2.GaussianBlur(ratio, (0, 0), sigma) + COMPOSITING.light_weight * np.log(inside)) / total),
        np.float32,
    )


def _dilate(share: F32, by: float) -> F32:
    size = 2 * max(round(by), 1) + 1
    return np.asarray(cv2.dilate(share, np.ones((size, size), np.uint8)), np.float32)
