"""Keeps brows as dark as their hair when a face takes a lighter or darker skin tone.

A light that is measured on skin holds the two skin tones as well, and hair has no part in these: black brows of a dark
face would be grey on a light one, and brown ones of a light face black on a dark one.  So a brow's pixel is taken for a
mixture of skin and hair, by its brightness between that of the skin beside the brow and that of hair, which is darker
than the brow's darkest pixels, as these are mixtures, too; the skin gets the light, the hair the change of light alone,
which is seen at the eyes and bounded by the two skins as enrolled.  A brow is brought to that mixture, which is never
lighter than the skin.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW, Group
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32
from guise.common.quantile import quantile


@dataclass(frozen=True)
class BrowHairLimits:
    """Lengths in face widths."""

    growth: float = 0.02  # of the brows
    beside: tuple[float, float] = (0.03, 0.06)  # from the brows, between which their skin lies
    darkest: float = 0.05  # quantile of the brows' brightness that is mostly hair
    hair: float = 0.55  # brightness of hair alone, of that quantile
    min_share: float = 0.01  # of a brow, from which a pixel belongs to it
    strength: float = 0.8
    min_factor: float = 0.2


LIMITS = BrowHairLimits()


class BrowHair:
    """The brows of textures (3, n); each has a skin and hair of its own, as faces are seldom lit alike on both sides.

    Parameters
    ----------
    reference : ReferenceFrame.
    tone : brightness of the face's skin over that of the frame's person, as both were enrolled: at most by that factor
        hair gets less or more light than skin.
    """

    def __init__(self, reference: ReferenceFrame, tone: float) -> None:
        self._brows = [_Brow(reference, brow, tone) for brow in (RIGHT_BROW, LEFT_BROW)]

    def lit_skin(self, texture: F32, gain: F32, offset: F32) -> list[F32]:
        """Brightness (b,) of bare skin in each brow's pixels under a light: gain and offset (3, n) of each pixel."""
        return [brow.lit_skin(texture, gain, offset) for brow in self._brows]

    def adjust(self, lit: F32, texture: F32, lit_skin: list[F32], light: float) -> None:
        """Darken or lighten the brows of a lit texture (3, n) in place.

        texture : (3, n) as it was.   lit_skin : see above.   light : change of brightness of what isn't skin.
        """
        for brow, skin in zip(self._brows, lit_skin, strict=True):
            brow.adjust(lit, texture, skin, light)


class _Brow:
    """One of them."""

    def __init__(self, reference: ReferenceFrame, brow: Group, tone: float) -> None:
        self._tone = tone
        core, grown, near, far = (
            soft_parts(reference, (brow,), grow)[reference.mask]
            for grow in (0.0, LIMITS.growth, *LIMITS.beside)
        )
        self._pixels = np.flatnonzero(grown > LIMITS.min_share)
        self._share = np.float32(LIMITS.strength) * grown[self._pixels]
        self._core = np.flatnonzero(core > 0.5)
        skin = skin_mask(reference)[reference.mask]
        self._beside = np.flatnonzero(skin & (far > 0.5) & (near < 0.5))

    def lit_skin(self, texture: F32, gain: F32, offset: F32) -> F32:
        skin = self._skin(texture)[:, None]
        lit = gain.take(self._pixels, 1) * skin + offset.take(self._pixels, 1)
        return np.asarray(LUMA @ lit, np.float32)

    def adjust(self, lit: F32, texture: F32, lit_skin: F32, light: float) -> None:
        own = LUMA @ texture.take(self._pixels, 1)
        skin = float(self._skin(texture) @ LUMA)
        hair = LIMITS.hair * quantile(LUMA @ texture.take(self._core, 1), LIMITS.darkest)
        of_skin = float(lit_skin.mean()) / max(skin, 1.0)
        other = self._tone * of_skin
        light = max(light, other) if self._tone < 1 else max(min(light, other), of_skin)
        share = np.clip((skin - own) / max(skin - hair, 1.0), 0, 1)
        aim = lit_skin + share * (np.minimum(hair * light, lit_skin) - lit_skin)
        brow = lit.take(self._pixels, 1)
        now = LUMA @ brow
        factor = np.clip(aim / np.maximum(now, 1.0), LIMITS.min_factor, max(self._tone, 1.0))
        lit[:, self._pixels] = brow * (1 + self._share * (factor - 1)).astype(np.float32)

    def _skin(self, texture: F32) -> F32:
        """(3,) colour of the skin beside the brow."""
        return np.asarray(texture.take(self._beside, 1).mean(1), np.float32)
