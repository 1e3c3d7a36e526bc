"""What about a clip will weaken a swap with the person, one sentence each, with what to do about it.

Seen in the landmarks of all frames and in the frame at rest that a model keeps.  Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import LEFT_EYE, LOWER_LIP_INNER, NOSE_TIP, RIGHT_EYE, UPPER_LIP_INNER
from guise.aam.model import Identity, RestFrame
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.common.arrays import F32, F64


@dataclass(frozen=True)
class QualityLimits:
    """Beyond which a clip is not as it should be.  Gaps of the lips are in inter-ocular distances."""

    max_shut_gap: float = 0.04  # of the lips in the frames in which they are nearest
    min_open_gap: float = 0.07  # in those in which they are farthest apart
    min_width_share: float = 0.7  # of the face's width in the clip, of the model's resolution
    min_grey_level: float = 55.0  # of skin
    max_side_ratio: float = 1.9  # of the brightness of the brighter half of the skin to the other
    max_turn_share: float = 0.17  # of the nose's tip from the middle of the face, of its width
    min_glasses_share: float = 0.015  # about either eye
    min_glasses_pixels: float = 80.0  # of a face's width, below which glasses cannot be told


LIMITS = QualityLimits()
EXTREME_PERCENT = 3  # of frames, that count as the extremes
# (n, 2) places about the middle of an eye, in inter-ocular distances.
_AROUND_EYE = np.stack(
    np.meshgrid(np.linspace(-0.3, 0.3, 16), np.linspace(-0.22, 0.22, 12)), axis=-1
).reshape(-1, 2)


def weaknesses(points: NDArray[np.floating], identity: Identity) -> list[str]:
    """The sentences, worst first as far as that is known.

    points : (n, 81, 2) of the frames of the clips, NaN without a face.
    """
    seen = points[np.isfinite(points).all((1, 2))].astype(np.float64)
    return [*_of_light(identity.rest_frame), *_of_shapes(seen, identity.reference.resolution)]


def _of_shapes(seen: F64, resolution: int) -> list[str]:
    gaps = np.linalg.norm(seen[:, LOWER_LIP_INNER] - seen[:, UPPER_LIP_INNER], axis=1) / interocular(seen)
    shut, wide = np.percentile(gaps, [EXTREME_PERCENT, 100 - EXTREME_PERCENT])
    width = float(np.median(np.ptp(seen[..., 0], axis=1)))
    turn = np.median(_turns(seen))
    told = []
    if shut > LIMITS.max_shut_gap:
        told.append(
            "the mouth is never shut, so the face at rest is guessed: rest for a second with the mouth shut"
        )
    if wide < LIMITS.min_open_gap:
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
    if _wears_glasses(parsing, rest.shape):
        told.append("the person wears glasses, which leave traces in the face: take them off")
    if max(halves) < LIMITS.min_grey_level:
        told.append("the face is dark: turn towards a window or a lamp")
    elif max(halves) > LIMITS.max_side_ratio * max(min(halves), 1.0):
        told.append("the light comes from one side: turn towards it")
    return told


def _wears_glasses(parsing: FaceParsing, shape: F64) -> bool:
    """Whether there are glasses about both eyes of a face (81, 2); hair and earrings are on one side or elsewhere."""
    if np.ptp(shape[:, 0]) < LIMITS.min_glasses_pixels:
        return False
    around = _AROUND_EYE * float(interocular(shape))
    shares = [
        parsing.at(shape[eye].mean(0) + around, parsing.share(FaceClass.GLASSES)).mean()
        for eye in (RIGHT_EYE, LEFT_EYE)
    ]
    return float(min(shares)) > LIMITS.min_glasses_share


def _mean(values: NDArray[Any], weights: F32) -> float:
    return float((values * weights).sum() / max(float(weights.sum()), 1e-6))
