"""What the expression changes in S, as far as T can take it.  Fields (h, w) on the grid of T'."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from analogy.photo.pictures import F32

NEAR = 0.012  # of the face's width: sigma of the neighbourhoods that are compared
FLAT = 0.04  # heights (logarithms of luminance) within which a neighbourhood is flat
COARSE = 0.02  # of the face's width: sigma of what is taken where S and T differ
NOISE = 1.5  # of the median power of detail
LIPS_TRUST = 3
LIPS = 0.012  # of the face's width, by which the mouth's inside is widened


def agreement(source: F32, target: F32, width: float) -> F32:
    """How alike two heights are around each pixel, 0 to 1, whatever their levels; two flat ones are alike.

    A fine change belongs to the structure that it changes: where T has none like it, or has it elsewhere, it would
    be seen as a ghost.
    """
    sigma = NEAR * width
    one, two = source - _blurred(source, sigma), target - _blurred(target, sigma)
    both, first, second = (_blurred(field, sigma) for field in (one * two, one * one, two * two))
    return np.asarray(np.clip((2 * both + FLAT**2) / (first + second + FLAT**2), 0, 1), np.float32)


def carried(change: F32, fine: F32, mouth: NDArray[np.bool_], width: float) -> F32:
    """A change of heights, its detail kept in shares (h, w) as far as it is no noise, the mouth's inside as around it.

    Teeth and the dark behind them are no change of the lips.
    """
    size = 2 * round(LIPS * width) + 1
    outside = 1 - cv2.dilate(mouth.astype(np.float32), np.ones((size, size), np.uint8))
    sigma = COARSE * width
    coarse = _blurred(change * outside, sigma) / (_blurred(outside, sigma) + 1e-6)
    kept = np.where(outside > 0, fine, fine**LIPS_TRUST) * ~mouth
    detail = change - coarse
    return np.asarray(coarse + kept * _signal(detail, NEAR * width) * detail, np.float32)


def _signal(detail: F32, sigma: float) -> F32:
    """The share of each pixel (h, w) that is no noise, as Wiener's filter has it; most pixels show noise alone."""
    power = _blurred(detail * detail, sigma)
    noise = NOISE * float(np.median(power))
    return np.asarray(np.maximum(power - noise, 0) / (power + 1e-12), np.float32)


def _blurred(field: F32, sigma: float) -> F32:
    return np.asarray(cv2.GaussianBlur(field, (0, 0), max(sigma, 0.5)), np.float32)
