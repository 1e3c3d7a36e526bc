"""Transfers expressions of one head to another of any topology, scale and pose.

A dense correspondence resamples the source on the target's topology, and the similarity of the two neutral heads brings
it into the target's frame.  Vertices without a counterpart on the source, or with one that is out of order with its
neighbours, continue their surroundings.  A rigid motion of the whole expression is removed first and applied again at
the end, so that a nod stays a nod.  Any unit; results are in that of the target.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from guise.aam.similarity import Failed, Similarity, align
from guise.analogy.anatomy import STILL, FaceFrame, kind_mask, name_components, with_components
from guise.analogy.baselines import ExpressionCloning, GradientTransfer
from guise.analogy.carriers import CARRIERS
from guise.analogy.correspondence import Correspondence
from guise.analogy.eyeballs import EyeTurns
from guise.analogy.feature_points import FeaturePointsError, find_feature_points
from guise.analogy.filling import TensionFill, holes
from guise.analogy.geometry import vertex_areas
from guise.analogy.lids import FacePair, LidMotion, motion_ratios
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.parts import PartMotion, submesh
from guise.analogy.registration import register, skin_mask
from guise.analogy.rigid import align_rigid_robust
from guise.analogy.slit_skin import SlitSkin
from guise.analogy.tents import TentTransfer, VertexTents
from guise.common.arrays import F64, Bool, Int

Method = Literal["tents", "deformable", "gradients", "cloning"]
TransferMethod = Callable[[list[F64]], list[F64]]


@dataclass(frozen=True)
class TransferSettings:
    """Settings of the transfer; radii are the head's."""

    tent_reach_radii: float = 0.04  # length over which tents rule
    fade_length_radii: float = 0.3  # over which an expression fades where the source has nothing
    max_ring_stretch: float = 2.2  # of a ring on the source, beyond which its correspondence is rejected
    min_ring_stretch: float = 0.28
    max_motion_ratio: float = 1.4  # of any vertex to the source's furthest, scaled
    seam_spans: float = (
        0.4  # widths of the eyes from a still body or clothes, over which the skin comes to rest
    )
    pose_samples: int = 400  # vertices that give the motion of the whole head


TRANSFER = TransferSettings()


