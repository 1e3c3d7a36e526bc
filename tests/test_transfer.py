"""Properties of the transfer between heads, on curved sheets of different topologies with eyes and lashes."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from guise.aam.similarity import Failed, Similarity, align_rigid
from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_points import FeaturePointsError
from guise.analogy.filling import TensionFill
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.rigid import align_rigid_robust, apply_rigid
from guise.analogy.tents import vertex_error
from guise.analogy.transfer import Method, Transfer, prepare_transfer
from guise.common.arrays import F64, Bool, Int

METHODS: tuple[Method, ...] = ("tents", "gradients", "cloning")
NO_TRIANGLES, NO_QUADS = np.empty((0, 3), np.intp), np.empty((0, 4), np.intp)


def quads_of(wide: int, high: int) -> Int:
    at = np.arange(wide * high).reshape(high, wide)
    corners = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    return np.stack([c.ravel() for c in corners], axis=1)


def places(wide: int, high: int) -> F64:
    """(n, 2) in -1..1."""
    u, v = np.meshgrid(np.linspace(-1, 1, wide), np.linspace(-1, 1, high))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def surface(at: F64, bend: float) -> F64:
    return np.column_stack([at, -bend * (at[:, 0] ** 2 + 0.5 * at[:, 1] ** 2)])


def smiling(neutral: F64) -> F64:
    """The lower half is drawn up and out; the upper half does not move."""
    lower = np.clip(-neutral[:, 1:2], 0, None) ** 2
    return neutral + lower * np.column_stack([0.3 * neutral[:, 0], np.full((len(neutral), 2), (0.2, 0.1))])


def between(wide: int, high: int, at: F64) -> Correspondence:
    """Where places (n, 2) lie on a sheet of quads."""
    column, row = (at[:, 0] + 1) / 2 * (wide - 1), (at[:, 1] + 1) / 2 * (high - 1)
    i, j = np.minimum(column.astype(int), wide - 2), np.minimum(row.astype(int), high - 2)
    x, y = column - i, row - j
    first = j * wide + i
    right = x >= y
    corners = np.column_stack(
        [first, np.where(right, first + 1, first + wide + 1), np.where(right, first + wide + 1, first + wide)]
    )
    one, two = np.where(right, x - y, x), np.where(right, y, y - x)
    return Correspondence(corners, np.column_stack([1 - one - two, one, two]), np.ones(len(at), bool))


def triangulated(quads: Int) -> Int:
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


COARSE, FINE = (14, 15), (21, 19)
SOURCE = Mesh(surface(places(*COARSE), 1.0), NO_TRIANGLES, quads_of(*COARSE))
TARGET = Mesh(surface(places(*FINE), 0.7) * (1.1, 0.9, 1.0), triangulated(quads_of(*FINE)), NO_QUADS)
LINK = between(*COARSE, places(*FINE))

angles = st.tuples(*[st.floats(-180, 180)] * 3)
shifts = st.tuples(*[st.floats(-50, 50)] * 3)


def motion(turn: tuple[float, ...], shift: tuple[float, ...], scale: float = 1.0) -> Similarity:
    return Similarity(scale, Rotation.from_euler("xyz", turn, degrees=True).as_matrix(), np.array(shift))


def placed(mesh: Mesh, by: Similarity) -> Mesh:
    return mesh.with_vertices(by.apply(mesh.vertices))


@pytest.fixture(scope="module", params=METHODS)
def transfer(request: pytest.FixtureRequest) -> Transfer:
    return Transfer(SOURCE, TARGET, LINK, request.param)


def test_the_neutral_face_gives_the_neutral_face(transfer: Transfer) -> None:
    assert_allclose(transfer(SOURCE.vertices), TARGET.vertices, atol=1e-12)


def test_several_expressions_at_once_are_what_each_is_alone(transfer: Transfer) -> None:
    by = motion((0, 20, 0), (1, 2, 3))
    expressions = [smiling(SOURCE.vertices), SOURCE.vertices, by.apply(smiling(SOURCE.vertices))]
    for made, expressive in zip(transfer.each(expressions), expressions, strict=True):
        assert_allclose(made, transfer(expressive), atol=1e-10)
    assert transfer.each([]) == []


@given(turn=angles, shift=shifts)
@pytest.mark.slow
def test_a_rigid_motion_of_the_expression_changes_the_pose_alone(
    transfer: Transfer, turn: tuple[float, ...], shift: tuple[float, ...]
) -> None:
    by = motion(turn, shift)
    expected = (transfer.pose @ by @ transfer.pose.inverse()).apply(transfer(smiling(SOURCE.vertices)))
    made = transfer(by.apply(smiling(SOURCE.vertices)))
    assert_allclose(made, expected, atol=1e-8)


@settings(max_examples=10)
@given(turn=angles, shift=shifts, scale=st.floats(0.01, 100), method=st.sampled_from(METHODS))
def test_a_target_that_is_turned_and_scaled_gets_its_expression_turned_and_scaled(
    turn: tuple[float, ...], shift: tuple[float, ...], scale: float, method: Method
) -> None:
    by = motion(turn, shift, scale)
    made = Transfer(SOURCE, placed(TARGET, by), LINK, method)(smiling(SOURCE.vertices))
    expected = by.apply(Transfer(SOURCE, TARGET, LINK, method)(smiling(SOURCE.vertices)))
    assert_allclose(made, expected, atol=1e-7 * scale)


@settings(max_examples=10)
@given(turn=angles, shift=shifts, scale=st.floats(0.01, 100), method=st.sampled_from(METHODS))
def test_a_source_that_is_turned_and_scaled_gives_the_same(
    turn: tuple[float, ...], shift: tuple[float, ...], scale: float, method: Method
) -> None:
    by = motion(turn, shift, scale)
    made = Transfer(placed(SOURCE, by), TARGET, LINK, method)(by.apply(smiling(SOURCE.vertices)))
    expected = Transfer(SOURCE, TARGET, LINK, method)(smiling(SOURCE.vertices))
    assert_allclose(made, expected, atol=1e-7)


@given(amount=st.floats(0.01, 1.5), seed=st.integers(0, 99))
@settings(max_examples=15)
def test_a_mesh_transferred_onto_itself_returns_itself(amount: float, seed: int) -> None:
    rough = np.random.default_rng(seed).normal(0, 0.01, SOURCE.vertices.shape)
    source = SOURCE.with_vertices(SOURCE.vertices + rough)
    expressive = source.vertices + amount * (smiling(source.vertices) - source.vertices)
    made = Transfer(source, source, Correspondence.identity(len(source.vertices)))(expressive)
    assert np.nanmax(vertex_error(source.vertices, expressive, made)) < 1e-6


def test_quads_and_their_triangulation_agree() -> None:
    whole = Mesh(TARGET.vertices, NO_TRIANGLES, quads_of(*FINE))
    split = Mesh(SOURCE.vertices, triangulated(SOURCE.quads), NO_QUADS)
    expressive = smiling(SOURCE.vertices)
    made = [Transfer(a, b, LINK)(expressive) for a, b in ((SOURCE, whole), (SOURCE, TARGET), (split, TARGET))]
    way = np.linalg.norm(made[0] - TARGET.vertices, axis=1).max()
    assert np.abs(made[0] - made[1]).max() < 0.03 * way
    assert_allclose(made[1], made[2], atol=1e-12)


def test_what_is_made_is_the_expression_of_the_other_head() -> None:
    """The truth: the target's sheet is the source's stretched, its expression the source's stretched alike."""
    stretch = (1.1, 0.9, 1.0)
    target = SOURCE.with_vertices(SOURCE.vertices * stretch)
    link = Correspondence.identity(len(target.vertices))
    wanted = smiling(SOURCE.vertices) * stretch
    made = Transfer(SOURCE, target, link)(smiling(SOURCE.vertices))
    assert (
        np.linalg.norm(made - wanted, axis=1).mean()
        < 0.15 * np.linalg.norm(wanted - target.vertices, axis=1).mean()
    )


