"""The finest structure of the person's own skin, on a face whose donor was filmed more softly than the picture.

What a donor's clip does not hold cannot be sharpened out of it: a raised contrast ends in streaks.  So where that is
not enough (`sharpness.py`) the finest band of the frame's brightness is laid into the texture, on skin alone: pores and
grain.  Folds, moles and edges, by which a person is known, stand out from it and stay out.  Pixels, x right, y down;
grey levels 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, NOSE_WINGS, RIGHT_BROW
from guise.aam.mask import FEATURE_PARTS, skin_mask, soft_parts
from guise.aam.reference import MeshSampler
from guise.aam.relief import Relief
from guise.common.arrays import F64, U8


@dataclass(frozen=True)
class OwnSkinLimits:
    """What is taken from the frame."""

    band_face_widths: float = 0.012  # standard deviation, below which structure is fine
    fold_grey_levels: float = 3.0  # standard deviation, of which structure is a fold or an edge and stays out
    feature_growth_face_widths: float = 0.035  # around eyes, brows, lips and nostrils of either face
    brow_growth_face_widths: float = 0.09  # around brows, which rise
    rim_face_widths: float = 0.02  # standard deviation by which it fades at the edge of skin
    cell_grid_pixels: int = 4  # between which places are interpolated


LIMITS = OwnSkinLimits()


class OwnSkin:
    """Lays the fine structure of a frame's skin into textures.

    Parameters
    ----------
    relief : of the face that is drawn.
    """

    def __init__(self, relief: Relief) -> None:
        reference = relief.reference
        self._width = reference.resolution
        features = (*FEATURE_PARTS, NOSE_WINGS)
        skin = cv2.GaussianBlur(
            skin_mask(reference).astype(np.float32), (0, 0), LIMITS.rim_face_widths * self._width
        )
        self._share = skin * (1 - soft_parts(reference, features, LIMITS.feature_growth_face_widths))
        self._share *= 1 - soft_parts(reference, (RIGHT_BROW, LEFT_BROW), LIMITS.brow_growth_face_widths)
        h, w = reference.size
        self._cells = -(-h // LIMITS.cell_grid_pixels), -(-w // LIMITS.cell_grid_pixels)
        axes = ((np.arange(n) + 0.5) * side / n - 0.5 for n, side in zip(self._cells, (h, w), strict=True))
        ys, xs = np.meshgrid(*axes, indexing="ij")
        self._sampler = MeshSampler.build(relief.mesh, np.column_stack([xs.ravel(), ys.ravel()]))

    def add(self, picture: U8, roi: U8, mesh: F64, zoom: float, share: float) -> None:
        """Lay a share of what a rectangle (h, w, 3) shows into a texture (h, w, 3), in place; brightness comes first.

        mesh : (81 + k, 2), where the texture is drawn, in the rectangle's pixels.   zoom : of these per grid pixel.
        """
        size = picture.shape[1::-1]
        luma = cv2.extractChannel(roi, 0).astype(np.float32)
        sigma = max(LIMITS.band_face_widths * self._width * zoom, 0.5)
        luma -= cv2.GaussianBlur(luma, (0, 0), sigma)
        energy = cv2.GaussianBlur(luma * luma, (0, 0), 2 * sigma)
        luma *= cv2.exp(energy * (-0.5 / LIMITS.fold_grey_levels**2))
        places = cv2.resize(self._sampler.positions(mesh).reshape(*self._cells, 2), size)
        band = cv2.remap(luma, places, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        band *= np.float32(share) * cv2.resize(self._share, size)
        texture = cv2.add(cv2.extractChannel(picture, 0), band, dtype=cv2.CV_8U)
        cv2.insertChannel(texture, picture, 0)
