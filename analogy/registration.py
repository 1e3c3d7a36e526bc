"""Dense correspondence of two heads by deforming one onto the other (Xiang et al. 2008).

The heads are aligned by a similarity (`guise.aam.similarity.align`) of given points; without points they must be
roughly aligned already.  Iterative closest points refine the alignment, then the source is deformed
(`guise.analogy.deform`).  Only the skin takes part: what the meshes say is skin (`guise.analogy.anatomy`), or else
their large components.  Eyes, teeth and other parts follow the nearest skin by a similarity, so that they keep their
shape and no skin sticks to them.

Lengths are in the unit of the target.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy.spatial import cKDTree

from guise.aam.similarity import Failed, Similarity, align
from guise.analogy.anatomy import CORRESPONDING, KINDS, MOUTH, SKIN, kind_mask
from guise.analogy.carriers import components_of
from guise.analogy.contours import find_contours
from guise.analogy.correspondence import Correspondence
from guise.analogy.deform import DEFORMATION, Guides, PointConstraints, deform
from guise.analogy.geometry import Surface, SurfacePoints, edge_lengths, face_normals, vertex_normals
from guise.analogy.mesh import Mesh
from guise.common.arrays import F64, Bool, Int
from guise.common.errors import GuiseError


@dataclass(frozen=True)
class RegistrationSettings:
    """Settings of the registration; sizes are the skin's (the root of its area), extents those of the points."""

    min_skin_area_share: float = 0.25  # of the largest component's area, from which a component is skin
    min_points: int = 3
    min_spread_ratio: float = 1e-3  # second to first extent of points, below which they lie on a line
    max_point_error_extents: float = 0.35  # between aligned points
    max_distance_sizes: float = 0.03  # from the other surface, beyond which a vertex has no counterpart
    max_border_distance_sizes: float = 0.004  # the same, where the closest point lies on a border
    min_overlap: float = 0.5  # share of vertices with a counterpart, without which heads need points
    min_extent_ratio: float = 0.5  # of the target's extent, below which the source has collapsed
    alignment_steps: int = 20  # of iterative closest points
    alignment_samples: int = 1000  # vertices, about
    alignment_quantile: float = 0.8  # of the closest matches, which align
    max_point_drift_extents: float = 0.1  # by which closest points may move given points apart
    part_neighbours: int = 200  # skin vertices that a small part follows


REGISTRATION = RegistrationSettings()


class RegistrationError(GuiseError):
    """Meshes or points that cannot be registered; one sentence."""


@dataclass(frozen=True)
class RegistrationQuality:
    """Figures of merit of a registration.

    matched : share of the target's skin vertices with a counterpart.   mean, p95 : distance from the skin of the fitted
    source to the target's surface where matched, in the target's unit.   folded : share of faces turned by more than 90
    degrees.   stretch : 95th percentile of the factor by which an edge became longer or shorter, scale removed.
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
    similarity : the initial alignment.
    """

    source: Mesh
    target: Mesh
    fitted: F64
    similarity: Similarity

    @cached_property
    def quality(self) -> RegistrationQuality:
        """Figures of merit, computed on first use."""
        mesh = self.source
        skin = skin_mask(mesh)
        faces = _faces_of(mesh, skin)
        surface, size = _skin_surface(self.target)
        normals = vertex_normals(self.fitted, mesh.faces)
        _, found, far = find_counterparts(surface, self.fitted[skin], normals[skin], size)
        far = far[found] if found.any() else np.zeros(1)
        aligned = self.similarity.apply(mesh.vertices)
        turned = face_normals(aligned, faces) * face_normals(self.fitted, faces)
        ratio = edge_lengths(self.fitted, faces) / edge_lengths(aligned, faces).clip(1e-300)
        ratio = ratio.ravel() / max(float(np.median(ratio)), 1e-300)
        stretch = np.percentile(np.maximum(ratio, 1 / ratio.clip(1e-6)), 95)
        matched = float(self.correspondence().found[skin_mask(self.target)].mean())
        return RegistrationQuality(
            matched, float(far.mean()), float(np.percentile(far, 95)), float((turned.sum(1) < 0).mean()), float(stretch)
        )  # fmt: skip

    def correspondence(self) -> Correspondence:
        """For each vertex of the target the closest point of the fitted source that faces the same way."""
        return self._correspondence

    @cached_property
    def _correspondence(self) -> Correspondence:
        return closest_point_correspondence(self.source.with_vertices(self.fitted), self.target)


