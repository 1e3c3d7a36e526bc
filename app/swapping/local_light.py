"""The scene's light and skin tone on a face, by the ratio of local means of skin.

Light scales what it falls on.  So what the frame shows of the source's skin, averaged around each place, is divided by
what the synthesised face shows there, averaged alike; the ratio is that of the two lights and skin tones together.
Brightness is averaged over a small neighbourhood, so that hard shadows keep their place, and colour over a larger one.
Brows, lips and folds are differences from the face's own mean; they take the colour of the ratio, and its brightness
within limits, so that they neither fade nor turn into noise.  Eyes and the inside of the mouth keep their own colours,
in the brightness that the source's have and the tint of the light on whites.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.coarse_grid import CellReader, CoarseGrid, TexelSums
from guise.app.swapping.whites import Whites
from guise.common.arrays import F32, Bool, Int


@dataclass(frozen=True)
class LocalLightLimits:
    """Widths, ranges and memory of the local light."""

    cell_face_widths: float = 0.025
    brightness_sigma_face_widths: float = 0.05
    colour_sigma_face_widths: float = 0.1
    brightness_ratio: tuple[float, float] = (0.15, 4.0)
    colour_ratio: tuple[float, float] = (0.6, 1.6)  # of a channel, beyond that of brightness
    detail_gain: tuple[float, float] = (0.5, 1.5)
    # Of brightness, at eyes and in the mouth: teeth that the frame shows don't light up a tongue.
    part_ratios: tuple[tuple[float, float], ...] = ((0.35, 1.8), (0.35, 1.1))
    memory: float = 0.5  # share kept from frame to frame
    black_grey_levels: float = 4.0  # added before a ratio is taken
    min_weight: float = 1e-3  # of a texel
    min_part_share: float = 0.25  # visible share of eyes or mouth from which their brightness is measured


LIMITS = LocalLightLimits()
PARTS = ((RIGHT_EYE, LEFT_EYE), (INNER_LIPS,))
DISGUISE_SIGMA_FACE_WIDTHS = 0.2  # of both means in a disguise: narrow ones follow the person's own features


class LocalLight:
    """A `Palette` of local ratios, smooth in time.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : (t,) indices into the reference frame's mask pixels, where colours are compared.
    mask : (h, w) bool, where the face is shown.
    enrolled : neutral RGB (n, 3) of the frame's person and of the face, in the reference frame's mask pixels; without
        them eyes and teeth take the tint of the skin's light.
    disguise : average so widely that nothing of the person's features is copied as light.
    """

    def __init__(
        self, reference: ReferenceFrame, texels: Int, mask: Bool, enrolled: tuple[F32, F32] | None = None,
        *, disguise: bool = False,
    ) -> None:  # fmt: skip
        grid = CoarseGrid(reference, LIMITS.cell_face_widths)
        self._cells = grid.size
        self._skin = np.flatnonzero((skin_mask(reference) & mask)[reference.mask][texels])
        places = grid.places(texels[self._skin])
        self._sums = TexelSums(grid.size, places)
        self._at_pixels = CellReader(grid.places())
        sigmas = LIMITS.brightness_sigma_face_widths, LIMITS.colour_sigma_face_widths
        if disguise:
            sigmas = DISGUISE_SIGMA_FACE_WIDTHS, DISGUISE_SIGMA_FACE_WIDTHS
        self._narrow, self._wide = map(grid.smoother, sigmas)
        self._parts = [soft_parts(reference, part, 0.0)[reference.mask] for part in PARTS]
        self._surface = 1 - np.maximum(*self._parts)
        self._whites = None if enrolled is None else Whites(reference, enrolled, texels[self._skin])
        self._part_texels = [np.flatnonzero(part[texels] > 0.5) for part in self._parts]
        self.reset()

    def reset(self) -> None:
        """Take the next update as it is."""
        self._own = np.zeros((3, *self._cells), np.float32)
        self._ratio = np.ones((3, *self._cells), np.float32)
        self._part_ratio = np.ones(len(self._parts))
        self._tint: F32 | None = None
        self._fresh = True

    @property
    def contrast(self) -> float:
        """Scale of grey differences on skin."""
        return float(np.median(_detail_gain(self._ratio)))

    def update(self, face: F32, seen: F32, visible: F32 | None) -> None:
        """See `Palette.update`."""
        visible = np.ones(len(face), np.float32) if visible is None else visible
        keep = np.float32(0.0 if self._fresh else LIMITS.memory)
        own, ratio = self._fitted(face[self._skin], seen[self._skin], visible[self._skin])
        self._own += (1 - keep) * (own - self._own)
        self._ratio += (1 - keep) * (ratio - self._ratio)
        for part, at in enumerate(self._part_texels):
            if len(at) and visible[at].mean() > LIMITS.min_part_share:
                value = _part_ratio(face[at], seen[at], visible[at], LIMITS.part_ratios[part])
                self._part_ratio[part] += (1 - keep) * (value - self._part_ratio[part])
        if self._whites is not None:
            tint = self._whites.tint(visible[self._skin] @ seen[self._skin])
            self._tint = tint if self._tint is None else tint + keep * (self._tint - tint)
        self._fresh = False

    def apply(self, texture: F32, to_stored: F32, offset: F32) -> F32:
        """See `Palette.apply`."""
        # own R + (texture - own) g, over black: an affine map of the texture, with coefficients on the coarse grid.
        gain = self._ratio * (_detail_gain(self._ratio) / _luma(self._ratio))
        black = np.float32(LIMITS.black_grey_levels) * (1 - gain)
        gains, lit = self._at_pixels(gain), self._at_pixels(self._own * (self._ratio - gain) - black)
        gains *= self._surface
        lit *= self._surface
        tint = self._ratio.mean((1, 2)) if self._tint is None else self._tint
        tint = tint / (LUMA @ tint)
        for part, value in zip(self._parts, self._part_ratio, strict=True):
            gains += np.multiply.outer(np.float32(value) * tint, part)
        gains *= texture.T
        gains += lit
        out = to_stored.astype(np.float32) @ gains
        out += offset.astype(np.float32)[:, None]
        return np.asarray(out)

    def _fitted(self, face: F32, seen: F32, visible: F32) -> tuple[F32, F32]:
        """The face's local mean over black and the ratio of colours (3, h, w), from the skin's texels (s, 3)."""
        black = np.float32(LIMITS.black_grey_levels)
        sums = self._sums(np.concatenate([face, seen], axis=1), visible + np.float32(LIMITS.min_weight))
        narrow, wide = (smoother.means(sums) + black for smoother in (self._narrow, self._wide))
        brightness = np.clip(_luma(narrow[3:]) / _luma(narrow[:3]), *LIMITS.brightness_ratio)
        tint = wide[3:] / np.maximum(wide[:3], 1) * (_luma(wide[:3]) / _luma(wide[3:]))
        return narrow[:3], brightness * np.clip(tint, *LIMITS.colour_ratio)


def _detail_gain(ratio: F32) -> F32:
    """(h, w) scale of differences from the local mean."""
    return np.asarray(np.clip(_luma(ratio), *LIMITS.detail_gain))


def _luma(planes: F32) -> F32:
    return np.asarray(np.tensordot(LUMA, planes, 1))


def _part_ratio(face: F32, seen: F32, visible: F32, limits: tuple[float, float]) -> float:
    """Ratio of mean brightness of an eye or mouth, within limits."""
    there, own = (float(visible @ (rgb @ LUMA)) / float(visible.sum()) for rgb in (seen, face))
    ratio = (there + LIMITS.black_grey_levels) / max(own + LIMITS.black_grey_levels, 1)
    return float(np.clip(ratio, *limits))
