"""Learning where a person's face ends: hair, background and glasses' rims at the border stay out.

Works on the reference grid (grid pixels, RGB 0..255).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import (
    BELOW_BROWS,
    BROWS,
    LEFT_BROW,
    LEFT_EYE,
    LEFT_EYE_OUTER,
    LIPS,
    LOWER_LIP_BOTTOM,
    NOSE_TIP,
    RIGHT_BROW,
    RIGHT_BROW_TOP,
    RIGHT_EYE,
    RIGHT_EYE_OUTER,
    Group,
)
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32

Mask = NDArray[np.bool_]


def core_mask(reference: ReferenceFrame) -> Mask:
    """(h, w) bool: brows but for their ends, eyes, nose, mouth and the skin between them; always face."""
    inner = reference.points[np.r_[BROWS[1:-1], BELOW_BROWS]]
    hull = cv2.convexHull(np.round(inner).astype(np.int32))
    canvas = np.zeros(reference.size, np.uint8)
    cv2.fillConvexPoly(canvas, hull, 1)
    grow = max(1, round(0.035 * reference.resolution))
    return (_disc(canvas, grow, cv2.MORPH_DILATE) > 0) & reference.mask


def skin_mask(reference: ReferenceFrame) -> Mask:
    """(h, w) bool: cheeks, nose and forehead, where a palette is compared; no eyes, brows, lips or rim."""
    canvas = (reference.mask * 255).astype(np.uint8)
    rim = max(1, round(0.06 * reference.resolution))
    skin = _disc(np.pad(canvas, 1), rim, cv2.MORPH_ERODE)[1:-1, 1:-1] > 0
    features = np.zeros(reference.size, np.uint8)
    for part in (RIGHT_BROW, LEFT_BROW, RIGHT_EYE, LEFT_EYE, LIPS):
        cv2.fillConvexPoly(features, cv2.convexHull(np.round(reference.points[part]).astype(np.int32)), 1)
    near = _disc(features, max(1, round(0.03 * reference.resolution)), cv2.MORPH_DILATE)
    return np.asarray(skin & (near == 0))


def expressive_mask(reference: ReferenceFrame) -> F32:
    """(h, w) float32 in [0, 1]: 1 at eyes and mouth, where expression changes the texture itself, soft-edged."""
    return soft_parts(reference, (RIGHT_EYE, LEFT_EYE, LIPS), 0.03)


def soft_parts(reference: ReferenceFrame, parts: Sequence[Group], grow: float) -> F32:
    """(h, w) float32: 1 in the hulls of landmark groups, grown by a share of the face's width, soft-edged."""
    canvas = np.zeros(reference.size, np.float32)
    for part in parts:
        hull = cv2.convexHull(np.round(reference.points[part]).astype(np.int32))
        cv2.fillConvexPoly(canvas, hull, 1.0)
    wide = cv2.dilate(canvas, np.ones((3, 3), np.uint8), iterations=round(grow * reference.resolution))
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), 0.015 * reference.resolution), np.float32)


def learn_mask(textures: F32, reference: ReferenceFrame) -> Mask:
    """Face pixels (h, w) bool learned from training textures (m, n, 3).

    A rim pixel is face when its colour in most frames belongs to the palette of the person's own skin (cheeks, nose,
    central forehead: a smooth field of colours over the grid, so that shading is not mistaken for hair) and when it
    does not flicker like background.
    """
    typical = np.median(textures, axis=0)
    skin = reference.scatter(skin_mask(reference)[reference.mask].astype(np.float32))[reference.mask] > 0
    picture = reference.scatter(typical)
    expected = smooth_skin(picture, skin_mask(reference) & core_band(reference), reference)[reference.mask]
    away = _distance(
        typical,
        expected,
        typical[skin & core_band(reference)[reference.mask]]
        - expected[skin & core_band(reference)[reference.mask]],
    )
    restless = np.median(np.abs(textures - typical).mean(2), axis=0)
    calm = restless < 3.0 * max(float(np.median(restless[skin])), 1.5)
    face = np.zeros(reference.size, bool)
    face[reference.mask] = (away < 4.0) & calm
    return _tidy(face | core_mask(reference), reference)


def core_band(reference: ReferenceFrame) -> Mask:
    """(h, w) bool: from the brows down to the mouth, between the outer eye corners: skin for certain."""
    ys, xs = np.mgrid[: reference.size[0], : reference.size[1]]
    p = reference.points
    across = (xs > p[RIGHT_EYE_OUTER, 0]) & (xs < p[LEFT_EYE_OUTER, 0])
    below = ys > p[RIGHT_BROW_TOP, 1] - 0.06 * reference.resolution
    return np.asarray(across & below & (ys < p[LOWER_LIP_BOTTOM, 1]))


def smooth_skin(picture: F32, known: Mask, reference: ReferenceFrame) -> F32:
    """Colours (h, w, 3) of the known pixels as a smooth function of the place, clamped to the known range."""
    ys, xs = np.mgrid[: reference.size[0], : reference.size[1]].astype(np.float32) / reference.resolution
    x, y = xs - xs.mean(), ys - ys.mean()
    design = np.stack([np.ones_like(x), x, y, x * x], axis=-1)
    a, b = design[known], picture[known]
    for _ in range(3):
        coefficients, *_ = np.linalg.lstsq(a, b, rcond=None)
        error = np.abs(a @ coefficients - b).mean(1)
        keep = error < 2.5 * max(float(np.median(error)), 1.0)
        a, b = a[keep], b[keep]
    low, high = np.quantile(b, 0.02, axis=0), np.quantile(b, 0.98, axis=0)
    return np.asarray(np.clip(design @ coefficients, low, high), np.float32)


def _distance(colours: F32, expected: F32, sample: F32) -> NDArray[np.float64]:
    """Mahalanobis distance of colours (n, 3) from the expected ones, scaled by the sample's residuals."""
    covariance = np.cov(sample.T) + np.eye(3) * 9.0
    difference = colours - expected
    return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", difference, np.linalg.inv(covariance), difference)))


def _tidy(face: Mask, reference: ReferenceFrame) -> Mask:
    """Open, close, keep the part that holds the core, fill holes."""
    from scipy.ndimage import binary_fill_holes, label

    radius = max(1, round(0.02 * reference.resolution))
    smooth = _disc(_disc(face.astype(np.uint8), radius, cv2.MORPH_CLOSE), radius, cv2.MORPH_OPEN) > 0
    parts, _ = label(smooth | core_mask(reference))
    nose = np.round(reference.points[NOSE_TIP]).astype(int)
    kept = binary_fill_holes(parts == parts[nose[1], nose[0]])
    return np.asarray(kept & reference.mask)


def _disc(picture: NDArray[np.uint8], radius: int, operation: int) -> NDArray[np.uint8]:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.morphologyEx(picture, operation, kernel), np.uint8)