class Transfer:
    """Transfers expressions of a source to a target; everything that depends on the neutral heads is computed once.

    Parameters
    ----------
    source, target : neutral heads.   correspondence : for each target vertex its point on the source.
    method : tents (Song et al. 2007), deformable (Xiang et al. 2008), gradients (Sumner and Popovic 2004) or cloning
        (Noh and Neumann 2001).
    keep_rigid : parts other than the skin (eyes, teeth) keep their place in the head instead of following the skin.
    face : of both heads, if known: lids then meet when they do on the source, and teeth move with their jaws.
    fitted : (N_s, 3) the source deformed onto the target; `deformable` alone needs it.

    Raises
    ------
    MeshError
        When the correspondence does not fit these heads or matches almost nothing, or `fitted` is lacking.
    SolverError
        When the system of the target has no unique solution.

    Examples
    --------
    >>> sheet = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]]), np.empty((0, 3), int),
    ...     np.array([[0, 1, 2, 3]]))
    >>> transfer = Transfer(sheet, sheet, Correspondence.identity(4))
    >>> bool(np.allclose(transfer(sheet.vertices), sheet.vertices))
    True
    """

    def __init__(
        self,
        source: Mesh,
        target: Mesh,
        correspondence: Correspondence,
        method: Method = "tents",
        keep_rigid: bool = False,
        face: FacePair | None = None,
        fitted: F64 | None = None,
    ) -> None:
        self.source, self.target = source, target
        on_skin = skin_mask(target)
        found = _matched_skin(source, target, correspondence, on_skin)
        skin = submesh(target, on_skin)
        self._all = correspondence.matrix(len(source.vertices))
        self._carry = self._all[np.flatnonzero(on_skin)]
        size = vertex_areas(skin.vertices, skin.faces) * found
        self.pose = _align(self._carry @ source.vertices, skin.vertices, size)
        apart = self.pose.apply(self._carry @ source.vertices) - skin.vertices
        radius = _rms_radius(skin.vertices, size)
        frame = FaceFrame.of(face.points[1]) if face else None
        continued = TensionFill(skin.vertices, skin.rings, found, TRANSFER.fade_length_radii * radius)(apart)
        own = VertexTents(skin.vertices, skin.rings)
        found &= _keeps_ring_shape(own.transformations(skin.vertices + continued))
        self._fill = TensionFill(skin.vertices, skin.rings, found, TRANSFER.fade_length_radii * radius)
        self._neutral = skin.vertices + self._fill(apart)
        throat = _throat(skin, found, frame)
        if throat.any():
            known = found | throat
            self._fill = TensionFill(skin.vertices, skin.rings, known, TRANSFER.fade_length_radii * radius)
        self._core = _make_method(method, self._neutral, own, TRANSFER.tent_reach_radii * radius)
        self._deformed = (
            _deformed_model(source, self.pose, fitted, skin_mask(source)) if method == "deformable" else None
        )
        self._skin = on_skin
        lids = face.lids if face else ()
        ratios = motion_ratios(lids, source.vertices, target.vertices, self.pose.scale)[on_skin, None]
        self._moved = np.where(throat[:, None], 0.0, ratios)
        self._lids = [LidMotion(source.vertices, target.vertices, eye) for eye in lids]
        same = bool((correspondence.weights.max(1) == 1).all())  # vertex to vertex, which slips nowhere
        self._slit_skin = (
            SlitSkin(target, on_skin, face.slits(target.vertices), source.vertices, correspondence.corners)
            if face and not same
            else None
        )
        matched = correspondence.found & ~skin_mask(source)[correspondence.corners].any(1)
        margins = face.margins(target.vertices) if face else None
        self._parts = PartMotion(target, on_skin, keep_rigid, matched, frame, margins)
        self._eyes = None
        if face and not keep_rigid and source.kinds is not None and target.kinds is not None:
            frames = FaceFrame.of(face.points[0]), FaceFrame.of(face.points[1])
            self._eyes = EyeTurns(source, target, frames, self.pose.rotation)
        self._held = None if frame is None else _away_from_seam(target, on_skin, frame.span)
        self._unmoved = _apart_from_head(target)
        self._sample = _subsample(np.flatnonzero(skin_mask(source)))

    def __call__(self, expressive: F64) -> F64:
        """The target (N_t, 3) with the expression of the source `expressive` (N_s, 3).

        Raises
        ------
        MeshError
            When the number of vertices differs from the source, or a vertex is not finite.
        """
        return self.each([expressive])[0]

    def each(self, expressions: Sequence[F64]) -> list[F64]:
        """The same for several expressions (N_s, 3), which takes less time than one by one.

        Raises
        ------
        MeshError
            As for one.
        """
        for expressive in expressions:
            _require_expression(expressive, self.source)
        motions = [self._motion(expressive) for expressive in expressions]
        stills = [motion.inverse().apply(x) for motion, x in zip(motions, expressions, strict=True)]
        ways = [self._way(still) for still in stills]
        skins = self._core([self._neutral + self._fill(self._moved * (self._carry @ way)) for way in ways])
        return [self._whole(*parts) for parts in zip(motions, stills, ways, skins, strict=True)]

    def _way(self, still: F64) -> F64:
        """What an expression (N_s, 3) does, in the target's frame: of the source, its skin by the deformed model."""
        way = (still - self.source.vertices) @ self.pose.linear.T
        if self._deformed:
            skin = skin_mask(self.source)
            way[skin] = self._deformed(self.pose.apply(still[skin])) - self._deformed.target
        return way

    def _whole(self, motion: Similarity, still: F64, way: F64, skin: F64) -> F64:
        """The target (N_t, 3) by its skin (n, 3), for a source (N_s, 3) moved by ways (N_s, 3) and then as a whole."""
        skin = self._in_order(still, self._bounded(skin, way))
        if self._held is not None:
            rest = self.target.vertices[self._skin]
            skin = rest + self._held[:, None] * (skin - rest)
        made = self._parts(skin, self._all @ way)
        if self._eyes is not None:
            made = self._eyes(still, made)
        done = (self.pose @ motion @ self.pose.inverse()).apply(made)
        done[self._unmoved] = self.target.vertices[self._unmoved]
        return done

    def _bounded(self, skin: F64, way: F64) -> F64:
        """The skin (n, 3), no vertex much farther from rest than the longest way (N_s, 3) of the source's."""
        rest = self.target.vertices[self._skin]
        moved = skin - rest
        far = np.sqrt(np.einsum("ni,ni->n", moved, moved))
        most = TRANSFER.max_motion_ratio * float(np.linalg.norm(way, axis=1).max())
        beyond = far > most
        skin[beyond] = rest[beyond] + moved[beyond] * (most / far[beyond])[:, None]
        return skin

    def _in_order(self, expressive: F64, skin: F64) -> F64:
        """The skin (n, 3) with lids as open as those of the source (N_s, 3), and no folds there or at the lips."""
        made = self.target.vertices.copy()
        made[self._skin] = skin
        if self._slit_skin:
            made = self._slit_skin.smoothed(made)
        for eye in self._lids:
            made = eye(expressive, made)
        if self._slit_skin:
            made = self._slit_skin.without_folds(made, expressive)
        return np.asarray(made[self._skin])

    def _motion(self, expressive: F64) -> Similarity:
        """Rigid motion of the source head."""
        before, after = self.source.vertices[self._sample], expressive[self._sample]
        return Similarity(1.0, *align_rigid_robust(before, after, np.ones(len(before))))


