"""Where two pictures differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from guise.common.arrays import U8

Part = tuple[int, int, int, int]  # of a picture: left, top, right, bottom


@dataclass(frozen=True)
class ChangeLimits:
    """What is a difference, and how much of what is about it belongs to it."""

    pixels: int = 5  # side of what differs on average by
    grey_levels: float = 6.0  # more than encoding makes
    context_share: float = 0.5  # of the side of what differs


LIMITS = ChangeLimits()


def changed_parts(before: U8, after: U8, scale: float) -> list[Part]:
    """Parts of a picture that differ, with what is about them; none overlap.

    before, after : (h, w) luma made smaller by `scale`; one may have a row or a column more, as an encoder needs.
    """
    height, width = np.minimum(before.shape, after.shape)
    before, after = before[:height, :width], after[:height, :width]
    differs = cv2.blur(cv2.absdiff(before, after), (LIMITS.pixels,) * 2) > LIMITS.grey_levels
    places = cv2.connectedComponentsWithStats(differs.astype(np.uint8))[2][1:]
    parts: list[Sequence[float]] = []
    for x, y, width, height in places[:, :4]:
        reach = LIMITS.context_share * max(width, height)
        part = (x - reach, y - reach, x + width + reach, y + height + reach)
        while (other := next((p for p in parts if _overlap(p, part)), None)) is not None:
            parts.remove(other)
            part = (*np.minimum(part, other)[:2], *np.maximum(part, other)[2:])
        parts.append(part)
    limits = np.array(before.shape[::-1] * 2)
    whole = [(np.clip(part, 0, limits) / scale).astype(int).tolist() for part in parts]
    return [(left, top, right, bottom) for left, top, right, bottom in whole]


def _overlap(one: Sequence[float], other: Sequence[float]) -> bool:
    return all(one[k] < other[k + 2] and other[k] < one[k + 2] for k in (0, 1))
