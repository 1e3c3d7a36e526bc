"""Pictures as they come, and as they are computed with: float32 RGB in 0 .. 1."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from guise.common.arrays import F32, F64
from guise.common.errors import GuiseError

Picture = NDArray[Any]

POINTS = 81
LUMINANCE = np.array([0.299, 0.587, 0.114], np.float32)  # Y of YUV


class PhotoError(GuiseError):
    """A picture or points that cannot be used; one sentence."""


def unit(picture: Picture, name: str) -> F32:
    """(h, w, 3) float32 in 0 .. 1 of a picture (h, w) or (h, w, 3), uint8, uint16 or float in 0 .. 1."""
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


def like(made: F32, picture: Picture) -> Picture:
    """Values (h, w, 3) in 0 .. 1 with the type and channels of a picture (h, w) or (h, w, 3)."""
    values = made @ LUMINANCE if picture.ndim == 2 else made
    if picture.dtype.kind == "f":
        return np.asarray(values, picture.dtype)
    return np.asarray(np.rint(values * np.float32(np.iinfo(picture.dtype).max)), picture.dtype)


def checked_points(points: ArrayLike, name: str) -> F64:
    """Points (81, 2) float64, pixels."""
    places = np.asarray(points, np.float64)
    if places.shape != (POINTS, 2):
        raise PhotoError(f"{name} must be ({POINTS}, 2) landmarks of scheme face81, got {places.shape}")
    if not np.isfinite(places).all():
        raise PhotoError(f"{name} must be finite; give the missing ones by hand")
    return places


def shrunk(picture: F32, points: F64, factor: float) -> tuple[F32, F64]:
    """A picture and its points, made smaller by a factor below 1 without aliasing."""
    if factor >= 1:
        return picture, points
    size = np.maximum(np.rint(np.array(picture.shape[1::-1]) * factor), 1).astype(int)
    exact = size / np.array(picture.shape[1::-1])
    small = cv2.resize(picture, (int(size[0]), int(size[1])), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32), (points + 0.5) * exact - 0.5


def sampled(picture: F32, places: F32) -> F32:
    """Bicubic samples of a picture (h, w) or (h, w, 3) at places (m, n, 2), its border repeated; in 0 .. 1."""
    made = cv2.remap(
        picture, np.ascontiguousarray(places), None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )  # type: ignore[call-overload]
    return np.asarray(np.clip(made, 0, 1), np.float32)
