"""A fine mesh over the canonical face, whose vertices follow 81 landmarks smoothly.

Each vertex is a fixed linear combination of the landmarks and of a ring around the face, the same for every picture.
The weights come from a thin plate under slight tension, slit along the lips and the lids, so that the upper lip moves
without the lower one.  Affine motions of the landmarks are reproduced exactly.

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
from guise.analogy.geometry import doubled_areas_2d
from guise.analogy.solver import factorise
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True)
class TemplateSettings:
    """Settings of the template; pixels are the canonical face's."""

    spacing_px: float = 5.0  # between vertices
    tension_length_px: float = 20.0  # over which bending gives way to tension
    ring_scale: float = 1.4  # of the way from the face's middle to its outline, where the ring lies
    chin_extra_scale: float = 0.2  # more below the chin, which moves most


TEMPLATE = TemplateSettings()

HOLES = (INNER_LIPS, RIGHT_EYE, LEFT_EYE)


@dataclass(frozen=True, eq=False)
class Template:
    """A triangle mesh over the face.

    Parameters
    ----------
    blend : (V, 81 + r) weights of landmarks and ring points for each vertex.
    triangles : (t, 3); skin first, so that lips and lids cover what is between them.
    parts : (t,) 0 for skin, 1 between the lips, 2 and 3 between the lids of the right and left eye.
    """

    blend: F64
    triangles: Int
    parts: Int

    def vertices(self, points: F64, around: F64) -> F64:
        """(V, 2) for landmarks (81, 2) and the ring (r, 2) around them, in the pixels of one picture."""
        return np.asarray(self.blend @ np.concatenate([points, around]))


def anchor_ring(points: F64) -> F64:
    """The ring (r, 2) around the face of neutral landmarks (81, 2), where nothing moves."""
    outline = points[SILHOUETTE]
    middle = outline.mean(0)
    down = points[CHIN] - middle
    share = np.clip((outline - middle) @ down / (down @ down), 0, 1)
    return np.asarray(
        middle + (outline - middle) * (TEMPLATE.ring_scale + TEMPLATE.chin_extra_scale * share)[:, None]
    )


@lru_cache(maxsize=1)
def face_template() -> Template:
    """The template, built once per process."""
    points = ReferenceFrame.canonical(160).points
    held = np.concatenate([points, anchor_ring(points)])
    vertices = _template_vertices(held)
    triangles, part = _triangulate(vertices, held)
    order = np.argsort(part, kind="stable")
    skin = triangles[part == 0]
    blend = _bending_blend(vertices, skin, len(held))
    blend = _harmonic_blend(vertices, triangles[part > 0], blend)
    return Template(_with_affine_precision(vertices, held, blend), triangles[order], part[order])


def points_in_polygon(polygon: F64, places: F64) -> Bool:
    """(n,) bool, which of positions (n, 2) lie in a polygon (k, 2)."""
    out = np.zeros(len(places), bool)
    x, y = places.T
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, 0), strict=True):
        if ay != by:
            out ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return out


def _template_vertices(held: F64) -> F64:
    """(V, 2): the fixed points, then points along the holes and the ring, then a grid between them."""
    curves = [held[hole] for hole in HOLES] + [held[COUNT:]]
    edges = np.concatenate([_subdivide(curve) for curve in curves])
    taken = np.concatenate([held, edges])
    low, high = held.min(0), held.max(0)
    rows = np.arange(low[1], high[1], TEMPLATE.spacing_px * 0.866)
    grid = np.concatenate(
        [
            np.column_stack(
                [
                    x := np.arange(low[0] + TEMPLATE.spacing_px / 2 * (k % 2), high[0], TEMPLATE.spacing_px),
                    np.full(len(x), y),
                ]
            )
            for k, y in enumerate(rows)
        ]
    )
    far = np.linalg.norm(grid[:, None] - taken, axis=2).min(1) > 0.6 * TEMPLATE.spacing_px
    return np.concatenate([taken, grid[far & points_in_polygon(held[COUNT:], grid)]])


def _subdivide(curve: F64) -> F64:
    """Points on the edges of a closed curve (k, 2), at most half a spacing apart."""
    out = []
    for a, b in zip(curve, np.roll(curve, -1, 0), strict=True):
        count = int(np.ceil(np.linalg.norm(b - a) / (TEMPLATE.spacing_px / 2)))
        share = np.arange(1, count)[:, None] / count
        out.append(a + (b - a) * share)
    return np.concatenate(out)


def _triangulate(vertices: F64, held: F64) -> tuple[Int, Int]:
    """Triangles (t, 3) within the ring, and the part of each (t,)."""
    from scipy.spatial import Delaunay

    triangles = Delaunay(vertices).simplices.astype(np.intp)
    centres = vertices[triangles].mean(1)
    part = np.zeros(len(triangles), np.intp)
    for number, hole in enumerate(HOLES):
        part[points_in_polygon(held[hole], centres)] = number + 1
    kept = points_in_polygon(held[COUNT:], centres) & (
        np.abs(doubled_areas_2d(vertices, triangles)) / 2 > 1e-6
    )
    return triangles[kept], part[kept]


def _stiffness(vertices: F64, triangles: Int) -> tuple[sp.csr_array, F64]:
    """The negated cotangent Laplacian (V, V) and the vertex areas (V,)."""
    count = len(vertices)
    area = np.abs(doubled_areas_2d(vertices, triangles)) / 2
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


def _bending_blend(vertices: F64, skin: Int, held: int) -> F64:
    """(V, held): the skin vertices as combinations of the first `held` ones."""
    stiffness, mass = _stiffness(vertices, skin)
    free = np.unique(skin)
    free = free[free >= held]
    spread = sp.diags_array(1 / np.where(mass > 0, mass, 1))
    energy = sp.csr_array(stiffness @ spread @ stiffness + stiffness / TEMPLATE.tension_length_px**2)
    return _minimise(energy, free, np.eye(len(vertices), held))


def _harmonic_blend(vertices: F64, holes: Int, blend: F64) -> F64:
    """The blend, with vertices in the holes as harmonic combinations of those around them."""
    free = np.flatnonzero(~blend.any(1))
    return _minimise(_stiffness(vertices, holes)[0], free, blend)


def _minimise(energy: sp.csr_array, free: Int, blend: F64) -> F64:
    """The blend with its free rows set to minimise the energy."""
    known = np.setdiff1d(np.arange(len(blend)), free)
    rows = energy[free]
    out = blend.copy()
    out[free] = factorise(rows[:, free])(-(rows[:, known] @ blend[known]))
    return out


def _with_affine_precision(vertices: F64, held: F64, blend: F64) -> F64:
    """The blend, corrected to be exact for affine motions."""
    of_held = np.column_stack([np.ones(len(held)), held])
    fit = np.asarray(np.linalg.pinv(of_held))
    of_all = np.column_stack([np.ones(len(vertices)), vertices])
    return np.asarray(blend + (of_all - blend @ of_held) @ fit)