def register(
    source: Mesh,
    target: Mesh,
    points: tuple[F64, F64] | None = None,
    trust: F64 | None = None,
    contours: tuple[F64, F64] | None = None,
) -> Registration:
    """Deform the source onto the target.

    Parameters
    ----------
    points : corresponding points (k, 3) on or near the source and (k, 3) on or near the target; the meshes may then
        differ by any similarity.  Without points they must be roughly aligned.
    trust : (k,) by which each counts in the deformation; None: all by 1.
    contours : feature points (20, 3) of both, between which contours guide the deformation; None: none do.

    Raises
    ------
    RegistrationError
        When the points give no similarity or do not fit, or the meshes are not aligned and there are no points.
    """
    surface, size = _skin_surface(target)
    if points is None:
        similarity = _align_without_points(source, surface, size)
    else:
        points = check_point_pairs(points)
        similarity = _align(source, surface, points)
    skin = np.flatnonzero(skin_mask(source))
    faces = _renumbered(_faces_of(source, skin_mask(source)), skin, len(source.vertices))
    rest = similarity.apply(source.vertices)
    given = (
        None
        if points is None
        else _point_constraints(rest[skin], faces, similarity.apply(points[0]), points[1], trust)
    )
    fitted = rest.copy()
    guides: Guides | None = None
    if contours is not None:
        own = rest[skin], faces, similarity.apply(contours[0])
        guides = partial(find_contours, own, surface, contours[1])
    fitted[skin] = deform(rest[skin], faces, surface, given, size, guides)
    _move_small_parts(fitted, rest, source, skin)
    return Registration(source, target, fitted, similarity)


def closest_point_correspondence(fitted: Mesh, target: Mesh) -> Correspondence:
    """For each vertex of the target the closest point of a mesh fitted to it; skin to skin, parts to parts."""
    normals = vertex_normals(target.vertices, target.faces)
    size = skin_size(target)
    corners = np.zeros((len(target.vertices), 3), np.intp)
    weights = np.zeros((len(target.vertices), 3))
    found = np.zeros(len(target.vertices), bool)
    skin = skin_mask(fitted)
    for at, own in _alike(fitted, target):
        faces = _faces_of(fitted, own)
        alike = len(faces) > 0
        if not len(at):
            continue
        surface = Surface(
            fitted.vertices,
            faces if alike else _faces_of(fitted, skin),
            DEFORMATION.normal_weight_sizes * size,
        )
        places, matched, _ = find_counterparts(surface, target.vertices[at], normals[at], size)
        corners[at], weights[at] = surface.faces[places.faces], places.weights
        found[at] = alike & matched
    return Correspondence(corners, weights, found)


def _alike(source: Mesh, target: Mesh) -> Iterator[tuple[Int, Bool]]:
    """Vertices (n,) of the target, and those (N_s,) of the source that they may correspond to, of the same kinds.

    What lies in a mouth may be in one piece on one head and in several on the other.
    """
    own, other = skin_mask(source), skin_mask(target)
    yield np.flatnonzero(other), own
    if source.kinds is None or target.kinds is None:
        yield np.flatnonzero(~other), ~own
        return
    for code in np.unique(target.kinds[~other]):
        kind = KINDS[code]
        same = kind_mask(source, (kind,) if kind in CORRESPONDING else ())
        if kind in MOUTH and (kind == "gums and cavity" or not same.any()):
            same = kind_mask(source, MOUTH)
        yield np.flatnonzero(target.kinds == code), same


