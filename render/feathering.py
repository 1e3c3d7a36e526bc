"""Gaussian-feathered alpha of a mask."""

import math

import cv2
import numpy as np

from guise.common.arrays import F32, Bool
from guise.render.errors import RendererError

_RADIUS_SIGMAS = 2.5


def feather(mask: Bool, sigma: float) -> F32:
    """Alpha that is 1 deep inside the mask and falls as a Gaussian edge to exactly 0 outside it.

    The mask is eroded by a square of radius r = ceil(2.5 sigma), then blurred by a Gaussian whose kernel
    ends at the same r. No kernel centred outside the mask can reach the eroded mask, so alpha is exactly 0
    there; every kernel centred 2r or more inside sees only the eroded mask, so alpha is exactly 1 there.
    Beyond the picture counts as outside.

    Parameters
    ----------
    mask : (h, w) bool.
    sigma : standard deviation of the edge in pixels, >= 0; 0 gives the hard mask.

    Returns
    -------
    (h, w) float32 in [0, 1].

    Raises
    ------
    RendererError
        When the mask is not (h, w) bool, sigma is negative, or a mask is too thin to hold the edge.

    Examples
    --------
    >>> mask = np.zeros((21, 21), bool)
    >>> mask[2:19, 2:19] = True
    >>> alpha = feather(mask, 1.5)
    >>> float(alpha[10, 10]), float(alpha[~mask].max())
    (1.0, 0.0)
    """
    _check(mask, sigma)
    solid = mask.astype(np.float32)
    radius = math.ceil(_RADIUS_SIGMAS * sigma)
    if radius == 0:
        return solid
    core = _erode(solid, radius)
    if mask.any() and not core.any():
        raise RendererError(f"the mask is too thin for a feather of sigma {sigma:g} px: give a smaller sigma")
    size = (2 * radius + 1, 2 * radius + 1)
    alpha = cv2.GaussianBlur(core, size, sigma, borderType=cv2.BORDER_CONSTANT)
    alpha[_erode(core, radius) > 0] = 1.0  # the kernel sums to 1 only up to rounding
    return np.clip(alpha, 0.0, 1.0).astype(np.float32, copy=False)


def _check(mask: Bool, sigma: float) -> None:
    if mask.ndim != 2 or mask.dtype != np.bool_:
        raise RendererError(f"mask must be (h, w) bool, got {mask.shape} {mask.dtype}")
    if not (math.isfinite(sigma) and sigma >= 0):
        raise RendererError(f"sigma must be a number of pixels >= 0, got {sigma!r}")


def _erode(solid: F32, radius: int) -> F32:
    square = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    eroded = cv2.erode(solid, square, borderType=cv2.BORDER_CONSTANT, borderValue=(0,))
    return np.asarray(eroded, np.float32)
