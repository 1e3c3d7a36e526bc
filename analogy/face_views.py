"""Finds the face of a mesh: the landmarker searches pictures of it from all directions.

A mesh does not say which way is up or where it looks.  The built-in landmarker recognises shaded pictures of bald
heads, so it is shown the mesh upright, then in the 23 other orientations by right angles, then in evenly spread ones.
The head of a whole body is small in such pictures: the top of the mesh and each of its large components are shown, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np

from guise.analogy.geometry import face_normals, sum_by_index
from guise.analogy.mesh import Mesh
from guise.analogy.normals import unit_vectors
from guise.analogy.views import OrthographicView, ViewedMesh
from guise.common.arrays import F32, F64

if TYPE_CHECKING:
    from guise.aam.landmarks.builtin import BuiltinLandmarker


@dataclass(frozen=True)
class FaceSearchSettings:
    """Settings of the search for a face on a mesh."""

    picture_px: int = 160  # side of a picture in which a face is sought
    cells_per_side: int = 64  # along the longest side; vertices in one cell are merged for the search
    min_confidence: float = 0.3  # of the landmarker, from which a face is looked at from the front
    extra_rotations: int = 96  # that are tried when right angles find none
    head_heights: tuple[float, ...] = (0.15, 0.27)  # of a body, that the head at its top may be tall
    components: int = 5  # the largest ones, each of which may be a head
    margin: float = 1.3  # of a picture of a head, beyond it


FACE_SEARCH = FaceSearchSettings()


@dataclass(frozen=True, eq=False)
class FaceView:
    """A mesh, a view of it that shows a face, and the landmarks of that face (scheme `face81`).

    Parameters
    ----------
    points : (81, 2) pixels of the view.
    """

    solid: ViewedMesh
    view: OrthographicView
    points: F32


@cache
def landmarker() -> BuiltinLandmarker:
    """The built-in landmarker of upright faces, as the search itself turns the mesh; for one thread at a time.

    Its points are as found: what they lack in pictures of people isn't what they lack in shaded heads.
    """
    from guise.aam.landmarks.builtin import BuiltinLandmarker

    return BuiltinLandmarker(turned=(), corrected=False)


def find_face_views(mesh: Mesh) -> Iterator[FaceView]:
    """Views of a mesh in which a face is seen, in the order they are found.

    Pictures shaded by normals come first, then pictures shaded by depth, which tolerate noise, small holes and
    inverted faces.
    """
    whole = ViewedMesh.of(mesh)
    rough = _decimated(whole)
    boxes = _component_boxes(mesh)
    upright, others = np.eye(3)[None], _right_angle_rotations()
    for turns in (upright, others):
        yield from _detect(whole, rough, turns)
        yield from _detect(whole.without_normals(), rough.without_normals(), turns)
        for axes in turns:
            yield from _seen_on_heads(whole, boxes, axes)
    yield from _detect(whole, rough, _uniform_rotations())
    yield from _detect(whole.without_normals(), rough.without_normals(), _uniform_rotations())


def face_views_along(solid: ViewedMesh, axes: F64) -> Iterator[FaceView]:
    """Views along axes (3, 3) in which a face is seen, of the whole and of its top."""
    yield from _detect(solid, _decimated(solid), axes[None])
    yield from _seen_on_heads(solid, [], axes)


def _seen_on_heads(solid: ViewedMesh, boxes: list[tuple[F64, float]], axes: F64) -> Iterator[FaceView]:
    for view in _head_views(solid.vertices, boxes, axes):
        near = solid.crop(view.centre, 1.5 * view.half)
        if len(near.faces):
            yield from _seen_from(view, solid, _decimated(near))


def _detect(solid: ViewedMesh, rough: ViewedMesh, turns: F64) -> Iterator[FaceView]:
    """The faces that are seen along axes (n, 3, 3); the search uses a decimated mesh."""
    for axes in turns:
        yield from _seen_from(rough.whole_view(axes, FACE_SEARCH.picture_px), solid, rough)


def _seen_from(view: OrthographicView, solid: ViewedMesh, rough: ViewedMesh) -> Iterator[FaceView]:
    for face in landmarker().detect(rough.render(view)[0]):
        if face.confidence >= FACE_SEARCH.min_confidence:
            yield FaceView(solid, view, face.points)


def _head_views(vertices: F64, boxes: list[tuple[F64, float]], axes: F64) -> Iterator[OrthographicView]:
    """Views along axes (3, 3) of what may be a head: the top of the mesh, and the boxes of components."""
    up = vertices @ axes[1]
    for share in FACE_SEARCH.head_heights:
        tall = share * float(np.ptp(up))
        top = vertices[up > up.max() - tall]
        middle = (top.min(0) + top.max(0)) / 2
        yield OrthographicView(axes, middle, FACE_SEARCH.margin * tall / 2, FACE_SEARCH.picture_px)
    for middle, size in boxes:
        yield OrthographicView(axes, middle, FACE_SEARCH.margin * size / 2, FACE_SEARCH.picture_px)


def _component_boxes(mesh: Mesh) -> list[tuple[F64, float]]:
    """Middle (3,) and longest side of the largest components of a mesh that has several."""
    double = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
    areas = np.bincount(mesh.components[mesh.faces[:, 0]], double)
    found = []
    for label in np.argsort(areas)[::-1][: FACE_SEARCH.components if len(areas) > 1 else 0]:
        at = mesh.vertices[mesh.components == label]
        found.append(((at.min(0) + at.max(0)) / 2, float(np.ptp(at, axis=0).max())))
    return found


def _decimated(solid: ViewedMesh) -> ViewedMesh:
    """At most a few thousand faces: vertices in one cell of a grid are merged."""
    low = solid.vertices.min(0)
    step = max(float(np.ptp(solid.vertices, axis=0).max()), 1e-300) / FACE_SEARCH.cells_per_side
    cell = np.floor((solid.vertices - low) / step).astype(np.int64) @ (
        1,
        2 * FACE_SEARCH.cells_per_side,
        4 * FACE_SEARCH.cells_per_side * FACE_SEARCH.cells_per_side,
    )
    _, label = np.unique(cell, return_inverse=True)
    kinds = int(label.max()) + 1
    vertices = sum_by_index(solid.vertices, label, kinds) / np.bincount(label)[:, None]
    normals = None if solid.normals is None else unit_vectors(sum_by_index(solid.normals, label, kinds))
    faces = label[solid.faces]
    solid_ones = (faces != np.roll(faces, 1, axis=1)).all(1)
    return ViewedMesh(vertices, faces[solid_ones], normals) if solid_ones.any() else solid


def _right_angle_rotations() -> F64:
    """(23, 3, 3) all rotations by right angles except the identity."""
    every = (
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order, signs in product(permutations(range(3)), product((1, -1), repeat=3))
    )
    return np.array([turn for turn in every if np.linalg.det(turn) > 0 and np.trace(turn) < 3])


def _uniform_rotations() -> F64:
    """(n, 3, 3) evenly spread rotations: super-Fibonacci spirals (Alexa 2022)."""
    from scipy.spatial.transform import Rotation

    number = np.arange(FACE_SEARCH.extra_rotations) + 0.5
    a, b = (2 * np.pi * number / by for by in (np.sqrt(2), 1.533751168755204288))
    inner, outer = (
        np.sqrt(number / FACE_SEARCH.extra_rotations),
        np.sqrt(1 - number / FACE_SEARCH.extra_rotations),
    )
    turns = [inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)]
    return np.asarray(Rotation.from_quat(np.stack(turns, axis=1)).as_matrix())
