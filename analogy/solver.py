"""Symmetric positive definite sparse systems: factorised once, solved many times.

SciPy's SuperLU, with its ordering for symmetric matrices, which takes half the time of the default.  Where pymetis is
installed, large systems are ordered by METIS's nested dissection, whose factors are smaller by a third.  BLAS runs in
one thread: the blocks are small, and a second thread doubles the processor time on a busy machine.
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
    """The solver of (A^T A + hold) x = r for right-hand sides r (n, k); factorised once.

    system : A (m, n).   hold : weight that keeps x near its prior.

    Raises
    ------
    SolverError
        When a part of x is undetermined.
    """
    normal = sp.csc_array(system.T @ system)
    return factorise(normal + hold * sp.eye_array(normal.shape[0], format="csc"))


def compact_rows(matrix: sp.sparray) -> sp.csr_array:
    """The matrix in CSR format with 32-bit indices, which saves a quarter of the memory traffic of a product."""
    rows = sp.csr_array(matrix)
    indices, ends = rows.indices.astype(np.int32), rows.indptr.astype(np.int32)
    return sp.csr_array((rows.data, indices, ends), shape=rows.shape)


def solver_name() -> str:
    """Name of the solver in use, for reports."""
    return "SuperLU" if find_spec("pymetis") is None else "SuperLU, METIS"


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
