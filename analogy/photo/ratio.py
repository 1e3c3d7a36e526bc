"""Expression ratio images (Liu, Shan and Zhang 2001) with their adaptive Gaussian: a method to compare with.

The target is multiplied by the ratio of luminances S' / S, warped to it.  Where the neighbourhoods of S and S' do not
correlate, they were not well aligned or there is no detail to keep: there the ratio is smoothed the most.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.common.arrays import F32, Bool


@dataclass(frozen=True)
class RatioSettings:
    """Settings of expression ratio images; faces are face widths."""

    max_sigma_faces: float = 0.02  # of the Gaussian where nothing correlates
    levels: int = 4  # Gaussians to choose from
    rim_faces: float = 0.03  # over which the ratio fades out
    neighbourhood_px: int = 2  # to each side
    max_ratio: float = 4.0  # by which a pixel becomes brighter or darker


RATIO = RatioSettings()
RATIO_LUMINANCE_OFFSET = np.float32(0.02)  # added to both, so that black divides


def smoothed_ratio(before: F32, after: F32, width: float) -> F32:
    """The adaptively smoothed ratio (h, w) of luminances (h, w); width : of the face, pixels."""
    plain = np.clip(
        (after + RATIO_LUMINANCE_OFFSET) / (before + RATIO_LUMINANCE_OFFSET),
        1 / RATIO.max_ratio,
        RATIO.max_ratio,
    )
    level = (1 - correlation(before, after)) * (RATIO.levels - 1)
    out = np.zeros_like(plain)
    for number in range(RATIO.levels):
        share = np.clip(1 - np.abs(level - number), 0, 1)
        sigma = RATIO.max_sigma_faces * width * number / (RATIO.levels - 1)
        out += share * (cv2.GaussianBlur(plain, (0, 0), sigma) if sigma > 0 else plain)
    return np.asarray(out, np.float32)


def correlation(one: F32, other: F32) -> F32:
    """Normalised cross-correlation (h, w) of neighbourhoods in 0 .. 1; flat ones do not correlate."""
    size = (2 * RATIO.neighbourhood_px + 1, 2 * RATIO.neighbourhood_px + 1)

    def mean(field: F32) -> F32:
        return np.asarray(cv2.blur(field, size), np.float32)

    first, second = one - mean(one), other - mean(other)
    both = mean(first * second)
    scale = np.sqrt(mean(first * first) * mean(second * second))
    return np.asarray(np.clip(both / np.maximum(scale, 1e-6), 0, 1), np.float32)


def rim_fade(region: Bool, width: float) -> F32:
    """(h, w) 1 inside a region, fading to 0 at its rim; width : of the face, pixels."""
    away = cv2.distanceTransform(region.astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(np.clip(away / (RATIO.rim_faces * width), 0, 1), np.float32)
