"""Properties of vertex tents and of the transfer by them, on a curved sheet of quads."""

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from guise.analogy.baselines import ExpressionCloning, GradientTransfer
from guise.analogy.solver import (
    SolverError,
    _by_superlu,
    _nested_dissection,
    factorise,
)
from guise.analogy.tents import Rings, TentTransfer, VertexTents, tips, vertex_error
from guise.common.arrays import F64, Int

SIDE = 14


def grid() -> Int:
    at = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    corners = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    return np.stack([c.ravel() for c in corners], axis=1)


def sheet(bend: float = 1.0, seed: int = 0) -> F64:
    """A curved sheet (196, 3) with a little noise."""
    u, v = np.meshgrid(np.linspace(-1, 1, SIDE), np.linspace(-1, 1, SIDE))
    noise = np.random.default_rng(seed).normal(0, 0.01, (SIDE * SIDE, 3))
    return np.stack([u, v, -bend * (u**2 + 0.5 * v**2)], axis=2).reshape(-1, 3) + noise


def smiling(neutral: F64) -> F64:
    """An expression: the lower half is drawn up and out; the upper half does not move."""
    lower = np.clip(-neutral[:, 1:2], 0, None) ** 2
    way = np.concatenate(
        [0.3 * neutral[:, :1], np.full((len(neutral), 1), 0.2), np.full((len(neutral), 1), 0.1)], 1
    )
    return neutral + lower * way


def turned(degrees: float) -> F64:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


QUADS = grid()
TRIANGLES = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
RINGS = Rings.of(SIDE * SIDE, (), QUADS)
SOURCE, TARGET = sheet(), sheet(0.6, seed=1) * (1.1, 0.9, 1.0)


def test_rings_of_a_quad_leave_out_its_diagonal() -> None:
    rings = Rings.of(4, (), [[0, 1, 2, 3]])
    assert set(zip(rings.start.tolist(), rings.end.tolist(), strict=True)) == {
        (0, 1), (1, 0), (1, 2), (2, 1), (2, 3), (3, 2), (3, 0), (0, 3),
    }  # fmt: skip
    assert len(rings.triangles) == 2


def test_a_tip_stands_on_its_face_and_grows_with_the_mesh() -> None:
    flat = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    rings = Rings.of(4, (), [[0, 1, 2, 3]])
    assert_allclose(tips(flat, rings), [[0, 0, 2]] * 4)
    assert_allclose(tips(3 * flat, rings), 3 * tips(flat, rings))


def test_the_transformation_of_a_turned_and_scaled_mesh_is_that_everywhere() -> None:
    motion = 1.7 * turned(35)
    found = VertexTents(SOURCE, RINGS).transformations(SOURCE @ motion.T + (4, 5, 6))
    assert_allclose(found, np.broadcast_to(motion.T, found.shape), atol=1e-4)


def test_an_expression_carried_to_its_own_mesh_is_itself() -> None:
    expressive = smiling(SOURCE)
    made = TentTransfer(SOURCE, SOURCE, RINGS)(expressive)
    assert np.nanmax(vertex_error(SOURCE, expressive, made)) < 1e-3
    assert_allclose(made, expressive, atol=1e-5)


def test_no_expression_gives_the_neutral_target() -> None:
    assert_allclose(TentTransfer(SOURCE, TARGET, RINGS)(SOURCE), TARGET, atol=1e-5)


def test_what_is_made_is_the_expression_and_not_a_copy_of_the_source() -> None:
    made = TentTransfer(SOURCE, TARGET, RINGS)(smiling(SOURCE))
    wanted, without = smiling(TARGET), TARGET
    assert np.abs(made - wanted).mean() < 0.25 * np.abs(without - wanted).mean()


def test_a_larger_target_gets_a_larger_expression() -> None:
    made = TentTransfer(SOURCE, TARGET, RINGS)(smiling(SOURCE))
    larger = TentTransfer(SOURCE, 7 * TARGET, RINGS)(smiling(SOURCE))
    assert_allclose(
        (larger - 7 * TARGET) - (larger - 7 * TARGET).mean(0),
        7 * (made - TARGET) - 7 * (made - TARGET).mean(0),
        atol=1e-3,
    )


def test_turning_the_whole_source_turns_the_whole_result() -> None:
    motion = turned(25)
    made = TentTransfer(SOURCE, TARGET, RINGS)(smiling(SOURCE))
    moved = TentTransfer(SOURCE, TARGET, RINGS)(smiling(SOURCE) @ motion.T)
    centred = moved - moved.mean(0), made @ motion.T - (made @ motion.T).mean(0)
    assert_allclose(*centred, atol=1e-3)


def test_several_expressions_at_once_are_what_each_is_alone() -> None:
    transfer = TentTransfer(SOURCE, TARGET, RINGS)
    expressions = [smiling(SOURCE), SOURCE, smiling(SOURCE) @ turned(25).T]
    for made, expressive in zip(transfer.each(expressions), expressions, strict=True):
        assert_allclose(made, transfer(expressive), atol=1e-8)


