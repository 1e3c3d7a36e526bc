"""What about a clip will weaken a swap with the person, one sentence each, with what to do about it.

Seen in the landmarks of all frames and in the frame at rest that a model keeps.  Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import openness
from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import (
    BROWS,
    EYES,
    INNER51,
    LEFT_BROW,
    LOWER_LIP_INNER,
    NOSE_TIP,
    RIGHT_BROW,
    UPPER_LIP_INNER,
)
from guise.aam.model import Identity, RestFrame
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.aam.without_glasses import wears_glasses
from guise.common.arrays import F32, F64


@dataclass(frozen=True)
class ClipQualityLimits:
    """Beyond which a clip is not as it should be.  Gaps of the lips are in inter-ocular distances."""

    max_shut_gap: float = 0.04  # of the lips in the frames in which they are nearest
    min_open_gap: float = 0.07  # in those in which they are farthest apart
    min_width_share: float = 0.7  # of the face's width in the clip, of the model's resolution
    min_grey_level: float = 55.0  # of skin
    min_sharpness: float = 0.48  # of the face, see `sharpness`
    max_side_ratio: float = 1.9  # of the brightness of the brighter half of the skin to the other
    max_turn_share: float = 0.17  # of the nose's tip from the middle of the face, of its width
    min_fringe_share: float = 0.4  # of hair on and above both brows
    fringe_reach: float = 0.12  # above the brows, inter-ocular distances
    min_rest_frames: int = 5  # in a row: mouth shut, eyes open, still
    min_rest_lids: float = 0.75  # of the usual opening of the lids
    max_rest_motion: float = 0.012  # of the points from frame to frame, inter-ocular distances
    least_frames: int = 30  # of a clip of which it is told; photos are never in a row


LIMITS = ClipQualityLimits()
EXTREME_PERCENT = 3  # of frames, that count as the extremes
SHARP_WIDTH = 140  # pixels of a face's width, from which it may be sharp
SHARP_BANDS = (1.0, 2.5)  # standard deviations, pixels of a face 160 pixels wide
USUAL_LIDS = 0.7  # quantile of the opening of the lids that is usual


def weaknesses(points: NDArray[np.floating], identity: Identity) -> list[str]:
    """The sentences, worst first as far as that is known.

    points : (n, 81, 2) of the frames of the clips, NaN without a face.
    """
    seen = points[np.isfinite(points).all((1, 2))].astype(np.float64)
    return [*_of_light(identity.rest_frame), *_of_shapes(seen, identity.reference.resolution)]


def sharpness(rest: RestFrame) -> float:
    """Root mean square of the finest structure of a face, over that of what is a little coarser."""
    scale = 160 / float(np.ptp(rest.shape[:, 0]))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    grey = cv2.cvtColor(rest.picture, cv2.COLOR_RGB2GRAY)
    luma = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=how).astype(np.float32)
    face = np.zeros(luma.shape, np.uint8)
    cv2.fillConvexPoly(face, cv2.convexHull(np.round(scale * rest.shape).astype(np.int32)), 1)
    near, far = (cv2.GaussianBlur(luma, (0, 0), sigma) for sigma in SHARP_BANDS)
    fine, coarse = (float((band[face > 0] ** 2).mean()) for band in (luma - near, near - far))
    return float(np.sqrt(fine / max(coarse, 1e-6)))


def longest_rest(seen: F64) -> int:
    """The largest number of frames in a row in which a face (n, 81, 2) is at rest."""
    motion = (
        np.diff(seen - seen[:, INNER51].mean(1, keepdims=True), axis=0)[:, INNER51]
        / interocular(seen)[1:, None, None]
    )
    lids = openness(seen)[:, 1]
    at_rest = (lip_gaps(seen) < LIMITS.max_shut_gap) & (
        lids > LIMITS.min_rest_lids * np.quantile(lids, USUAL_LIDS)
    )
    at_rest[1:] &= np.linalg.norm(motion, axis=2).mean(1) < LIMITS.max_rest_motion
    ends = np.flatnonzero(np.diff(np.concatenate([[0], at_rest.astype(int), [0]])))
    return int((ends[1::2] - ends[::2]).max(initial=0))


def lip_gaps(seen: F64) -> F64:
    """(n,) how far the lips of faces (n, 81, 2) are apart, inter-ocular distances."""
    gaps = np.linalg.norm(seen[:, LOWER_LIP_INNER] - seen[:, UPPER_LIP_INNER], axis=1)
    return np.asarray(gaps / interocular(seen))


def _of_shapes(seen: F64, resolution: int) -> list[str]:
    shut, wide = np.percentile(lip_gaps(seen), [EXTREME_PERCENT, 100 - EXTREME_PERCENT])
    width = float(np.median(np.ptp(seen[..., 0], axis=1)))
    turn = np.median(_turns(seen))
    told = []
    if shut > LIMITS.max_shut_gap:
        told.append(
            "the mouth is never shut, so the face at rest is guessed: rest for a second with the mouth shut"
        )
    elif len(seen) >= LIMITS.least_frames and longest_rest(seen) < LIMITS.min_rest_frames:
        told.append(
            "the face is never at rest, so what it looks like then is guessed: look into the camera for a second, the "
            "mouth shut"
        )
    if len(seen) >= LIMITS.least_frames and wide < LIMITS.min_open_gap:
        told.append("the mouth never opens, so what is behind the lips is guessed: say a few sentences")
    if width < LIMITS.min_width_share * resolution:
        told.append(f"the face is only {width:.0f} pixels wide and will look soft: come closer to the camera")
    if abs(turn) > LIMITS.max_turn_share:
        told.append("the face is turned aside most of the time: look into the camera for some seconds")
    return told


def _turns(seen: F64) -> F64:
    """(n,) how far the nose's tip is from the middle of the face, in its widths; positive to the right."""
    low, high = seen[..., 0].min(1), seen[..., 0].max(1)
    return np.asarray((seen[:, NOSE_TIP, 0] - (low + high) / 2) / np.maximum(high - low, 1e-6))


