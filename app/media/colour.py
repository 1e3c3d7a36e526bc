"""Conversion between a frame's stored components and RGB.

Components are Y, U, V as stored (0..255, limited or full range) or, for RGB pictures, G, B, R: the
order that H.273 gives to "RGB" video, in which the first component is the one closest to luma.
RGB is full range, 0..255, non-linear; transfer and primaries are left as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RGB, BT709, UNSPECIFIED, FCC, BT470BG, SMPTE170M, SMPTE240M = 0, 1, 2, 4, 5, 6, 7
BT2020_NCL, BT2020_CL = 9, 10
LIMITED, FULL = 1, 2

# Kr, Kb of ITU-T H.273, table 4.
_LUMA_WEIGHTS: dict[int, tuple[float, float]] = {
    BT709: (0.2126, 0.0722),
    FCC: (0.30, 0.11),
    BT470BG: (0.299, 0.114),
    SMPTE170M: (0.299, 0.114),
    SMPTE240M: (0.212, 0.087),
    BT2020_NCL: (0.2627, 0.0593),
    BT2020_CL: (0.2627, 0.0593),
}


@dataclass(frozen=True, eq=False)
class ColourMatrix:
    """Affine maps between stored components and RGB, all in units of 0..255.

    to_rgb : (3, 4) float32, rgb = to_rgb[:, :3] @ yuv + to_rgb[:, 3].
    from_rgb : (3, 4) float32, its inverse.
    """

    to_rgb: NDArray[np.float32]
    from_rgb: NDArray[np.float32]

    def __post_init__(self) -> None:
        self.to_rgb.setflags(write=False)
        self.from_rgb.setflags(write=False)


def yuv_matrix(colourspace: int, colour_range: int, height: int) -> ColourMatrix:
    """The matrix of a Y, U, V picture from its tags (H.273 matrix and FFmpeg range numbers).

    An unspecified colourspace is BT.709 from 720 lines up and BT.601 below; an unspecified range is limited.

    >>> [f"{weight:.3f}" for weight in yuv_matrix(BT709, LIMITED, 720).to_rgb[0]]
    ['1.164', '0.000', '1.793', '-248.101']
    """
    fallback = BT709 if height >= 720 else SMPTE170M
    kr, kb = _LUMA_WEIGHTS.get(colourspace, _LUMA_WEIGHTS[fallback])
    kg = 1.0 - kr - kb
    to_rgb = np.array(
        [
            [1.0, 0.0, 2 * (1 - kr)],
            [1.0, -2 * (1 - kb) * kb / kg, -2 * (1 - kr) * kr / kg],
            [1.0, 2 * (1 - kb), 0.0],
        ]
    )
    black, luma_span, chroma_span = (0.0, 255.0, 255.0) if colour_range == FULL else (16.0, 219.0, 224.0)
    linear = to_rgb * (255.0 / np.array([luma_span, chroma_span, chroma_span]))
    return _affine(linear, np.array([black, 128.0, 128.0]))


def gbr_matrix() -> ColourMatrix:
    """The matrix of a picture stored as G, B, R: a permutation."""
    return _affine(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.zeros(3))


def _affine(linear: NDArray[np.float64], zero: NDArray[np.float64]) -> ColourMatrix:
    """rgb = linear @ (yuv - zero), and back.  linear : (3, 3); zero : (3,)."""
    forward = np.column_stack([linear, -linear @ zero])
    backward = np.column_stack([np.linalg.inv(linear), zero])
    return ColourMatrix(forward.astype(np.float32), backward.astype(np.float32))
