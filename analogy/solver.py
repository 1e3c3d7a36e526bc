"""Symmetric positive definite sparse systems: factorised once, solved many times, or iterated where they are large.

SciPy's SuperLU, with its ordering for symmetric matrices, which takes half the time of the default.  Where pymetis is
installed, large systems are ordered by METIS's nested dissection, whose factors are smaller by a third.  BLAS runs in
one thread: the blocks are small, and a second thread doubles the processor time on a busy machine.

The factors of a fine mesh take gigabytes.  Conjugate gradients need none, and few steps where the prior holds each
unknown against a short reach, as in a transfer by tents.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp

from guise.common.arrays import F64, Int
from guise.common.errors import GuiseError

Solve = Callable[[F64], F64]

MIN_DISSECTED = 2000  # unknowns; below, an ordering takes longer than it saves
MAX_FACTORISED = 120_000  # unknowns; above, a system is iterated if it is well conditioned
MAX_STIFFNESS = 1e4  # mean of the diagonal, of the hold, up to which it is well conditioned
ITERATED_RESIDUAL, MAX_ITERATIONS = 1e-3, 300  # of the first, in the norm of the preconditioner; steps
SMOOTHING = 0.33  # of the interpolation
NOT_UNIQUE = "the system has no unique solution: part of the mesh is unconstrained"


class SolverError(GuiseError):
    """A system that has no unique solution; one sentence."""


def factorise(matrix: sp.sparray) -> Solve:
    """The solver of A x = b for right-hand sides b (n, k).

    matrix : A (n, n), symmetric positive definite.

    Raises
    ------
    SolverError
        When it is not positive definite.

    Examples
    --------
    >>> solve = factorise(sp.csc_array(np.diag([2.0, 4.0])))
    >>> solve(np.array([[2.0], [2.0]])).ravel().tolist()
    [1.0, 0.5]
    """
    return make_factoriser(matrix)(matrix)


def make_factoriser(like: sp.sparray) -> Callable[[sp.sparray], Solve]:
    """`factorise` for matrices with the nonzero pattern of `like`: the ordering is found once."""
    order = _nested_dissection(like) if like.shape[0] >= MIN_DISSECTED else None
    return lambda matrix: _by_superlu(sp.csc_matrix(matrix), order)


def factorise_least_squares(system: sp.sparray, hold: float) -> Solve:
    """The solver of (A^T A + hold) x = r for right-hand sides r (n, k); factorised once, or iterated if large.

    system : A (m, n).   hold : weight that keeps x near its prior.

    Raises
    ------
    SolverError
        When a part of x is undetermined.
    """
    normal = sp.csc_array(system.T @ system)
    stiffness = float(normal.diagonal().mean())
    matrix = normal + hold * sp.eye_array(normal.shape[0], format="csc")
    if len(normal.indptr) > MAX_FACTORISED and stiffness <= MAX_STIFFNESS * hold:
        return _iterate(compact_rows(matrix))
    return factorise(matrix)


def compact_rows(matrix: sp.sparray) -> sp.csr_array:
    """The matrix in CSR format with 32-bit indices, which saves a quarter of the memory traffic of a product."""
    rows = sp.csr_array(matrix)
    indices, ends = rows.indices.astype(np.int32), rows.indptr.astype(np.int32)
    return sp.csr_array((rows.data, indices, ends), shape=rows.shape)


def solver_name() -> str:
    """Name of the solver in use, for reports."""
    return "SuperLU" if find_spec("pymetis") is None else "SuperLU, METIS"


def _iterate(matrix: sp.csr_array) -> Solve:
    """Conjugate gradients; all right-hand sides advance together.

    Preconditioned by the diagonal and by the solution on a coarse level (additive two-level method): an independent set
    of the unknowns, from which the others are interpolated by the sizes of their entries.
    """
    scale = 1 / matrix.diagonal()[:, None]
    spread = abs(matrix)[:, _independent_set(matrix)]
    spread = sp.diags_array(1 / spread.sum(axis=1)) @ spread
    spread = compact_rows(spread - SMOOTHING * sp.diags_array(scale[:, 0]) @ (matrix @ spread))
    gather = compact_rows(spread.T)
    coarse = factorise(gather @ matrix @ spread)

    def solve(right: F64) -> F64:
        found, residual = np.zeros_like(right), right.copy()
        way, before, enough = np.zeros_like(right), np.ones(right.shape[1]), None
        for _ in range(MAX_ITERATIONS):
            drawn = scale * residual + spread @ coarse(gather @ residual)
            size = (residual * drawn).sum(0)
            enough = ITERATED_RESIDUAL**2 * size if enough is None else enough
            if (size <= enough).all():
                return found
            way *= size / before.clip(1e-300)
            way += drawn
            ahead = matrix @ way
            step = size / (way * ahead).sum(0).clip(1e-300)
            found += step * way
            residual -= step * ahead
            before = size
        raise SolverError(NOT_UNIQUE)

    return solve


def _independent_set(matrix: sp.csr_array) -> Int:
    """(c,) unknowns, no two of which share an entry, and with one of which every other unknown shares one."""
    rank = np.random.default_rng(0).permutation(matrix.shape[0]) + 1
    chosen = np.zeros(len(rank), bool)
    while rank.any():
        best = np.maximum.reduceat(rank[matrix.indices], matrix.indptr[:-1])
        new = (rank > 0) & (rank == best)
        chosen |= new
        rank[new | (np.maximum.reduceat(new[matrix.indices], matrix.indptr[:-1]))] = 0
    return np.flatnonzero(chosen)


def _nested_dissection(matrix: sp.sparray) -> Int | None:
    """(n,) the rows in the order of METIS's nested dissection; None where it is not installed."""
    try:
        import pymetis
    except ImportError:
        return None
    entries = sp.coo_matrix(matrix)
    off = entries.row != entries.col
    graph = sp.csr_matrix((off[off], (entries.row[off], entries.col[off])), shape=matrix.shape)
    adjacency = pymetis.CSRAdjacency(graph.indptr.astype(np.int32), graph.indices.astype(np.int32))
    return np.asarray(pymetis.nested_dissection(adjacency)[0], np.intp)


def _by_superlu(matrix: sp.csc_matrix, order: Int | None = None) -> Solve:
    from scipy.sparse.linalg import splu

    from guise.common.threads import one_thread

    placed = matrix if order is None else sp.csc_matrix(matrix[order][:, order])
    ordering = "MMD_AT_PLUS_A" if order is None else "NATURAL"
    try:
        with one_thread():
            factor = splu(placed, permc_spec=ordering, diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise SolverError(NOT_UNIQUE) from error

    def solve(right: F64) -> F64:
        given = np.ascontiguousarray(right, np.float64)
        with one_thread():
            if order is None:
                return np.asarray(factor.solve(given))
            found = np.empty_like(given)
            found[order] = factor.solve(given[order])
            return found

    return solve
