"""Weighted similarity alignment of n-D points: the pose of a face and the palette of its colours.

A similarity maps x to scale * R x + t.  The same solver serves landmarks (2-D, pixels, x right, y down) and
RGB triples (3-D, 0..255), as in de la Hunty, Asthana and Goecke (ICPR 2010), section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guise.common.arrays import F64
from guise.common.kernels import kernel
from guise.common.small import mean

Complex = NDArray[np.complex128]
Scale = Literal["least-squares", "symmetric"]


@dataclass(frozen=True)
class Failed:
    """An expected numerical failure: falsy, and carries its reason.

    >>> bool(Failed("coincident points"))
    False
    """

    reason: str

    def __bool__(self) -> Literal[False]:
        return False


@dataclass(frozen=True, eq=False)
class Similarity:
    """x -> scale * R x + t.

    Parameters
    ----------
    scale : float > 0.
    rotation : (d, d) float, a proper rotation.
    translation : (d,) float, in the units of the points.
    """

    scale: float
    rotation: F64
    translation: F64

    @classmethod
    def identity(cls, dimension: int = 2) -> Similarity:
        """The similarity that leaves every point of the given dimension where it is."""
        return cls(1.0, np.eye(dimension), np.zeros(dimension))

    @property
    def linear(self) -> F64:
        """(d, d) float: scale * R."""
        return self.scale * self.rotation

    def apply(self, points: ArrayLike) -> F64:
        """Points (n, d) mapped; shape (n, d)."""
        return np.asarray(np.asarray(points, np.float64) @ self.linear.T + self.translation)

    def inverse(self) -> Similarity:
        """The similarity that undoes this one."""
        back = self.rotation.T
        return Similarity(1.0 / self.scale, back, -(back @ self.translation) / self.scale)

    def __matmul__(self, other: Similarity) -> Similarity:
        """Composition: (a @ b).apply(x) == a.apply(b.apply(x))."""
        return Similarity(
            self.scale * other.scale,
            self.rotation @ other.rotation,
            self.scale * (self.rotation @ other.translation) + self.translation,
        )


def align(
    source: ArrayLike,
    target: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    scale: Scale = "least-squares",
    prior: float = 0.0,
) -> Similarity | Failed:
    """Weighted similarity that takes source to target.

    Parameters
    ----------
    source, target : (n, d) float, the same units.
    weights : (n,) float >= 0, uniform when None.  They enter the means, the variances and the covariance.
    scale : "least-squares" is trace(D S) / sigma_x^2; it shrinks contrast when the two sets decorrelate.
        "symmetric" is sigma_y / sigma_x, which does not.
    prior : float >= 0, pull of the rotation towards the identity, relative to the mean variance of the two
        sets; 0 is the plain solution.

    Returns
    -------
    Similarity, or Failed("coincident points") when the weighted points have no extent.

    References
    ----------
    Umeyama 1991, eqs. 38-43, with weights in the covariance, and S = diag(1, .., 1, sign det Z).

    Examples
    --------
    >>> moved = align([[0, 0], [1, 0], [0, 1]], [[2, 2], [2, 4], [0, 2]])
    >>> round(moved.scale, 6), moved.apply([[1, 1]]).round(6).tolist()
    (2.0, [[0.0, 4.0]])
    """
    x, y = np.asarray(source, np.float64), np.asarray(target, np.float64)
    if x.ndim != 2 or x.shape != y.shape:
        raise ValueError(f"source and target must be (n, d) alike, got {x.shape} and {y.shape}")
    w = _normalised_weights(weights, len(x))
    if w is None:
        return Failed("all weights are zero")
    mu_x, mu_y = w @ x, w @ y
    dx, dy = x - mu_x, y - mu_y
    var_x, var_y = float(w @ (dx * dx).sum(1)), float(w @ (dy * dy).sum(1))
    if var_x <= _rounding_variance(x) or var_y <= _rounding_variance(y):
        return Failed("coincident points")
    z = (dy * w[:, None]).T @ dx  # Z of the paper
    if prior > 0:
        z = z + prior * np.sqrt(var_x * var_y) / x.shape[1] * np.eye(x.shape[1])
    rotation, d = nearest_rotation(z)
    c = float(np.sqrt(var_y / var_x)) if scale == "symmetric" else float(d.sum() / var_x)
    if c <= 0:
        return Failed("the points have no common direction")
    return Similarity(c, rotation, mu_y - c * (rotation @ mu_x))


def _rounding_variance(points: F64) -> float:
    """Variance up to which points (n, d) coincide, whatever their unit."""
    return 1e-12 * float(np.abs(points).max(initial=0)) ** 2


def _normalised_weights(weights: ArrayLike | None, n: int) -> F64 | None:
    if weights is None:
        return np.full(n, 1.0 / n)
    w = np.asarray(weights, np.float64)
    if w.shape != (n,):
        raise ValueError(f"weights must be ({n},), got {w.shape}")
    if (w < 0).any() or not np.isfinite(w).all():
        raise ValueError("weights must be finite and not negative")
    total = float(w.sum())
    return w / total if total > 0 else None


def nearest_rotation(z: F64) -> tuple[F64, F64]:
    """The proper rotation (..., d, d) that is nearest to a covariance (..., d, d) of target and source.

    Also its singular values (..., d), the last one with the sign that makes the rotation proper (Umeyama 1991, eq. 43).
    """
    u, d, vt = np.linalg.svd(z)
    sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    u[..., -1] *= sign[..., None]
    d[..., -1] *= sign
    return np.asarray(u @ vt), np.asarray(d)


def align_rigid(source: F64, target: F64, weights: F64) -> tuple[F64, F64]:
    """R (..., d, d) and t (..., d) of the least-squares motion x -> R x + t from source to target (..., n, d).

    :func:`align` without the scale, for batches.   weights : (..., n), positive.
    """
    w = (weights / weights.sum(-1, keepdims=True))[..., None]
    mu_x, mu_y = (w * source).sum(-2), (w * target).sum(-2)
    z = np.swapaxes(w * (target - mu_y[..., None, :]), -1, -2) @ (source - mu_x[..., None, :])
    rotation = nearest_rotation(z)[0]
    return rotation, mu_y - np.einsum("...ij,...j->...i", rotation, mu_x)


def align_complex(source: Complex, target: Complex) -> tuple[Complex, Complex]:
    """Least-squares 2-D similarities of source (n,) to targets (..., n), points as x + iy: scale z + shift.

    :func:`align` without weights, for batches.  Both results are (..., 1); the absolute value of the first is the scale
    and its angle the turn.  The source must have extent.
    """
    mu_x, mu_y = mean(source), mean(target, -1)[..., None]
    dx = source - mu_x
    covariance: Complex = np.add.reduce(np.conj(dx) * (target - mu_y), -1, keepdims=True)
    scale = covariance / np.add.reduce(np.abs(dx) ** 2)
    return scale, mu_y - scale * mu_x


class PlanarSimilarity(NamedTuple):
    """x' = a x - b y + tx, y' = b x + a y + ty."""

    a: float
    b: float
    tx: float
    ty: float

    @property
    def linear(self) -> F64:
        """(2, 2) for rows: points (n, 2) go to points @ linear + (tx, ty)."""
        return np.array([[self.a, self.b], [-self.b, self.a]])

    @property
    def scale(self) -> float:
        """Target pixels per source pixel."""
        return float(np.hypot(self.a, self.b))

    @property
    def inverse(self) -> PlanarSimilarity:
        """The similarity that takes points back; the scale must not be 0."""
        turn = 1 / complex(self.a, self.b)
        return _similarity(turn, complex(self.tx, self.ty), 0)

    def apply(self, points: F64) -> F64:
        """Points (n, 2) mapped; shape (n, 2)."""
        mapped: F64 = points @ self.linear + (self.tx, self.ty)
        return mapped


def align_planar(source: F64, target: F64, weights: F64) -> PlanarSimilarity:
    """Least-squares 2-D similarity: the closed form of :func:`align` for the per-frame path.

    Weights (n,) must sum to 1 and the source must have extent; neither is checked here.
    """
    made = np.empty(4)
    planar_similarity(source, target, weights, made)
    return PlanarSimilarity(*made.tolist())


@kernel
def planar_similarity(source: F64, target: F64, weights: F64, made: F64) -> None:
    """The numbers of the similarity that takes points to others.

    source, target : (n, 2).   weights : (n,), summing to 1.   made : (4,), those of `PlanarSimilarity`, written.
    """
    (mu_x, away), (mu_y, goal) = (_centred(points, weights) for points in (source, target))
    weighted = weights * away
    turn = complex(np.vdot(weighted, goal)) / float(np.vdot(weighted, away).real)
    made[:] = _similarity(turn, mu_x, mu_y)


def _centred(points: F64, weights: F64) -> tuple[complex, Complex]:
    """Their weighted mean and what they are away from it (n,), as x + iy."""
    plane: Complex = np.ascontiguousarray(points, np.float64).view(np.complex128)[:, 0]
    mean = complex(weights @ plane)
    return mean, plane - mean


def _similarity(turn: complex, source: complex, target: complex) -> PlanarSimilarity:
    """The similarity that multiplies by a complex number and takes a point to another."""
    shift = target - turn * source
    return PlanarSimilarity(turn.real, turn.imag, shift.real, shift.imag)
