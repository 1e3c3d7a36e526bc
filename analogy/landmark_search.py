"""Feature points carried from one head to another by local search (Xiang et al. 2008, algorithm 1).

Around each point a geodesic patch of the template is registered rigidly to the target from nine starts by iterative
closest points whose normals must agree within 60 degrees; the start of least error wins.  Distances are taken along the
target's normals, so that patches do not cling to its vertices.  In the two-pass variant the template is then deformed
onto the target by what was found, and the search is made again with the deformed patches.

The paper's radius, 6 % of the width of an eye, is less than an edge of its meshes; here it is a part of the head.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.analogy.deform import ANGLE
from guise.analogy.geometry import Surface, gathered, geodesic_patch, vertex_normals
from guise.analogy.mesh import Mesh
from guise.analogy.register import aligned_by_points, checked, register, size_of
from guise.common.arrays import F64, Int

# By default; of the target's size (the root of its area): how far the patches reach, and twice the starts' shift.
RADIUS = 0.015
STEPS = 15
SHIFTS = np.stack(np.meshgrid((0.0, -1.0, 1.0), (0.0, -1.0, 1.0), (0.0,)), axis=-1).reshape(-1, 3) / 2


def refine_points(
    template: Mesh,
    template_points: F64,
    target: Mesh,
    start_points: F64,
    passes: int = 2,
    radius: float = RADIUS,
) -> F64:
    """The target's points (k, 3), on its surface, that look like the template's (k, 3).

    start_points : (k, 3) near them on the target.   passes : 2 deforms the template between two searches, 1 does not.
    radius : of the patches, in the target's size; no point is moved farther than that from its start.

    Raises
    ------
    RegistrationError
        When the points do not belong together.
    """
    ids = _nearest_vertices(template, template_points)
    first, start = checked((template_points, start_points))
    surface = Surface(target.vertices, target.faces, 0.0)
    placed = aligned_by_points(first, start).apply(template.vertices)
    found = start
    for again in range(passes):
        if again:
            placed = register(template, target, (first, found)).fitted
        found = _searched(placed, template.faces, ids, surface, found, radius * size_of(target))
    return found


@dataclass(frozen=True, eq=False)
class _Patches:
    """Points of all patches (p, 3), normals, and the patch of each (p,), patches 0 to count - 1."""

    points: F64
    normals: F64
    patch: Int
    count: int


def _searched(placed: F64, faces: Int, ids: Int, surface: Surface, start: F64, radius: float) -> F64:
    """Algorithm 1 for all points and starts at once."""
    patches, centres = _nine_starts(placed, faces, ids, start, radius)
    moved, error = _icp(patches, centres, surface)
    best = error.reshape(len(SHIFTS), -1).argmin(axis=0)
    ends = moved.reshape(len(SHIFTS), -1, 3)[best, np.arange(len(ids))]
    near = np.linalg.norm(ends - start, axis=1) <= radius
    return surface.closest(np.where(near[:, None], ends, start), np.zeros_like(start)).positions


def _nine_starts(placed: F64, faces: Int, ids: Int, start: F64, radius: float) -> tuple[_Patches, F64]:
    """Patches put to where their points start, nine times; and the points (9 k, 3)."""
    normals = vertex_normals(placed, faces)
    inside = [geodesic_patch(placed, faces, int(v), radius) for v in ids]
    members, label = np.concatenate(inside), np.repeat(np.arange(len(ids)), [len(i) for i in inside])
    shifted = placed[members] + (start - placed[ids])[label]
    shifts = SHIFTS * radius
    points = (shifted[None] + shifts[:, None]).reshape(-1, 3)
    patch = (label[None] + len(ids) * np.arange(len(SHIFTS))[:, None]).ravel()
    centres = (start[None] + shifts[:, None]).reshape(-1, 3)
    nine = len(SHIFTS)
    return _Patches(points, np.tile(normals[members], (nine, 1)), patch, nine * len(ids)), centres


def _icp(patches: _Patches, centres: F64, surface: Surface) -> tuple[F64, F64]:
    """Where rigid motions onto the surface take the centres (c, 3), and the mean squared distances there (c,)."""
    points, normals, count = patches.points, patches.normals, patches.count
    error: F64 = np.zeros(count)
    for _ in range(STEPS):
        near = surface.nearest(points, normals)
        across = surface.normals[near]
        onto = points + ((surface.samples[near] - points) * across).sum(1, keepdims=True) * across
        alike = ((normals * across).sum(1) > np.cos(np.deg2rad(ANGLE))).astype(np.float64)
        weight = alike / np.bincount(patches.patch, alike, count).clip(1)[patches.patch]
        mean = gathered(weight[:, None] * points, patches.patch, count)
        other = gathered(weight[:, None] * onto, patches.patch, count)
        turns = _turns(points - mean[patches.patch], onto - other[patches.patch], weight, patches)
        error = gathered((weight * ((onto - points) ** 2).sum(1))[:, None], patches.patch, count)[:, 0]
        error[np.bincount(patches.patch, alike, count) == 0] = np.inf
        points = _moved(points, patches.patch, turns, mean, other)
        centres = _moved(centres, np.arange(count), turns, mean, other)
        normals = np.einsum("nij,nj->ni", turns[patches.patch], normals)
    return centres, error


def _turns(points: F64, onto: F64, weight: F64, patches: _Patches) -> F64:
    """(count, 3, 3) rotations of the patches, by SVD of their covariances."""
    outer = (weight[:, None, None] * onto[:, :, None] * points[:, None, :]).reshape(-1, 9)
    u, _, vt = np.linalg.svd(gathered(outer, patches.patch, patches.count).reshape(-1, 3, 3))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return np.asarray(u @ vt)


def _moved(points: F64, patch: Int, turns: F64, mean: F64, other: F64) -> F64:
    """Points about their patches' means, turned and put to the other means; patches that match nothing stay."""
    still = np.asarray(~other.any(axis=1), bool)
    way = np.einsum("nij,nj->ni", turns[patch], points - mean[patch]) + other[patch]
    return np.where(still[patch][:, None], points, way)


def _nearest_vertices(mesh: Mesh, points: F64) -> Int:
    """(k,) the vertices of a mesh that are nearest to points (k, 3)."""
    far = ((mesh.vertices[None] - np.asarray(points, np.float64)[:, None]) ** 2).sum(2)
    return np.asarray(far.argmin(axis=1), np.intp)
