"""Residual motion from S to S' that landmarks miss: dense optical flow between the two, warped onto each other.

Skin slides and brows bend between landmarks.  If such motion were taken for a change of light, its edges would appear
twice in T'.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.common.arrays import F32, U8, Bool


@dataclass(frozen=True)
class FlowSettings:
    """Settings of the residual flow; faces are face widths."""

    max_length_faces: float = 0.03
    field_sigma_faces: float = 0.01
    contrast_sigma_faces: float = 0.02  # of the neighbourhoods whose contrast is equalised
    min_contrast: float = 0.05  # log luminance, below which contrast is not raised
    full_confidence_gain: float = 0.7  # share of the squared difference that must vanish for full confidence


FLOW = FlowSettings()


def residual_flow(after: F32, before: F32, region: Bool, width: float) -> F32:
    """(h, w, 2) pixels: flow from each pixel of `after` to the same point in `before`.

    after, before : (h, w) log luminance of S' and S on the grid of T'.
    region : (h, w), where flow is estimated.   width : of the face, pixels.
    """
    one, two = _equalise_contrast(after, width), _equalise_contrast(before, width)
    engine = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    found = np.asarray(
        engine.calc(_to_uint8(one), _to_uint8(two), np.zeros((*one.shape, 2), np.float32)), np.float32
    )
    limit = np.float32(FLOW.max_length_faces * width)
    found *= np.minimum(1, limit / np.maximum(np.linalg.norm(found, axis=2), 1e-6))[:, :, None]
    trust = _flow_confidence(one, two, found, width) * region
    sigma = FLOW.field_sigma_faces * width
    total = cv2.GaussianBlur(trust, (0, 0), sigma)
    field = cv2.GaussianBlur(found * trust[:, :, None], (0, 0), sigma)
    return np.asarray(
        field / (total + 0.05)[:, :, None] * cv2.blur(region.astype(np.float32), (5, 5))[:, :, None]
    )


def sample_field(field: F32, places: F32) -> F32:
    """Bilinear samples (h, w, d) of a field at positions (h, w, 2)."""
    return np.asarray(
        cv2.remap(
            np.ascontiguousarray(field), places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        ),  # type: ignore[call-overload]
        np.float32,
    )


def _equalise_contrast(field: F32, width: float) -> F32:
    """A field (h, w) without its local mean, of equalised contrast."""
    sigma = FLOW.contrast_sigma_faces * width
    detail = field - cv2.GaussianBlur(field, (0, 0), sigma)
    spread = np.sqrt(cv2.GaussianBlur(detail * detail, (0, 0), 2 * sigma) + FLOW.min_contrast**2)
    return np.asarray(detail / spread, np.float32)


def _to_uint8(field: F32) -> U8:
    return np.asarray(np.clip(field * 40 + 128, 0, 255), np.uint8)


def _flow_confidence(one: F32, two: F32, found: F32, width: float) -> F32:
    """(h, w) 0 to 1: how much of the difference the flow explains."""
    height, across = one.shape
    x, y = np.meshgrid(np.arange(across, dtype=np.float32), np.arange(height, dtype=np.float32))
    moved = sample_field(two, np.stack([x, y], axis=2) + found)
    sigma = FLOW.contrast_sigma_faces * width
    before = cv2.GaussianBlur((one - two) ** 2, (0, 0), sigma)
    after = cv2.GaussianBlur((one - moved) ** 2, (0, 0), sigma)
    return np.asarray(np.clip((1 - after / (before + 1e-3)) / FLOW.full_confidence_gain, 0, 1), np.float32)
