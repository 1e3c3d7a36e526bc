"""The picture's own grain on a drawn face.

A mean of frames has less noise than a frame, and a drawn face without the noise around it looks pasted on.  So the
noise of the frame's skin before drawing is compared with that of the same pixels after it, and what is missing is added
to the texture of the frames that follow.  Pixels, x right, y down; grey levels 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.mask import skin_mask
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.quantile import quantile


@dataclass(frozen=True)
class GrainLimits:
    """What is measured, how often, and how much is added."""

    finest_sigma_pixels: float = 0.8  # of the Gaussian beyond which nothing counts as grain
    patch_pixels: int = 9  # sides of the squares whose energy is measured
    smooth_quantile: float = 0.3  # of the squares' energies: skin without features
    places: int = 400  # on skin
    min_inside: float = 0.5  # share of the places that must lie in the picture
    shown_share: float = 0.3  # of the variance added to a texture that the picture shows in the finest band
    rate: float = 0.4  # share of a difference made up for at once
    every_frames: int = 4  # between measurements
    max_grey_levels: float = 4.0  # standard deviation
    min_grey_levels: float = 0.3  # below which rounding would swallow it
    tile_slack_pixels: int = 64  # by which the pattern is shifted at random from frame to frame


LIMITS = GrainLimits()


class Grain:
    """Measures the grain of frames and adds it to textures; the same frames always get the same grain.

    Parameters
    ----------
    reference : ReferenceFrame.
    mask : (h, w) bool, where the face is drawn.
    """

    def __init__(self, reference: ReferenceFrame, mask: Bool) -> None:
        rng = np.random.default_rng(0)
        skin = np.flatnonzero((skin_mask(reference) & mask)[reference.mask])
        self._sampler = reference.sampler[np.sort(rng.permutation(skin)[: LIMITS.places])]
        height, width = (2 * side + LIMITS.tile_slack_pixels for side in reference.size)
        self._tile = rng.standard_normal((height, width), np.float32)
        self.reset()

    def reset(self) -> None:
        """Start without grain, at the next face."""
        self._variance = 0.0
        self._frames = 0

    @property
    def deviation(self) -> float:
        """Standard deviation of what is added to a texture, grey levels."""
        return float(np.sqrt(self._variance))

    def add(self, picture: U8, frame: int) -> None:
        """Put the grain of the frame of this number on a texture (h, w, 3), brightness first, in place."""
        if self.deviation < LIMITS.min_grey_levels:
            return
        x, y = np.random.default_rng(frame).integers(0, LIMITS.tile_slack_pixels, 2)
        h, w = picture.shape[:2]
        luma = cv2.extractChannel(picture, 0)
        tile = self._tile[y : y + h, x : x + w]
        cv2.addWeighted(luma, 1.0, tile, self.deviation, 0.0, dst=luma, dtype=cv2.CV_8U)
        cv2.insertChannel(luma, picture, 0)

    def seen(self, picture: U8) -> F32 | None:
        """The energy of grain in a rectangle (h, w, 3) before drawing; None in frames that aren't measured."""
        self._frames += 1
        return grain_energy(picture) if self._frames % LIMITS.every_frames == 1 else None

    def update(self, seen: F32, drawn: U8, mesh: F64) -> None:
        """Compare what was `seen` in a rectangle with it after drawing (h, w, 3), on a mesh (81, 2) in its pixels."""
        x, y = np.round(self._sampler.positions(mesh)).astype(int).T
        h, w = seen.shape
        inside = (x >= 0) & (x < w) & (y >= 0) & (y < h)
        if inside.mean() < LIMITS.min_inside:
            return
        there, own = (
            quantile(energy[y[inside], x[inside]], LIMITS.smooth_quantile)
            for energy in (seen, grain_energy(drawn))
        )
        missing = (there - own) / LIMITS.shown_share
        self._variance = float(np.clip(self._variance + LIMITS.rate * missing, 0, LIMITS.max_grey_levels**2))


def grain_energy(picture: U8) -> F32:
    """(h, w) mean square of the finest band around each pixel of a picture (h, w, 3), brightness first."""
    luma = cv2.extractChannel(picture, 0).astype(np.float32)
    luma -= cv2.GaussianBlur(luma, (0, 0), LIMITS.finest_sigma_pixels)
    side = (LIMITS.patch_pixels, LIMITS.patch_pixels)
    return np.asarray(cv2.boxFilter(luma * luma, -1, side), np.float32)