def skin_mask(mesh: Mesh) -> Bool:
    """(N,) whether a vertex is skin; where the mesh says nothing, whether its component is large.

    That is, has at least a quarter of the area of the largest one.
    """
    if mesh.kinds is not None:
        return kind_mask(mesh, SKIN)
    double = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
    areas = np.bincount(mesh.components[mesh.faces[:, 0]], double)
    return np.asarray((areas >= REGISTRATION.min_skin_area_share * areas.max())[mesh.components])


def skin_size(mesh: Mesh) -> float:
    """Square root of the area of the skin."""
    double = np.linalg.norm(face_normals(mesh.vertices, _faces_of(mesh, skin_mask(mesh))), axis=1)
    return float(np.sqrt(double.sum() / 2))


def find_counterparts(
    surface: Surface, points: F64, normals: F64, size: float
) -> tuple[SurfacePoints, Bool, F64]:
    """Closest points to points (n, 3) with normals (n, 3), which of them are counterparts, and their distances (n,).

    A counterpart faces the same way and is near; on an open border it must be very near, so that vertices beyond a
    border have none.
    """
    places = surface.closest_points(points, normals)
    far = np.linalg.norm(places.positions - points, axis=1)
    inner = (places.weights * ~surface.border[surface.faces[places.faces]]).sum(1) > 1e-9
    alike = np.asarray(
        (places.normals * normals).sum(1) > np.cos(np.deg2rad(DEFORMATION.max_normal_angle_deg))
    )
    return (
        places,
        alike
        & (
            far
            < size * np.where(inner, REGISTRATION.max_distance_sizes, REGISTRATION.max_border_distance_sizes)
        ),
        far,
    )


def _faces_of(mesh: Mesh, chosen: Bool) -> Int:
    """The faces (m, 3) of chosen vertices (N,)."""
    return np.asarray(mesh.faces[chosen[mesh.faces].all(1)])


def _skin_surface(mesh: Mesh) -> tuple[Surface, float]:
    size = skin_size(mesh)
    return Surface(
        mesh.vertices, _faces_of(mesh, skin_mask(mesh)), DEFORMATION.normal_weight_sizes * size
    ), size


def check_point_pairs(points: tuple[F64, F64]) -> tuple[F64, F64]:
    """Corresponding points (k, 3) of two meshes as float64; RegistrationError when they cannot be used."""
    first, second = (np.asarray(p, np.float64) for p in points)
    if first.shape != second.shape or first.ndim != 2 or first.shape[1] != 3:
        raise RegistrationError(f"points must be (k, 3) on both meshes, got {first.shape} and {second.shape}")
    if len(first) < REGISTRATION.min_points:
        raise RegistrationError(
            f"{len(first)} points are too few to align the heads: give at least {REGISTRATION.min_points}"
        )
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise RegistrationError("points must be finite, but some are NaN or infinite: leave those out")
    return first, second


def align_by_points(first: F64, second: F64) -> Similarity:
    """The similarity from points (k, 3) of the source to the target; RegistrationError when they do not match."""
    for name, points in (("source", first), ("target", second)):
        spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
        if spread[1] <= REGISTRATION.min_spread_ratio * spread[0] or spread[0] == 0:
            raise RegistrationError(
                f"the points on the {name} coincide or lie on a line: spread them over the face"
            )
    similarity = align(first, second)
    extent = np.sqrt(((second - second.mean(0)) ** 2).sum(1).mean())
    if (
        isinstance(similarity, Failed)
        or _rms_distance(similarity, first, second) > REGISTRATION.max_point_error_extents * extent
    ):
        raise RegistrationError(
            "the points of the two meshes do not correspond: no rotation and scale brings them close to each "
            "other; check their order, and left and right"
        )
    return similarity


def _rms_distance(similarity: Similarity, first: F64, second: F64) -> float:
    return float(np.sqrt(((similarity.apply(first) - second) ** 2).sum(1).mean()))


