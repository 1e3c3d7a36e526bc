"""Landmarks of a face in space, triangulated from pictures from many sides.

The surface under a pixel is a poor estimate of depth: eyes are holes, nostrils are deep, and a nose hides its own wing.
The landmarker knows the points from every side, so each is triangulated, whatever the surface does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks import OUTER_EYE_CORNERS, Face
from guise.aam.landmarks.schemes import IBUG68, LEFT_EYE, NOSE_TIP, OUTER_LIPS, RIGHT_EYE
from guise.aam.similarity import Failed
from guise.analogy.face_views import FaceView, landmarker
from guise.analogy.normals import unit_vectors
from guise.analogy.rigid import rotation_angle
from guise.analogy.views import OrthographicView, ViewedMesh
from guise.common.arrays import F64, U8


@dataclass(frozen=True)
class TriangulationSettings:
    """Settings of the triangulation; eye widths are from outer corner to outer corner."""

    picture_px: int = 160  # side of the pictures; the landmarker's own crop is 128
    view_half_eye_widths: float = 1.0  # from the middle of the face to a picture's edge
    crop_eye_widths: float = 1.3  # from there to what is drawn
    settled_angle_deg: float = 8.0  # by which the frontal view may still change
    max_frontal_rounds: int = 4  # in which the frontal view is sought
    min_confidence: float = 0.45  # heads have 0.97; with a half or 10 % of the faces missing 0.35 to 0.8
    depth_weight: float = 0.3  # of distance in depth beside distance across
    reweighting_rounds: int = 6
    half_weight_medians: float = 1.5  # median distances at which a line of sight weighs a half


TRIANGULATION = TriangulationSettings()
# Degrees of yaw and pitch: until the head is seen from the front, and then.
FRONTAL_VIEWS = ((0, 0), (-20, 0), (20, 0), (0, 12))
SURROUNDING_VIEWS = tuple((yaw, pitch) for yaw in (-24, 0, 24) for pitch in (-12, 0, 12))


@dataclass(frozen=True, eq=False)
class TriangulatedFace:
    """The landmarks of scheme `face81` in space.

    Parameters
    ----------
    points : (81, 3), not on the surface but near it.   distances : (v, 81) distances of the v lines of sight from them.
    axes : (3, 3) rows: to the person's left, up, forward.   eye_width : between the outer eye corners.
    confidence : of the landmarker, mean over the pictures.   surface : the visible part of the mesh.
    """

    points: F64
    distances: F64
    axes: F64
    eye_width: float
    confidence: float
    surface: ViewedMesh

    def on_surface(self, places: F64) -> F64:
        """Points (n, 3) of the surface nearest to positions (n, 3); depth, which is less certain, counts less."""
        along = self.axes.T * (1, 1, TRIANGULATION.depth_weight)
        return np.asarray(
            self.surface.transformed(along).closest_points(places @ along) @ np.linalg.inv(along)
        )


def triangulate_face(facing: FaceView) -> TriangulatedFace | Failed:
    """Triangulate a face: find its frontal view step by step, then look from all sides of it."""
    view, start = facing.view, None
    for _ in range(TRIANGULATION.max_frontal_rounds):
        seen = _triangulate(facing.solid, view, FRONTAL_VIEWS, start)
        if isinstance(seen, Failed):
            return seen
        start, before, view = seen.points, view, _frontal_view(seen.points)
        if rotation_angle(before.axes @ view.axes.T) < TRIANGULATION.settled_angle_deg:
            break
    seen = _triangulate(facing.solid, view, SURROUNDING_VIEWS, start)
    if isinstance(seen, Failed) or (
        _has_protruding_nose(seen) and seen.confidence >= TRIANGULATION.min_confidence
    ):
        return seen
    return Failed(
        "what looks like a face on the mesh is not one: it is hollow, or looks like a face from few sides only"
    )


def _triangulate(
    solid: ViewedMesh, front: OrthographicView, turns: Sequence[tuple[float, float]], start: F64 | None
) -> TriangulatedFace | Failed:
    """The points as seen from `turns` about a view; `start` (81, 3), about where they are, spares the search."""
    near = (
        solid
        if start is None
        else solid.crop(
            front.centre, TRIANGULATION.crop_eye_widths / TRIANGULATION.view_half_eye_widths * front.half
        )
    )
    rows, lines, confidence, shown = [], [], 0.0, np.zeros(len(near.faces), bool)
    for yaw, pitch in turns:
        view = front.rotated(yaw, pitch)
        picture, seen = near.render(view)
        shown[seen.triangle[seen.covered]] = True
        face = _detect_face(picture, None if start is None else view.project(start)[:, :2])
        if face is not None:
            rows.append(view.axes[:2])
            lines.append(view.unproject(face.points))
            confidence += face.confidence / len(turns)
    if len(rows) < 2:
        return Failed("what looks like a face on the mesh does so from one side only")
    points, off = intersect_lines(np.array(rows), np.array(lines))
    return TriangulatedFace(
        points, off, frontal_axes(points), _eye_width(points), confidence, near.submesh(shown)
    )


def _detect_face(picture: U8, near: F64 | None) -> Face | None:
    """The most confident face of a picture, or the one near given landmarks (81, 2)."""
    if near is not None:
        return landmarker().refine(picture, Face.around(near, 1.0))
    return max(landmarker().detect(picture), key=lambda face: face.confidence, default=None)


def intersect_lines(rows: F64, lines: F64) -> tuple[F64, F64]:
    """Points (k, 3) closest to lines of sight, and the distances (v, k) of the lines from them.

    rows : (v, 2, 3) orthonormal axes of the v pictures.   lines : (v, k, 2) where each line passes along them.
    Least squares with Cauchy weights: lines far from the others count less.
    """
    weights = np.ones(lines.shape[:2])
    for _ in range(TRIANGULATION.reweighting_rounds):
        normal = np.einsum("vk,vri,vrj->kij", weights, rows, rows)
        right = np.einsum("vk,vri,vkr->ki", weights, rows, lines)
        points = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        off = np.linalg.norm(np.einsum("vri,ki->vkr", rows, points) - lines, axis=2)
        weights = 1 / (
            1 + (off / np.maximum(TRIANGULATION.half_weight_medians * np.median(off, axis=0), 1e-300)) ** 2
        )
    return points, off


def frontal_axes(points: F64) -> F64:
    """(3, 3) rows: to the person's left, up and forward, of points (81, 3)."""
    right, left, mouth = (points[part].mean(0) for part in (RIGHT_EYE, LEFT_EYE, OUTER_LIPS))
    across = unit_vectors(left - right)
    rise = (left + right) / 2 - mouth
    up = unit_vectors(rise - (rise @ across) * across)
    return np.stack([across, up, np.cross(across, up)])


def _has_protruding_nose(seen: TriangulatedFace) -> bool:
    """Whether the nose lies in front of the eyes: the inside of a mask looks like a face, too."""
    nose = seen.points[NOSE_TIP] - seen.points[OUTER_EYE_CORNERS].mean(0)
    return float(nose @ seen.axes[2]) > 0


def _frontal_view(points: F64) -> OrthographicView:
    return OrthographicView(
        frontal_axes(points),
        points[IBUG68].mean(0),
        TRIANGULATION.view_half_eye_widths * _eye_width(points),
        TRIANGULATION.picture_px,
    )


def _eye_width(points: F64) -> float:
    right, left = OUTER_EYE_CORNERS
    return float(np.linalg.norm(points[left] - points[right]))
