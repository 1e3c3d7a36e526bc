"""Where a face is drawn on another head: the shown mask, the outline, and the proportions of a disguise.

Points and masks on the reference grid, pixels, x right, y down.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.reference import POINTS, ReferenceFrame
from guise.common.arrays import F64

RIM = 0.09  # face widths from the hull in which the source's hair stays
REACH = 0.11  # face widths over which the inner points follow the outline
OUTLINE = np.r_[:17, 68:POINTS]  # jaw and forehead

APART = 0.09  # share of the way from the nose's root to the temple by which a disguise moves an eye and its brow out
RAISED = 0.05  # share of the way from the nose's root to the hair by which it moves the brows up
WIDER = 0.06  # share by which it enlarges the mouth


def shown_mask(source: NDArray[np.bool_], frame: ReferenceFrame) -> NDArray[np.bool_]:
    """Where a face is shown on the source's head (h, w): all of it, but not over hair at the forehead and at the rim.

    Farther inside, below the brows, the source's mask does not count: what it leaves out there (stubble, shadow, a lock
    of hair) would show the source's own face.  The target needs no mask: its neutral face is bare skin where hair was.
    """
    inside = cv2.distanceTransform(np.pad(frame.mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    below = np.arange(frame.size[0])[:, None] >= frame.points[[19, 24], 1].mean()
    return np.asarray(frame.mask & (source | (below & (inside > RIM * frame.resolution))))


def outward(frame: ReferenceFrame, jaw: float, forehead: float) -> F64:
    """(81, 2) grid pixels: the ways out of the face for the points of its outline; 0 for the others.

    jaw, forehead : face widths; the latter from none at the temples to all in the middle.
    """
    away = frame.points[OUTLINE] - frame.points[27:36].mean(0)
    height = np.sqrt(np.sin(np.linspace(0, np.pi, POINTS - 68)).clip(0))
    reach = frame.resolution * np.concatenate([np.full(17, jaw), forehead * height])
    ways = np.zeros((POINTS, 2))
    ways[OUTLINE] = reach[:, None] * away / np.linalg.norm(away, axis=1, keepdims=True)
    return ways


def outline_pull(frame: ReferenceFrame) -> F64:
    """(81, 81) weights by which each point follows the outline of the head in the picture.

    Jaw and forehead follow in full, so that the face is as wide as the head and no second chin shows; inner points
    follow the outline near them, less the farther they are, so that no brow reaches past a turned head.
    """
    near = np.exp(-((_to_outline(frame) * 1.5) ** 2))
    pull = np.zeros((POINTS, POINTS))
    pull[:, OUTLINE] = _bound(frame) * near / near.sum(1, keepdims=True)
    pull[OUTLINE] = np.eye(POINTS)[OUTLINE]
    return pull


def proportions(frame: ReferenceFrame) -> F64:
    """(81, 81) weights that take a face's points to those of a face with other proportions and the same outline.

    Eyes and brows lie farther apart, the brows higher, and the mouth is larger.  Every move is a share of a way along
    the face itself, so that place, size and turn in the picture do not matter and the far side of a turned head moves
    as little as it is wide.
    """
    points = np.eye(POINTS)
    moves = np.zeros_like(points)
    for side, temple in ((np.r_[17:22, 36:42], 0), (np.r_[22:27, 42:48], 16)):
        moves[side] = APART * (points[temple] - points[27])
    moves[17:27] += RAISED * (points[74] - points[27])
    moves[48:68] = WIDER * (points[48:68] - points[48:68].mean(0))
    return np.asarray(points + (1 - _bound(frame)) * moves)


def _bound(frame: ReferenceFrame) -> F64:
    """(81, 1) share in [0, 1] by which each point is bound to the outline: 1 on it, less the farther it is."""
    return np.asarray(np.exp(-(_to_outline(frame).min(1) ** 2))[:, None])


def _to_outline(frame: ReferenceFrame) -> F64:
    """(81, 30) distances of the points from those of the outline, in REACH."""
    away = np.linalg.norm(frame.points[:, None] - frame.points[OUTLINE], axis=2)
    return np.asarray(away / (REACH * frame.resolution))
