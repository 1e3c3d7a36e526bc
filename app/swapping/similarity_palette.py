"""The colour similarity from the face's palette to the frame's, with the frame's light over the face.

Light over a face is a smooth field (`guise.aam.light`) fitted to skin, with separate levels for the eyes and for the
inside of the mouth (teeth don't darken with the skin); its slopes keep little colour, and eyes and mouth keep the
donor's.  The donor's own field is subtracted; what remains (brows, lips, folds) is scaled by the ratio of the two
fields, as light scales what it falls on, and mapped by a similarity of colours (de la Hunty, Asthana and Goecke 2010,
section 3.2, with the symmetric scale); then the field that the frame shows is added.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE
from guise.aam.light import light_ratio, quadratic_fields
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Scale, Similarity, align
from guise.common.arrays import F32, F64, Bool, Floating, Int

QUADRATIC_FIELDS = 6  # leading fields: those of `quadratic_fields`


@dataclass(frozen=True)
class PaletteLimits:
    """How the palette is fitted and how far it may go."""

    slope_tint: float = 0.4  # share of colour that the slopes of the light keep
    memory: float = 0.72  # share kept from update to update
    update_interval_frames: int = 2  # light changes slowly
    light_jump_grey_levels: float = 10.0  # a change of light by more isn't noise and is followed at once
    rotation_prior: float = 1.0  # pull of the colours' rotation towards the identity
    contrast: tuple[float, float] = (0.9, 1.5)  # range of the similarity's scale
    light_ratio: tuple[float, float] = (0.5, 2.0)  # range of the ratio of two lights
    highlight_slope: float = 0.35  # above the brightest skin, so that teeth and eyes don't glow
    brightest_skin_quantile: float = 0.98
    min_visible: float = 1e-3  # as which less counts
    whole_visible: float = 0.9  # of each texel, from which all count alike
    ridge: float = (
        1e-3  # damping per texel of the quadratic terms; a tenth of it of the levels of eyes and mouth
    )


LIMITS = PaletteLimits()


class SimilarityPalette:
    """A `Palette` of a similarity and smooth fields, smooth in time.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : (t,) indices into the reference frame's mask pixels, where colours are compared.
    mask : (h, w) bool, where the face is shown.
    scale : of the colour similarity.
    """

    def __init__(self, reference: ReferenceFrame, texels: Int, mask: Bool, scale: Scale) -> None:
        self._scale: Scale = scale
        self._field = _fields(reference)
        shown = mask[reference.mask][texels]
        self._shown = np.flatnonzero(shown)
        self._skin = np.flatnonzero(shown & skin_mask(reference)[reference.mask][texels])
        self._planes = np.ascontiguousarray(self._field.T)
        self._at = self._field[texels].astype(np.float64)
        inner = self._at[:, QUADRATIC_FIELDS:].max(1) > 0.5
        self._fitted = np.union1d(self._skin, np.flatnonzero(inner))
        self._solve = self._solver(np.ones(len(self._at)))
        self._at_shown = self._at[self._shown]
        self.reset()

    def reset(self) -> None:
        """The next update is taken as it is."""
        fields = self._field.shape[1]
        self._linear, self._own, self._there = np.eye(3), np.zeros((fields, 3)), np.zeros((fields, 3))
        self._bright, self._fresh, self._frames = 255.0, True, 0

    @property
    def contrast(self) -> float:
        """Scale of grey differences on skin."""
        return float(self._linear.sum() / 3) * float(_ratio(self._own[0].mean(), self._there[0].mean()))

    def update(self, face: F32, seen: F32, visible: F32 | None = None) -> None:
        """See `Palette.update`; after the first update only every second frame counts."""
        self._frames += 1
        if self._frames % LIMITS.update_interval_frames and not self._fresh:
            return
        keep = 0.0 if self._fresh else LIMITS.memory
        weights = np.ones(len(seen)) if visible is None else np.maximum(visible, LIMITS.min_visible)
        whole = float(weights.min()) >= LIMITS.whole_visible
        solve = self._solve if whole else self._solver(weights)
        own, there = (_with_grey_slopes(solve @ rgb[self._fitted]) for rgb in (face, seen))
        levels = own[QUADRATIC_FIELDS:]
        there[QUADRATIC_FIELDS:] = _grey(there[QUADRATIC_FIELDS:]) + levels - _grey(levels)
        keep *= float(np.exp(-(((there[0] - self._there[0]).mean() / LIMITS.light_jump_grey_levels) ** 2)))
        self._own = keep * self._own + (1 - keep) * own
        self._there = keep * self._there + (1 - keep) * there
        own, there = self._at_shown @ self._own, self._at_shown @ self._there
        gain = _ratio(own.mean(1), there.mean(1))[:, None]
        found = align(
            gain * (face[self._shown] - own),
            seen[self._shown] - there,
            None if whole else weights[self._shown],
            scale=self._scale,
            prior=LIMITS.rotation_prior,
        )
        if isinstance(found, Similarity):
            linear = float(np.clip(found.scale, *LIMITS.contrast)) * found.rotation
            self._linear = keep * self._linear + (1 - keep) * linear
        skin = self._skin[weights[self._skin] > 0.5] if not whole else self._skin
        bright = _brightest(seen[skin].mean(1)) if len(skin) else self._bright
        self._bright = keep * self._bright + (1 - keep) * bright
        self._fresh = False

    def _solver(self, weights: F64) -> F64:
        """(8, m) from the fitted texels' values to the fields, where texels have weights (t,)."""
        known = self._at[self._fitted]
        weighted = known.T * weights[self._fitted]
        ridge = LIMITS.ridge * len(known) * np.diag([0, 0, 0, 1, 1, 1, 0.1, 0.1])
        return np.asarray(np.linalg.solve(weighted @ known + ridge, weighted))

    def apply(self, texture: F32, to_stored: F32, offset: F32) -> F32:
        """See `Palette.apply`."""
        matrix = to_stored @ self._linear
        light = self._there @ to_stored.T
        light[0] += offset
        greys = self._own.mean(1), self._there.mean(1)
        fields = (
            np.concatenate([(self._own @ matrix.T).T, light.T, np.stack(greys)]).astype(np.float32)
            @ self._planes
        )
        out = matrix.astype(np.float32) @ texture.T
        out -= fields[:3]
        out *= _ratio(fields[6], fields[7])
        out += fields[3:6]
        knee = np.float32(self._bright * to_stored[0].sum() + offset[0])
        out[0] -= np.float32(1 - LIMITS.highlight_slope) * np.maximum(out[0] - knee, 0)
        return np.asarray(out, np.float32)


