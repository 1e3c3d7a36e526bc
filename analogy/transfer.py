"""Expressions of one head carried to another of any topology, scale and pose.

The source is brought to the target's topology by a dense correspondence and into its frame by the similarity of the
two neutral heads; vertices for which the source has nothing, or a place out of order with those around it, continue
their surroundings.  A rigid motion of the whole expression is taken off before and put on again after, so that a nod
is a nod and nothing more.  Any units; the results are in the target's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from guise.aam.similarity import Failed, Similarity, align
from guise.analogy.baselines import Cloning, GradientTransfer
from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_points import FeaturePointsError, find
from guise.analogy.filling import Filling
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.parts import Parts, areas, restricted
from guise.analogy.register import register, skin_of
from guise.analogy.rigid import fit_most
from guise.analogy.tents import Tents, TentTransfer
from guise.common.arrays import F64, Bool, Int

Method = Literal["tents", "gradients", "cloning"]
Core = Callable[[F64], F64]

REACH = 0.15  # of the head's radius: the length over which tents rule
FADE = 0.3  # of the head's radius: how far an expression goes on where the source has nothing
STRETCHED, SQUEEZED = 3.0, 0.2  # of a ring on the source, from which its places are not believed
SAMPLE = 400  # vertices that say how the head as a whole moves


class Transfer:
    """Carries expressions of a source to a target; all that depends on the two neutral heads is done once.

    Parameters
    ----------
    source, target : neutral heads.   correspondence : for each target vertex its place on the source.
    method : tents (Song et al. 2007), gradients (Sumner and Popovic 2004) or cloning (Noh and Neumann 2001).
    keep_rigid : parts other than the skin (eyes, teeth) stay where they are in the head, instead of moving with it.

    Raises
    ------
    MeshError
        When the correspondence is not of these heads or finds next to nothing.
    SolverError
        When the target cannot be solved for.

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
    ) -> None:
        self.source, self.target = source, target
        on_skin = skin_of(target)
        found = _found(source, target, correspondence, on_skin)
        skin = restricted(target, on_skin)
        self._carry = correspondence.matrix(len(source.vertices))[np.flatnonzero(on_skin)]
        size = areas(skin) * found
        self.pose = _aligned(self._carry @ source.vertices, skin.vertices, size)
        apart = self.pose.apply(self._carry @ source.vertices) - skin.vertices
        radius = _radius(skin.vertices, size)
        continued = Filling(skin.vertices, skin.rings, found, FADE * radius)(apart)
        found &= _in_order(skin.vertices + continued, skin)
        self._fill = Filling(skin.vertices, skin.rings, found, FADE * radius)
        self._neutral = skin.vertices + self._fill(apart)
        self._core = _core(method, self._neutral, skin, REACH * radius)
        self._parts = Parts(target, on_skin, keep_rigid)
        self._sample = _sampled(np.flatnonzero(skin_of(source)))

    def __call__(self, expressive: F64) -> F64:
        """The target (N_t, 3) with the expression that the source has in `expressive` (N_s, 3).

        Raises
        ------
        MeshError
            When the expression has another number of vertices than the source, or one is not finite.
        """
        _check(expressive, self.source)
        motion = self._motion(expressive)
        way = (motion.inverse().apply(expressive) - self.source.vertices) @ self.pose.linear.T
        made = self._parts(self._core(self._neutral + self._fill(self._carry @ way)))
        return (self.pose @ motion @ self.pose.inverse()).apply(made)

    def _motion(self, expressive: F64) -> Similarity:
        """How the source's head as a whole moved."""
        before, after = self.source.vertices[self._sample], expressive[self._sample]
        return Similarity(1.0, *fit_most(before, after, np.ones(len(before))))


def prepare(
    source: Mesh,
    target: Mesh,
    points: tuple[F64, F64] | None = None,
    method: Method = "tents",
    keep_rigid: bool = False,
) -> Transfer:
    """A transfer between two heads that are registered first.

    points : (k, 3) on the source and (k, 3) on the target that belong together; None: the feature points are found.

    Raises
    ------
    FeaturePointsError, RegistrationError, MeshError, SolverError
        When there is no face to be found, and as the steps do.
    """
    if points is None:
        points = _feature_points(source, "source"), _feature_points(target, "target")
    correspondence = register(source, target, points).correspondence()
    return Transfer(source, target, correspondence, method, keep_rigid)


def _feature_points(mesh: Mesh, name: str) -> F64:
    found = find(mesh)
    if isinstance(found, Failed):
        raise FeaturePointsError(f"no face was found on the {name}: {found.reason}")
    return found.positions


def _core(method: Method, source: F64, target: Mesh, reach: float) -> Core:
    if method == "tents":
        return TentTransfer(source, target.vertices, target.rings, reach)
    if method == "gradients":
        return GradientTransfer(source, target.vertices, target.rings)
    if method == "cloning":
        return Cloning(source, target.vertices, target.rings)
    raise MeshError(f"the method must be tents, gradients or cloning, got {method}")


def _found(source: Mesh, target: Mesh, correspondence: Correspondence, skin: Bool) -> Bool:
    """Of each skin vertex of the target, whether it has a place on the source's skin."""
    corners = correspondence.corners
    if len(corners) != len(target.vertices):
        raise MeshError(
            f"the correspondence is of {len(corners)} vertices, the target has {len(target.vertices)}"
        )
    if corners.max() >= len(source.vertices):
        raise MeshError(
            f"the correspondence names vertex {corners.max()}, the source has {len(source.vertices)}"
        )
    found = (correspondence.found & skin_of(source)[corners].all(1))[skin]
    if found.sum() < 3:
        raise MeshError(
            f"the source has a place for {found.sum()} of {len(found)} skin vertices of the target: "
            "are they both heads? give feature points for both"
        )
    return np.asarray(found)


def _aligned(source: F64, target: F64, weights: F64) -> Similarity:
    pose = align(source, target, weights)
    if isinstance(pose, Failed):
        raise MeshError(f"the source cannot be aligned with the target: {pose.reason}")
    return pose


def _in_order(carried: F64, target: Mesh) -> Bool:
    """Of each vertex, whether its ring keeps about its form on the source: a place on the other lip tears it."""
    change = Tents(target.vertices, target.rings).transformations(carried)
    stretch = np.linalg.svd(change, compute_uv=False)
    flipped = np.linalg.det(change) <= 0
    return np.asarray((stretch[:, 0] < STRETCHED) & (stretch[:, 2] > SQUEEZED) & ~flipped)


def _radius(vertices: F64, weights: F64) -> float:
    """Root mean square distance from the middle."""
    share = weights / weights.sum()
    return float(np.sqrt(share @ np.square(vertices - share @ vertices).sum(1)))


def _sampled(vertices: Int) -> Int:
    return vertices[:: -(-len(vertices) // SAMPLE)]


def _check(expressive: F64, source: Mesh) -> None:
    if expressive.shape != source.vertices.shape:
        raise MeshError(
            f"the expression has {len(expressive)} vertices, its neutral {len(source.vertices)}: "
            "both must be the same mesh, with its vertices in one order"
        )
    if not np.isfinite(expressive).all():
        raise MeshError("the expression has vertices that are not finite (NaN or infinite)")
