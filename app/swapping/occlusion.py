"""What hides the source's face in a frame: a hand, a mug, a microphone.

The source's model says what their face looks like with its present expression.  Where the frame differs from that in
colour by more than a smooth light explains, or is far darker or brighter than any shadow or gloss, something else is
seen.  There the light isn't measured, and the frame's own pixels stay in front of the drawn face.  A hand of the colour
of the face isn't noticed.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE, RIGID_WEIGHTS
from guise.aam.mask import soft_parts
from guise.aam.similarity import align_planar
from guise.app.swapping.coarse_grid import CellReader, CoarseGrid, TexelSums
from guise.common.arrays import F32, F64, Floating, Int


@dataclass(frozen=True)
class OcclusionLimits:
    """Widths, thresholds and memory; differences are of natural logarithms of channels."""

    cell_face_widths: float = 0.025
    light_sigma_face_widths: float = 0.12
    sigma_face_widths: float = 0.025  # over which differences are averaged
    difference: tuple[float, float] = (0.11, 0.19)  # up to which all is visible, from which all is hidden
    shadow: float = 0.8  # difference in brightness that light may make
    darkness_weight: float = 0.2  # of what exceeds it, beside the difference in colour
    memory: float = 0.5  # share kept of the occlusion from frame to frame
    light_memory: float = 0.6  # share kept of the light
    first_rounds: int = 3  # of the first, robust fit of the light
    max_outlier: float = 0.17  # difference of a texel that counts in it
    black_grey_levels: float = 4.0  # added before a ratio is taken
    min_weight: float = 1e-3  # of a texel
    shown: tuple[float, float] = (0.2, 0.9)  # occlusion: up to it the drawn face is whole, from it gone
    feature_growth_face_widths: float = 0.02  # around eyes and mouth, whose inside is hard to predict


LIMITS = OcclusionLimits()
HOLE_KERNEL = np.ones((3, 3), np.uint8)  # cells; smaller holes in what hides the face are filled


class Occlusion:
    """Measured frame by frame, smooth in time.

    Parameters
    ----------
    model : AppearanceModel of the source.
    texels : (t,) indices into the reference frame's mask pixels, where frames are sampled.
    """

    def __init__(self, model: AppearanceModel, texels: Int) -> None:
        reference = self._reference = model.reference
        rows = (SHAPE_ENTRIES + 3 * texels[:, None] + np.arange(3)).ravel()
        self._mean = model.components.mean[rows]
        self._basis = np.ascontiguousarray(model.components.basis[rows])
        grid = self._grid = CoarseGrid(reference, LIMITS.cell_face_widths)
        places = grid.places(texels)
        self._sums, self._at_texels = TexelSums(grid.size, places), CellReader(places)
        self._light_smoother = grid.smoother(LIMITS.light_sigma_face_widths)
        self._smoother = grid.smoother(LIMITS.sigma_face_widths)
        inside = soft_parts(reference, (RIGHT_EYE, LEFT_EYE, INNER_LIPS), LIMITS.feature_growth_face_widths)
        self._reliable = 1 - inside[reference.mask][texels]
        self._everywhere = np.ones(len(texels), np.float32)
        self._sampler = reference.sampler[texels]
        self._corners = np.stack(np.meshgrid(*(np.arange(n, dtype=np.float32) for n in grid.size[::-1])))
        self.reset()

    def reset(self) -> None:
        """Measure the next frame without memory."""
        self._light: F32 | None = None
        self._hidden = np.zeros(self._grid.size, np.float32)
        self._visible = np.ones(len(self._reliable), np.float32)

    @property
    def visible(self) -> F32:
        """(t,) share in [0, 1] by which each texel counts as the source's face."""
        return self._visible

    @property
    def found(self) -> bool:
        """Whether anything hides a part of the face."""
        return float(self._hidden.max()) > LIMITS.shown[0]

    def update(self, parameters: F32, seen: F32) -> None:
        """Measure a frame.

        parameters (k,) : of the source's appearance in it.   seen (t, 3) : the frame's RGB at the texels.
        """
        own = (self._mean + self._basis @ parameters).reshape(-1, 3)
        black = np.float32(LIMITS.black_grey_levels)
        log = np.log((np.maximum(seen, 0) + black) / (np.maximum(own, 0) + black))
        if self._light is None:
            self._light = self._first_light(log)
        change = log - self._at_texels(self._light).T
        clear = self._reliable * self._visible > 0.5
        jump = np.median(change[clear], axis=0) if clear.any() else np.zeros(3, np.float32)
        self._light += jump[:, None, None]
        hidden = self._hidden_cells(_difference(change - jump))
        self._hidden += np.float32(1 - LIMITS.memory) * (hidden - self._hidden)
        self._visible = np.clip(1 - 2 * self._at_texels(self._hidden[None])[0], 0, 1)
        weights = self._reliable * self._visible + np.float32(LIMITS.min_weight)
        light = self._light_smoother.means(self._sums(log, weights))
        self._light += np.float32(1 - LIMITS.light_memory) * (light - self._light)

    def uncovered(self, mesh: F64, head: F64) -> F32:
        """(h, w) share in [0, 1] of the drawn face that nothing hides, on the reference grid.

        mesh, head : (81, 2) pixels, where the face is drawn and where the source's own lies.
        """
        fit = align_planar(head, self._reference.points, RIGID_WEIGHTS)
        away = self._sampler.positions((fit.apply(mesh) - fit.apply(head)) / self._grid.cell)
        x, y = self._corners + self._smoother.means(self._sums(away, self._everywhere))
        hidden = cv2.remap(self._hidden, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        height, width = self._reference.size
        to_cells = np.array([[1 / self._grid.cell, 0, 0], [0, 1 / self._grid.cell, 0]])
        shares = cv2.warpAffine(
            1 - _ramp(hidden, LIMITS.shown),
            to_cells,
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.clip(shares, 0, 1)

    def _first_light(self, log: F32) -> F32:
        """Smooth light (3, h, w) of logarithms (t, 3), without the texels far from it."""
        weights = self._reliable + np.float32(LIMITS.min_weight)
        for _ in range(LIMITS.first_rounds):
            light = self._light_smoother.means(self._sums(log, weights))
            difference = _difference(log - self._at_texels(light).T)
            weights = self._reliable * (difference < LIMITS.max_outlier) + np.float32(LIMITS.min_weight)
        return light

    def _hidden_cells(self, difference: Floating) -> F32:
        """(h, w) share in [0, 1] that is hidden, of the texels' differences (t,) from their face in this light."""
        weights = self._reliable + np.float32(LIMITS.min_weight)
        local = self._smoother.means(self._sums(difference[:, None], weights))[0]
        shares = _ramp(local, LIMITS.difference)
        return np.asarray(cv2.morphologyEx(shares, cv2.MORPH_CLOSE, HOLE_KERNEL), np.float32)


def _ramp(values: ArrayLike, ends: tuple[float, float]) -> F32:
    """0 up to the first end, 1 from the second, linear between them."""
    return np.asarray(np.clip((np.asarray(values) - ends[0]) / (ends[1] - ends[0]), 0, 1), np.float32)


def _difference(change: F32) -> F32:
    """(t,) how little light explains changes (t, 3) of the channels' logarithms: colour, and extreme brightness."""
    brightness = change.mean(1)
    excess = np.maximum(np.abs(brightness) - np.float32(LIMITS.shadow), 0)
    colour = np.abs(change - brightness[:, None]).mean(1)
    return np.asarray(colour + np.float32(LIMITS.darkness_weight) * excess)
