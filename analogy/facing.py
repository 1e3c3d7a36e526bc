"""Where the face of a mesh is: pictures of it from all directions, in which the landmarker looks for one.

A mesh says neither what is up nor where it looks.  A shaded picture of a bald head is face enough for the landmarker
that ships with Guise, so it is shown the mesh upright, then turned in 23 ways by right angles, then in any way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np

from guise.analogy.geometry import gathered
from guise.analogy.mesh import Mesh
from guise.analogy.normals import unit
from guise.analogy.views import Solid, View
from guise.common.arrays import F32, F64

if TYPE_CHECKING:
    from guise.aam.landmarks.builtin import BuiltinLandmarker


SEEK = 160  # pixels, the side of a picture in which a face is sought
CELLS = 64  # along the longest side of a mesh: vertices in one are merged for the search
LIKELY = 0.3  # the landmarker's probability from which a face is worth a look from the front
ANYWAYS = 96  # turns tried when right angles do not do


@dataclass(frozen=True, eq=False)
class Facing:
    """A mesh, the view of it that shows a face, and the face's points in scheme `face81` there.

    Parameters
    ----------
    points : (81, 2) pixels of the view.
    """

    solid: Solid
    view: View
    points: F32


@cache
def landmarker() -> BuiltinLandmarker:
    """The landmarker that ships with Guise; for one thread at a time."""
    from guise.aam.landmarks.builtin import BuiltinLandmarker

    return BuiltinLandmarker()


def facings(mesh: Mesh) -> Iterator[Facing]:
    """Views of a mesh in which a face is seen, as they are found.

    Pictures shaded by the mesh's normals come before such by depths, which stand noise, pepper holes and faces that
    are inside out.
    """
    whole = Solid.of(mesh)
    rough = _rough(whole)
    upright, others = np.eye(3)[None], np.concatenate([_right_angles(), _any_ways()])
    for turns in (upright, others):
        yield from _seen(whole, rough, turns)
        yield from _seen(whole.plain(), rough.plain(), turns)


def _seen(solid: Solid, rough: Solid, turns: F64) -> Iterator[Facing]:
    """The faces of a solid seen along axes (n, 3, 3), sought on a rough one."""
    for axes in turns:
        view = rough.whole(axes, SEEK)
        for face in landmarker().detect(rough.picture(view)[0]):
            if face.confidence >= LIKELY:
                yield Facing(solid, view, face.points)


def _rough(solid: Solid) -> Solid:
    """A few thousand faces at most: vertices in one cell of a grid become one."""
    low = solid.vertices.min(0)
    step = max(float(np.ptp(solid.vertices, axis=0).max()), 1e-300) / CELLS
    cell = np.floor((solid.vertices - low) / step).astype(np.int64) @ (1, 2 * CELLS, 4 * CELLS * CELLS)
    _, label = np.unique(cell, return_inverse=True)
    kinds = int(label.max()) + 1
    vertices = gathered(solid.vertices, label, kinds) / np.bincount(label)[:, None]
    normals = None if solid.normals is None else unit(gathered(solid.normals, label, kinds))
    faces = label[solid.faces]
    solid_ones = (faces != np.roll(faces, 1, axis=1)).all(1)
    return Solid(vertices, faces[solid_ones], normals) if solid_ones.any() else solid


def _right_angles() -> F64:
    """(23, 3, 3): all turns by right angles but none at all."""
    every = (
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order, signs in product(permutations(range(3)), product((1, -1), repeat=3))
    )
    return np.array([turn for turn in every if np.linalg.det(turn) > 0 and np.trace(turn) < 3])


def _any_ways() -> F64:
    """(n, 3, 3) turns spread evenly over all: super-Fibonacci spirals (Alexa 2022)."""
    from scipy.spatial.transform import Rotation

    number = np.arange(ANYWAYS) + 0.5
    a, b = (2 * np.pi * number / by for by in (np.sqrt(2), 1.533751168755204288))
    inner, outer = np.sqrt(number / ANYWAYS), np.sqrt(1 - number / ANYWAYS)
    turns = [inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)]
    return np.asarray(Rotation.from_quat(np.stack(turns, axis=1)).as_matrix())
