"""Where a face is drawn on another head: on its pose, and the head's jaw line with it.

Where the donor's jaw is narrower, wider, longer or shorter, the frame is warped before the face is drawn: its jaw line
goes to the drawn one, what lies beside it follows less and less with the distance, and beyond a reach every pixel stays
as it is, and so do ears and the rest of the head.  Without it the donor's face is squeezed into the person's outline.
The displacements of the jaw's points are carried to a coarse grid by normalised Gaussian weights (no system is solved,
as the jaw line of a turned head has another shape in each frame).

Pixels, x right, y down; points of shapes on the reference grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    JAW,
    OUTLINE,
    RIGID_WEIGHTS,
)
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.similarity import align_planar
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.memory import Memory
from guise.app.media import Frame
from guise.common.arrays import F32, F64, U8
from guise.common.tuned import tuned


@dataclass(frozen=True)
class PlaceLimits:
    """How points follow the outline."""

    # over which the inner points follow the outline
    outline_reach: float = tuned(0.11, "face widths", "picture.truth")
    # by which the outline follows that of the head
    outline_share: float = tuned(0.7, "share", "picture.truth")


@dataclass(frozen=True)
class OutlineLimits:
    """How far from the jaw line the frame moves with it; lengths in face widths."""

    # from the drawn jaw line, beyond which the frame stays; half of that towards the face
    outer_reach: float = tuned(0.28, "face widths", "picture.truth")
    # standard deviation, over which the jaw's points share a place
    weight_width: float = tuned(0.06, "face widths", "picture.truth")
    cell: float = tuned(0.035, "face widths", "speed")  # of the coarse grid
    # of all points, below which nothing is done
    min_move_pixels: float = tuned(0.3, "pixels", "picture.truth")


LIMITS, OUTLINE_WARP = PlaceLimits(), OutlineLimits()
POINTS_PER_SEGMENT = tuned(4, "points", "picture.truth")  # of the jaw line, from which distances are measured


class Place:
    """Lays the drawn face on the head.

    Parameters
    ----------
    reference : ReferenceFrame.
    beyond : (81, 2) grid pixels, what is added at the outline, see `forehead.outward`.
    """

    def __init__(self, reference: ReferenceFrame, beyond: F64) -> None:
        self._reference, self._beyond = reference, beyond
        self._back = np.linalg.norm(beyond, axis=1, keepdims=True) / reference.resolution

    def lay(self, face: FaceInFrame, memory: Memory) -> None:
        """By the pose of the head, whose outline the shape already has.

        What is added at the outline recedes as a skull does, by as much as it grows.
        """
        fit = self._reference.to_grid(face.head).inverse
        beyond = self._beyond @ fit.linear + self._back * face.sight.across
        beyond *= face.sight.facing[:POINTS, None]
        face.mesh = fit.apply(face.shape) + beyond
        face.zoom = fit.scale

    def pull_jaw(self, face: FaceInFrame, memory: Memory) -> None:
        """Move the frame's jaw line to that of the drawn face."""
        warp_outline(face.frame, face.head, face.mesh, face.zoom * self._reference.resolution)


class RigidPlace:
    """Lays the drawn face on the head by its rigid landmarks, as the papers do, and draws it to the head's outline."""

    def __init__(self, reference: ReferenceFrame) -> None:
        self._pull = followed_outline(reference)

    def lay(self, face: FaceInFrame, memory: Memory) -> None:
        """By the points themselves."""
        fit = align_planar(face.shape, face.head, RIGID_WEIGHTS)
        mesh = fit.apply(face.shape)
        face.mesh, face.zoom = mesh + self._pull @ (face.head - mesh), fit.scale


def followed_outline(reference: ReferenceFrame) -> F64:
    """(81, 81) weights by which each point follows the outline of the head in the picture.

    Jaw and forehead follow by a share, so that the face is about as wide as the head and no second chin shows;
    inner points follow the outline near them, less the farther away they are, so that no brow extends beyond a turned
    head.
    """
    near = np.exp(-((_to_outline(reference) * 1.5) ** 2))
    pull = np.zeros((POINTS, POINTS))
    pull[:, OUTLINE] = _bound(reference) * near / near.sum(1, keepdims=True)
    pull[OUTLINE] = np.eye(POINTS)[OUTLINE]
    return LIMITS.outline_share * pull


def _bound(reference: ReferenceFrame) -> F64:
    """(81, 1) share in [0, 1] by which each point is bound to the outline: 1 on it, less the farther away."""
    return np.asarray(np.exp(-(_to_outline(reference).min(1) ** 2))[:, None])


def _to_outline(reference: ReferenceFrame) -> F64:
    """(81, 30) distances of the points from those of the outline, in reaches of it."""
    away = np.linalg.norm(reference.points[:, None] - reference.points[OUTLINE], axis=2)
    return np.asarray(away / (LIMITS.outline_reach * reference.resolution))


def warp_outline(frame: Frame, head: F64, mesh: F64, face_width: float) -> None:
    """Move the frame's jaw line, that of `head` (81, 2), to that of `mesh` (81, 2), in place."""
    moves, drawn = mesh[JAW] - head[JAW], mesh[JAW]
    if np.abs(moves).max() < OUTLINE_WARP.min_move_pixels:
        return
    moving = drawn[np.linalg.norm(moves, axis=1) >= OUTLINE_WARP.min_move_pixels / 2]
    reach = OUTLINE_WARP.outer_reach * face_width
    x0, y0, w, h = frame.align_roi(*(moving.min(0) - reach), *(moving.max(0) + reach + 1))
    if w < 2 or h < 2:
        return
    field = displacements((h, w), drawn - (x0, y0), moves, face_width)
    frame.write_roi(x0, y0, pulled(frame.read_roi(x0, y0, w, h), field))


def displacements(size: tuple[int, int], jaw: F64, moves: F64, face_width: float) -> F32:
    """(h, w, 2) by which each pixel of a rectangle has come along with a jaw line (17, 2) that has moved by (17, 2)."""
    height, width = size
    cells = [max(2, round(side / (OUTLINE_WARP.cell * face_width))) for side in (width, height)]
    xs, ys = ((np.arange(n) + 0.5) * side / n - 0.5 for n, side in zip(cells, (width, height), strict=True))
    places = np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2)
    line, along = _dense(jaw), _dense(moves)
    squared = ((places[:, None] - line) ** 2).sum(2)
    near = squared.min(1, keepdims=True)
    weights = np.exp((near - squared) / (2 * (OUTLINE_WARP.weight_width * face_width) ** 2))
    moved = weights @ along / weights.sum(1, keepdims=True)
    polygon = jaw.astype(np.float32)
    inside = np.array([cv2.pointPolygonTest(polygon, (float(x), float(y)), False) > 0 for x, y in places])
    reach = np.where(inside, OUTLINE_WARP.outer_reach / 2, OUTLINE_WARP.outer_reach) * face_width
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
