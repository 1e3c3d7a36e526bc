"""Where a person's face ends, learned from their frames: hair, background and glasses' rims at the border stay out.

Works on the reference grid (grid pixels, RGB 0..255).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

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
from guise.aam.light import skin_colours
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, U8, Bool, Int


@dataclass(frozen=True)
class MaskLimits:
    """Sizes and thresholds of the masks."""

    core_growth_face_widths: float = 0.035  # of the core beyond the hull of its landmarks
    rim_face_widths: float = 0.06  # at the hull's border that is not counted as skin
    feature_growth_face_widths: float = 0.03  # around eyes, brows and lips that is not skin
    above_brow_face_widths: float = 0.06  # up to which the core band reaches
    tidy_radius_face_widths: float = 0.02  # of opening and closing
    soft_edge_face_widths: float = 0.015  # standard deviation
    max_colour_deviations: float = 4.0  # Mahalanobis distance from the expected skin colour
    colour_noise_grey_levels: float = 3.0  # added to the deviation of skin colours
    min_parsed_share: float = 0.85  # of the face in the parsed frames, from which a pixel is given more:
    max_parsed_colour_deviations: float = 12.0
    max_fringe_share: float = 0.15  # of the face in them, below which a pixel above the brows is hair
    max_flicker_skin_medians: float = 3.0  # beyond which a pixel is background
    min_flicker_grey_levels: float = 1.5  # to which a calmer skin's flicker is raised


LIMITS = MaskLimits()
FEATURE_PARTS = RIGHT_BROW, LEFT_BROW, RIGHT_EYE, LEFT_EYE, LIPS


def core_mask(reference: ReferenceFrame) -> Bool:
    """(h, w) bool: brows but for their ends, eyes, nose, mouth and the skin between them; always face."""
    inner = reference.points[np.r_[BROWS[1:-1], BELOW_BROWS]]
    hull = cv2.convexHull(np.round(inner).astype(np.int32))
    canvas = np.zeros(reference.size, np.uint8)
    cv2.fillConvexPoly(canvas, hull, 1)
    grow = max(1, round(LIMITS.core_growth_face_widths * reference.resolution))
    return (_disc(canvas, grow, cv2.MORPH_DILATE) > 0) & reference.mask


def skin_mask(reference: ReferenceFrame, growth: float | None = None) -> Bool:
    """(h, w) bool: cheeks, nose and forehead, where a palette is compared; no eyes, brows, lips or rim.

    growth : face widths around eyes, brows and lips that are left out, too.
    """
    canvas = (reference.mask * 255).astype(np.uint8)
    rim = max(1, round(LIMITS.rim_face_widths * reference.resolution))
    skin = _disc(np.pad(canvas, 1), rim, cv2.MORPH_ERODE)[1:-1, 1:-1] > 0
    features = np.zeros(reference.size, np.uint8)
    for part in FEATURE_PARTS:
        cv2.fillConvexPoly(features, cv2.convexHull(np.round(reference.points[part]).astype(np.int32)), 1)
    growth = LIMITS.feature_growth_face_widths if growth is None else growth
    near = _disc(features, max(1, round(growth * reference.resolution)), cv2.MORPH_DILATE)
    return np.asarray(skin & (near == 0))


def expressive_mask(reference: ReferenceFrame) -> F32:
    """(h, w) float32 in [0, 1]: 1 at eyes and mouth, where expression changes the texture itself, soft-edged."""
    return soft_parts(reference, (RIGHT_EYE, LEFT_EYE, LIPS))


def soft_parts(
    reference: ReferenceFrame, parts: Sequence[Group], grow: float = LIMITS.feature_growth_face_widths
) -> F32:
    """(h, w) float32: 1 in the hulls of landmark groups, grown by a share of the face's width, soft-edged."""
    canvas = np.zeros(reference.size, np.float32)
    for part in parts:
        hull = cv2.convexHull(np.round(reference.points[part]).astype(np.int32))
        cv2.fillConvexPoly(canvas, hull, 1.0)
    wide = cv2.dilate(canvas, np.ones((3, 3), np.uint8), iterations=round(grow * reference.resolution))
    return np.asarray(
        cv2.GaussianBlur(wide, (0, 0), LIMITS.soft_edge_face_widths * reference.resolution), np.float32
    )


