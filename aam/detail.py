"""Fine detail of a face at rest, from frames that dense optical flow brings into register before they are averaged.

Landmarks miss by a per cent or so of the face's width, so an average over them loses moles, lashes and pores.  Flow
(Kroeger, Timofte, Dai and Van Gool, Fast Optical Flow using Dense Inverse Search, ECCV 2016) from the average to each
frame finds what they miss.  Works on the fine grid: the reference frame's at twice its resolution.  RGB 0..255.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import INNER_LIPS
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.sampling import remap_points

FINE = 2  # pixels of the fine grid per grid pixel, along each axis


@dataclass(frozen=True)
class DetailLimits:
    """Sizes and thresholds of the registration and of what counts as detail."""

    rounds: int = 2  # of registration to the average
    max_frames: int = 6  # the sharpest, averaged
    band_face_widths: float = 0.03  # standard deviation, beyond which a difference is light, not detail
    max_change: float = (
        0.15  # of brightness beyond that band, by which what is seen is hardly the face any more
    )
    feature_face_widths: float = 0.006  # standard deviation, below which flow doesn't look
    contrast_face_widths: float = 0.1  # standard deviation, over which contrast is evened out for the flow
    flow_face_widths: float = 0.01  # standard deviation by which the flow is smoothed
    max_flow_face_widths: float = 0.04
    noise_grey_levels: float = 2.5  # added to local contrast
    rim_face_widths: tuple[float, float] = (
        0.04,
        0.12,
    )  # inside the face, from where on there is detail, and all of it


LIMITS = DetailLimits()


class FineGrid:
    """Samples the luma of pictures on the fine grid of a reference frame."""

    def __init__(self, reference: ReferenceFrame) -> None:
        h, w = reference.size
        ys, xs = np.mgrid[: FINE * h, : FINE * w]
        places = (np.column_stack([xs.ravel(), ys.ravel()]) + 0.5) / FINE - 0.5
        self._reference, self._sampler = reference, MeshSampler.build(reference, places)

    def __call__(self, rgb: U8, shape: F64) -> F32:
        """Luma (2 h, 2 w) of a picture (h', w', 3) under a shape (81, 2) in its pixels; reduced by area if larger."""
        scale = self._reference.to_shape(shape).scale / FINE
        luma = (rgb @ LUMA).astype(np.float32)
        if scale > 1.25:
            small = (max(2, round(luma.shape[1] / scale)), max(2, round(luma.shape[0] / scale)))
            factor = np.array(small) / luma.shape[::-1]
            luma = np.asarray(cv2.resize(luma, small, interpolation=cv2.INTER_AREA), np.float32)
            shape = (shape + 0.5) * factor - 0.5
        h, w = self._reference.size
        return remap_points(luma, self._sampler.positions(shape)).reshape(FINE * h, FINE * w)


def with_detail(
    texture: F32, frames: Sequence[F32], mask: Bool, reference: ReferenceFrame
) -> tuple[F32, F32]:
    """A neutral texture (n, 3) as sharp as the frames are, and the luma (2 h, 2 w) that its grid is too coarse for.

    Parameters
    ----------
    frames : luma (2 h, 2 w) of frames at rest, see `FineGrid`.
    mask : (h, w) bool, face: beyond it, and inside the lips, nothing is added.
    """
    h, w = reference.size
    sigma = FINE * LIMITS.band_face_widths * reference.resolution
    base = _enlarged(reference.scatter(texture @ LUMA), reference)
    mean = registered_mean(base, _sharpest(frames, mask, sigma), reference.resolution * FINE)
    difference = mean - base
    known = _enlarged(reference.mask.astype(np.float32), reference)
    light = _blurred(difference * known, sigma) / np.maximum(_blurred(known, sigma), 1e-3)
    shown = _inside(mask, reference) * (1 - soft_parts(reference, (INNER_LIPS,), 0.0))
    alike = np.exp(-((light / (LIMITS.max_change * np.maximum(base, 1) + LIMITS.noise_grey_levels)) ** 2))
    fine = np.asarray((difference - light) * alike * _enlarged(shown, reference), np.float32)
    coarse = np.asarray(cv2.resize(fine, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    detail = fine - _enlarged(coarse, reference)
    return np.asarray(texture + coarse[reference.mask][:, None], np.float32), np.asarray(detail, np.float32)


def registered_mean(template: F32, frames: Sequence[F32], face_pixels: float) -> F32:
    """The mean of luma pictures (h, w), each warped onto the template (h, w), then onto the mean so far.

    face_pixels : across the face.
    """
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    looks = [_evened(frame, face_pixels) for frame in frames]
    places = np.stack(np.meshgrid(*map(np.arange, template.shape[::-1])), axis=2).astype(np.float32)
    mean = template
    for _ in range(LIMITS.rounds):
        target = _evened(mean, face_pixels)
        warped = []
        for frame, look in zip(frames, looks, strict=True):
            away = _blurred(
                np.asarray(flow.calc(target, look, None), np.float32),  # type: ignore[call-overload]
                LIMITS.flow_face_widths * face_pixels,
            )
            limit = LIMITS.max_flow_face_widths * face_pixels
            place = places + np.clip(away, -limit, limit)
            warped.append(cv2.remap(frame, place, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))  # type: ignore[call-overload]
        mean = np.asarray(np.mean(warped, axis=0), np.float32)
    return mean


def _inside(mask: Bool, reference: ReferenceFrame) -> F32:
    """Share (h, w) of detail that counts: at the rim of a mask (h, w) flow takes the background for the face."""
    away = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    first, last = np.multiply(LIMITS.rim_face_widths, reference.resolution)
    return np.asarray(np.clip((away - first) / (last - first), 0, 1), np.float32)


def _sharpest(frames: Sequence[F32], mask: Bool, sigma: float) -> list[F32]:
    """The frames with the most energy in the band of detail, at most `max_frames`, in their order."""
    face = cv2.resize(mask.astype(np.uint8), frames[0].shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    energy = [float(np.std((f - _blurred(f, sigma / 4))[face]) / max(f[face].mean(), 1)) for f in frames]
    return [frames[i] for i in sorted(np.argsort(energy)[::-1][: LIMITS.max_frames])]


def _evened(luma: F32, face_pixels: float) -> U8:
    """Luma without light and local contrast, for flow to follow features."""
    fine = _blurred(luma, LIMITS.feature_face_widths * face_pixels)
    fine -= _blurred(fine, LIMITS.contrast_face_widths * face_pixels)
    contrast = np.sqrt(_blurred(fine * fine, LIMITS.contrast_face_widths * face_pixels))
    return np.asarray(np.clip(40 * fine / (contrast + LIMITS.noise_grey_levels) + 128, 0, 255), np.uint8)


def _enlarged(picture: F32, reference: ReferenceFrame) -> F32:
    h, w = reference.size
    return np.asarray(cv2.resize(picture, (FINE * w, FINE * h), interpolation=cv2.INTER_LINEAR), np.float32)


def _blurred(picture: F32, sigma: float) -> F32:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.float32)
