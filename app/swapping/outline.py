"""The head's jaw line moved to where the drawn face has it, with a little of what is beside it.

Where the donor's jaw is narrower, wider, longer or shorter, the frame is warped before the face is drawn: its jaw line
goes to the drawn one, what lies beside it follows less and less with the distance, and beyond a reach every pixel stays
as it is, and so do ears and the rest of the head.  Without it the donor's face is squeezed into the person's outline.

The displacements of the jaw's points are carried to a coarse grid by normalised Gaussian weights (no system is solved,
as the jaw line of a turned head has another shape in each frame).  Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import JAW
from guise.app.media import Frame
from guise.common.arrays import F32, F64, U8


@dataclass(frozen=True)
class OutlineLimits:
    """How far from the jaw line the frame moves with it; lengths in face widths."""

    outer_reach: float = 0.28  # from the drawn jaw line, beyond which the frame stays
    inner_reach: float = 0.14  # the same towards the face
    weight_width: float = 0.06  # standard deviation, over which the jaw's points share a place
    cell: float = 0.035  # of the coarse grid
    min_move_pixels: float = 0.3  # of all points, below which nothing is done


LIMITS = OutlineLimits()
POINTS_PER_SEGMENT = 4  # of the jaw line, from which distances are measured


def warp_outline(frame: Frame, head: F64, mesh: F64, face_width: float) -> None:
    """Move the frame's jaw line, that of `head` (81, 2), to that of `mesh` (81, 2), in place."""
    moves, drawn = mesh[JAW] - head[JAW], mesh[JAW]
    if np.abs(moves).max() < LIMITS.min_move_pixels:
        return
    moving = drawn[np.linalg.norm(moves, axis=1) >= LIMITS.min_move_pixels / 2]
    reach = LIMITS.outer_reach * face_width
    x0, y0, w, h = frame.align_roi(*(moving.min(0) - reach), *(moving.max(0) + reach + 1))
    if w < 2 or h < 2:
        return
    field = displacements((h, w), drawn - (x0, y0), moves, face_width)
    frame.write_roi(x0, y0, pulled(frame.read_roi(x0, y0, w, h), field))


def displacements(size: tuple[int, int], jaw: F64, moves: F64, face_width: float) -> F32:
    """(h, w, 2) by which each pixel of a rectangle has come along with a jaw line (17, 2) that has moved by (17, 2)."""
    height, width = size
    cells = [max(2, round(side / (LIMITS.cell * face_width))) for side in (width, height)]
    xs, ys = ((np.arange(n) + 0.5) * side / n - 0.5 for n, side in zip(cells, (width, height), strict=True))
    places = np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2)
    line, along = _dense(jaw), _dense(moves)
    squared = ((places[:, None] - line) ** 2).sum(2)
    near = squared.min(1, keepdims=True)
    weights = np.exp((near - squared) / (2 * (LIMITS.weight_width * face_width) ** 2))
    moved = weights @ along / weights.sum(1, keepdims=True)
    polygon = jaw.astype(np.float32)
    inside = np.array([cv2.pointPolygonTest(polygon, (float(x), float(y)), False) > 0 for x, y in places])
    reach = np.where(inside, LIMITS.inner_reach, LIMITS.outer_reach) * face_width
    fade = np.clip(1 - near[:, 0] / reach**2, 0, 1) ** 2
    coarse = (moved * fade[:, None]).reshape(cells[1], cells[0], 2).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def pulled(picture: U8, field: F32) -> U8:
    """A picture (h, w, 3) whose pixels have come from where a field (h, w, 2) says; where it is 0 they are the same."""
    height, width = picture.shape[:2]
    places = -field
    places[..., 0] += np.arange(width, dtype=np.float32)
    places[..., 1] += np.arange(height, dtype=np.float32)[:, None]
    moved = cv2.remap(picture, places, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(moved, np.uint8)


def _dense(points: F64) -> F64:
    """Points (n, 2) with others between them on straight lines."""
    at = np.linspace(0, len(points) - 1, (len(points) - 1) * POINTS_PER_SEGMENT + 1)
    return np.column_stack([np.interp(at, np.arange(len(points)), points[:, i]) for i in (0, 1)])
