"""The identity's iris colour on the source's own eyeballs.

The source's eyeballs show through the drawn lids, so that the gaze, the light and its reflections are the scene's
(`apertures.py`).  Their irises take the identity's colour: what is an iris is scaled, channel by channel, by how the
two people's irises differ from their own whites; so neither light counts.  RGB 0..255.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.light import LUMA
from guise.common.arrays import F32, F64, Bool


@dataclass(frozen=True)
class IrisLimits:
    """Sizes, and what counts as iris."""

    radius_eye_widths: float = 0.25
    ring: float = 1.6  # radii, up to which an iris is compared with what is beside it
    soft: float = 0.3  # radii, of its border
    min_visible: float = 0.75  # of an iris within the aperture, of the most there can be
    max_off_middle: float = 0.2  # of an iris, in heights of the aperture
    colour_ring: tuple[float, float] = (
        0.35,
        0.9,
    )  # radii, between which the colour is taken: no pupil, no rim
    white_share: float = 0.3  # of what lies beside the iris, the brightest, taken for white
    bright: float = 0.9  # quantile of an eye's brightness that its white has
    min_contrast: float = 0.25  # of the white, by which an iris is darker at least
    gain: tuple[float, float] = (0.15, 2.5)
    black_grey_levels: float = 4.0
    memory: float = 0.5  # share of the place kept from frame to frame
    max_step_radii: float = 0.6  # beyond which the place is taken as it is found


LIMITS = IrisLimits()


@dataclass(frozen=True, eq=False)
class EyeColours:
    """RGB (3,) of an eye's white and iris."""

    white: F32
    iris: F32


class IrisFinder:
    """Finds the iris in pictures (h, w, 3) of an eye.

    Parameters
    ----------
    share : (h, w) share in [0, 1] by which pixels are within the lids.
    """

    def __init__(self, share: F32) -> None:
        inside = share > 0.5
        columns = np.flatnonzero(inside.any(0))
        self.radius = LIMITS.radius_eye_widths * (columns[-1] - columns[0] + 1)
        self._inside, self._share = inside, share
        reach = int(np.ceil(LIMITS.ring * self.radius))
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        away = np.hypot(x, y)
        self._kernels = [
            np.asarray(kernel / kernel.sum(), np.float32)
            for kernel in (away <= self.radius, (away > self.radius) & (away <= reach))
        ]
        self._weights = [np.maximum(self._mean(share, kernel), 1e-3) for kernel in self._kernels]
        rows = np.flatnonzero(inside.any(1))
        height = rows[-1] - rows[0] + 1
        off_middle = np.abs(np.arange(len(share)) - rows.mean()) / height
        visible = self._weights[0] > LIMITS.min_visible * self._weights[0].max()
        self._allowed: Bool = visible & inside & (off_middle <= LIMITS.max_off_middle)[:, None]
        self._grid = np.mgrid[: share.shape[0], : share.shape[1]].astype(np.float32)

    def centre(self, luma: F32) -> F64 | None:
        """(2,) y, x of the disc that is darkest against what is beside it; None if no place is possible."""
        if not self._allowed.any():
            return None
        disc, ring = (
            self._mean(luma * self._share, kernel) / weight
            for kernel, weight in zip(self._kernels, self._weights, strict=True)
        )
        score = np.where(self._allowed, ring - disc, -np.inf)
        return np.array(np.unravel_index(int(score.argmax()), score.shape), np.float64)

    def away(self, centre: F64) -> F32:
        """(h, w) distance from a centre (2,), radii."""
        y, x = self._grid
        return np.asarray(np.hypot(y - centre[0], x - centre[1]) / self.radius, np.float32)

    def colours(self, picture: F32) -> EyeColours | None:
        """The colours of an eye (h, w, 3); None where no iris or no white is seen."""
        luma = picture @ LUMA
        centre = self.centre(luma)
        if centre is None:
            return None
        away = self.away(centre)
        iris = self._inside & (away > LIMITS.colour_ring[0]) & (away < LIMITS.colour_ring[1])
        beside = self._inside & (away > 1 + LIMITS.soft)
        if not iris.any() or not beside.any():
            return None
        white = beside & (luma >= np.quantile(luma[beside], 1 - LIMITS.white_share))
        return EyeColours(*(picture[where].mean(0) for where in (white, iris)))

    def white(self, luma: F32) -> float:
        """Grey level of the brightest part of an eye."""
        return float(np.quantile(luma[self._inside], LIMITS.bright))

    @staticmethod
    def _mean(plane: NDArray[np.float32], kernel: F32) -> F32:
        return np.asarray(cv2.filter2D(plane, cv2.CV_32F, kernel, borderType=cv2.BORDER_CONSTANT))


class IrisTint:
    """Gives the irises of one eye another's colour, frame by frame.

    Parameters
    ----------
    share : (h, w) share in [0, 1] by which pixels are within the lids.
    source, target : (h, w, 3) the two people's eyes at rest, in the same places.

    Attributes
    ----------
    gain : (3,) factor of an iris's channels; None where one of the two shows no iris or no white.
    """

    def __init__(self, share: F32, source: F32, target: F32) -> None:
        self._finder = IrisFinder(share)
        self.gain: F32 | None = None
        own, other = self._finder.colours(source), self._finder.colours(target)
        if own is None or other is None:
            return
        black = np.float32(LIMITS.black_grey_levels)
        gain = (other.iris + black) / (other.white + black) * (own.white + black) / (own.iris + black)
        self.gain = np.clip(gain, *LIMITS.gain).astype(np.float32)
        level = max(float(own.white @ LUMA), 1.0)
        difference = (own.white - own.iris) / level
        squared = max(float(difference @ difference), LIMITS.min_contrast**2)
        self._direction = np.asarray(difference / squared, np.float32)
        self._offset = float(own.white @ self._direction) / level
        self._place: F64 | None = None

    def apply(self, eye: F32, strength: float = 1.0) -> F32:
        """An eye (h, w, 3) with the other's iris, by a share in [0, 1]: a shut eye has none."""
        if self.gain is None or strength == 0:
            return eye
        level = max(self._finder.white(eye @ LUMA), 1.0)
        unlike_white = np.clip(self._offset - eye @ (self._direction / level), -0.5, 1).astype(np.float32)
        centre = self._finder.centre(-unlike_white)
        if centre is None:
            return eye
        centre = self._steadied(centre)
        disc = np.clip((1 - self._finder.away(centre)) / LIMITS.soft + 0.5, 0, 1)
        share = np.float32(strength) * disc * np.clip(2 * unlike_white, 0, 1)
        return np.asarray(eye * (1 + share[..., None] * (self.gain - 1)), np.float32)

    def _steadied(self, centre: F64) -> F64:
        last, radius = self._place, self._finder.radius
        if last is not None and np.hypot(*(centre - last)) < LIMITS.max_step_radii * radius:
            centre = centre + LIMITS.memory * (last - centre)
        self._place = centre
        return centre


def of_one_colour(tints: Sequence[IrisTint]) -> None:
    """Give both eyes the same change of colour: light and reflections make single eyes differ."""
    gains = [tint.gain for tint in tints if tint.gain is not None]
    if gains:
        mean = np.exp(np.mean(np.log(gains), axis=0)).astype(np.float32)
        for tint in tints:
            if tint.gain is not None:
                tint.gain = mean
