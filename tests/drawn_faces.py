"""Drawn faces with landmarks, at rest and smiling, for expression analogies between photographs."""

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    BROWS,
    INNER_LIPS,
    JAW,
    LEFT_BROW,
    LEFT_EYE,
    NOSE_ROOT,
    OUTER_LIPS,
    RIGHT_BROW,
    RIGHT_EYE,
    UPPER_INNER_LIP,
)
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, U8

Picture = U8

SIZE = (230, 200)
NEUTRAL = ReferenceFrame.canonical(96).points + np.array([50, 45])
NEUTRAL[UPPER_INNER_LIP] += (0, 3.6)  # the canonical mouth is open
NEUTRAL[list(INNER_LIPS[7:4:-1])] -= (0, 3.6)


def drawn(points: F64, seed: int, skin: float = 0.6, furrow: float = 0.0) -> F32:
    """A face (230, 200, 3) in 0 .. 1 with brows, eyes and lips at the landmarks, and a furrow on its brow."""
    noise = np.random.default_rng(seed).normal(0, 1, SIZE).astype(np.float32)
    shade = cv2.GaussianBlur(noise, (0, 0), 6) + 0.02 * noise
    picture = np.full((*SIZE, 3), 0.4, np.float32)
    tone = np.array([1, 0.8, 0.7]) * skin
    for part, colour in (
        ((*JAW, *range(80, 67, -1)), tone),
        (RIGHT_EYE, (0.9, 0.9, 0.9)),
        (LEFT_EYE, (0.9, 0.9, 0.9)),
        (OUTER_LIPS, tone * (0.9, 0.6, 0.6)),
        (INNER_LIPS, (0.2, 0.1, 0.1)),
        (RIGHT_BROW, tone * 0.4),
        (LEFT_BROW, tone * 0.4),
    ):
        corners = np.rint(points[list(part)] * 16).astype(np.int32)
        cv2.fillPoly(picture, [corners], [float(c) for c in colour], cv2.LINE_AA, 4)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    middle = points[NOSE_ROOT] - (0, 22)
    dark = np.exp(-(((x - middle[0]) / 14) ** 2) - ((y - middle[1]) / 2) ** 2)
    lit = cv2.GaussianBlur(picture, (0, 0), 0.7) * (1 + 0.1 * shade - furrow * dark)[:, :, None]
    return np.asarray(np.clip(lit, 0, 1), np.float32)


def smiling(points: F64, much: float = 1.0) -> F64:
    """Mouth corners out and up, lower lip down, brows up."""
    out = points.copy()
    out[[OUTER_LIPS[0], INNER_LIPS[0]]] += np.array([-4, -4]) * much
    out[[OUTER_LIPS[6], INNER_LIPS[4]]] += np.array([4, -4]) * much
    out[[*OUTER_LIPS[7:], *INNER_LIPS[5:]]] += np.array([0, 5]) * much
    out[BROWS] += np.array([0, -4]) * much
    return out


def eight(picture: F32) -> Picture:
    return np.asarray(np.rint(255 * picture), np.uint8)


OTHER = (NEUTRAL - NEUTRAL.mean(0)) * (1.05, 0.95) + NEUTRAL.mean(0) + (2, 1)
S, T = eight(drawn(NEUTRAL, 0)), eight(drawn(OTHER, 1, 0.45))
S1 = eight(drawn(smiling(NEUTRAL), 0, furrow=0.4))