def _with_grey_slopes(fields: F64) -> F64:
    """Fields (8, 3) with less colour in their slopes: slopes of colour would give one head two eye colours."""
    slopes = fields[1:QUADRATIC_FIELDS]
    fields[1:QUADRATIC_FIELDS] = _grey(slopes) + LIMITS.slope_tint * (slopes - _grey(slopes))
    return fields


def _grey(colours: F64) -> F64:
    return np.asarray(colours.mean(1, keepdims=True))


def _brightest(values: F32) -> float:
    """The value at `brightest_skin_quantile`."""
    place = int(LIMITS.brightest_skin_quantile * (len(values) - 1))
    return float(np.partition(values, place)[place])


def _ratio(own: Floating, there: Floating) -> Floating:
    """Ratio of two grey fields, within range."""
    return light_ratio(own, there, LIMITS.light_ratio)


def _fields(reference: ReferenceFrame) -> F32:
    """(n, 8): `quadratic_fields`, eyes and inner mouth over the mask pixels."""
    eyes = soft_parts(reference, (RIGHT_EYE, LEFT_EYE), 0.0)[reference.mask]
    mouth = soft_parts(reference, (INNER_LIPS,), 0.0)[reference.mask]
    return np.column_stack([quadratic_fields(reference), eyes, mouth]).astype(np.float32)
