"""What T does not show, taken from S': the inside of a mouth that opens, lids that come down."""

from __future__ import annotations

import cv2
import numpy as np

from analogy.photo.heights import DARK
from analogy.photo.pictures import F32

AROUND = 0.02  # of the face's width: sigma of the surroundings whose colours are taken
LIPS = 0.008  # the same of a mouth, inside which colours are those of the light
WEIGHT = 0.1  # of the light, of the surroundings' that lie all around
LASHES = 0.016  # of the face's width, by which lids are widened
SEAM = 0.004  # of the face's width: sigma of what is blended


def lidded(made: F32, shown: F32, lids: F32, width: float) -> F32:
    """A picture (h, w, 3) with the lids of another, in shares (h, w), in its own colours; for a face's width."""
    wide = _widened(lids, LASHES * width)
    skin = np.asarray(_widened(wide, LASHES * width) == 0, np.float32)
    return _blended(made, shown, wide, _light(made, shown, skin, None, AROUND * width), width)


def filled(made: F32, shown: F32, mouth: F32, light: F32, width: float) -> F32:
    """A picture (h, w, 3) with the inside of another's mouth, in shares (h, w), in a light (3,); for a face's width.

    Near the lips it has the lips' colours, as some of it is lips; but none brighter than the light.
    """
    wide = _widened(mouth, SEAM * width)
    outside = np.asarray(wide == 0, np.float32)
    gain = np.minimum(_light(made, shown, outside, light, LIPS * width), light)
    return _blended(made, shown, wide, gain, width)


def _light(made: F32, shown: F32, known: F32, inside: F32 | None, sigma: float) -> F32:
    """Gain (h, w, 3) of one picture over another, where known (h, w), spread into what is not; far inside as given."""
    ratio = np.log((np.clip(made, 0, 1) + DARK) / (shown + DARK)) * known[:, :, None]
    weight = 1e-6 if inside is None else WEIGHT
    far = np.zeros(3, np.float32) if inside is None else np.log(inside)
    around = cv2.GaussianBlur(known, (0, 0), sigma)[:, :, None]
    return np.asarray(
        np.exp((cv2.GaussianBlur(ratio, (0, 0), sigma) + weight * far) / (around + weight)), np.float32
    )


def _blended(made: F32, shown: F32, share: F32, gain: F32, width: float) -> F32:
    alpha = cv2.GaussianBlur(share, (0, 0), max(SEAM * width, 0.5))[:, :, None]
    return np.asarray(made + alpha * ((shown + DARK) * gain - DARK - made), np.float32)


def _widened(share: F32, by: float) -> F32:
    size = 2 * max(round(by), 1) + 1
    return np.asarray(cv2.dilate(share, np.ones((size, size), np.uint8)), np.float32)
