"""Linear expression transfer between two appearance models, with the matrices precomputed.

y_t* = (Q_t + alpha Qbar_t) y_s minimises |y_t - y_s|^2 + phi |Qbar_t y_t|^2 with alpha = 1 / (phi + 1) (de la Hunty,
Asthana and Goecke, ICPR 2010, theorem 1; it prints Q_s, the proof gives Q_t).  With y_s = Y_s rho_s that is
M rho_s, M = alpha Y_s + (1 - alpha) Y_t (Y_t^T Y_s).

Two things are added to the paper.  Both faces are anchored on their neutral appearance, because the mean of a talking
face isn't at rest.  And what alpha lets through is gated over the face: fully for the shape and around eyes and mouth,
where expression shows in the texture; less elsewhere, where it is mostly the source's own brows and shading.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel
from guise.aam.mask import expressive_mask
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32
from guise.common.errors import GuiseError
from guise.common.kernels import COMPILED, kernel

DEFAULT_ALPHA = 0.6
DEFAULT_GATE = 0.35  # share of alpha away from eyes and mouth
BLOCK = 4096  # entries of an appearance that are mapped at a time, for the cache
MAX_NEUTRAL_YAW_DEGREES = 35.0


class ReferenceMismatchError(GuiseError):
    """Models that can't be mixed because their reference frames differ."""