# -- what the source has nothing for ----------------------------------------------------------------------------


def with_hole(missing: Bool) -> Correspondence:
    """Where nothing is found, places are nonsense."""
    corners = np.where(missing[:, None], 0, LINK.corners)
    return Correspondence(corners, LINK.weights, ~missing)


@pytest.mark.parametrize("method", METHODS)
def test_vertices_without_a_counterpart_continue_those_around_them(method: Method) -> None:
    at = places(*FINE)
    missing = (np.abs(at[:, 0]) < 0.25) & (np.abs(at[:, 1] + 0.6) < 0.25)
    assert 10 < missing.sum() < 100
    whole = Transfer(SOURCE, TARGET, LINK, method)(smiling(SOURCE.vertices))
    made = Transfer(SOURCE, TARGET, with_hole(missing), method)(smiling(SOURCE.vertices))
    way = np.linalg.norm(whole - TARGET.vertices, axis=1).max()
    assert np.abs(made - whole)[missing].max() < 0.15 * way
    assert np.abs(made - whole)[~missing].max() < 0.05 * way


def test_what_lies_beyond_the_source_comes_to_rest() -> None:
    below = places(*FINE)[:, 1] < -0.3
    made = Transfer(SOURCE, TARGET, with_hole(below))(smiling(SOURCE.vertices))
    way = np.linalg.norm(made - TARGET.vertices, axis=1).reshape(FINE[1], FINE[0])[:, FINE[0] // 2]
    assert way[0] < 0.3 * way.max()


@pytest.mark.parametrize("method", METHODS)
def test_a_few_places_out_of_order_do_not_tear_the_mesh(method: Method) -> None:
    """Three vertices of the lower half are matched with the upper half, which does not move."""
    corners = LINK.corners.copy()
    wrong = [60, 61, 62]
    corners[wrong] = LINK.corners[-60:-57]
    whole = Transfer(SOURCE, TARGET, LINK, method)(smiling(SOURCE.vertices))
    torn = Correspondence(corners, LINK.weights, np.ones(len(corners), bool))
    made = Transfer(SOURCE, TARGET, torn, method)(smiling(SOURCE.vertices))
    way = np.linalg.norm(whole - TARGET.vertices, axis=1)
    assert way[wrong].min() > 0.3 * way.max()
    assert np.linalg.norm(made - whole, axis=1).max() < 0.2 * way.max()


def test_places_that_all_fall_together_give_numbers() -> None:
    corners = np.where(places(*FINE)[:, :1] > 0, LINK.corners[:1], LINK.corners)
    together = Correspondence(corners, LINK.weights, np.ones(len(corners), bool))
    for method in METHODS:
        made = Transfer(SOURCE, TARGET, together, method)(smiling(SOURCE.vertices))
        assert np.isfinite(made).all()
        assert np.abs(made).max() < 10


# -- eyes, lashes ---------------------------------------------------------------------------------------------


def ball(centre: tuple[float, float, float], radius: float) -> tuple[F64, Int]:
    """A closed octahedron, twice refined."""
    points = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    for _ in range(2):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        once, at = np.unique(edges, axis=0, return_inverse=True)
        middle = points[once].mean(1)
        a, b, c = faces.T
        ab, bc, ca = (at.reshape(-1, 3) + len(points)).T
        points = np.concatenate([points, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        faces = np.concatenate(
            [np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return points * radius + centre, faces


def joined(*parts: tuple[F64, Int]) -> Mesh:
    starts = np.cumsum([0, *[len(points) for points, _ in parts]])
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=False)]
    return Mesh(np.concatenate([points for points, _ in parts]), np.concatenate(faces), NO_QUADS)


SHEET = (SOURCE.vertices, triangulated(SOURCE.quads))
LOWER, UPPER = ball((0.0, -0.9, -0.6), 0.15), ball((0.0, 0.6, -0.4), 0.15)
LASHES_AT = np.column_stack([np.repeat(np.linspace(-0.5, 0.5, 8), 2), np.tile([-0.8, -0.85], 8)])
LASH = np.add(surface(LASHES_AT, 1.0), (0, 0, 0.03))
CARD = (LASH, np.array([[k, k + 1, k + 3, k + 2] for k in range(0, 14, 2)]))
HEAD = joined(SHEET, LOWER, UPPER, (LASH, triangulated(CARD[1])))
SKIN = len(SHEET[0])
PARTS = [slice(SKIN, SKIN + 66), slice(SKIN + 66, SKIN + 132), slice(SKIN + 132, None)]


def expressive_head(of: Callable[[F64], F64]) -> F64:
    """The skin moves; eyes and lashes do something else, of which the target is to see nothing."""
    return np.concatenate([of(HEAD.vertices[:SKIN]), HEAD.vertices[SKIN:] * 1.5 + 3])


def made_head(of: Callable[[F64], F64], keep_rigid: bool = False) -> F64:
    """A head whose parts have no counterpart on the source."""
    same = Correspondence.identity(len(HEAD.vertices))
    link = Correspondence(same.corners, same.weights, np.arange(len(HEAD.vertices)) < SKIN)
    return Transfer(HEAD, HEAD, link, keep_rigid=keep_rigid)(expressive_head(of))


def test_small_parts_do_not_change_what_the_skin_does() -> None:
    assert_allclose(made_head(smiling)[:SKIN], smiling(SOURCE.vertices), atol=1e-6)


def opening(skin: F64) -> F64:
    """The lower part turns about a hinge, as a jaw."""
    lower = skin[:, 1] < -0.55
    turn = Rotation.from_euler("x", 8, degrees=True).as_matrix()
    return np.where(lower[:, None], np.add(skin, (0, 0, 1)) @ turn.T - (0, 0, 1), skin)


def test_teeth_keep_their_form_and_go_with_the_jaw() -> None:
    made = made_head(opening)
    for part in PARTS[:2]:
        size = np.linalg.norm(made[part] - made[part].mean(0), axis=1)
        assert_allclose(size, 0.15, atol=1e-9)
    whole = np.linalg.norm(opening(HEAD.vertices[PARTS[0]]) - HEAD.vertices[PARTS[0]], axis=1).mean()
    assert whole > 0.05
    assert np.abs(made[PARTS[0]] - opening(HEAD.vertices[PARTS[0]])).max() < 0.1 * whole
    assert np.abs(made[PARTS[1]] - HEAD.vertices[PARTS[1]]).max() < 1e-3


def test_teeth_stay_when_the_skin_around_them_stretches() -> None:
    made = made_head(lambda skin: skin * np.where(skin[:, 1:2] < 0, (1.3, 1, 1), 1))
    assert np.abs(made[PARTS[0]] - HEAD.vertices[PARTS[0]]).max() < 0.01


def test_an_eye_stays_when_its_lid_closes() -> None:
    def blinking(skin: F64) -> F64:
        lid = (np.abs(skin[:, 0]) < 0.2) & (np.abs(skin[:, 1] - 0.65) < 0.1)
        assert lid.sum() >= 3
        return skin - lid[:, None] * (0, 0.1, 0)

    made = made_head(blinking)
    assert np.abs(made[PARTS[1]] - HEAD.vertices[PARTS[1]]).max() < 0.01


def test_lashes_bend_with_the_skin_under_them() -> None:
    made = made_head(smiling)[PARTS[2]]
    assert np.linalg.norm(made - smiling(LASH), axis=1).max() < 0.05
    assert not np.allclose(np.linalg.norm(made[0] - made[-1]), np.linalg.norm(LASH[0] - LASH[-1]), rtol=0.01)


def test_small_parts_stay_where_they_are_when_asked_to() -> None:
    made = made_head(smiling, keep_rigid=True)
    assert_allclose(made[SKIN:], HEAD.vertices[SKIN:], atol=1e-4)
    assert_allclose(made[:SKIN], smiling(SOURCE.vertices), atol=1e-6)


def test_small_parts_that_stay_still_go_with_the_head() -> None:
    by = motion((10, 20, 30), (1, 2, 3))
    made = made_head(lambda skin: by.apply(smiling(skin)), keep_rigid=True)
    assert_allclose(made[SKIN:], by.apply(HEAD.vertices[SKIN:]), atol=1e-4)


# -- mistakes -------------------------------------------------------------------------------------------------


def test_an_expression_of_another_mesh_is_refused() -> None:
    with pytest.raises(MeshError, match="the expression has 209 vertices, its neutral 210"):
        Transfer(SOURCE, TARGET, LINK)(SOURCE.vertices[1:])


def test_an_expression_that_is_not_finite_is_refused() -> None:
    broken = SOURCE.vertices.copy()
    broken[3, 1] = np.nan
    with pytest.raises(MeshError, match="not finite"):
        Transfer(SOURCE, TARGET, LINK)(broken)


def test_a_correspondence_of_other_meshes_is_refused() -> None:
    with pytest.raises(MeshError, match="the correspondence is of 399 vertices, the target has 210"):
        Transfer(SOURCE, SOURCE, LINK)
    beyond = Correspondence(LINK.corners + 100, LINK.weights, LINK.found)
    with pytest.raises(MeshError, match="names vertex 309, the source has 210"):
        Transfer(SOURCE, TARGET, beyond)


def test_a_correspondence_that_finds_nothing_is_refused() -> None:
    with pytest.raises(MeshError, match="a place for 0 of 399"):
        Transfer(SOURCE, TARGET, with_hole(np.ones(399, bool)))


def test_another_method_is_refused() -> None:
    with pytest.raises(MeshError, match="tents, deformable, gradients or cloning, got magic"):
        Transfer(SOURCE, TARGET, LINK, "magic")  # type: ignore[arg-type]


def test_the_deformable_model_moves_as_deformation_transfer_onto_it_says() -> None:
    """Both are of one topology here, so that nothing is interpolated; it needs the source on the target."""
    target = SOURCE.with_vertices(SOURCE.vertices * (1.1, 0.9, 1.0))
    same = Correspondence.identity(len(target.vertices))
    with pytest.raises(MeshError, match="take the dense correspondence"):
        Transfer(SOURCE, target, same, "deformable")
    made, plain = (
        Transfer(SOURCE, target, same, method, fitted=target.vertices)(smiling(SOURCE.vertices))
        for method in ("deformable", "gradients")
    )
    assert_allclose(made, plain, atol=1e-6)


def test_without_a_face_there_is_nothing_to_prepare(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "guise.analogy.transfer.find_feature_points", lambda mesh: Failed("nothing looks like a face")
    )
    with pytest.raises(FeaturePointsError, match="no face was found on the source: nothing looks"):
        prepare_transfer(SOURCE, TARGET)


def test_with_points_the_heads_are_registered() -> None:
    at = [0, 6, 13, 98, 104, 111, 196, 202, 209]
    target = SOURCE.with_vertices(SOURCE.vertices * (1.05, 0.95, 1.0))
    made = prepare_transfer(SOURCE, target, (SOURCE.vertices[at], target.vertices[at]))(
        smiling(SOURCE.vertices)
    )
    wanted = smiling(SOURCE.vertices) * (1.05, 0.95, 1.0)
    still = np.linalg.norm(wanted - target.vertices, axis=1).mean()
    assert np.linalg.norm(made - wanted, axis=1).mean() < 0.35 * still


# -- rigid motions, filling -----------------------------------------------------------------------------------


def noisy(seed: int = 0) -> tuple[F64, F64]:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(40, 3))
    return points, motion((20, 30, 40), (1, 2, 3)).apply(points) + rng.normal(0, 0.1, points.shape)


def residual(source: F64, target: F64, weights: F64, turn: F64, shift: F64) -> float:
    return float(weights @ np.square(apply_rigid(source, turn, shift) - target).sum(1))


def test_no_other_motion_fits_better() -> None:
    source, target = noisy()
    weights = np.random.default_rng(1).uniform(0.1, 2, len(source))
    turn, shift = align_rigid(source, target, weights)
    best = residual(source, target, weights, turn, shift)
    assert np.linalg.det(turn) == pytest.approx(1)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        other = Rotation.from_rotvec(rng.normal(0, 0.02, 3)).as_matrix() @ turn
        assert residual(source, target, weights, other, shift + rng.normal(0, 0.02, 3)) > best


def test_a_point_of_weight_two_counts_as_two_and_one_of_next_to_none_as_none() -> None:
    source, target = noisy()
    weights = np.ones(40)
    weights[0] = 2
    twice = [np.concatenate([points, points[:1]]) for points in (source, target)]
    assert_allclose(align_rigid(source, target, weights)[0], align_rigid(*twice, np.ones(41))[0], atol=1e-12)
    weights[0] = 1e-12
    assert_allclose(
        align_rigid(source, target, weights)[1],
        align_rigid(source[1:], target[1:], np.ones(39))[1],
        atol=1e-9,
    )


def test_sets_are_fitted_each_on_its_own() -> None:
    pairs = [noisy(seed) for seed in range(3)]
    turns, shifts = align_rigid(*(np.stack(points) for points in zip(*pairs, strict=True)), np.ones((3, 40)))
    for (source, target), turn, shift in zip(pairs, turns, shifts, strict=True):
        assert_allclose(align_rigid(source, target, np.ones(40))[0], turn, atol=1e-12)
        assert_allclose(align_rigid(source, target, np.ones(40))[1], shift, atol=1e-12)


def test_the_motion_of_most_is_found_though_others_move() -> None:
    source, _ = noisy()
    by = motion((5, -10, 3), (0.5, 0, 0))
    target = by.apply(source)
    target[:16] += (0.3, 0.2, 0.0)
    turn, shift = align_rigid_robust(source, target, np.ones(40))
    assert_allclose(turn, by.rotation, atol=1e-3)
    assert_allclose(shift, by.translation, atol=2e-3)


def test_known_values_are_kept_and_unknown_ones_lie_between_or_fall_off() -> None:
    known = np.abs(places(*COARSE)[:, 0]) > 0.3
    values = np.where(known[:, None], 1.0, np.nan)
    near, far = (TensionFill(SOURCE.vertices, SOURCE.rings, known, reach)(values) for reach in (10.0, 0.05))
    assert_allclose(near[known], 1)
    assert_allclose(near, 1, atol=0.02)
    assert np.abs(far[~known]).min() < 0.3


def test_values_go_on_without_a_crease() -> None:
    at = places(20, 20)
    known = at[:, 1] > -0.5
    flat = np.column_stack([at, np.zeros(len(at))])
    made = TensionFill(flat, Mesh(flat, NO_TRIANGLES, quads_of(20, 20)).rings, known, 1.0)(at[:, 1:])
    slope = np.diff(made.reshape(20, 20)[:, 10]) / np.diff(at[:, 1].reshape(20, 20)[:, 10])
    first = np.flatnonzero(known.reshape(20, 20)[:, 10])[0]
    assert_allclose(slope[first - 1], 1, atol=0.5)
