"""A fine mesh over the canonical face, whose vertices follow 81 landmarks smoothly.

Each vertex is a fixed linear combination of the landmarks and of a ring around the face, the same for every picture:
it interpolates them by a bending surface under slight tension, slit along the lips and the lids, so that an upper lip
moves without the lower one.  Affine motions of the landmarks are reproduced exactly.

Reference frame: pixels of the canonical face, 160 across.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.sparse as sp

from guise.aam.landmarks.schemes import (
    CHIN,
    COUNT,
    INNER_LIPS,
    LEFT_EYE,
    RIGHT_EYE,
    SILHOUETTE,
)
from guise.aam.reference import ReferenceFrame
from guise.analogy.solver import factorised
from guise.common.arrays import F64, Bool, Int

SPACING = 5.0  # between vertices, canonical pixels
TENSION = 20.0  # canonical pixels over which bending gives way to tension
BEYOND = 1.4  # of the way from the face's middle to its outline, where the ring lies
BELOW = 0.2  # more under the chin, which moves most
HOLES = (INNER_LIPS, RIGHT_EYE, LEFT_EYE)


@dataclass(frozen=True, eq=False)
class Template:
    """The mesh.

    Parameters
    ----------
    blend : (V, 81 + r) what of each landmark and ring point makes a vertex.
    triangles : (t, 3); skin first, so that lips and lids lie over what is between them.
    parts : (t,) 0 of skin, 1 between the lips, 2 and 3 between the lids of the right and the left eye.
    """

    blend: F64
    triangles: Int
    parts: Int

    def vertices(self, points: F64, around: F64) -> F64:
        """(V, 2) of points (81, 2) and the ring (r, 2) around them, any one picture's pixels."""
        return np.asarray(self.blend @ np.concatenate([points, around]))


def ring(points: F64) -> F64:
    """The ring (r, 2) around the face of landmarks (81, 2), its chin at rest; where nothing moves."""
    outline = points[SILHOUETTE]
    middle = outline.mean(0)
    down = points[CHIN] - middle
    share = np.clip((outline - middle) @ down / (down @ down), 0, 1)
    return np.asarray(middle + (outline - middle) * (BEYOND + BELOW * share)[:, None])


@lru_cache(maxsize=1)
def template() -> Template:
    """The template, made once in a process."""
    points = ReferenceFrame.canonical(160).points
    held = np.concatenate([points, ring(points)])
    vertices = _places(held)
    triangles, part = _triangulated(vertices, held)
    order = np.argsort(part, kind="stable")
    skin = triangles[part == 0]
    blend = _bent(vertices, skin, len(held))
    blend = _filled(vertices, triangles[part > 0], blend)
    return Template(_affine(vertices, held, blend), triangles[order], part[order])


def inside(polygon: F64, places: F64) -> Bool:
    """Which of places (n, 2) lie in a polygon (k, 2)."""
    out = np.zeros(len(places), bool)
    x, y = places.T
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, 0), strict=True):
        if ay != by:
            out ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return out


def _places(held: F64) -> F64:
    """(V, 2): what is held, then places along the holes and the ring, then a grid between them."""
    curves = [held[hole] for hole in HOLES] + [held[COUNT:]]
    edges = np.concatenate([_along(curve) for curve in curves])
    taken = np.concatenate([held, edges])
    low, high = held.min(0), held.max(0)
    rows = np.arange(low[1], high[1], SPACING * 0.866)
    grid = np.concatenate(
        [
            np.column_stack(
                [x := np.arange(low[0] + SPACING / 2 * (k % 2), high[0], SPACING), np.full(len(x), y)]
            )
            for k, y in enumerate(rows)
        ]
    )
    far = np.linalg.norm(grid[:, None] - taken, axis=2).min(1) > 0.6 * SPACING
    return np.concatenate([taken, grid[far & inside(held[COUNT:], grid)]])


def _along(curve: F64) -> F64:
    """Places within the edges of a closed curve (k, 2), at most half a spacing apart."""
    out = []
    for a, b in zip(curve, np.roll(curve, -1, 0), strict=True):
        count = int(np.ceil(np.linalg.norm(b - a) / (SPACING / 2)))
        share = np.arange(1, count)[:, None] / count
        out.append(a + (b - a) * share)
    return np.concatenate(out)


def _triangulated(vertices: F64, held: F64) -> tuple[Int, Int]:
    """Triangles (t, 3) within the ring, and the part each is of."""
    from scipy.spatial import Delaunay

    triangles = Delaunay(vertices).simplices.astype(np.intp)
    centres = vertices[triangles].mean(1)
    part = np.zeros(len(triangles), np.intp)
    for number, hole in enumerate(HOLES):
        part[inside(held[hole], centres)] = number + 1
    kept = inside(held[COUNT:], centres) & (_areas(vertices, triangles) > 1e-6)
    return triangles[kept], part[kept]


def _areas(vertices: F64, triangles: Int) -> F64:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.asarray(np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2)


def _stiffness(vertices: F64, triangles: Int) -> tuple[sp.csr_array, F64]:
    """The Laplacian by cotangents (V, V), positive, and the vertices' areas (V,)."""
    count = len(vertices)
    area = _areas(vertices, triangles)
    rows, columns, values = [], [], []
    for k in range(3):
        i, j, o = (triangles[:, (k + n) % 3] for n in range(3))
        u, v = vertices[i] - vertices[o], vertices[j] - vertices[o]
        rows.append(i)
        columns.append(j)
        values.append((u * v).sum(1) / (4 * area))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    half = sp.csr_array(sp.coo_array(entries, shape=(count, count)))
    both = half + half.T
    mass: F64 = np.asarray(np.bincount(triangles.ravel(), np.repeat(area / 3, 3), count), np.float64)
    return sp.csr_array(sp.diags_array(np.asarray(both.sum(1)).ravel()) - both), mass


def _bent(vertices: F64, skin: Int, held: int) -> F64:
    """(V, held): the skin's vertices as combinations of the first `held`, which stay themselves."""
    stiffness, mass = _stiffness(vertices, skin)
    free = np.unique(skin)
    free = free[free >= held]
    spread = sp.diags_array(1 / np.where(mass > 0, mass, 1))
    energy = sp.csr_array(stiffness @ spread @ stiffness + stiffness / TENSION**2)
    return _solved(energy, free, np.eye(len(vertices), held))


def _filled(vertices: F64, holes: Int, blend: F64) -> F64:
    """The blend with the vertices within the holes as harmonic combinations of those around them."""
    free = np.flatnonzero(~blend.any(1))
    return _solved(_stiffness(vertices, holes)[0], free, blend)


def _solved(energy: sp.csr_array, free: Int, blend: F64) -> F64:
    """The blend with its free rows set so that the energy is least."""
    known = np.setdiff1d(np.arange(len(blend)), free)
    rows = energy[free]
    out = blend.copy()
    out[free] = factorised(rows[:, free])(-(rows[:, known] @ blend[known]))
    return out


def _affine(vertices: F64, held: F64, blend: F64) -> F64:
    """The blend, made exact for affine motions."""
    of_held = np.column_stack([np.ones(len(held)), held])
    fit = np.asarray(np.linalg.pinv(of_held))
    of_all = np.column_stack([np.ones(len(vertices)), vertices])
    return np.asarray(blend + (of_all - blend @ of_held) @ fit)
