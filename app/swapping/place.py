"""Where a face is drawn on another head: the shown mask, the outline, and the proportions of a disguise.

Points and masks on the reference grid, pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.hull import beyond_hull
from guise.aam.landmarks.schemes import (
    BROW_TOPS,
    BROWS,
    FOREHEAD,
    HAIRLINE,
    JAW,
    LEFT_BROW,
    LEFT_EYE,
    LEFT_TEMPLE,
    NOSE,
    NOSE_ROOT,
    OUTLINE,
    RIGHT_BROW,
    RIGHT_EYE,
    RIGHT_TEMPLE,
)
from guise.aam.mask import soft_parts
from guise.aam.reference import POINTS, ReferenceFrame
from guise.common.arrays import F64, Bool

HAIR_RIM_FACE_WIDTHS = 0.09  # inside the hull, where the source's hair is kept
BROW_GROWTH_FACE_WIDTHS = 0.05  # around the brows, within which the source's own never show
OUTLINE_REACH_FACE_WIDTHS = 0.11  # over which the inner points follow the outline
FOREHEAD_WIDENING = 0.4  # sideways share of what is added to a forehead
OUTLINE_SHARE = 0.7  # by which the outline follows that of the head


@dataclass(frozen=True)
class DisguiseProportions:
    """By which a disguise moves the features, as shares of distances in the face itself."""

    eyes_apart: float = 0.13  # of the way from the nose's root to the temple: each eye and its brow
    brows_raised: float = 0.05  # of the way from the nose's root to the hairline


DISGUISE = DisguiseProportions()


def shown_mask(source: Bool, reference: ReferenceFrame) -> Bool:
    """Where a face is shown on the source's head (h, w): everywhere but over hair at the forehead and at the rim.

    Around the brows it is shown whatever the source's mask says, which takes the tails of dark or raised brows for
    hair; a fringe is kept in front frame by frame, see `Occlusion`.  Farther inside, below the brows, the source's mask
    doesn't count either: what it leaves out there (stubble, shadow, a lock of hair) would show the source's own face.
    The target needs no mask: its neutral face has skin where hair was.
    """
    inside = cv2.distanceTransform(np.pad(reference.mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    below = np.arange(reference.size[0])[:, None] >= reference.points[BROW_TOPS, 1].mean()
    brows = soft_parts(reference, (RIGHT_BROW, LEFT_BROW), BROW_GROWTH_FACE_WIDTHS) > 0.5
    inner = below & (inside > HAIR_RIM_FACE_WIDTHS * reference.resolution)
    return np.asarray(reference.mask & (source | inner | brows))


def outward(reference: ReferenceFrame, jaw: float, forehead: float) -> F64:
    """(81, 2) grid pixels: displacements of the outline's points out of the face; 0 for the others.

    jaw, forehead : face widths; the latter grows from zero at the temples to all of it in the middle, and leads up more
        than to the sides, where hair frames a face.
    """
    away = reference.points - reference.points[NOSE].mean(0)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    height = np.sqrt(np.sin(np.linspace(0, np.pi, len(FOREHEAD))).clip(0))
    ways = np.zeros((POINTS, 2))
    ways[JAW] = jaw * away[JAW]
    ways[FOREHEAD] = forehead * height[:, None] * (away[FOREHEAD] * (FOREHEAD_WIDENING, 0) - (0, 1))
    return reference.resolution * ways


def convex(points: F64) -> F64:
    """Points (81 + k, 2) of a drawn face with the jaw's moved out to the convex hull of all that aren't the forehead's.

    The far cheek of a turned head is seen before the line of its jaw, and the outline would have notches between them.
    """
    beyond, out = beyond_hull(points[JAW], np.delete(points, FOREHEAD, axis=0))
    made = points.copy()
    made[JAW] -= beyond[:, None] * out
    return made


def outline_pull(reference: ReferenceFrame) -> F64:
    """(81, 81) weights by which each point follows the outline of the head in the picture.

    Jaw and forehead follow by `OUTLINE_SHARE`, so that the face is about as wide as the head and no second chin shows;
    inner points follow the outline near them, less the farther away they are, so that no brow extends beyond a turned
    head.
    """
    near = np.exp(-((_to_outline(reference) * 1.5) ** 2))
    pull = np.zeros((POINTS, POINTS))
    pull[:, OUTLINE] = _bound(reference) * near / near.sum(1, keepdims=True)
    pull[OUTLINE] = np.eye(POINTS)[OUTLINE]
    return OUTLINE_SHARE * pull


def proportions(reference: ReferenceFrame) -> F64:
    """(81, 81) weights that take a face's points to those of a face with other proportions and the same outline.

    Eyes and brows lie farther apart, and the brows higher.  Every displacement is a share of a
    distance in the face itself, so that position, size and rotation in the picture don't matter and the far side of a
    turned head moves only as much as it is wide.
    """
    points = np.eye(POINTS)
    moves = np.zeros_like(points)
    for brow, eye, temple in ((RIGHT_BROW, RIGHT_EYE, RIGHT_TEMPLE), (LEFT_BROW, LEFT_EYE, LEFT_TEMPLE)):
        moves[np.r_[brow, eye]] = DISGUISE.eyes_apart * (points[temple] - points[NOSE_ROOT])
    moves[BROWS] += DISGUISE.brows_raised * (points[HAIRLINE] - points[NOSE_ROOT])
    return np.asarray(points + (1 - _bound(reference)) * moves)


def _bound(reference: ReferenceFrame) -> F64:
    """(81, 1) share in [0, 1] by which each point is bound to the outline: 1 on it, less the farther away."""
    return np.asarray(np.exp(-(_to_outline(reference).min(1) ** 2))[:, None])


def _to_outline(reference: ReferenceFrame) -> F64:
    """(81, 30) distances of the points from those of the outline, in OUTLINE_REACH_FACE_WIDTHS."""
    away = np.linalg.norm(reference.points[:, None] - reference.points[OUTLINE], axis=2)
    return np.asarray(away / (OUTLINE_REACH_FACE_WIDTHS * reference.resolution))
