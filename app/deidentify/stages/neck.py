"""The source's own neck below another head: its tone passes over from the head's to its own, and no seam is left.

Along the jaw the head's skin lies over the neck's.  The ratio of the two there, smooth along the seam, changes the
neck's skin below, less and less further down; clothes, hair and what is behind keep their colours.  Pixels; RGB.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import JAW
from guise.common.arrays import F32, F64, U8, Bool


@dataclass(frozen=True)
class NeckLimits:
    """Lengths are widths of the face."""

    seam: float = 0.14  # below the jaw, where the two skins are compared
    along: float = 0.12  # standard deviation of the ratio's smoothing
    down: float = 0.45  # over which it fades
    edge: float = 0.1  # of what is looked at, over which it fades, too
    reach: float = 0.9  # below the jaw, where all is as it was
    sampled_pixels: float = 64.0  # width of the face at which the ratio is worked out
    min_red: float = 0.06  # log ratio of red to green that skin has at least
    like: tuple[float, float] = (
        0.14,
        0.7,
    )  # standard deviations of skin's log ratios of colours, and log brightness
    max_log: float = 1.1  # of a ratio
    min_pixels: int = 30  # of skin on both sides, to compare


LIMITS = NeckLimits()


def necked(own: U8, head: U8, share: F32, mesh: F64) -> U8:
    """A picture (h, w, 3) in which the skin below a jaw takes on the tone of the head that will lie over it.

    own : without the head.   head, share : (h, w, 3) and (h, w), what will lie over it.   mesh : (81, 2) its landmarks.
    """
    width, jaw = float(np.ptp(mesh[:, 0])), mesh[JAW]
    height = own.shape[0]
    x0, x1 = (
        int(np.clip(x, 0, own.shape[1]))
        for x in (jaw[:, 0].min() - 0.1 * width, jaw[:, 0].max() + 0.1 * width)
    )
    y0, y1 = (int(np.clip(y, 0, height)) for y in (jaw[:, 1].mean(), jaw[:, 1].max() + LIMITS.reach * width))
    if min(x1 - x0, y1 - y0) < 8:
        return own
    part = np.s_[y0:y1, x0:x1]
    scale = min(1.0, LIMITS.sampled_pixels / width)
    size = max(2, round((x1 - x0) * scale)), max(2, round((y1 - y0) * scale))
    small, over, much = (
        np.asarray(cv2.resize(p[part], size, interpolation=cv2.INTER_AREA), np.float32)
        for p in (own, head, share)
    )
    away, below = _away(mesh - (x0, y0), size, (size[0] / (x1 - x0), size[1] / (y1 - y0)))
    away /= width * scale
    band = below & (away < LIMITS.seam)
    logs, wanted = (np.log(p + 2) for p in (small, over))
    seam = band & _may_be_skin(logs) & (much > 0.25)
    if seam.sum() < LIMITS.min_pixels:
        return own
    like = np.median(logs[seam], axis=0)
    weight = (_like(logs, like) * much * band * _may_be_skin(wanted)).astype(np.float32)
    if weight.sum() < LIMITS.min_pixels / 2:
        return own
    ratio = np.clip(wanted - logs, -LIMITS.max_log, LIMITS.max_log) * weight[..., None]
    mean, sigma = ratio.sum((0, 1)) / weight.sum(), LIMITS.along * width * scale
    near, total = (cv2.GaussianBlur(p, (0, 0), sigma) for p in (ratio, weight))
    field = (near + 0.02 * mean) / (total[..., None] + 0.02)
    field *= np.exp(-np.square(away / LIMITS.down))[..., None]
    field *= np.clip((LIMITS.reach - 0.05 - away) / LIMITS.down, 0, 1)[..., None]
    border = np.ones(np.add(size[::-1], 2), np.uint8)
    border[[0, -1]], border[:, [0, -1]] = 0, 0
    inside = cv2.distanceTransform(border, cv2.DIST_L2, 3)[1:-1, 1:-1] / (LIMITS.edge * width * scale)
    field *= np.clip(inside, 0, 1)[..., None]
    whole = cv2.resize(field.astype(np.float32), (x1 - x0, y1 - y0), interpolation=cv2.INTER_LINEAR)
    there = own[part].astype(np.float32)
    skin = cv2.GaussianBlur(_like(np.log(there + 2), like), (0, 0), max(0.6, 0.004 * width))
    made = own.copy()
    made[part] = np.clip(there * np.exp(whole * skin[..., None]), 0, 255).round()
    return made


def _away(mesh: F64, size: tuple[int, int], scale: tuple[float, float]) -> tuple[F32, Bool]:
    """(h, w) pixels from the face of a mesh (81, 2) in a smaller picture, and whether one lies below the jaw."""
    w, h = size
    face, jaw = np.ones((h, w), np.uint8), np.zeros((h, w), np.uint8)
    placed = np.round((mesh + 0.5) * scale - 0.5).astype(np.int32)
    cv2.fillConvexPoly(face, cv2.convexHull(placed), 0)
    cv2.fillPoly(jaw, [placed[JAW]], 1)
    away = cv2.distanceTransform(np.pad(face, 1, constant_values=1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(away, np.float32), (np.cumsum(jaw, axis=0) > 0) & (face > 0)


def _may_be_skin(logs: F32) -> Bool:
    """(h, w) whether red is more than green, and green no less than blue."""
    red, green, blue = np.moveaxis(logs, 2, 0)
    return np.asarray((red - green > LIMITS.min_red) & (green - blue > -LIMITS.min_red))


def _like(logs: F32, colour: F32) -> F32:
    """(h, w) in [0, 1] how much logarithms of colours (h, w, 3) are those of the skin of a colour (3,)."""
    apart = logs - colour
    tint, bright = LIMITS.like
    odd = np.square(apart[..., 0] - apart[..., 1]) + np.square(apart[..., 2] - apart[..., 1])
    return np.asarray(np.exp(-odd / (2 * tint**2) - np.square(apart[..., 1] / bright) / 2), np.float32)
