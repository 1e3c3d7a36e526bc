"""How well the texture under a known shape matches a person, also where a part of their face is known to be hidden.

The person's texture is a mean and components of normalised grey values on the tracker's feature grid.  Hidden places
don't count: the visible ones are normalised as the mean is there, and the components' coefficients are the likeliest
ones given them (probabilistic principal components: Tipping and Bishop 1999, with some values missing).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.appearance import Components
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, Bool, Floating, Int
from guise.common.small import mean


@dataclass(frozen=True)
class MatchLimits:
    """What counts as another texture."""

    occlusion_residual: float = 0.8  # of the normalised texture, from which a place doesn't show the person
    occlusion_blur_grid_pixels: float = 2.5  # standard deviation, over which that residual is averaged


LIMITS = MatchLimits()


@dataclass(frozen=True)
class TextureResidual:
    """What the person's texture leaves unexplained.

    Parameters
    ----------
    residual : root mean square over the visible places, of values of unit standard deviation.
    foreign_share : share of the visible places about which it exceeds `occlusion_residual`.
    """

    residual: float
    foreign_share: float


class TextureMatcher:
    """Compares sampled grey values with a person's texture.

    Parameters
    ----------
    texture : Components of the normalised values (n).
    pixels : (n,) indices into the mask pixels of the reference frame, where the values lie.
    noise : root mean square that the components leave of the person's own texture.
    """

    def __init__(self, texture: Components, pixels: Int, reference: ReferenceFrame, noise: float) -> None:
        self._texture, self._pixels, self._reference = texture, pixels, reference
        self._prior = np.diag((noise / texture.deviations) ** 2)
        self._whole = self._blurred(np.ones(len(pixels), np.float32))

    def match(self, values: F32, hidden: Bool | None = None) -> TextureResidual:
        """Grey values (n,) against the person's; those `hidden` (n,) don't count."""
        if hidden is None or not hidden.any():
            centred = normalised(values) - self._texture.mean
            left = centred - self._texture.basis @ (centred @ self._texture.basis)
            return TextureResidual(
                float(np.sqrt((left**2).mean())), float(self._foreign(left, self._whole).mean())
            )
        if hidden.all():
            return TextureResidual(float("inf"), 1.0)
        seen = ~hidden
        weights = seen.astype(np.float32)
        left = np.zeros(len(values), np.float32)
        left[seen] = self._unexplained(values[seen], seen)
        foreign = self._foreign(left, self._blurred(weights))[seen]
        return TextureResidual(float(np.sqrt((left[seen] ** 2).mean())), float(foreign.mean()))

    def _unexplained(self, values: F32, seen: Bool) -> F32:
        """What is left of the visible grey values (m,)."""
        mean, basis = self._texture.mean[seen], self._texture.basis[seen]
        centred = normalised(values) * mean.std() + mean.mean() - mean
        coefficients = np.linalg.solve(basis.T @ basis + self._prior, basis.T @ centred)
        return np.asarray(centred - basis @ coefficients, np.float32)

    def _foreign(self, left: Floating, weight: F32) -> Bool:
        """Where (n,) the unexplained is large, given the blurred weight of the visible places."""
        energy = self._blurred(np.square(left, dtype=np.float32))
        return np.asarray(energy > LIMITS.occlusion_residual**2 * weight)

    def _blurred(self, values: F32) -> F32:
        """Values (n,) averaged over their surroundings; places that aren't used count as 0."""
        grid = np.zeros(len(self._reference.pixels), np.float32)
        grid[self._pixels] = values
        picture = cv2.GaussianBlur(self._reference.scatter(grid), (0, 0), LIMITS.occlusion_blur_grid_pixels)
        return np.asarray(picture[self._reference.mask][self._pixels])


def residual(values: F32, mean: F32, basis: F32) -> float:
    """Root mean square of what components, of a mean (n,) and a basis (m, n), leave unexplained of grey values (n,)."""
    centred = normalised(values) - mean
    coefficients = basis @ centred
    energy = float(centred @ centred) - float(coefficients @ coefficients)
    return float(np.sqrt(max(energy, 0.0) / len(centred)))


def normalised(values: F32) -> F32:
    """Values (n,) with zero mean and unit standard deviation."""
    centred = values - mean(values)
    return np.asarray(centred / (np.sqrt(centred @ centred / len(centred)) + 1e-3), np.float32)
