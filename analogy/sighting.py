"""Points of a face in space: where the lines of sight from many sides meet.

A pixel's surface is a poor answer for its depth: eyes are holes, nostrils are deep, and a nose hides its own wing.
The landmarker knows these points from every side, so each is placed where it is seen, whatever the surface does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks import OUTER_EYE_CORNERS, Face
from guise.aam.landmarks.schemes import IBUG68, LEFT_EYE, NOSE_TIP, OUTER_LIPS, RIGHT_EYE
from guise.aam.similarity import Failed
from guise.analogy.facing import Facing, landmarker
from guise.analogy.normals import unit
from guise.analogy.views import Solid, View
from guise.common.arrays import F64, U8

PIXELS = 160  # side of the pictures; the landmarker's own crop is 128
HALF, REACH = 1.0, 1.3  # eye widths from the middle of the face to a picture's edge; to what is drawn
# Degrees of yaw and pitch: until the head is seen from the front, and then.
FIRST = ((0, 0), (-20, 0), (20, 0), (0, 12))
THEN = tuple((yaw, pitch) for yaw in (-24, 0, 24) for pitch in (-12, 0, 12))
SETTLED, ROUNDS = 8.0, 4  # degrees, by which the front may still change; how often it is sought
LEAST = (
    0.45  # confidence of a face; heads have 0.97, those that lack a half or 10 % of their faces 0.35 to 0.8
)
DEPTH = 0.3  # what a distance in depth counts beside one across, for the nearest point of the surface
STEPS, LOOSE = 6, 1.5  # rounds of weighting, and the medians of distance at which a line weighs one half


@dataclass(frozen=True, eq=False)
class Sighted:
    """The points of scheme `face81` in space.

    Parameters
    ----------
    points : (81, 3), not on the surface but near it.   off : (v, 81) distances of the v lines of sight from them.
    axes : (3, 3) rows: to the person's left, up, forward.   eye_width : between the outer eye corners.
    confidence : the mean of the landmarker's over the pictures.   surface : what was seen of the mesh.
    """

    points: F64
    off: F64
    axes: F64
    eye_width: float
    confidence: float
    surface: Solid

    def on_surface(self, places: F64) -> F64:
        """The points (n, 3) of the surface nearest to places (n, 3), which are known less well in depth than across."""
        along = self.axes.T * (1, 1, DEPTH)
        return np.asarray(self.surface.times(along).nearest(places @ along) @ np.linalg.inv(along))


def sighted(facing: Facing) -> Sighted | Failed:
    """The points of a face that was found: seen from ever nearer to its front, then from all sides of that."""
    view, start = facing.view, None
    for _ in range(ROUNDS):
        seen = _observed(facing.solid, view, FIRST, start)
        if isinstance(seen, Failed):
            return seen
        start, before, view = seen.points, view, _frontal(seen.points)
        if _angle(before.axes, view.axes) < SETTLED:
            break
    seen = _observed(facing.solid, view, THEN, start)
    if isinstance(seen, Failed) or (_stands_out(seen) and seen.confidence >= LEAST):
        return seen
    return Failed(
        "what looks like a face on the mesh is none: it is hollow, or looks like one from few sides"
    )


def _observed(
    solid: Solid, front: View, turns: Sequence[tuple[float, float]], start: F64 | None
) -> Sighted | Failed:
    """The points as seen from `turns` about a view; `start` (81, 3), about where they are, spares the search."""
    near = solid if start is None else solid.near(front.centre, REACH / HALF * front.half)
    rows, lines, confidence, shown = [], [], 0.0, np.zeros(len(near.faces), bool)
    for yaw, pitch in turns:
        view = front.turned(yaw, pitch)
        picture, seen = near.picture(view)
        shown[seen.triangle[seen.covered]] = True
        face = _face(picture, None if start is None else view.project(start)[:, :2])
        if face is not None:
            rows.append(view.axes[:2])
            lines.append(view.unproject(face.points))
            confidence += face.confidence / len(turns)
    if len(rows) < 2:
        return Failed("what looks like a face on the mesh does so from one side only")
    points, off = meeting(np.array(rows), np.array(lines))
    return Sighted(points, off, frontal_axes(points), _width(points), confidence, near.part(shown))


def _face(picture: U8, near: F64 | None) -> Face | None:
    """The surest face of a picture, or the one with points (81, 2) near those given."""
    if near is not None:
        return landmarker().refine(picture, Face.around(near, 1.0))
    return max(landmarker().detect(picture), key=lambda face: face.confidence, default=None)


def meeting(rows: F64, lines: F64) -> tuple[F64, F64]:
    """Where lines of sight meet: points (k, 3) and the distances (v, k) of the lines from them.

    rows : (v, 2, 3) orthonormal axes of the v pictures.   lines : (v, k, 2) where each line passes along them.
    Least squares, in which lines far from the rest weigh less (Cauchy's weights).
    """
    weights = np.ones(lines.shape[:2])
    for _ in range(STEPS):
        normal = np.einsum("vk,vri,vrj->kij", weights, rows, rows)
        right = np.einsum("vk,vri,vkr->ki", weights, rows, lines)
        points = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        off = np.linalg.norm(np.einsum("vri,ki->vkr", rows, points) - lines, axis=2)
        weights = 1 / (1 + (off / np.maximum(LOOSE * np.median(off, axis=0), 1e-300)) ** 2)
    return points, off


def frontal_axes(points: F64) -> F64:
    """(3, 3) rows: to the person's left, up and forward, of points (81, 3)."""
    right, left, mouth = (points[part].mean(0) for part in (RIGHT_EYE, LEFT_EYE, OUTER_LIPS))
    across = unit(left - right)
    rise = (left + right) / 2 - mouth
    up = unit(rise - (rise @ across) * across)
    return np.stack([across, up, np.cross(across, up)])


def _stands_out(seen: Sighted) -> bool:
    """Whether the nose is before the eyes: a mask from behind looks like a face, too."""
    nose = seen.points[NOSE_TIP] - seen.points[OUTER_EYE_CORNERS].mean(0)
    return float(nose @ seen.axes[2]) > 0


def _frontal(points: F64) -> View:
    return View(frontal_axes(points), points[IBUG68].mean(0), HALF * _width(points), PIXELS)


def _width(points: F64) -> float:
    right, left = OUTER_EYE_CORNERS
    return float(np.linalg.norm(points[left] - points[right]))


def _angle(one: F64, other: F64) -> float:
    """Degrees between two sets of axes (3, 3)."""
    return float(np.degrees(np.arccos(np.clip((np.trace(one @ other.T) - 1) / 2, -1, 1))))