def prepare_transfer(
    source: Mesh,
    target: Mesh,
    points: tuple[F64, F64] | None = None,
    method: Method = "tents",
    keep_rigid: bool = False,
) -> Transfer:
    """Register two heads and prepare a transfer between them.

    points : corresponding points (k, 3) on the source and (k, 3) on the target; None: feature points are detected.

    Raises
    ------
    FeaturePointsError, RegistrationError, MeshError, SolverError
        When no face is found, or a step fails.
    """
    face, trust = None, None
    if points is None:
        points = _feature_points(source, "source"), _feature_points(target, "target")
        source, target = (
            mesh if mesh.kinds is not None else with_components(mesh, name_components(mesh, own), own)
            for mesh, own in zip((source, target), points, strict=True)
        )
        face = FacePair.of(source, target, points)
        points, trust = face.with_margins(source, target), face.trust
    done = register(source, target, points, trust)
    return Transfer(source, target, done.correspondence(), method, keep_rigid, face, done.fitted)


def _feature_points(mesh: Mesh, name: str) -> F64:
    found = find_feature_points(mesh)
    if isinstance(found, Failed):
        raise FeaturePointsError(f"no face was found on the {name}: {found.reason}")
    return found.positions


def _make_method(method: Method, source: F64, target: VertexTents, reach: float) -> TransferMethod:
    if method == "tents":
        return TentTransfer(source, target.neutral, target.rings, reach, target).each
    by_one: dict[str, type[GradientTransfer | ExpressionCloning]] = {
        "gradients": GradientTransfer,
        "cloning": ExpressionCloning,
    }
    if method == "deformable":  # the deformed model has moved as the target should
        return lambda expressions: [target.neutral + (expressive - source) for expressive in expressions]
    if method in by_one:
        transfer = by_one[method](source, target.neutral, target.rings)
        return lambda expressions: [transfer(expressive) for expressive in expressions]
    raise MeshError(f"the method must be tents, deformable, gradients or cloning, got {method}")


def _deformed_model(source: Mesh, pose: Similarity, fitted: F64 | None, skin: Bool) -> GradientTransfer:
    """Deformation transfer from the skin of the source, in its pose on the target, to that deformed onto it."""
    if fitted is None:
        raise MeshError(
            "the method deformable needs the source deformed onto the target: take the dense correspondence"
        )
    return GradientTransfer(pose.apply(source.vertices[skin]), fitted[skin], submesh(source, skin).rings)


