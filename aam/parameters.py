"""Appearance parameters of an observed face: a regularised least-squares fit on a sparse set of texels.

The frame is sampled at only a few thousand places of the reference grid; the samples serve the colour similarity too.
Light that differs from the enrolment clip is absorbed by nuisance columns (offset, gain and slopes per channel), which
are dropped, so that it doesn't pass for expression.  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel
from guise.aam.light import grid_places
from guise.aam.mask import skin_mask
from guise.aam.reference import MeshSampler
from guise.common.arrays import F32, F64, Int

DEFAULT_PLACES = 2400
TEXEL_NOISE_GREY_LEVELS = 6.0  # standard deviation: camera noise and what the modes can't show
LIGHT_GREY_LEVELS = 40.0  # standard deviation of differences of light


class ParameterEstimator:
    """Precomputed fit of the parameters rho (k,) to a shape and sparse texels.

    Parameters
    ----------
    model : AppearanceModel of the person in view.
    places : number of texels to sample.
    seed : of their random choice.
    """

    def __init__(self, model: AppearanceModel, places: int = DEFAULT_PLACES, seed: int = 0) -> None:
        self.model = model
        inside = np.flatnonzero(model.mask[model.reference.mask])
        rng = np.random.default_rng(seed)
        self.texels = np.sort(rng.permutation(inside)[:places])
        self.sampler: MeshSampler = model.reference.sampler[self.texels]
        basis, mean = model.components.basis, model.components.mean
        grow = np.sqrt(len(model.reference.pixels) / len(self.texels))
        texture = (
            basis[SHAPE_ENTRIES:].reshape(-1, 3, basis.shape[1])[self.texels].reshape(-1, basis.shape[1])
        )
        self._mean_shape = mean[:SHAPE_ENTRIES]
        self._mean_texels = model.texture_of(mean)[self.texels]
        k = basis.shape[1]
        light = self._light_columns()
        design = np.zeros((SHAPE_ENTRIES + len(texture), k + light.shape[1]))
        design[:SHAPE_ENTRIES, :k] = basis[:SHAPE_ENTRIES]
        design[SHAPE_ENTRIES:, :k] = texture * grow
        design[SHAPE_ENTRIES:, k:] = light * grow
        prior = np.concatenate(
            [
                (TEXEL_NOISE_GREY_LEVELS / np.maximum(model.components.deviations, 1e-3)) ** 2,
                np.full(light.shape[1], (TEXEL_NOISE_GREY_LEVELS / LIGHT_GREY_LEVELS) ** 2),
            ]
        )
        solved = np.linalg.solve(design.T @ design + np.diag(prior), design.T)[:k]
        self._from_shape = solved[:, :SHAPE_ENTRIES].astype(np.float32)
        self._from_texels = np.ascontiguousarray(solved[:, SHAPE_ENTRIES:] * grow, np.float32)

    @cached_property
    def skin(self) -> Int:
        """Indices of the texels that show skin, on which palettes are compared."""
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
        mean, place = self._mean_texels, grid_places(self.model.reference)[self.texels]
        columns = np.zeros((len(mean), 3, 12))
        for channel in range(3):
            columns[:, channel, 4 * channel] = 1
            columns[:, channel, 4 * channel + 1] = mean[:, channel] / 128 - 1
            columns[:, channel, 4 * channel + 2 : 4 * channel + 4] = place
        return columns.reshape(-1, 12)