def _of_light(rest: RestFrame) -> list[str]:
    """What the frame at rest shows of light and glasses."""
    parsing = FaceParser().parse(rest.picture, rest.shape)
    skin = parsing.share(FaceClass.SKIN)
    size = skin.shape[1], skin.shape[0]
    inverse = cv2.invertAffineTransform(parsing.to_picture)
    luma = cv2.warpAffine(cv2.cvtColor(rest.picture, cv2.COLOR_RGB2GRAY), inverse, size, flags=cv2.INTER_AREA)
    halves = [_mean(luma[:, half], skin[:, half]) for half in (np.s_[: size[0] // 2], np.s_[size[0] // 2 :])]
    told = []
    if np.ptp(rest.shape[:, 0]) >= SHARP_WIDTH and sharpness(rest) < LIMITS.min_sharpness:
        told.append("the picture of the face is soft: film in focus, in more light, without a filter")
    if wears_glasses(parsing, rest.shape):
        told.append(
            "the person wears glasses, of which traces stay in the face: take them off, or swap with --glasses keep"
        )
    if _has_fringe(parsing, rest.shape):
        told.append("hair hangs over the brows, which then cannot be shown moving: pin it back")
    if max(halves) < LIMITS.min_grey_level:
        told.append("the face is dark: turn towards a window or a lamp")
    elif max(halves) > LIMITS.max_side_ratio * max(min(halves), 1.0):
        told.append("the light comes from one side: turn towards it")
    return told


def _has_fringe(parsing: FaceParsing, shape: F64) -> bool:
    """Whether hair covers both brows of a face (81, 2)."""
    up = shape[BROWS].mean(0) - shape[EYES].mean(0)
    up *= LIMITS.fringe_reach * float(interocular(shape)) / max(float(np.linalg.norm(up)), 1e-6)
    hair = parsing.share(FaceClass.HAIR)
    shares = [
        parsing.at(np.concatenate([shape[brow], shape[brow] + up]), hair).mean()
        for brow in (RIGHT_BROW, LEFT_BROW)
    ]
    return float(min(shares)) > LIMITS.min_fringe_share


def _mean(values: NDArray[Any], weights: F32) -> float:
    return float((values * weights).sum() / max(float(weights.sum()), 1e-6))
