"""The components of a mesh on which feature points lie: the skin of the face, whatever else the file holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from guise.analogy.geometry import barycentric
from guise.analogy.mesh import Mesh
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True)
class CarrierLimits:
    """Thresholds of what carries points, in spans: between the outer corners of the eyes."""

    reach: float = 0.06  # from a point, beyond the nearest component
    min_points: int = 3  # that a further component carries alone
    touching: float = 1e-3
    min_touching: int = 3  # vertices of a further component that touch the first


CARRIERS = CarrierLimits()


def components_of(mesh: Mesh) -> list[Int]:
    """The vertices (n,) of each component."""
    order = np.argsort(mesh.components, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(mesh.components[order])) + 1)


def carriers(mesh: Mesh, points: F64, span: float) -> list[int]:
    """The components on which points (k, 3) lie: that of most, and those of the rest that touch it."""
    rows = components_of(mesh)
    if len(rows) == 1:
        return [0]
    on = _points_on(mesh, points, len(rows), CARRIERS.reach * span)
    size = np.array([len(part) for part in rows]) / len(mesh.vertices)
    chosen = [int((on.sum(0) + size / 2).argmax())]
    left = ~on[:, chosen[0]]
    for number in np.argsort(-on[left].sum(0), kind="stable"):
        if on[left, number].sum() < CARRIERS.min_points:
            break
        face = mesh.vertices[np.concatenate([rows[k] for k in chosen])]
        if touching(cKDTree(face), mesh.vertices[rows[number]], span):
            chosen.append(int(number))
    return chosen


def touching(face: cKDTree, rim: F64, span: float) -> bool:
    """Whether some vertices (n, 3) coincide with those of a face."""
    reach = CARRIERS.touching * span
    return bool(
        (face.query(rim, distance_upper_bound=reach)[0] < reach).sum() >= CARRIERS.min_touching
        if len(rim)
        else False
    )


def _points_on(mesh: Mesh, points: F64, count: int, reach: float) -> Bool:
    """(k, c) which of the components are about as near to each point as the nearest."""
    corners = mesh.vertices[mesh.faces]
    middle = corners.mean(1)
    radius = np.linalg.norm(corners - middle[:, None], axis=2).max(1)
    on = np.zeros((len(points), count), bool)
    for place, row in zip(points, on, strict=True):
        away = np.linalg.norm(middle - place, axis=1)
        close = np.flatnonzero(away - radius <= (away + radius).min() + reach)
        weights = barycentric(np.broadcast_to(place, (len(close), 3)), corners[close])
        far = np.linalg.norm(np.einsum("mk,mki->mi", weights, corners[close]) - place, axis=1)
        near = close[far <= far.min() + reach]
        row[mesh.components[mesh.faces[near, 0]]] = True
    return on
