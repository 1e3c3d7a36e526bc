"""Memory and checks that both compositors share."""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import DTypeLike, NDArray

from guise.common.arrays import F32, U8
from guise.render.errors import RendererError
from guise.render.mesh import TexturedMesh

Texture = U8 | F32
Alpha = U8 | F32  # of 255, or of 1


class Scratch:
    """An array whose size changes a little from frame to frame, without an allocation for each."""

    def __init__(self, dtype: DTypeLike) -> None:
        self._memory: NDArray[Any] = np.empty(0, dtype)

    def view(self, *shape: int) -> NDArray[Any]:
        """A C-contiguous array of this shape with arbitrary values."""
        size = math.prod(shape)
        if size > self._memory.size:
            self._memory = np.empty(size + size // 4, self._memory.dtype)
        return self._memory[:size].reshape(shape)


class Texels:
    """The synthesised texture with its alpha as (th, tw, 4) uint8, which both compositors sample.

    One picture holds colour and alpha so that one look-up gives both, and so that both compositors start
    from the same eight bits.
    """

    def __init__(self, mesh: TexturedMesh, alpha: Alpha) -> None:
        self._shape = (mesh.height, mesh.width)
        self.rgba: U8 = np.zeros((*self._shape, 4), np.uint8)
        self._rounded: U8 = np.empty((*self._shape, 3), np.uint8)
        self._zeros: F32 = np.zeros((*self._shape, 3), np.float32)
        self.set_alpha(alpha)

    def set_alpha(self, alpha: Alpha) -> None:
        """Use another (th, tw) alpha, float in [0, 1] or uint8."""
        check_alpha(alpha)
        if alpha.shape != self._shape:
            raise RendererError(f"alpha must be {self._shape}, got {alpha.shape}")
        scale = 1.0 if alpha.dtype == np.uint8 else 255.0
        self.alpha = np.asarray(cv2.convertScaleAbs(alpha, alpha=scale), np.uint8)  # rounded to nearest

    def rounded(self, texture: Texture) -> U8:
        """A (th, tw, 3) uint8 or float32 texture in 0..255 as bytes, rounded to nearest."""
        if texture.shape != (*self._shape, 3):
            raise RendererError(f"texture must be {(*self._shape, 3)}, got {texture.shape}")
        if texture.dtype == np.float32:
            # adding zeros is the cheapest conversion that both rounds and saturates
            cv2.add(np.asarray(texture, np.float32), self._zeros, dst=self._rounded, dtype=cv2.CV_8U)
            return self._rounded
        if texture.dtype != np.uint8:
            raise RendererError(f"texture must be uint8 or float32, got {texture.dtype}")
        return np.ascontiguousarray(texture)

    def load(self, texture: Texture) -> U8:
        """Load such a texture with the alpha; returns the RGBA picture."""
        cv2.cvtColor(self.rounded(texture), cv2.COLOR_RGB2RGBA, dst=self.rgba)
        cv2.insertChannel(self.alpha, self.rgba, 3)  # both together take half the time of mixChannels
        return self.rgba


def check_alpha(alpha: Alpha) -> None:
    """Raise RendererError unless alpha is (th, tw) float in [0, 1] or uint8."""
    if alpha.ndim != 2 or (alpha.dtype.kind != "f" and alpha.dtype != np.uint8) or alpha.size == 0:
        raise RendererError(f"alpha must be (th, tw) float or uint8, got {alpha.shape} {alpha.dtype}")
    if alpha.dtype == np.uint8:
        return
    if not (np.minimum.reduce(alpha, None) >= 0 and np.maximum.reduce(alpha, None) <= 1):  # true for nan too
        raise RendererError("alpha must lie in [0, 1]")


def check_opacity(opacity: float) -> float:
    """The opacity, or RendererError unless it lies in [0, 1]."""
    if not 0.0 <= opacity <= 1.0:
        raise RendererError(f"opacity must lie in [0, 1], got {opacity}")
    return float(opacity)


def output_for(roi: U8, out: U8 | None) -> U8:
    """`out` holding the rectangle's pixels: a copy of roi when None, roi itself when it is given as out."""
    _check_image("roi", roi)
    if out is None:
        return roi.copy()
    if out is roi:
        return out
    _check_image("out", out)
    if out.shape != roi.shape:
        raise RendererError(f"out must be {roi.shape} like roi, got {out.shape}")
    np.copyto(out, roi)
    return out


def _check_image(name: str, image: U8) -> None:
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or image.size == 0:
        raise RendererError(f"{name} must be (h, w, 3) uint8, got {image.shape} {image.dtype}")
    if image.strides[1:] != (3, 1):
        raise RendererError(f"{name} must hold a row's pixels side by side, got strides {image.strides}")