def test_quads_and_their_triangulation_agree() -> None:
    by_quads = TentTransfer(SOURCE, TARGET, RINGS)(smiling(SOURCE))
    by_triangles = TentTransfer(SOURCE, TARGET, Rings.of(SIDE * SIDE, TRIANGLES))(smiling(SOURCE))
    way = np.linalg.norm(smiling(SOURCE) - SOURCE, axis=1).max()
    assert np.abs(by_quads - by_triangles).max() < 0.05 * way


def test_a_face_without_area_gives_numbers() -> None:
    broken = SOURCE.copy()
    broken[20] = broken[21] = broken[22]
    assert np.isfinite(TentTransfer(broken, TARGET, RINGS)(smiling(broken))).all()
    assert np.isfinite(TentTransfer(SOURCE, broken, RINGS)(smiling(SOURCE))).all()


def positive_definite(size: int) -> sp.csc_matrix:
    rng = np.random.default_rng(3)
    root = sp.random_array((3 * size // 2, size), density=8 / size, rng=rng) + sp.eye_array(
        3 * size // 2, size
    )
    return sp.csc_matrix(root.T @ root)


def test_every_order_of_the_unknowns_solves_alike_and_refuses_what_is_singular() -> None:
    matrix, right = positive_definite(40), np.random.default_rng(4).normal(size=(40, 3))
    for solve in (factorise(matrix), _by_superlu(matrix, np.random.default_rng(5).permutation(40))):
        assert_allclose(matrix @ solve(right), right, atol=1e-9)
    for order in (None, np.arange(4)):
        with pytest.raises(SolverError, match="no unique solution"):
            _by_superlu(sp.csc_matrix((4, 4)), order)


def test_large_meshes_are_iterated_to_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    expressions = [smiling(SOURCE), SOURCE, turned(10) @ SOURCE.T]
    expressions[2] = np.ascontiguousarray(expressions[2].T)
    exact = TentTransfer(SOURCE, TARGET, RINGS, 0.5).each(expressions)
    monkeypatch.setattr("guise.analogy.solver.MAX_FACTORISED", 10)
    for one, other in zip(TentTransfer(SOURCE, TARGET, RINGS, 0.5).each(expressions), exact, strict=True):
        assert_allclose(one, other, atol=2e-3 * np.abs(exact[0] - TARGET).max())
    monkeypatch.setattr("guise.analogy.solver.MAX_ITERATIONS", 0)
    with pytest.raises(SolverError):
        TentTransfer(SOURCE, TARGET, RINGS, 0.5)(smiling(SOURCE))


def test_nested_dissection_orders_every_unknown_once_and_solves_alike() -> None:
    pytest.importorskip("pymetis")
    matrix, right = positive_definite(100), np.random.default_rng(4).normal(size=(100, 3))
    order = _nested_dissection(matrix)
    assert order is not None
    assert sorted(order.tolist()) == list(range(100))
    assert_allclose(_by_superlu(matrix, order)(right), factorise(matrix)(right), atol=1e-9)


@pytest.mark.parametrize("method", [GradientTransfer, ExpressionCloning])
def test_the_other_methods_know_themselves_and_the_neutral(
    method: type[GradientTransfer] | type[ExpressionCloning],
) -> None:
    expressive = smiling(SOURCE)
    assert_allclose(method(SOURCE, SOURCE, RINGS)(expressive), expressive, atol=1e-5)
    assert_allclose(method(SOURCE, TARGET, RINGS)(SOURCE), TARGET, atol=1e-5)


@pytest.mark.parametrize("method", [TentTransfer, GradientTransfer, ExpressionCloning])
def test_every_method_turns_an_expression_with_the_head(
    method: type[TentTransfer] | type[GradientTransfer] | type[ExpressionCloning],
) -> None:
    motion = 1.3 * turned(20)
    made = method(SOURCE, TARGET, RINGS)(smiling(SOURCE))
    moved = method(SOURCE @ motion.T, TARGET @ motion.T, RINGS)(smiling(SOURCE) @ motion.T)
    assert_allclose(moved, made @ motion.T, atol=1e-4)


def test_deformation_transfer_turns_with_the_source_alone() -> None:
    motion = turned(25)
    made = GradientTransfer(SOURCE, TARGET, RINGS)(smiling(SOURCE))
    moved = GradientTransfer(SOURCE, TARGET, RINGS)(smiling(SOURCE) @ motion.T)
    assert_allclose(moved - moved.mean(0), (made - made.mean(0)) @ motion.T, atol=1e-3)


def test_cloning_scales_with_the_target() -> None:
    made = ExpressionCloning(SOURCE, 2 * SOURCE, RINGS)(smiling(SOURCE))
    assert_allclose(made, 2 * smiling(SOURCE), atol=1e-9)


def test_cloning_stays_finite_where_the_source_collapses() -> None:
    """Such as where several vertices of a target have one place on the source."""
    source = SOURCE.copy()
    source[[0, 1, SIDE, SIDE + 1]] = source[0]
    made = ExpressionCloning(source, TARGET, RINGS)(smiling(source))
    assert np.abs(made - TARGET).max() < 4 * np.abs(smiling(source) - source).max()
