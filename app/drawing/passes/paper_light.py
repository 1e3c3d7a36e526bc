"""Light by the papers' similarity of colours.

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
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.memory import Memory
from guise.common.arrays import F32, F64, Bool, Floating, Int
from guise.common.decay import FRAME_SECONDS, Decay
from guise.common.tuned import derived

QUADRATIC_FIELDS = derived(
    6, "fields", "1, x, y, x², xy and y²: the leading fields are those of `quadratic_fields`"
)


@dataclass(frozen=True)
class PaperLightLimits:
    """How the palette is fitted and how far it may go."""

    # of colour that the slopes of the light keep
    slope_tint: float = derived(0.4, "share", "a choice: the papers leave it open")
    memory: Decay = derived(
        Decay(0.72, 2 * FRAME_SECONDS), "share over seconds", "a choice: the papers leave it open"
    )
    # from one update to the next: light changes slowly
    update_seconds: float = derived(2 * FRAME_SECONDS, "seconds", "a choice: the papers leave it open")
    # a change of light by more isn't noise and is followed at once
    light_jump_grey_levels: float = derived(10.0, "grey levels", "a choice: the papers leave it open")
    rotation_prior: float = 1.0  # pull of the colours' rotation towards the identity
    # range of the similarity's scale
    contrast: tuple[float, float] = derived((0.9, 1.5), "ratio", "a choice: the papers leave it open")
    # range of the ratio of two lights
    light_ratio: tuple[float, float] = derived((0.5, 2.0), "ratio", "a choice: the papers leave it open")
    # above the brightest skin, so that teeth and eyes don't glow
    highlight_slope: float = derived(0.35, "ratio", "a choice: the papers leave it open")
    brightest_skin_quantile: float = derived(0.98, "quantile", "a choice: the papers leave it open")
    # damping per texel of the quadratic terms; a tenth of it of the levels of eyes and mouth
    ridge: float = derived(1e-3, "ratio", "a choice: the papers leave it open")


LIMITS = PaperLightLimits()


class PaperLight:
    """A similarity of colours and smooth fields, smooth in time.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : (t,) indices into the reference frame's mask pixels, where colours are compared.
    mask : (h, w) bool, where the face is shown.
    scale : of the colour similarity; "least-squares" is the paper's.
    """

    def __init__(
        self, reference: ReferenceFrame, texels: Int, mask: Bool, scale: Scale = "symmetric"
    ) -> None:
        self._scale: Scale = scale
        field, self._texels = _fields(reference), texels
        shown = mask[reference.mask][texels]
        self._shown = np.flatnonzero(shown)
        self._skin = np.flatnonzero(shown & skin_mask(reference)[reference.mask][texels])
        self._planes = np.ascontiguousarray(field.T)
        at = field[texels].astype(np.float64)
        inner = at[:, QUADRATIC_FIELDS:].max(1) > 0.5
        self._fitted = np.union1d(self._skin, np.flatnonzero(inner))
        known = at[self._fitted]
        ridge = LIMITS.ridge * len(known) * np.diag([0, 0, 0, 1, 1, 1, 0.1, 0.1])
        self._solve = np.linalg.solve(known.T @ known + ridge, known.T)
        self._at_shown = at[self._shown]

    def measure(self, face: FaceInFrame, memory: Memory) -> None:
        """Move towards the mapping from the face's colours to what the frame shows."""
        kept, clock = memory.paper_light, memory.clock
        if not face.seen or not clock.is_due(kept.updated + LIMITS.update_seconds):
            return
        face_rgb, seen = face.canvas.texture[self._texels], face.seen.rgb
        own, there = (_with_grey_slopes(self._solve @ rgb[self._fitted]) for rgb in (face_rgb, seen))
        levels = own[QUADRATIC_FIELDS:]
        there[QUADRATIC_FIELDS:] = _grey(there[QUADRATIC_FIELDS:]) + levels - _grey(levels)
        keep = 0.0
        if kept.own is not None and kept.there is not None:
            jump = (there[0] - kept.there[0]).mean() / LIMITS.light_jump_grey_levels
            keep = LIMITS.memory.over(clock.now - kept.updated) * float(np.exp(-(jump**2)))
            own, there = keep * kept.own + (1 - keep) * own, keep * kept.there + (1 - keep) * there
        kept.own, kept.there, kept.updated = own, there, clock.now
        own, there = self._at_shown @ own, self._at_shown @ there
        gain = _ratio(own.mean(1), there.mean(1))[:, None]
        found = align(
            gain * (face_rgb[self._shown] - own), seen[self._shown] - there, scale=self._scale,
            prior=LIMITS.rotation_prior,
        )  # fmt: skip
        if isinstance(found, Similarity):
            linear = float(np.clip(found.scale, *LIMITS.contrast)) * found.rotation
            kept.linear = keep * kept.linear + (1 - keep) * linear
        kept.bright = keep * kept.bright + (1 - keep) * _brightest(seen[self._skin].mean(1))

    def apply(self, face: FaceInFrame, memory: Memory) -> None:
        """Put the face's texture into the frame's light and colours."""
        kept, canvas, colour = memory.paper_light, face.canvas, face.frame.yuv
        assert kept.own is not None
        assert kept.there is not None
        to_stored, offset = colour.from_rgb[:, :3], colour.from_rgb[:, 3]
        matrix = to_stored @ kept.linear
        light = kept.there @ to_stored.T
        light[0] += offset
        greys = kept.own.mean(1), kept.there.mean(1)
        fields = (
            np.concatenate([(kept.own @ matrix.T).T, light.T, np.stack(greys)]).astype(np.float32)
            @ self._planes
        )
        out = matrix.astype(np.float32) @ canvas.texture.T
        out -= fields[:3]
        out *= _ratio(fields[6], fields[7])
        out += fields[3:6]
        knee = np.float32(kept.bright * to_stored[0].sum() + offset[0])
        out[0] -= np.float32(1 - LIMITS.highlight_slope) * np.maximum(out[0] - knee, 0)
        canvas.planes = np.asarray(out, np.float32)
        grey = float(kept.linear.sum() / 3) * float(_ratio(kept.own[0].mean(), kept.there[0].mean()))
        canvas.contrast = grey * float(to_stored[0].sum())


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
