"""Transfers feature points from one head to another by local search (Xiang et al. 2008, algorithm 1).

A geodesic patch of the template around each point is registered rigidly to the target from nine starts, by iterative
closest points whose normals agree within 60 degrees; the start with the least error wins.  Distances are measured along
the target's normals, so that patches do not cling to its vertices.  In the two-pass variant the template is then
deformed onto the target with the points found, and the search is repeated with the deformed patches.

The paper's radius, 6 % of the width of an eye, is shorter than an edge of its meshes; here it is relative to the head.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.similarity import nearest_rotation
from guise.analogy.deform import DEFORMATION
from guise.analogy.geometry import Surface, geodesic_patch, sum_by_index, vertex_normals
from guise.analogy.mesh import Mesh
from guise.analogy.registration import align_by_points, check_point_pairs, register, skin_size
from guise.common.arrays import F64, Int

# Default radius of the patches, and twice the offset of the starts; in sizes of the target (the root of its area).
SEARCH_RADIUS_SIZES = 0.015
ICP_ITERATIONS = 15
START_OFFSETS = np.stack(np.meshgrid((0.0, -1.0, 1.0), (0.0, -1.0, 1.0), (0.0,)), axis=-1).reshape(-1, 3) / 2


def refine_feature_points(
    template: Mesh,
    template_points: F64,
    target: Mesh,
    start_points: F64,
    passes: int = 2,
    radius: float = SEARCH_RADIUS_SIZES,
) -> F64:
    """Points (k, 3) on the surface of the target that match those of the template (k, 3).

    start_points : (k, 3) approximate points on the target.   passes : 1, or 2 to deform the template in between.
    radius : of the patches, in sizes of the target; no point moves farther than that from its start.

    Raises
    ------
    RegistrationError
        When the points do not correspond.
    """
    ids = _nearest_vertices(template, template_points)
    first, start = check_point_pairs((template_points, start_points))
    surface = Surface(target.vertices, target.faces, 0.0)
    placed = align_by_points(first, start).apply(template.vertices)
    found = start
    for again in range(passes):
        if again:
            placed = register(template, target, (first, found)).fitted
        found = _search(placed, template.faces, ids, surface, found, radius * skin_size(target))
    return found


@dataclass(frozen=True, eq=False)
class _Patches:
    """Points of all patches (p, 3), their normals, and the patch of each (p,), from 0 to count - 1."""

    points: F64
    normals: F64
    patch: Int
    count: int


def _search(placed: F64, faces: Int, ids: Int, surface: Surface, start: F64, radius: float) -> F64:
    """Algorithm 1 for all points and starts at once: (k, 3)."""
    patches, centres = _start_patches(placed, faces, ids, start, radius)
    moved, error = _icp(patches, centres, surface)
    best = error.reshape(len(START_OFFSETS), -1).argmin(axis=0)
    ends = moved.reshape(len(START_OFFSETS), -1, 3)[best, np.arange(len(ids))]
    near = np.linalg.norm(ends - start, axis=1) <= radius
    return surface.closest_points(np.where(near[:, None], ends, start), np.zeros_like(start)).positions


def _start_patches(placed: F64, faces: Int, ids: Int, start: F64, radius: float) -> tuple[_Patches, F64]:
    """Patches moved to the nine starts of their points, and the starts (9 k, 3)."""
    normals = vertex_normals(placed, faces)
    inside = [geodesic_patch(placed, faces, int(v), radius) for v in ids]
    members, label = np.concatenate(inside), np.repeat(np.arange(len(ids)), [len(i) for i in inside])
    shifted = placed[members] + (start - placed[ids])[label]
    shifts = START_OFFSETS * radius
    points = (shifted[None] + shifts[:, None]).reshape(-1, 3)
    patch = (label[None] + len(ids) * np.arange(len(START_OFFSETS))[:, None]).ravel()
    centres = (start[None] + shifts[:, None]).reshape(-1, 3)
    nine = len(START_OFFSETS)
    return _Patches(points, np.tile(normals[members], (nine, 1)), patch, nine * len(ids)), centres


def _icp(patches: _Patches, centres: F64, surface: Surface) -> tuple[F64, F64]:
    """Centres (c, 3) after rigid registration to the surface, and mean squared distances (c,)."""
    points, normals, count = patches.points, patches.normals, patches.count
    error: F64 = np.zeros(count)
    for _ in range(ICP_ITERATIONS):
        near = surface.nearest_samples(points, normals)
        across = surface.normals[near]
        onto = points + ((surface.samples[near] - points) * across).sum(1, keepdims=True) * across
        alike = ((normals * across).sum(1) > np.cos(np.deg2rad(DEFORMATION.max_normal_angle_deg))).astype(
            np.float64
        )
        weight = alike / np.bincount(patches.patch, alike, count).clip(1)[patches.patch]
        mean = sum_by_index(weight[:, None] * points, patches.patch, count)
        other = sum_by_index(weight[:, None] * onto, patches.patch, count)
        turns = _patch_rotations(points - mean[patches.patch], onto - other[patches.patch], weight, patches)
        error = sum_by_index((weight * ((onto - points) ** 2).sum(1))[:, None], patches.patch, count)[:, 0]
        error[np.bincount(patches.patch, alike, count) == 0] = np.inf
        points = _move_patches(points, patches.patch, turns, mean, other)
        centres = _move_patches(centres, np.arange(count), turns, mean, other)
        normals = np.einsum("nij,nj->ni", turns[patches.patch], normals)
    return centres, error


def _patch_rotations(points: F64, onto: F64, weight: F64, patches: _Patches) -> F64:
    """(count, 3, 3) rotations of the patches, from the SVD of their covariances."""
    outer = (weight[:, None, None] * onto[:, :, None] * points[:, None, :]).reshape(-1, 9)
    return nearest_rotation(sum_by_index(outer, patches.patch, patches.count).reshape(-1, 3, 3))[0]


def _move_patches(points: F64, patch: Int, turns: F64, mean: F64, other: F64) -> F64:
    """Points rotated about the means of their patches and moved to the other means; unmatched patches stay."""
    still = np.asarray(~other.any(axis=1), bool)
    way = np.einsum("nij,nj->ni", turns[patch], points - mean[patch]) + other[patch]
    return np.where(still[patch][:, None], points, way)


def _nearest_vertices(mesh: Mesh, points: F64) -> Int:
    """(k,) the vertices of a mesh nearest to points (k, 3)."""
    far = ((mesh.vertices[None] - np.asarray(points, np.float64)[:, None]) ** 2).sum(2)
    return np.asarray(far.argmin(axis=1), np.intp)
