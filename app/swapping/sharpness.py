"""A drawn face as sharp as the picture around it.

A donor filmed sharper than the picture, or in harder light, looks cut out and pasted on; a small or blurred one looks
painted.  So the gradients of the frame's skin before drawing are compared with those of the same pixels after it, and
the fine contrast of the texture is scaled until both are alike, within limits: a texture holds no more detail than its
donor's clip, and wrinkles are the donor's own.  What is still missing is taken from the frame (`own_skin.py`).
Pixels, x right, y down; grey levels 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.mask import FEATURE_PARTS, skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, U8, Bool


@dataclass(frozen=True)
class SharpnessLimits:
    """What is measured, how often, and how far contrast is scaled."""

    band_face_widths: float = 0.04  # standard deviation, beyond which a difference is light, not detail
    feature_share: float = 0.4  # of a lowering, by which eyes, brows and lips follow
    feature_growth_face_widths: float = 0.02  # around them, where nothing is raised
    smoothing_pixels: float = 0.7  # standard deviation, before gradients are taken
    places: int = 800  # on skin
    min_inside: float = 0.5  # share of the places that must lie in the picture
    max_excess: float = 4.0  # gradient energy of a place, of the mean, above which it's an edge
    min_energy: float = 4.0  # of gradients, grey levels squared, below which both are smooth
    slack_octaves: tuple[float, float] = (-0.1, 0.3)  # of gradient energy, by which the frame may be sharper
    own_slack_octaves: float = 0.4  # the same, above which the frame's own structure is shown
    rate: float = 0.35  # share of a difference made up for at once
    first_frames: int = 12  # of a face, each measured and made up for twice as fast
    every_frames: int = 4  # between later measurements
    gain: tuple[float, float] = (0.35, 1.2)  # least and most
    unseen_gain: float = 0.03  # from 1, within which nothing is done


LIMITS = SharpnessLimits()


class Sharpness:
    """Measures gradients of frames and scales the fine contrast of textures.

    Parameters
    ----------
    reference : ReferenceFrame.
    mask : (h, w) bool, where the face is drawn.

    Attributes
    ----------
    gain : by which fine contrast of skin is multiplied.
    own_share : in [0, 1], of the fine structure of the frame's own skin that is shown.
    """

    def __init__(self, reference: ReferenceFrame, mask: Bool) -> None:
        rng = np.random.default_rng(0)
        skin = np.flatnonzero((skin_mask(reference) & mask)[reference.mask])
        self._sampler = reference.sampler[np.sort(rng.permutation(skin)[: LIMITS.places])]
        self._lowered = 1 - np.float32(1 - LIMITS.feature_share) * soft_parts(reference, FEATURE_PARTS, 0.0)
        self._raised = 1 - soft_parts(reference, FEATURE_PARTS, LIMITS.feature_growth_face_widths)
        side = round(np.sqrt(6 * (LIMITS.band_face_widths * reference.resolution) ** 2 + 1))
        self._box = (side | 1, side | 1)  # two such means are nearly a Gaussian
        self.reset()

    def reset(self) -> None:
        """Start with the texture as it is, at the next face."""
        self._frames = 0
        self.own_share = 0.0
        self._set(1.0)

    def apply(self, picture: U8) -> U8:
        """A texture (h, w, 3) with its fine contrast scaled."""
        if abs(self.gain - 1) < LIMITS.unseen_gain:
            return picture
        smooth = cv2.blur(cv2.blur(picture, self._box), self._box)
        return np.asarray(cv2.blendLinear(picture, smooth, *self._weights), np.uint8)

    def seen(self, picture: U8) -> F32 | None:
        """Gradients of a rectangle (h, w, 3) before drawing; None in frames that aren't measured."""
        self._frames += 1
        due = self._early or self._frames % LIMITS.every_frames == 0
        return gradient_energy(picture) if due else None

    def update(self, seen: F32, drawn: U8, mesh: F64) -> None:
        """Compare what was `seen` in a rectangle with it after drawing (h, w, 3), on a mesh (81, 2) in its pixels."""
        x, y = np.round(self._sampler.positions(mesh)).astype(int).T
        h, w = seen.shape
        inside = (x >= 0) & (x < w) & (y >= 0) & (y < h)
        if inside.mean() < LIMITS.min_inside:
            return
        there, own = (_typical(e[y[inside], x[inside]]) for e in (seen, gradient_energy(drawn)))
        octaves = float(np.log2(there / own))
        beyond = octaves - float(np.clip(octaves, *LIMITS.slack_octaves))
        rate = LIMITS.rate * (2 if self._early else 1)
        self.own_share = float(np.clip(self.own_share + rate * (octaves - LIMITS.own_slack_octaves), 0, 1))
        self._set(float(np.clip(self.gain * 2 ** (rate * beyond / 2), *LIMITS.gain)))

    def _set(self, gain: float) -> None:
        self.gain = gain
        share = np.float32(gain - 1) * (self._raised if gain > 1 else self._lowered)
        self._weights = 1 + share, -share  # of a texture and of its mean

    @property
    def measured(self) -> bool:
        """Whether a frame of this face has been seen."""
        return self._frames > 0

    @property
    def _early(self) -> bool:
        return self._frames <= LIMITS.first_frames


def gradient_energy(picture: U8) -> F32:
    """(h, w) squared gradient of a picture (h, w, 3), brightness first, grey levels per pixel squared."""
    luma = cv2.GaussianBlur(cv2.extractChannel(picture, 0), (0, 0), LIMITS.smoothing_pixels)
    along, down = cv2.spatialGradient(luma)
    return np.asarray((along.astype(np.float32) ** 2 + down.astype(np.float32) ** 2) / 64, np.float32)


def _typical(energies: F32) -> float:
    """The mean of energies (n,), to which single edges add little."""
    return float(np.minimum(energies, LIMITS.max_excess * energies.mean()).mean()) + LIMITS.min_energy / 64
