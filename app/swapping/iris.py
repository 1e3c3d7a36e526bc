"""The identity's iris colour on the source's own eyeballs.

The source's eyeballs show through the drawn lids, so that the gaze, the light and its reflections are the scene's
(`apertures.py`).  Their irises take the identity's colour: what is an iris is scaled, channel by channel, by how the
two people's irises differ from their own whites; so neither light counts.  RGB 0..255.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from guise.aam.light import LUMA
from guise.common.arrays import F32, F64, Int
from guise.common.quantile import quantile


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


class DiscMeans:
    """Means of pictures (h, w) over discs and the rings about them, at a few places; beyond a picture are zeros.

    Sums over the rows of a disc are differences of the picture's sums from the left.

    Parameters
    ----------
    size : (height, width) of the pictures.
    places : (n, 2) y, x of the discs' middles.
    radii : of a disc and of its ring, pixels.
    """

    def __init__(self, size: tuple[int, int], places: Int, radii: tuple[float, float]) -> None:
        reach = int(radii[1])
        self._sums = np.zeros((size[0] + 2 * reach, size[1] + 2 * reach + 1))
        self._inner = np.s_[reach : reach + size[0], reach + 1 : reach + 1 + size[1]]
        self._right = np.s_[reach : reach + size[0], reach + size[1] :]
        self._ends, counts = [], [0]
        for radius in radii:
            rows = np.arange(-int(radius), int(radius) + 1)
            half = np.sqrt(radius**2 - rows**2).astype(int)
            row = (places[:, :1] + reach + rows) * self._sums.shape[1] + reach
            self._ends.append((row + places[:, 1:] + half + 1, row + places[:, 1:] - half))
            counts.append(int((2 * half + 1).sum()))
        self._counts = np.diff(counts)[:, None]

    def __call__(self, picture: F32) -> F64:
        """(2, n) means over the discs and over the rings."""
        np.cumsum(picture, axis=1, out=self._sums[self._inner])
        self._sums[self._right] = self._sums[self._right][:, :1]
        disc, both = ((self._sums.take(end) - self._sums.take(start)).sum(1) for end, start in self._ends)
        return np.stack([disc, both - disc]) / self._counts


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
        radii = self.radius, float(np.ceil(LIMITS.ring * self.radius))
        rows = np.flatnonzero(inside.any(1))
        off_middle = np.abs(np.arange(len(share)) - rows.mean()) / (rows[-1] - rows[0] + 1)
        every = np.argwhere(inside)
        disc = DiscMeans(share.shape, every, radii)(share)[0]
        visible = disc > LIMITS.min_visible * disc.max()
        self._places = every[visible & (off_middle <= LIMITS.max_off_middle)[every[:, 0]]]
        self._means = DiscMeans(share.shape, self._places, radii)
        self._weights = np.maximum(self._means(share), 1e-3)
        self._grid = np.mgrid[: share.shape[0], : share.shape[1]].astype(np.float32)

    def centre(self, luma: F32) -> F64 | None:
        """(2,) y, x of the disc that is darkest against what is beside it; None if no place is possible."""
        if not len(self._places):
            return None
        disc, ring = self._means(luma * self._share) / self._weights
        return np.asarray(self._places[int((ring - disc).argmax())], np.float64)

    def around(self, centre: F64, radii: float) -> tuple[slice, slice]:
        """The rows and columns in which pixels may be nearer to a centre (2,) than so many radii."""
        reach = radii * self.radius
        low = np.maximum(np.floor(centre - reach), 0).astype(int)
        high = np.ceil(centre + reach).astype(int) + 1
        return slice(low[0], high[0]), slice(low[1], high[1])

    def away(self, centre: F64, box: tuple[slice, slice] = np.s_[:, :]) -> F32:
        """Distance of pixels from a centre (2,), radii: of all (h, w), or of those in a box."""
        y, x = self._grid[:, *box]
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
        return quantile(luma[self._inside], LIMITS.bright)


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
        box = self._finder.around(centre, 1 + LIMITS.soft / 2)
        disc = np.clip((1 - self._finder.away(centre, box)) / LIMITS.soft + 0.5, 0, 1)
        share = np.float32(strength) * disc * np.clip(2 * unlike_white[box], 0, 1)
        tinted = eye.copy()
        tinted[box] *= 1 + share[..., None] * (self.gain - 1)
        return tinted

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
