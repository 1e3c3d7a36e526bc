"""Dense correspondence of two heads by deforming one onto the other (Xiang et al. 2008).

Aligned by given points with a similarity (`guise.aam.similarity.align`, which works in three dimensions as in
two), or, where there are none and the heads stand roughly alike, from there; improved by closest points; then deformed
(`guise.analogy.deform`).  Only the skin takes part: the large components of the meshes.  Eyes, teeth and other
small parts follow the nearest skin by a similarity, so that they keep their form and no skin sticks to them.

Lengths in the target's unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from guise.aam.similarity import Failed, Similarity, align
from guise.analogy.correspondence import Correspondence
from guise.analogy.deform import ANGLE, TURN, Points, deform
from guise.analogy.geometry import Places, Surface, edge_lengths, face_normals, vertex_normals
from guise.analogy.mesh import Mesh
from guise.common.arrays import F64, Bool, Int
from guise.common.errors import GuiseError

SKIN = 0.25  # of the largest component's area, from which a component is skin
FEWEST = 3  # points
THIN = 1e-3  # of their extent, below which points lie on a line
APART = 0.35  # of the points' extent, by which they may miss each other once aligned
FAR = 0.03  # of the size: a vertex farther from the other surface has no counterpart
BORDER_FAR = 0.004  # the same where the closest place is on a border
OVERLAP = 0.5  # share of vertices that must find a counterpart before heads without points are deformed
SHRUNK = 0.5  # of the target's extent, below which the source has collapsed onto a part of it
CLOSEST_STEPS, SAMPLE = 20, 1000  # steps by closest points to align, with about so many vertices
CLOSEST = 0.8  # share of the closest matches that align
MOVED = 0.1  # of the points' extent, by which closest points may take them apart
NEIGHBOURS = 200  # skin vertices that a small part follows


class RegistrationError(GuiseError):
    """Meshes or points that cannot be registered; one sentence."""


@dataclass(frozen=True)
class Quality:
    """How a registration went.

    matched : share of the target's skin vertices with a counterpart.   mean, p95 : distance of the fitted source's skin
    from the target's surface there, in the target's unit.   folded : share of faces turned by more than 90 degrees.
    stretch : 95th percentile of how many times longer or shorter an edge became, scale removed.
    """

    matched: float
    mean: float
    p95: float
    folded: float
    stretch: float


@dataclass(frozen=True, eq=False)
class Registration:
    """A source deformed onto a target.

    Parameters
    ----------
    source, target : the meshes.   fitted : (N_s, 3) the source's vertices on the target.
    similarity : the alignment that came first.
    """

    source: Mesh
    target: Mesh
    fitted: F64
    similarity: Similarity

    @cached_property
    def quality(self) -> Quality:
        """The report's figures."""
        mesh = self.source
        skin = skin_of(mesh)
        faces = _faces_of(mesh, skin)
        surface, size = _skin_surface(self.target)
        normals = vertex_normals(self.fitted, mesh.faces)
        _, found, far = counterparts(surface, self.fitted[skin], normals[skin], size)
        far = far[found] if found.any() else np.zeros(1)
        aligned = self.similarity.apply(mesh.vertices)
        turned = face_normals(aligned, faces) * face_normals(self.fitted, faces)
        ratio = edge_lengths(self.fitted, faces) / edge_lengths(aligned, faces).clip(1e-300)
        ratio = ratio.ravel() / max(float(np.median(ratio)), 1e-300)
        stretch = np.percentile(np.maximum(ratio, 1 / ratio.clip(1e-6)), 95)
        matched = float(self.correspondence().found[skin_of(self.target)].mean())
        return Quality(
            matched, float(far.mean()), float(np.percentile(far, 95)), float((turned.sum(1) < 0).mean()), float(stretch)
        )  # fmt: skip

    def correspondence(self) -> Correspondence:
        """For each vertex of the target the closest place of the fitted source that faces the same way."""
        return closest_places(self.source.moved(self.fitted), self.target)