def _matched_skin(source: Mesh, target: Mesh, correspondence: Correspondence, skin: Bool) -> Bool:
    """Whether each skin vertex of the target has a counterpart on the skin of the source."""
    corners = correspondence.corners
    if len(corners) != len(target.vertices):
        raise MeshError(
            f"the correspondence is of {len(corners)} vertices, the target has {len(target.vertices)}"
        )
    if corners.max() >= len(source.vertices):
        raise MeshError(
            f"the correspondence names vertex {corners.max()}, the source has {len(source.vertices)}"
        )
    found = (correspondence.found & skin_mask(source)[corners].all(1))[skin]
    if found.sum() < 3:
        raise MeshError(
            f"the source has a place for {found.sum()} of {len(found)} skin vertices of the target: "
            "are they both heads? give feature points for both"
        )
    return np.asarray(found)


def _throat(skin: Mesh, found: Bool, face: FaceFrame | None) -> Bool:
    """(n,) the end of a mouth bag of which the source has nothing: it stays with the skull."""
    end = np.zeros(len(found), bool)
    if face is not None and not found.all():
        lacking = np.flatnonzero(~found)
        hole, inside = holes(skin.rings, found)[0], face.in_mouth(skin.vertices[lacking])
        bag = lacking[~np.isin(hole, hole[~inside])]
        end[bag] = face.throat(skin.vertices[bag])
    return end


def _align(source: F64, target: F64, weights: F64) -> Similarity:
    pose = align(source, target, weights)
    if isinstance(pose, Failed):
        raise MeshError(f"the source cannot be aligned with the target: {pose.reason}")
    return pose


def _keeps_ring_shape(change: F64) -> Bool:
    """Whether the ring of each vertex keeps its shape on the source, to which it is transformed by (n, 3, 3).

    A match on the other lip tears it.
    """
    stretch = np.linalg.svd(change, compute_uv=False)
    flipped = np.linalg.det(change) <= 0
    return np.asarray(
        (stretch[:, 0] < TRANSFER.max_ring_stretch) & (stretch[:, 2] > TRANSFER.min_ring_stretch) & ~flipped
    )


def _rms_radius(vertices: F64, weights: F64) -> float:
    """Root mean square distance from the centroid."""
    share = weights / weights.sum()
    return float(np.sqrt(share @ np.square(vertices - share @ vertices).sum(1)))


def _away_from_seam(mesh: Mesh, skin: Bool, span: float) -> F64 | None:
    """(n,) 0 for vertices of the skin where a body or clothes begin, rising to 1 away from there; None without any."""
    if mesh.kinds is None or not kind_mask(mesh, STILL).any():
        return None
    own, still = mesh.vertices[skin], kind_mask(mesh, STILL)
    crossing = mesh.faces[skin[mesh.faces].any(1) & still[mesh.faces].any(1)]
    seam = mesh.vertices[np.unique(crossing[skin[crossing]])]
    reach = CARRIERS.touching * span
    near = cKDTree(mesh.vertices[still]).query(own, distance_upper_bound=reach)[0] < reach
    seam = np.concatenate([seam, own[near]])
    if not len(seam):
        return None
    share = np.clip(cKDTree(seam).query(own)[0] / (TRANSFER.seam_spans * span), 0, 1)
    return np.asarray(share**2 * (3 - 2 * share))


def _apart_from_head(mesh: Mesh) -> Int:
    """Vertices (n,) of clothes and of a body that is not of one piece with the head: they stay when the head turns."""
    if mesh.kinds is None:
        return np.empty(0, np.intp)
    joined = np.unique(mesh.components[skin_mask(mesh)])
    return np.flatnonzero(kind_mask(mesh, STILL) & ~np.isin(mesh.components, joined))


def _subsample(vertices: Int) -> Int:
    return vertices[:: -(-len(vertices) // TRANSFER.pose_samples)]


def _require_expression(expressive: F64, source: Mesh) -> None:
    if expressive.shape != source.vertices.shape:
        raise MeshError(
            f"the expression has {len(expressive)} vertices, its neutral {len(source.vertices)}: "
            "both must be the same mesh, with its vertices in one order"
        )
    if not np.isfinite(expressive).all():
        raise MeshError("the expression has vertices that are not finite (NaN or infinite)")
