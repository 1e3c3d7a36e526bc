"""What hangs loose beside a head that is to be replaced: strands of hair, ribbons, earrings; for ``--region head``.

The parsing sees nothing so thin.  But beside a head the background is often plain: what differs there from its colour,
which changes smoothly, is thin, and begins at the head, is part of that head.  Where the background has a pattern,
nobody can tell, and all stays.  Lengths are widths of the face.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.app.deidentify.stages.head_matte import FoundHead, Gap
from guise.app.media import Frame
from guise.common.arrays import F32, F64, Bool


@dataclass(frozen=True)
class LooseLimits:
    """Where is looked, and what counts."""

    face_pixels: float = 110.0  # width of the face as it is looked at
    reach: tuple[float, float, float] = (1.1, 1.35, 1.3)  # aside, up and down from the middle of the face
    rounds: int = 4  # of a plain background, without what differs from the one before
    min_pixels: int = 500  # of it
    differs: tuple[float, float, float] = (2.5, 9.0, 20.0)  # root mean squares, least and most grey levels,
    plain_share: float = 0.93  # up to which so much of what is beside the head is plain
    thin: float = 0.1  # half the width of what is no body, up to
    off_body: float = 0.03  # from a body or neck, within which nothing is loose
    near: tuple[float, float] = (0.05, 0.12)  # to the head, where it begins and by which it goes beyond it
    growth: float = 0.02  # of what goes


LIMITS = LooseLimits()


def gap_of(frame: Frame, shape: F64, head: FoundHead) -> Gap:
    """What a head leaves that was found about a face (81, 2), with what hangs loose beside it."""
    gap = Gap.of(head)
    width, centre = float(np.ptp(shape[:, 0])), (shape.min(0) + shape.max(0)) / 2
    aside, up, down = (width * reach for reach in LIMITS.reach)
    roi = frame.align_roi(centre[0] - aside, centre[1] - up, centre[0] + aside, centre[1] + down)
    scale = min(1.0, LIMITS.face_pixels / max(width, 1.0))
    size = max(2, round(roi[2] * scale)), max(2, round(roi[3] * scale))
    if min(roi[2:]) < 2:
        return gap
    away, body = (
        np.asarray(cv2.resize(share, size, interpolation=cv2.INTER_AREA) > 0.05)
        for share in (gap.share(roi), gap.body_share(roi))
    )
    picture = cv2.resize(frame.rgb_roi(*roi), size, interpolation=cv2.INTER_AREA).astype(np.float32)
    beside = ~(away | body) & (np.arange(size[1])[:, None] < (centre[1] - roi[1]) * scale)
    plain = _plain(picture, ~away, beside, width * scale)
    if plain is None:
        return gap
    skin = head.in_picture(head.head, roi)
    neck = np.asarray(cv2.resize(skin, size, interpolation=cv2.INTER_AREA) > 0.5) & ~away
    odd = ~(away | plain)
    body = _wide(odd, LIMITS.thin * width * scale)
    loose = _loose(odd & ~_near(body | neck, LIMITS.off_body * width * scale), away, width * scale)
    return gap.with_parts(loose, body, np.array(roi[:2], np.float64), scale) if loose.any() else gap


def _plain(picture: F32, free: Bool, beside: Bool, width: float) -> Bool | None:
    """(h, w) where a picture (h, w, 3) shows the plain background of a head; None if it has a pattern.

    free, beside : (h, w) what is no head, and what is background for certain.   width : of the face, pixels.
    """
    y, x = (np.mgrid[: len(free), : free.shape[1]] / width).astype(np.float32)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1)
    plain = beside
    for _ in range(LIMITS.rounds):
        if plain.sum() < LIMITS.min_pixels:
            return None
        factors = np.linalg.lstsq(terms[plain], picture[plain], rcond=None)[0]
        distance = np.abs(picture - terms @ factors).max(2)
        times, least, most = LIMITS.differs
        limit = max(times * float(np.sqrt((distance[plain] ** 2).mean())), least)
        plain = free & (distance < limit)
    return plain if limit <= most and plain[beside].mean() >= LIMITS.plain_share else None


def _wide(part: Bool, pixels: float) -> Bool:
    """Where a part (h, w) is wider than twice so many pixels."""
    side = 2 * max(1, round(pixels)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.morphologyEx(part.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0)


def _loose(thin: Bool, away: Bool, width: float) -> Bool:
    """(h, w) what of thin things (h, w) begins at a head (h, w) and is more than its edge."""
    near, far = (_near(away, share * width) for share in LIMITS.near)
    _, labels = cv2.connectedComponents(thin.astype(np.uint8))
    hanging = np.setdiff1d(np.intersect1d(labels[near], labels[~far]), [0])
    return np.asarray(_near(np.isin(labels, hanging), LIMITS.growth * width))


def _near(part: Bool, pixels: float) -> Bool:
    side = 2 * max(1, round(pixels)) + 1
    return np.asarray(cv2.dilate(part.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
