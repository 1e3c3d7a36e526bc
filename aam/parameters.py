"""Appearance parameters of an observed face: a regularised least-squares fit on a sparse set of texels.

The frame is sampled at a few thousand places of the reference grid only; those samples serve the colour similarity
too.  Light that differs from the enrolment clip is absorbed by nuisance columns (offset, gain and slopes per
channel) and dropped, so that it does not pass for expression.  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import SHAPE, AppearanceModel
from guise.aam.mask import skin_mask
from guise.aam.reference import MeshSampler
from guise.common.arrays import F32, F64

PLACES = 2400
NOISE = 6.0  # grey levels a texel is off by, camera noise and what the modes cannot show
LIGHT = 40.0  # grey levels by which light may differ


class ParameterEstimator:
    """Precomputed fit of the parameters rho (k,) to a shape and sparse texels.

    Parameters
    ----------
    model : AppearanceModel of the person in view.
    places : number of texels to look at.
    seed : of their choice.
    """

    def __init__(self, model: AppearanceModel, places: int = PLACES, seed: int = 0) -> None:
        self.model = model
        inside = np.flatnonzero(model.mask[model.reference.mask])
        rng = np.random.default_rng(seed)
        self.texels = np.sort(rng.permutation(inside)[:places])
        self.sampler: MeshSampler = model.reference.sampler[self.texels]
        basis, mean = model.components.basis, model.components.mean
        grow = np.sqrt(len(model.reference.pixels) / len(self.texels))
        texture = basis[SHAPE:].reshape(-1, 3, basis.shape[1])[self.texels].reshape(-1, basis.shape[1])
        self._mean_shape = mean[:SHAPE]
        self._mean_texels = model.texture_of(mean)[self.texels]
        k = basis.shape[1]
        light = self._light_columns()
        design = np.zeros((SHAPE + len(texture), k + light.shape[1]))
        design[:SHAPE, :k] = basis[:SHAPE]
        design[SHAPE:, :k] = texture * grow
        design[SHAPE:, k:] = light * grow
        prior = np.concatenate(
            [
                (NOISE / np.maximum(model.components.deviations, 1e-3)) ** 2,
                np.full(light.shape[1], (NOISE / LIGHT) ** 2),
            ]
        )
        solved = np.linalg.solve(design.T @ design + np.diag(prior), design.T)[:k]
        self._from_shape = solved[:, :SHAPE].astype(np.float32)
        self._from_texels = np.ascontiguousarray(solved[:, SHAPE:] * grow, np.float32)

    @cached_property
    def skin(self) -> NDArray[np.intp]:
        """Indices into the texels that show skin: where palettes are compared."""
        reference = self.model.reference
        return np.flatnonzero(skin_mask(reference)[reference.mask][self.texels])

    def __call__(self, shape: F64, texels: F32) -> F32:
        """rho (k,) of a shape (81, 2) in frame pixels and the frame's RGB (t, 3) at `sampler.positions(shape)`."""
        reference = self.model.reference
        aligned = reference.align(shape).ravel() * reference.shape_weight - self._mean_shape
        return np.asarray(
            self._from_shape @ aligned.astype(np.float32)
            + self._from_texels @ (texels - self._mean_texels).ravel(),
            np.float32,
        )

    def _light_columns(self) -> F64:
        """(3 t, 12): per channel an offset, a gain and two slopes over the face."""
        reference, mean = self.model.reference, self._mean_texels
        ys, xs = np.divmod(reference.pixels[self.texels], reference.size[1])
        place = (np.column_stack([xs, ys]) - np.array(reference.size[::-1]) / 2) / reference.resolution
        columns = np.zeros((len(mean), 3, 12))
        for channel in range(3):
            columns[:, channel, 4 * channel] = 1
            columns[:, channel, 4 * channel + 1] = mean[:, channel] / 128 - 1
            columns[:, channel, 4 * channel + 2 : 4 * channel + 4] = place
        return columns.reshape(-1, 12)
