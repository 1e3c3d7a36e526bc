"""Conversion of pictures to and from float32 RGB in 0 .. 1, and sampling."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from guise.aam.landmarks.schemes import COUNT
from guise.common.arrays import F32, F64
from guise.common.errors import GuiseError

Picture = NDArray[Any]

LUMINANCE = np.array([0.299, 0.587, 0.114], np.float32)  # Y of YUV


class PhotoError(GuiseError):
    """A picture or landmarks that cannot be used; one sentence."""


def as_float_rgb(picture: Picture, name: str) -> F32:
    """A picture (h, w) or (h, w, 3), uint8, uint16 or float in 0 .. 1, as float32 (h, w, 3) in 0 .. 1."""
    pixels = np.asarray(picture)
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] != 3) or min(pixels.shape) < 1:
        raise PhotoError(f"{name} must be (h, w) or (h, w, 3), got {pixels.shape}")
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    if pixels.dtype in (np.uint8, np.uint16):
        return np.asarray(pixels * np.float32(1 / np.iinfo(pixels.dtype).max))
    if pixels.dtype.kind != "f":
        raise PhotoError(f"{name} must be uint8, uint16 or float in 0 to 1, got {pixels.dtype}")
    if not (np.abs(pixels - 0.5) <= 0.5).all():  # false for nan too
        raise PhotoError(f"{name} holds values outside 0 to 1")
    return np.ascontiguousarray(pixels, np.float32)


def as_type_of(made: F32, picture: Picture) -> Picture:
    """Values (h, w, 3) in 0 .. 1 converted to the type and channels of a picture (h, w) or (h, w, 3)."""
    values = made @ LUMINANCE if picture.ndim == 2 else made
    if picture.dtype.kind == "f":
        return np.asarray(values, picture.dtype)
    most = float(np.iinfo(picture.dtype).max)
    depth = cv2.CV_8U if picture.dtype == np.uint8 else cv2.CV_16U
    return np.asarray(cv2.addWeighted(values, most, values, 0, 0, dtype=depth), picture.dtype)


def check_landmarks(points: ArrayLike, name: str) -> F64:
    """Points (81, 2) float64, pixels."""
    places = np.asarray(points, np.float64)
    if places.shape != (COUNT, 2):
        raise PhotoError(f"{name} must be ({COUNT}, 2) landmarks of scheme face81, got {places.shape}")
    if not np.isfinite(places).all():
        raise PhotoError(f"{name} must be finite: correct the missing ones by hand")
    return places


def downscale(picture: F32, points: F64, factor: float) -> tuple[F32, F64]:
    """A picture and its points, downscaled without aliasing; unchanged for a factor of 1 or more."""
    if factor >= 1:
        return picture, points
    size = np.maximum(np.rint(np.array(picture.shape[1::-1]) * factor), 1).astype(int)
    exact = size / np.array(picture.shape[1::-1])
    small = cv2.resize(picture, (int(size[0]), int(size[1])), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32), (points + 0.5) * exact - 0.5


def sample_bicubic(picture: F32, places: F32) -> F32:
    """Bicubic samples of a picture (h, w) or (h, w, 3) at positions (m, n, 2), clipped to 0 .. 1."""
    made = cv2.remap(
        picture, np.ascontiguousarray(places), None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )  # type: ignore[call-overload]
    return np.asarray(np.clip(made, 0, 1), np.float32)
