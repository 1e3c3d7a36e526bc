"""The colour similarity from the face's palette to the frame's, with the frame's light over the face.

Light over a face is a smooth field: per channel a quadratic in the place on the reference grid, fitted to skin, with
levels of their own for the eyes and for the inside of the mouth (teeth do not darken with the skin); its slopes keep
little colour, and eyes and mouth keep the donor's.  The donor's own
field is taken off; what remains (brows, lips, folds) is scaled by the ratio of the two fields, as light scales what it
falls on, and carried by a similarity of colours (de la Hunty, Asthana and Goecke 2010, section 3.2, with the symmetric
scale); then the field that the frame shows is put on.  RGB 0..255.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Scale, Similarity, align
from guise.common.arrays import F32, F64

QUADRATIC = 6  # leading fields
TINT = 0.4  # share of colour that the slopes of the light keep
MEMORY = 0.72  # share that stays from update to update
EVERY = 2  # frames to an update: light changes slowly
JUMP = 10.0  # grey levels; a change of light by more is no noise and is followed at once
PRIOR = 1.0  # pull of the rotation towards none
CONTRAST = (0.9, 1.5)  # range of the scale
GAIN = (0.5, 2.0)  # range of the ratio of the fields
KNEE = 0.35  # slope above the brightest skin, so that teeth and eyes do not glow


class Palette:
    """Fits once per frame, smooth in time; applies to whole textures.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : (t,) indices into the frame's mask pixels: where colours are compared.
    mask : (h, w) bool, where the face is shown.
    scale : of the colour similarity.
    """

    def __init__(
        self, reference: ReferenceFrame, texels: NDArray[np.intp], mask: NDArray[np.bool_], scale: Scale
    ) -> None:
        self._scale: Scale = scale
        self._field = _fields(reference)
        shown = mask[reference.mask][texels]
        self._shown = np.flatnonzero(shown)
        self._skin = np.flatnonzero(shown & skin_mask(reference)[reference.mask][texels])
        self._planes = np.ascontiguousarray(self._field.T)
        self._at = self._field[texels].astype(np.float64)
        inner = self._at[:, QUADRATIC:].max(1) > 0.5
        self._fitted = np.union1d(self._skin, np.flatnonzero(inner))
        known = self._at[self._fitted]
        ridge = 1e-3 * len(known) * np.diag([0, 0, 0, 1, 1, 1, 0.1, 0.1])
        self._solve = np.linalg.solve(known.T @ known + ridge, known.T)
        self._at_shown = self._at[self._shown]
        self.forget()

    def forget(self) -> None:
        """The next update is taken as it is."""
        fields = self._field.shape[1]
        self._linear, self._own, self._there = np.eye(3), np.zeros((fields, 3)), np.zeros((fields, 3))
        self._bright, self._fresh, self._frames = 255.0, True, 0

    @property
    def contrast(self) -> float:
        """Scale of grey differences on skin."""
        return float(self._linear.sum() / 3) * float(_gain(self._own[0].mean(), self._there[0].mean()))

    def update(self, face: F32, seen: F32) -> None:
        """Move towards what takes the face's RGB (t, 3) to what the frame shows (t, 3), both at the texels.

        Every second frame only, once there is a first answer.
        """
        self._frames += 1
        if self._frames % EVERY and not self._fresh:
            return
        keep = 0.0 if self._fresh else MEMORY
        own, there = _toned(self._solve @ face[self._fitted]), _toned(self._solve @ seen[self._fitted])
        there[QUADRATIC:] = _grey(there[QUADRATIC:]) + own[QUADRATIC:] - _grey(own[QUADRATIC:])
        keep *= float(np.exp(-(((there[0] - self._there[0]).mean() / JUMP) ** 2)))
        self._own = keep * self._own + (1 - keep) * own
        self._there = keep * self._there + (1 - keep) * there
        own, there = self._at_shown @ self._own, self._at_shown @ self._there
        gain = _gain(own.mean(1), there.mean(1))[:, None]
        found = align(
            gain * (face[self._shown] - own), seen[self._shown] - there, scale=self._scale, prior=PRIOR
        )
        if isinstance(found, Similarity):
            linear = float(np.clip(found.scale, *CONTRAST)) * found.rotation
            self._linear = keep * self._linear + (1 - keep) * linear
        bright = _upper(seen[self._skin].mean(1))
        self._bright = keep * self._bright + (1 - keep) * bright
        self._fresh = False

    def apply(self, texture: F32, to_stored: F32, offset: F32) -> F32:
        """A texture (n, 3) RGB in the frame's palette, as planes (3, n) float32 of the frame's stored components.

        to_stored (3, 3), offset (3,) : RGB to stored components; the first of them is brightness.
        """
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
        out *= _gain(fields[6], fields[7])
        out += fields[3:6]
        knee = np.float32(self._bright * to_stored[0].sum() + offset[0])
        out[0] -= np.float32(1 - KNEE) * np.maximum(out[0] - knee, 0)
        return np.asarray(out, np.float32)


def _toned(fields: F64) -> F64:
    """Fields (8, 3) with less colour in their slopes: slopes of colour would give one head two eye colours."""
    slopes = fields[1:QUADRATIC]
    fields[1:QUADRATIC] = _grey(slopes) + TINT * (slopes - _grey(slopes))
    return fields


def _grey(colours: F64) -> F64:
    return np.asarray(colours.mean(1, keepdims=True))


def _upper(values: F32) -> float:
    """The value that 2 % exceed."""
    place = int(0.98 * (len(values) - 1))
    return float(np.partition(values, place)[place])


def _gain(own: NDArray[np.floating], there: NDArray[np.floating]) -> NDArray[np.floating]:
    """Ratio of two grey fields, kept in range; black does not count."""
    return np.asarray(np.clip((there + 8) / np.maximum(own + 8, 1), *GAIN))


def _fields(reference: ReferenceFrame) -> F32:
    """(n, 8): 1, x, y, x^2, x y, y^2 over the mask pixels, in face widths from the middle; eyes; inner mouth."""
    ys, xs = np.divmod(reference.pixels, reference.size[1])
    x = (xs - reference.size[1] / 2) / reference.resolution
    y = (ys - reference.size[0] / 2) / reference.resolution
    eyes = soft_parts(reference, (RIGHT_EYE, LEFT_EYE), 0.0)[reference.mask]
    mouth = soft_parts(reference, (INNER_LIPS,), 0.0)[reference.mask]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, eyes, mouth], axis=1).astype(np.float32)
