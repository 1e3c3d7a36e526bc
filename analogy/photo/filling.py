"""What T does not show, taken from S': the inside of a mouth that opens, lids that come down."""

from __future__ import annotations

import cv2
import numpy as np

from guise.analogy.photo.heights import DARK
from guise.analogy.photo.pictures import LUMINANCE
from guise.common.arrays import F32

BRIGHT = 3  # power of its luminance by which skin counts
AROUND = 0.03  # of the face's width: sigma of the surroundings whose colours are taken
LIPS = 0.008  # the same of a mouth, inside which colours are those of the light
WEIGHT = 0.1  # of the light, of the surroundings' that lie all around
LASHES = 0.016  # of the face's width, by which lids are widened
SOON = 2  # times its share is a lid opaque: none is seen through
SEAM = 0.004  # of the face's width: sigma of what is blended


def lidded(made: F32, shown: F32, lids: F32, width: float) -> F32:
    """A picture (h, w, 3) with the lids of another, in shares (h, w), for a face's width.

    They have the colours of the skin around the eye, and are nowhere brighter.
    """
    wide = _widened(lids, LASHES * width)
    around = np.asarray(_widened(wide, LASHES * width) == 0, np.float32)
    luminance = shown @ LUMINANCE
    shade = (luminance + DARK) / (_skin(luminance, luminance, around, width) + DARK)
    colours = _skin(made, made @ LUMINANCE, around, width)
    lid = (colours + DARK) * np.minimum(shade, 1)[:, :, None] - DARK
    alpha = cv2.GaussianBlur(np.minimum(SOON * wide, 1), (0, 0), LASHES / 2 * width)[:, :, None]
    return np.asarray(made + alpha * (lid - made), np.float32)


def _skin(picture: F32, luminance: F32, around: F32, width: float) -> F32:
    """What a picture (h, w, ..) has around, spread; bright skin counts more than hairs."""
    weight = around * luminance**BRIGHT
    every = weight if picture.ndim == 2 else weight[:, :, None]
    sigma = AROUND * width
    spread = cv2.GaussianBlur(weight, (0, 0), sigma) + 1e-9
    return np.asarray(
        cv2.GaussianBlur(picture * every, (0, 0), sigma) / spread.reshape(every.shape), np.float32
    )


def filled(made: F32, shown: F32, mouth: F32, light: F32, width: float) -> F32:
    """A picture (h, w, 3) with the inside of another's mouth, in shares (h, w), in a light (3,); for a face's width.

    Near the lips it has the lips' colours, as some of it is lips; but none brighter than the light.
    """
    wide = _widened(mouth, SEAM * width)
    outside = np.asarray(wide == 0, np.float32)
    gain = np.minimum(_light(made, shown, outside, light, width), light)
    alpha = cv2.GaussianBlur(wide, (0, 0), max(SEAM * width, 0.5))[:, :, None]
    return np.asarray(made + alpha * ((shown + DARK) * gain - DARK - made), np.float32)


def _light(made: F32, shown: F32, known: F32, inside: F32, width: float) -> F32:
    """Gain (h, w, 3) of one picture over another, where known (h, w), spread into what is not; far inside as given."""
    sigma = LIPS * width
    ratio = np.log((np.clip(made, 0, 1) + DARK) / (shown + DARK)) * known[:, :, None]
    total = cv2.GaussianBlur(known, (0, 0), sigma)[:, :, None] + WEIGHT
    return np.asarray(
        np.exp((cv2.GaussianBlur(ratio, (0, 0), sigma) + WEIGHT * np.log(inside)) / total), np.float32
    )


def _widened(share: F32, by: float) -> F32:
    size = 2 * max(round(by), 1) + 1
    return np.asarray(cv2.dilate(share, np.ones((size, size), np.uint8)), np.float32)