def register(source: Mesh, target: Mesh, points: tuple[F64, F64] | None = None) -> Registration:
    """The source deformed onto the target.

    Parameters
    ----------
    points : (k, 3) on or near the source and (k, 3) on or near the target, that belong together; the meshes may then
        differ in place, turn and scale by anything.  Without, they must stand roughly alike.

    Raises
    ------
    RegistrationError
        When the points do not tell a similarity, do not fit, or the meshes do not stand alike without points.
    """
    surface, size = _skin_surface(target)
    if points is None:
        similarity = _aligned_by_places(source, surface, size)
    else:
        points = checked(points)
        similarity = _aligned(source, surface, points)
    skin = np.flatnonzero(skin_of(source))
    faces = _renumbered(_faces_of(source, skin_of(source)), skin, len(source.vertices))
    rest = similarity.apply(source.vertices)
    given = None if points is None else _on(rest[skin], faces, similarity.apply(points[0]), points[1])
    fitted = rest.copy()
    fitted[skin] = deform(rest[skin], faces, surface, given, size)
    _follow(fitted, rest, source, skin)
    return Registration(source, target, fitted, similarity)


def closest_places(fitted: Mesh, target: Mesh) -> Correspondence:
    """For each vertex of the target the closest place of a mesh that lies on it; skin to skin, parts to parts."""
    normals = vertex_normals(target.vertices, target.faces)
    size = size_of(target)
    corners = np.zeros((len(target.vertices), 3), np.intp)
    weights = np.zeros((len(target.vertices), 3))
    found = np.zeros(len(target.vertices), bool)
    own, other = skin_of(fitted), skin_of(target)
    for kind in (True, False):
        at = np.flatnonzero(other == kind)
        faces = _faces_of(fitted, own == kind)
        alike = len(faces) > 0
        if not len(at):
            continue
        surface = Surface(fitted.vertices, faces if alike else _faces_of(fitted, own), TURN * size)
        places, matched, _ = counterparts(surface, target.vertices[at], normals[at], size)
        corners[at], weights[at] = surface.faces[places.faces], places.weights
        found[at] = alike & matched
    return Correspondence(corners, weights, found)


def skin_of(mesh: Mesh) -> Bool:
    """(N,) the vertices of the large components: those with at least a quarter of the largest one's area."""
    double = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
    areas = np.bincount(mesh.components[mesh.faces[:, 0]], double)
    return np.asarray((areas >= SKIN * areas.max())[mesh.components])


def size_of(mesh: Mesh) -> float:
    """The root of the skin's area."""
    double = np.linalg.norm(face_normals(mesh.vertices, _faces_of(mesh, skin_of(mesh))), axis=1)
    return float(np.sqrt(double.sum() / 2))


def counterparts(surface: Surface, points: F64, normals: F64, size: float) -> tuple[Places, Bool, F64]:
    """The closest places to points (n, 3) with normals (n, 3), which of them are counterparts, and how far they are.

    A counterpart faces the same way, is near, and on an open border very near: what lies beyond a border has none.
    """
    places = surface.closest(points, normals)
    far = np.linalg.norm(places.positions - points, axis=1)
    inner = (places.weights * ~surface.border[surface.faces[places.faces]]).sum(1) > 1e-9
    alike = np.asarray((places.normals * normals).sum(1) > np.cos(np.deg2rad(ANGLE)))
    return places, alike & (far < size * np.where(inner, FAR, BORDER_FAR)), far


def _faces_of(mesh: Mesh, chosen: Bool) -> Int:
    """The faces (m, 3) whose vertices are among the chosen (N,); components are chosen as a whole."""
    return np.asarray(mesh.faces[chosen[mesh.faces[:, 0]]])


def _skin_surface(mesh: Mesh) -> tuple[Surface, float]:
    size = size_of(mesh)
    return Surface(mesh.vertices, _faces_of(mesh, skin_of(mesh)), TURN * size), size


def checked(points: tuple[F64, F64]) -> tuple[F64, F64]:
    """Points (k, 3) of two meshes that belong together; RegistrationError when they can be no such."""
    first, second = (np.asarray(p, np.float64) for p in points)
    if first.shape != second.shape or first.ndim != 2 or first.shape[1] != 3:
        raise RegistrationError(f"points must be (k, 3) on both meshes, got {first.shape} and {second.shape}")
    if len(first) < FEWEST:
        raise RegistrationError(f"{len(first)} points do not tell how the heads lie: give at least {FEWEST}")
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise RegistrationError("the points must be finite, some are NaN or infinite: leave those out")
    return first, second