def beyond_mask(mask: Bool) -> tuple[Int, Int]:
    """Flat indices of the pixels outside a mask (h, w), and of the mask's pixel nearest to each.

    Its colour is continued there, so that no filter takes in the black beside a face.
    """
    _, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    inside = np.flatnonzero(mask)
    place = np.empty(int(labels.max()) + 1, np.intp)
    place[labels.ravel()[inside]] = inside
    outside = np.flatnonzero(~mask)
    return outside, place[labels.ravel()[outside]]


def learn_mask(textures: F32, reference: ReferenceFrame, parsed: F32 | None = None) -> Bool:
    """Face pixels (h, w) bool learned from training textures (m, n, 3).

    parsed : (h, w) mean share of the face in the parsed frames, or None.

    A rim pixel is face when its colour in most frames belongs to the palette of the person's own skin (cheeks, nose,
    central forehead: a smooth field of colours over the grid, so that shading is not mistaken for hair) and when it
    does not flicker like background.  What the parsing calls face in nearly all frames may differ much more: raised
    brows, shadows and a beard are no hair.  What it rarely calls face above the brows is a fringe, whatever its colour.
    """
    typical = np.median(textures, axis=0)
    skin = skin_mask(reference)
    known = skin & core_band(reference)
    expected = skin_colours(reference.scatter(typical), known, reference)[reference.mask]
    distance = _distance(typical, expected, (typical - expected)[known[reference.mask]])
    flicker = np.median(np.abs(textures - typical).mean(2), axis=0)
    usual = max(float(np.median(flicker[skin[reference.mask]])), LIMITS.min_flicker_grey_levels)
    steady = flicker < LIMITS.max_flicker_skin_medians * usual
    face = np.zeros(reference.size, bool)
    face[reference.mask] = (distance < LIMITS.max_colour_deviations) & steady
    if parsed is not None:
        sure = parsed[reference.mask] > LIMITS.min_parsed_share
        face[reference.mask] |= sure & (distance < LIMITS.max_parsed_colour_deviations)
        above = np.arange(reference.size[0])[:, None] < reference.points[BROWS, 1].min()
        face &= ~(above & (parsed < LIMITS.max_fringe_share))
    return _tidy(face | core_mask(reference), reference)


def core_band(reference: ReferenceFrame) -> Bool:
    """(h, w) bool: from the brows down to the mouth, between the outer eye corners: always skin."""
    ys, xs = np.mgrid[: reference.size[0], : reference.size[1]]
    p = reference.points
    across = (xs > p[RIGHT_EYE_OUTER, 0]) & (xs < p[LEFT_EYE_OUTER, 0])
    below = ys > p[RIGHT_BROW_TOP, 1] - LIMITS.above_brow_face_widths * reference.resolution
    return np.asarray(across & below & (ys < p[LOWER_LIP_BOTTOM, 1]))


def _distance(colours: F32, expected: F32, sample: F32) -> F64:
    """Mahalanobis distance of colours (n, 3) from the expected ones, given residuals (m, 3) of a sample of skin."""
    covariance = np.cov(sample.T) + np.eye(3) * LIMITS.colour_noise_grey_levels**2
    difference = colours - expected
    return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", difference, np.linalg.inv(covariance), difference)))


def _tidy(face: Bool, reference: ReferenceFrame) -> Bool:
    """Open, close, keep the part that holds the core, fill holes."""
    radius = max(1, round(LIMITS.tidy_radius_face_widths * reference.resolution))
    smooth = _disc(_disc(face.astype(np.uint8), radius, cv2.MORPH_CLOSE), radius, cv2.MORPH_OPEN) > 0
    parts = _parts(smooth | core_mask(reference))
    nose = np.round(reference.points[NOSE_TIP]).astype(int)
    around = _parts(np.pad(parts != parts[nose[1], nose[0]], 1, constant_values=True))
    return np.asarray((around != around[0, 0])[1:-1, 1:-1] & reference.mask)


def _parts(inside: Bool) -> Int:
    """(h, w) number of the part, connected by sides, to which each pixel inside belongs; 0 outside."""
    return np.asarray(cv2.connectedComponents(inside.astype(np.uint8), connectivity=4)[1])


def _disc(picture: U8, radius: int, operation: int) -> U8:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.morphologyEx(picture, operation, kernel), np.uint8)
