"""The half-pixel shift between this project's pixels and GL: here and nowhere else.

Everywhere else a pixel's centre lies at integer coordinates, x right, y down. GL puts it at integer + 1/2.
Row 0 of an image is row 0 of a GL texture and of a framebuffer, so that y needs no flip on the way in or
out.
"""

import numpy as np

from guise.common.arrays import F32, Floating


def to_clip_space(vertices: Floating, width: int, height: int) -> F32:
    """Positions for `gl_Position` when the viewport is width x height pixels.

    Parameters
    ----------
    vertices : (v, 2) float, pixels.

    Returns
    -------
    (v, 2) float32; -1 and 1 are the outer edges of the viewport's first and last pixels.

    Examples
    --------
    >>> to_clip_space(np.array([[-0.5, 3.5]]), 4, 4).tolist()
    [[-1.0, 1.0]]
    """
    return ((vertices + 0.5) * (2.0 / width, 2.0 / height) - 1.0).astype(np.float32)


def to_texture_space(uv: Floating, width: int, height: int) -> F32:
    """Coordinates for a normalised sampler of a texture of width x height texels.

    Parameters
    ----------
    uv : (v, 2) float, texture pixels.

    Returns
    -------
    (v, 2) float32; 0 and 1 are the outer edges of the first and last texels.

    Examples
    --------
    >>> to_texture_space(np.array([[1.5, 3.5]]), 4, 4).tolist()
    [[0.5, 1.0]]
    """
    return ((uv + 0.5) / (width, height)).astype(np.float32)
