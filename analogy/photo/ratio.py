"""Expression ratio images (Liu, Shan and Zhang 2001), with their adaptive Gaussian: a method to compare with.

The ratio of luminances S' / S, warped to the target, multiplies it.  Where the neighbourhoods of S and S' do not
correlate they were not well aligned, or there is nothing to keep: there the ratio is smoothed the most.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F32, Bool

WIDEST = 0.02  # of the face's width: the Gaussian's sigma where nothing correlates
LEVELS = 4  # Gaussians between which is chosen
RIM = 0.03  # of the face's width, over which it fades
NEAR = 2  # pixels to each side in a neighbourhood
DARK = np.float32(0.02)  # luminance added to both, so that black divides
MOST = 4.0  # by which a pixel becomes brighter or darker


def ratio(before: F32, after: F32, width: float) -> F32:
    """The smoothed ratio (h, w) of luminances (h, w), for a face of a width in pixels."""
    plain = np.clip((after + DARK) / (before + DARK), 1 / MOST, MOST)
    level = (1 - correlation(before, after)) * (LEVELS - 1)
    out = np.zeros_like(plain)
    for number in range(LEVELS):
        share = np.clip(1 - np.abs(level - number), 0, 1)
        sigma = WIDEST * width * number / (LEVELS - 1)
        out += share * (cv2.GaussianBlur(plain, (0, 0), sigma) if sigma > 0 else plain)
    return np.asarray(out, np.float32)


def correlation(one: F32, other: F32) -> F32:
    """Normalised cross-correlation (h, w) of neighbourhoods in 0 .. 1; flat ones do not correlate."""
    size = (2 * NEAR + 1, 2 * NEAR + 1)

    def mean(field: F32) -> F32:
        return np.asarray(cv2.blur(field, size), np.float32)

    first, second = one - mean(one), other - mean(other)
    both = mean(first * second)
    scale = np.sqrt(mean(first * first) * mean(second * second))
    return np.asarray(np.clip(both / np.maximum(scale, 1e-6), 0, 1), np.float32)


def faded(region: Bool, width: float) -> F32:
    """(h, w) 1 inside a region, falling to 0 at its rim, for a face of a width in pixels."""
    away = cv2.distanceTransform(region.astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(np.clip(away / (RIM * width), 0, 1), np.float32)
