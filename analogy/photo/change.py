"""What the expression changes in S, as far as T can take it.  Fields (h, w) on the grid of T'."""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F32, Bool

NEAR = 0.012  # of the face's width: sigma of the neighbourhoods that are compared
FLAT = 0.03  # heights (logarithms of luminance) within which a neighbourhood is flat
SAME = 1e-4  # the same where even noise must agree
COARSE = 0.02  # of the face's width: sigma of what is taken where S and T differ
NOISE = 1.5  # of the median power of detail
LIPS_TRUST = 3  # power of the agreement beside what is filled
BRIGHTER = 0.25  # heights, which no brightening exceeds
STEP = 6  # pixels between those by which light is judged
ROUNDS = 8  # of reweighting
SPREAD = 0.01  # heights around the plane of light
LIPS = 0.012  # of the face's width, by which what is filled is widened


def agreement(source: F32, target: F32, width: float) -> tuple[F32, F32]:
    """Two fields 0 to 1: how alike heights are around each pixel, whatever their levels; whether they are the same."""
    sigma = NEAR * width
    one, two = source - _blurred(source, sigma), target - _blurred(target, sigma)
    both = 2 * _blurred(one * two, sigma)
    power = _blurred(one * one + two * two, sigma)
    alike, same = ((both + flat**2) / (power + flat**2) for flat in (FLAT, SAME))
    return np.asarray(np.clip(alike, 0, 1), np.float32), np.asarray(np.clip(same, 0, 1) ** 2, np.float32)


def carried(change: F32, alike: F32, same: F32, filled: Bool, width: float) -> F32:
    """What the target's heights take of a change from S to S', by how alike S and T are (h, w), and whether the same.

    Its detail, in so far as S is there like T and the change no noise; else what is left of it when smoothed.  A
    fine change belongs to the structure that it changes: where T has none like it, it would be seen as a ghost.
    What is filled from S' is taken as around it: teeth and the dark behind them are no change of the lips.
    """
    size = 2 * round(LIPS * width) + 1
    widened = cv2.dilate(filled.astype(np.uint8), np.ones((size, size), np.uint8))
    outside = np.asarray(widened == 0, np.float32)
    sigma = COARSE * width
    coarse = _blurred(change * outside, sigma) / (_blurred(outside, sigma) + 1e-6)
    detail = change - coarse
    kept = np.where(outside > 0, alike, alike**LIPS_TRUST) * ~filled
    return np.asarray(coarse + kept * _signal(detail, same, NEAR * width) * detail, np.float32)


def steadied(change: F32, face: Bool, keep: float) -> F32:
    """A change of heights (h, w) less the plane that most of the face shows: S and S' were lit a little differently.

    keep : the share of that light which is kept; where T is S itself, that of S' is as good.
    The plane of Cauchy's likelihood, by reweighted least squares: an expression is far from it, not noise around it.
    """
    y, x = np.nonzero(face[::STEP, ::STEP]) * np.array(STEP)
    if len(x) < 3:
        return change
    terms = np.column_stack([np.ones(len(x)), x, y])
    values = change[y, x].astype(np.float64)
    plane, hold = np.array([np.median(values), 0, 0]), 1e-9 * np.eye(3)
    for _ in range(ROUNDS):
        weighted = terms / ((values - terms @ plane) ** 2 + SPREAD**2)[:, None]
        plane = np.linalg.solve(weighted.T @ terms + hold, weighted.T @ values)
    height, width = change.shape
    light = plane[0] + plane[1] * np.arange(width) + (plane[2] * np.arange(height))[:, None]
    return np.asarray(change - (1 - keep) * light, np.float32)


def bounded(change: F32, keep: float) -> F32:
    """A change of heights (h, w) that brightens little; as it is by a share to keep, where T is S itself.

    Skin in a socket or a fold becomes several times as bright when it comes into the light; T's, which need not lie in
    shadow at all, must not.
    """
    up = np.maximum(change, 0)
    return np.asarray(change - (1 - keep) * (up - BRIGHTER * np.tanh(up / BRIGHTER)), np.float32)


def _signal(detail: F32, same: F32, sigma: float) -> F32:
    """The share of each pixel (h, w) that is no noise, as Wiener's filter has it; most pixels show noise alone.

    Where T is S itself, so is its noise.
    """
    power = _blurred(detail * detail, sigma)
    noise = NOISE * float(np.median(power)) * (1 - same)
    return np.asarray(np.maximum(power - noise, 0) / (power + 1e-12), np.float32)


def _blurred(field: F32, sigma: float) -> F32:
    return np.asarray(cv2.GaussianBlur(field, (0, 0), max(sigma, 0.5)), np.float32)