class Extrapolator:
    """Maps a source model's parameters to the target's appearance.

    Anchored on the neutral faces: y = n_t + M (rho_s - rho_s,neutral), with n_t turned to the yaw of the source's
    neutral face.  Without anchoring: y = m_t + M rho_s, which carries the difference of the two mean expressions into
    every frame.

    Parameters
    ----------
    source, target : AppearanceModel with the same reference frame.
    alpha : share in [0, 1] of the expression outside the target's own space that is let through: 1 is direct
        transfer, 0 projection.
    anchored : anchor on the neutral appearances.
    gate : share in [0, 1] of alpha for texture away from eyes and mouth; 1 is the paper's formula.
    max_deviations : of the target's own modes from the anchor, to which their amounts are limited: far beyond what
        the target's clip shows (a head turned farther, say) their sum breaks up into streaks.  None for no limit.
    moving : (h, w) share in [0, 1] of the texture's movement that is shown; None for all of it.
    tone : (3,) RGB of the target's skin over that of the source's, by which the movement of the source's texture is
        scaled: on a darker skin the same shade is fewer grey levels.  None for 1.

    Raises
    ------
    ReferenceMismatchError
        When the reference frames differ.
    """

    def __init__(
        self,
        source: AppearanceModel,
        target: AppearanceModel,
        alpha: float = DEFAULT_ALPHA,
        *,
        anchored: bool = True,
        gate: float = DEFAULT_GATE,
        max_deviations: float | None = None,
        moving: F32 | None = None,
        tone: F32 | None = None,
    ) -> None:
        if source.reference.id != target.reference.id:
            raise ReferenceMismatchError(
                f"the two models have different reference frames ({source.reference.resolution} and "
                f"{target.reference.resolution} pixels across the face); enroll both with the same --resolution"
            )
        self.reference = source.reference
        self._bases = source.components.basis, target.components.basis
        self._tone = np.ones((1, 1), np.float32) if tone is None else _tones(tone, source.reference)
        self._amounts = self._bases[1].T @ (self._bases[0] * self._tone)
        self._most = None if max_deviations is None else max_deviations * target.components.deviations
        self._shown = np.ones((1, 1), np.float32) if moving is None else _weights(moving, source.reference)
        self._soft = _weights(gate + (1 - gate) * expressive_mask(source.reference), source.reference)
        self._base = turned_neutral(target, source) if anchored else target.components.mean
        self._ones = np.ones(len(self._base[SHAPE_ENTRIES:]) // 3, np.float32)
        self._rest = source.neutral_parameters if anchored else np.zeros_like(source.neutral_parameters)
        self.alpha = alpha

    @property
    def alpha(self) -> float:
        """The share let through; setting it makes M anew."""
        return self._alpha

    @alpha.setter
    def alpha(self, value: float) -> None:
        if not 0 <= value <= 1:
            raise GuiseError(f"alpha must be in [0, 1], got {value}")
        self._alpha = float(value)
        # Half floats suffice, as a term of the sum is a few grey levels, but NumPy takes long to read them.
        kind = np.float32 if COMPILED is None else np.float16
        (size, expressed_modes), taken_back = self._bases[0].shape, self._bases[1].shape[1]
        self._of_shape = self._rows(slice(SHAPE_ENTRIES)).T
        self._of_texture: NDArray[np.floating] = np.empty(
            (expressed_modes + taken_back, size - SHAPE_ENTRIES), kind
        )
        for start in range(0, self._of_texture.shape[1], BLOCK):
            block = self._of_texture[:, start : start + BLOCK]
            first = SHAPE_ENTRIES + start
            rows = self._rows(slice(first, first + block.shape[1]))
            # Which is 7 times as fast as astype.
            block[:] = rows if kind is np.float32 else cv2.add(rows, np.zeros(1), dtype=cv2.CV_16F)

    def _rows(self, entries: slice) -> F32:
        """Some columns of the transposed matrix: of the parameters, then of what is taken back of the target's modes.

        No views, which hold all of it.
        """
        source, target = (basis[entries] for basis in self._bases)
        soft, shown, tone = (
            one if len(one) == 1 else one[entries] for one in (self._soft, self._shown, self._tone)
        )
        matrix, away = target @ self._amounts, source * tone
        away -= matrix
        away *= np.float32(self._alpha) * soft
        matrix += away
        matrix *= shown
        return np.asarray(cv2.transpose(np.concatenate([matrix, -shown * target], axis=1)), np.float32)

    @property
    def matrix(self) -> F32:
        """M (n, k), of whose texture half floats are kept."""
        both = np.concatenate([self._of_shape, self._of_texture.T.astype(np.float32)])
        return both[:, : len(self._rest)]

    def apply(self, parameters: F32, share: float = 1.0, factors: F32 | None = None) -> F32:
        """Target appearance (n,) of source parameters rho_s (k,).

        share : of their way from rest that is taken.
        factors : of the texture's pixels; None for 1.
        """
        away = np.float32(share) * (parameters - self._rest)
        amounts = np.concatenate([away, self._beyond(away)])
        made = np.empty_like(self._base)
        made[:SHAPE_ENTRIES] = self._base[:SHAPE_ENTRIES] + self._of_shape @ amounts
        factors = self._ones if factors is None else factors
        expressed(self._base[SHAPE_ENTRIES:], self._of_texture, amounts, factors, made[SHAPE_ENTRIES:])
        return made

    def _beyond(self, away: F32) -> F32:
        """By how much parameters on a way from rest (k,) have more of the target's modes than they may."""
        amounts = self._amounts @ away
        if self._most is None:
            return np.zeros_like(amounts)
        return np.asarray(amounts - np.minimum(np.maximum(amounts, -self._most), self._most), np.float32)


@kernel
def expressed(base: F32, matrix: NDArray[np.floating], away: F32, factors: F32, out: F32) -> None:
    """out = (base + matrix^T away) factors: a texture (3 n,) of a base, modes (k, 3 n), amounts (k,), factors (n,)."""
    used = int(away.nonzero()[0].max(initial=-1)) + 1
    np.dot(away[:used], np.asarray(matrix[:used], np.float32), out=out)
    out += base
    out.reshape(-1, 3)[:] *= factors[:, None]


def _weights(shares: F32, reference: ReferenceFrame) -> F32:
    """(n, 1) weights of an appearance vector's entries: 1 for the shape, shares (h, w) for the texture."""
    texture = np.repeat(shares[reference.mask].astype(np.float32), 3)
    return np.concatenate([np.ones(SHAPE_ENTRIES, np.float32), texture])[:, None]


def _tones(tone: F32, reference: ReferenceFrame) -> F32:
    """(n, 1) factors of an appearance vector's entries: 1 for the shape, tone (3,) for the texture."""
    texture = np.tile(tone, len(reference.pixels))
    return np.concatenate([np.ones(SHAPE_ENTRIES, np.float32), texture])[:, None]


def turned_neutral(target: AppearanceModel, source: AppearanceModel) -> F32:
    """The target's neutral appearance with its shape turned to the yaw of the source's."""
    reference = target.reference
    yaw = np.clip(reference.yaw(source.neutral_shape), -MAX_NEUTRAL_YAW_DEGREES, MAX_NEUTRAL_YAW_DEGREES)
    yaw -= reference.yaw(target.neutral_shape)
    neutral = target.neutral.copy()
    neutral[:SHAPE_ENTRIES] += (yaw * reference.shape_weight * reference.yaw_mode).ravel().astype(np.float32)
    return neutral
