"""Light over a face: per channel a smooth field, a polynomial in the place on the reference grid.

Light scales what it falls on, so two lights are compared by the ratio of their fields.  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, Bool, Floating

LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # weights of R, G and B (BT.601)
BLACK_GREY_LEVELS = 8  # added before a ratio is taken, as near-black says nothing of the light


@dataclass(frozen=True)
class SkinFit:
    """The robust fit of `skin_colours`."""

    rounds: int = 3
    max_error_medians: float = 2.5  # beyond which a pixel is left out of the next round
    kept_quantiles: tuple[float, float] = (0.02, 0.98)  # to which colours are clamped


SKIN_FIT = SkinFit()


def grid_places(reference: ReferenceFrame) -> F64:
    """(n, 2) places x, y of the mask's pixels, in face widths from the middle of the grid."""
    ys, xs = np.divmod(reference.pixels, reference.size[1])
    middle = np.array(reference.size[::-1]) / 2
    return np.asarray((np.column_stack([xs, ys]) - middle) / reference.resolution)


def quadratic_fields(reference: ReferenceFrame) -> F64:
    """(n, 6): 1, x, y, x^2, x y, y^2 at `grid_places`; a light field is a linear combination of them."""
    x, y = grid_places(reference).T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def light_ratio(light: Floating, other: Floating, limits: tuple[float, float]) -> Floating:
    """other / light, elementwise, within limits."""
    return np.asarray(
        np.clip((other + BLACK_GREY_LEVELS) / np.maximum(light + BLACK_GREY_LEVELS, 1), *limits)
    )


def equalised_light(
    textures: F32, skin: Bool, reference: ReferenceFrame, limits: tuple[float, float] = (0.25, 4.0)
) -> F32:
    """Textures (t, n, 3) as if all had been taken in their mean light, fitted to the skin (n,) of each.

    limits : of the ratio of two lights.
    """
    fields = quadratic_fields(reference)
    solve = np.linalg.pinv(fields[skin])
    mean = fields @ (solve @ textures[:, skin].mean(0))
    equalised = np.empty_like(textures)
    for texture, out in zip(textures, equalised, strict=True):
        out[:] = texture * light_ratio(fields @ (solve @ texture[skin]), mean, limits)
    return equalised


def skin_colours(picture: F32, known: Bool, reference: ReferenceFrame) -> F32:
    """Colours (h, w, 3) of known skin as a smooth function of the place, clamped to the range of the known colours."""
    ys, xs = np.mgrid[: reference.size[0], : reference.size[1]].astype(np.float32) / reference.resolution
    x, y = xs - xs.mean(), ys - ys.mean()
    fields = np.stack([np.ones_like(x), x, y, x * x], axis=-1)
    a, b = fields[known], picture[known]
    for _ in range(SKIN_FIT.rounds):
        coefficients, *_ = np.linalg.lstsq(a, b, rcond=None)
        error = np.abs(a @ coefficients - b).mean(1)
        keep = error < SKIN_FIT.max_error_medians * max(float(np.median(error)), 1.0)
        a, b = a[keep], b[keep]
    low, high = (np.quantile(b, q, axis=0) for q in SKIN_FIT.kept_quantiles)
    return np.asarray(np.clip(fields @ coefficients, low, high), np.float32)