def _align_by_closest_points(source: Mesh, surface: Surface, start: Similarity) -> Similarity:
    """The similarity of the skin refined by iterative closest points; each step leaves out the farthest fifth."""
    chosen = np.flatnonzero(skin_mask(source))
    chosen = chosen[:: max(1, len(chosen) // REGISTRATION.alignment_samples)]
    at, normals = source.vertices[chosen], vertex_normals(source.vertices, source.faces)[chosen]
    similarity = start
    for _ in range(REGISTRATION.alignment_steps):
        placed, facing = similarity.apply(at), normals @ similarity.rotation.T
        near = surface.nearest_samples(placed, facing)
        far = np.linalg.norm(surface.samples[near] - placed, axis=1)
        alike = np.asarray(
            (surface.normals[near] * facing).sum(1) > np.cos(np.deg2rad(DEFORMATION.max_normal_angle_deg))
        )
        alike &= (far <= np.quantile(far, REGISTRATION.alignment_quantile)) & ~surface.border_samples[near]
        step = align(at, surface.samples[near], alike.astype(np.float64))
        if isinstance(step, Failed):
            break
        similarity = step
    return similarity


def _align(source: Mesh, surface: Surface, points: tuple[F64, F64]) -> Similarity:
    """Align by points, then by closest points unless that moves the points apart."""
    by_points = align_by_points(*points)
    closest = _align_by_closest_points(source, surface, by_points)
    extent = float(np.sqrt(((points[1] - points[1].mean(0)) ** 2).sum(1).mean()))
    good = (
        _rms_distance(closest, *points)
        <= _rms_distance(by_points, *points) + REGISTRATION.max_point_drift_extents * extent
    )
    return closest if good else by_points


def _align_without_points(source: Mesh, surface: Surface, size: float) -> Similarity:
    """Align by closest points alone, starting from the current positions."""
    similarity = _align_by_closest_points(source, surface, Similarity.identity(3))
    skin = skin_mask(source)
    placed = similarity.apply(source.vertices)
    facing = vertex_normals(placed, source.faces)[skin]
    _, found, _ = find_counterparts(surface, placed[skin], facing, size)
    shrunk = (
        np.ptp(placed[skin], axis=0).max()
        < REGISTRATION.min_extent_ratio * np.ptp(surface.vertices, axis=0).max()
    )
    if found.mean() < REGISTRATION.min_overlap or shrunk:
        raise RegistrationError("the meshes are not roughly aligned: give corresponding points on both")
    return similarity


def _point_constraints(
    vertices: F64, faces: Int, points: F64, positions: F64, trust: F64 | None
) -> PointConstraints:
    """Constraints that take points (k, 3) on the skin of the source to their positions (k, 3)."""
    surface = Surface(vertices, faces, 0.0)
    places = surface.closest_points(points, np.zeros_like(points))
    each = np.ones(len(points)) if trust is None else trust
    return PointConstraints(faces[places.faces], places.weights, positions, each)


def _renumbered(faces: Int, chosen: Int, count: int) -> Int:
    """Faces renumbered to the chosen vertices (n,)."""
    numbers = np.full(count, -1)
    numbers[chosen] = np.arange(len(chosen))
    return np.asarray(numbers[faces])


def _move_small_parts(fitted: F64, rest: F64, mesh: Mesh, skin: Int) -> None:
    """Move the small parts in `fitted` (N, 3) with the nearest skin, each by a similarity."""
    inside = np.zeros(len(rest), bool)
    inside[skin] = True
    tree = cKDTree(rest[skin]) if not inside.all() else None
    for component in components_of(mesh):
        part = component[~inside[component]]
        if not len(part):
            continue
        assert tree is not None
        near = np.unique(tree.query(rest[part], k=max(1, REGISTRATION.part_neighbours // len(part)))[1])
        near = skin[near]
        moved = align(rest[near], fitted[near])
        shift = (fitted[near] - rest[near]).mean(0)
        fitted[part] = rest[part] + shift if isinstance(moved, Failed) else moved.apply(rest[part])