def aligned_by_points(first: F64, second: F64) -> Similarity:
    """Takes points (k, 3) of the source to those of the target; RegistrationError when they do not belong together."""
    for name, points in (("source", first), ("target", second)):
        spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
        if spread[1] <= THIN * spread[0] or spread[0] == 0:
            raise RegistrationError(
                f"the points on the {name} lie at one place or on a line: spread them over the face"
            )
    similarity = align(first, second)
    extent = np.sqrt(((second - second.mean(0)) ** 2).sum(1).mean())
    if isinstance(similarity, Failed) or _missed(similarity, first, second) > APART * extent:
        raise RegistrationError(
            "the points of the two meshes do not belong together: no turn and scale brings them near each other; "
            "check their order, and left and right"
        )
    return similarity


def _missed(similarity: Similarity, first: F64, second: F64) -> float:
    return float(np.sqrt(((similarity.apply(first) - second) ** 2).sum(1).mean()))


def _closest(source: Mesh, surface: Surface, start: Similarity) -> Similarity:
    """The similarity (of the skin) improved by closest points, the farthest fifth left out in every step."""
    chosen = np.flatnonzero(skin_of(source))
    chosen = chosen[:: max(1, len(chosen) // SAMPLE)]
    at, normals = source.vertices[chosen], vertex_normals(source.vertices, source.faces)[chosen]
    similarity = start
    for _ in range(CLOSEST_STEPS):
        placed, facing = similarity.apply(at), normals @ similarity.rotation.T
        near = surface.nearest(placed, facing)
        far = np.linalg.norm(surface.samples[near] - placed, axis=1)
        alike = np.asarray((surface.normals[near] * facing).sum(1) > np.cos(np.deg2rad(ANGLE)))
        alike &= (far <= np.quantile(far, CLOSEST)) & ~surface.on_border[near]
        step = align(at, surface.samples[near], alike.astype(np.float64))
        if isinstance(step, Failed):
            break
        similarity = step
    return similarity


def _aligned(source: Mesh, surface: Surface, points: tuple[F64, F64]) -> Similarity:
    """By points, then by closest points, unless that takes the points apart: the meshes show other parts of a head."""
    by_points = aligned_by_points(*points)
    closest = _closest(source, surface, by_points)
    extent = float(np.sqrt(((points[1] - points[1].mean(0)) ** 2).sum(1).mean()))
    good = _missed(closest, *points) <= _missed(by_points, *points) + MOVED * extent
    return closest if good else by_points


def _aligned_by_places(source: Mesh, surface: Surface, size: float) -> Similarity:
    """By closest points alone, from where the meshes stand."""
    similarity = _closest(source, surface, Similarity.identity(3))
    skin = skin_of(source)
    placed = similarity.apply(source.vertices)
    facing = vertex_normals(placed, source.faces)[skin]
    _, found, _ = counterparts(surface, placed[skin], facing, size)
    shrunk = np.ptp(placed[skin], axis=0).max() < SHRUNK * np.ptp(surface.vertices, axis=0).max()
    if found.mean() < OVERLAP or shrunk:
        raise RegistrationError(
            "the meshes are not roughly aligned: give points that belong together on both"
        )
    return similarity


def _on(vertices: F64, faces: Int, points: F64, positions: F64) -> Points:
    """The places of points (k, 3) on the source's skin, with where they belong."""
    surface = Surface(vertices, faces, 0.0)
    places = surface.closest(points, np.zeros_like(points))
    return Points(faces[places.faces], places.weights, positions)


def _renumbered(faces: Int, chosen: Int, count: int) -> Int:
    """Faces with ids among the chosen vertices (n,) only."""
    numbers = np.full(count, -1)
    numbers[chosen] = np.arange(len(chosen))
    return np.asarray(numbers[faces])


def _follow(fitted: F64, rest: F64, mesh: Mesh, skin: Int) -> None:
    """Moves the small parts in `fitted` (N, 3) as the skin nearest to them moved, by a similarity each."""
    inside = np.zeros(len(rest), bool)
    inside[skin] = True
    tree = cKDTree(rest[skin]) if not inside.all() else None
    for label in np.unique(mesh.components[~inside]):
        part = np.flatnonzero(mesh.components == label)
        assert tree is not None
        near = np.unique(tree.query(rest[part], k=max(1, NEIGHBOURS // len(part)))[1])
        near = skin[near]
        moved = align(rest[near], fitted[near])
        shift = (fitted[near] - rest[near]).mean(0)
        fitted[part] = rest[part] + shift if isinstance(moved, Failed) else moved.apply(rest[part])
