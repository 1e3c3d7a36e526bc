"""Lids that meet on any mesh, and parts of the mouth that stay in their jaws."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from guise.analogy.anatomy import FaceFrame
from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.geometry import Surface
from guise.analogy.lids import FacePair, LidMotion, Lids, find_lids, motion_ratios
from guise.analogy.mesh import Mesh
from guise.analogy.transfer import Method, Transfer
from guise.common.arrays import F64, Int

EYES = (-3.0, 3.0)  # x of their middles, at y = 0
HALF = 1.3  # of their width
NO_TRIANGLES = np.empty((0, 3), np.intp)
POINTS = {
    "nose_bridge": (0, 1, 3), "nose_tip": (0, -2, 4), "chin": (0, -9, 1.4), "upper_lip_inner": (0, -5.9, 2.3),
    "lower_lip_inner": (0, -6, 2.3), "mouth_corner_right": (-2.3, -6, 2), "mouth_corner_left": (2.3, -6, 2),
    "eye_right_outer": (-4.3, 0, 2.6), "eye_right_inner": (-1.7, 0, 2.9),
    "eye_left_inner": (1.7, 0, 2.9), "eye_left_outer": (4.3, 0, 2.6),
}  # fmt: skip
FACE_POINTS = np.array([POINTS.get(name, (0, 0, 3)) for name in FEATURE_POINT_NAMES], np.float64)


def face(steps: int, gap: float) -> tuple[Mesh, F64, F64]:
    """A bent sheet with two eyes, its vertices with the upper lids down, and its places before eyes were opened.

    steps : of the grid, in half an eye.   gap : between the lids.
    """
    x, away = np.linspace(-6, 6, 9 * steps + 1), np.linspace(0, 12, 9 * steps + 1)
    one, other = np.meshgrid(x, away)
    lens = np.max([np.clip(1 - ((one - middle) / HALF) ** 2, 0, None) for middle in EYES], axis=0)
    half = lens * np.exp(-(other**2)) * gap / 2
    upper, lower = other.ravel(), -other.ravel()
    flat = np.column_stack([np.tile(one.ravel(), 2), np.concatenate([upper, lower])])
    opened = flat + np.column_stack([np.zeros(len(flat)), np.concatenate([half.ravel(), -half.ravel()])])
    shut = opened - np.column_stack(
        [np.zeros(len(flat)), np.concatenate([2 * half.ravel(), 0 * half.ravel()])]
    )
    ids = np.arange(2 * one.size)
    welded = np.flatnonzero((other.ravel() == 0) & (lens.ravel() == 0))
    ids[one.size + welded] = welded
    quads = _quads(*one.shape)
    used, faces = np.unique(ids[np.concatenate([quads, quads[:, ::-1] + one.size])], return_inverse=True)
    deep = [np.column_stack([at, 3 - 0.02 * (at**2).sum(1)])[used] for at in (opened, shut, flat)]
    return Mesh(deep[0], NO_TRIANGLES, faces.reshape(-1, 4)), deep[1], deep[2]


def _quads(rows: int, columns: int) -> Int:
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return np.stack([first, first + 1, first + columns + 1, first + columns], axis=1)


def link(source: tuple[Mesh, F64, F64], target: tuple[Mesh, F64, F64]) -> Correspondence:
    """By the places before the eyes were opened."""
    (mesh, _, flat), (_, _, places) = source, target
    apart = np.array([0, 0.02, 0])
    sides = [np.where(mesh_y[:, None] > 0, at + apart, at - apart) for mesh_y, at in
             ((mesh.vertices[:, 1], flat), (target[0].vertices[:, 1], places))]  # fmt: skip
    found = Surface(sides[0], mesh.faces, 0.0).closest_points(sides[1], np.zeros_like(sides[1]))
    return Correspondence(mesh.faces[found.faces], found.weights, np.ones(len(places), bool))


def gaps(eye: Lids, vertices: F64) -> F64:
    return np.linalg.norm(eye.upper.at(vertices) - eye.lower.at(vertices), axis=1)


def test_margins_lie_on_the_lids_from_corner_to_corner() -> None:
    mesh, _, _ = face(8, 1.0)
    for eye, middle in zip(find_lids(mesh, FACE_POINTS), EYES, strict=True):
        assert eye is not None
        high, low = eye.upper.at(mesh.vertices), eye.lower.at(mesh.vertices)
        expected = 0.5 * (1 - ((high[:, 0] - middle) / HALF) ** 2)
        assert_allclose(high[:, 1], expected, atol=0.15)
        assert_allclose(low[:, 1], -expected, atol=0.15)
        assert (np.diff(high[:, 0]) > 0).all()


def walled(mesh: Mesh) -> Mesh:
    """The face with walls that lead from the lids into eye sockets, whose openings are smaller than the eyes."""
    edges = np.sort(np.concatenate([mesh.quads[:, [k, (k + 1) % 4]] for k in range(4)]), axis=1)
    found, counts = np.unique(edges, axis=0, return_counts=True)
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    rim = found[(counts == 1) & (np.abs(y)[found] < 2).all(1) & (np.abs(x)[found] < 5).all(1)]
    vertices, triangles = [mesh.vertices], []
    for step in range(6):
        first = len(mesh.vertices) * (step + 1)
        middle = np.where(x < 0, EYES[0], EYES[1])
        share = 0.4 * (step + 1) / 6
        inner = np.column_stack(
            [x + share * (middle - x), (1 - share) * y, mesh.vertices[:, 2] - 1.5 * share]
        )
        vertices.append(inner)
        a, b = rim.T + (first - len(mesh.vertices) if step else 0)
        c, d = rim.T + first
        upper = (y[rim].sum(1) > 0)[:, None]
        way = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
        triangles.append(np.where(np.tile(upper, (2, 1)), way, way[:, ::-1]))
    faces = np.concatenate([*triangles, mesh.quads[:, :3], mesh.quads[:, [0, 2, 3]]])
    used, faces = np.unique(faces, return_inverse=True)
    return Mesh.of_triangles(np.concatenate(vertices)[used], faces.reshape(-1, 3))


def test_walls_of_eye_sockets_are_not_taken_for_lids() -> None:
    plain, _, _ = face(8, 1.0)
    mesh = walled(plain)
    for eye, bare in zip(find_lids(mesh, FACE_POINTS), find_lids(plain, FACE_POINTS), strict=True):
        assert eye is not None
        assert bare is not None
        for curve, margin in ((eye.upper, bare.upper), (eye.lower, bare.lower)):
            assert_allclose(curve.at(mesh.vertices)[2:-2, 1], margin.at(plain.vertices)[2:-2, 1], atol=0.1)


def test_shut_eyes_and_missing_ones_have_no_margins() -> None:
    assert find_lids(face(8, 1e-3)[0], FACE_POINTS) == (None, None)
    mesh, _, _ = face(8, 1.0)
    assert find_lids(mesh, np.zeros_like(FACE_POINTS)) == (None, None)


@pytest.mark.parametrize("method", ["tents", "gradients", "cloning"])
@pytest.mark.parametrize(("steps", "gap"), [(5, 1.0), (7, 1.5)])
@pytest.mark.slow
def test_lids_meet_on_other_meshes_and_larger_and_smaller_eyes(
    steps: int, gap: float, method: Method
) -> None:
    source, target = face(8, 1.0), face(steps, gap)
    pair = FacePair.of(source[0], target[0], (FACE_POINTS, FACE_POINTS))
    assert len(pair.lids) == 2
    alone, together = (
        Transfer(source[0], target[0], link(source, target), method, face=known)(source[1])
        for known in (None, pair)
    )
    for _, eye in pair.lids:
        rest = gaps(eye, target[0].vertices)
        left = (gaps(eye, together) / rest)[2:-2]
        assert left.max() < max(0.15, 0.6 * (gaps(eye, alone) / rest)[2:-2].max())
    still = np.abs(target[0].vertices[:, 1]) > 3
    assert np.abs(together - target[0].vertices)[still].max() < 0.05


def creased(mesh: Mesh, height: float, depth: float = 0.15) -> Mesh:
    """The face with a fold above each upper lid."""
    x, y, z = mesh.vertices.T
    lens = np.max([np.clip(1 - ((x - middle) / HALF) ** 2, 0, None) for middle in EYES], axis=0)
    fold = depth * (lens > 0) * np.exp(-(((y - lens / 2 - height) / 0.15) ** 2))
    return mesh.with_vertices(np.column_stack([x, y, z - fold]))


@pytest.mark.parametrize("height", [0.3, 0.55])
@pytest.mark.slow
def test_creases_of_upper_lids_are_found_where_they_are(height: float) -> None:
    mesh = creased(face(20, 1.0)[0], height)
    for eye, middle in zip(find_lids(mesh, FACE_POINTS), EYES, strict=True):
        assert eye is not None
        assert eye.crease is not None
        x, y, _ = eye.crease.at(mesh.vertices)[2:-2].T
        assert_allclose(y, 0.5 * (1 - ((x - middle) / HALF) ** 2) + height, atol=0.1)


def test_smooth_lids_have_no_crease() -> None:
    for eye in find_lids(face(20, 1.0)[0], FACE_POINTS):
        assert eye is not None
        assert eye.crease is None


@pytest.mark.slow
def test_creases_guide_the_match_where_they_are_the_same_fold() -> None:
    plain = face(20, 1.0)[0]
    meshes = plain, creased(plain, 0.3), creased(plain, 0.4), creased(plain, 0.75)
    smooth, *others = (FacePair.of(meshes[1], mesh, (FACE_POINTS, FACE_POINTS)) for mesh in meshes)
    assert [len(pair.creases) for pair in (smooth, *others)] == [0, 2, 2, 0]
    first, second = others[1].with_margins(meshes[1], meshes[2])
    assert len(first) == len(second) == len(others[1].trust) > len(smooth.trust)
    assert_allclose((second - first)[-20:, 1], 0.1, atol=0.08)


def test_larger_eyes_move_farther_and_smaller_ones_as_the_source() -> None:
    small, large = face(8, 1.0)[0], face(8, 1.2)[0]
    away = np.abs(large.vertices[:, 1]) > 3.5
    for scale in (1.0, 3.0):
        target = large.with_vertices(scale * large.vertices)
        points = FACE_POINTS, scale * FACE_POINTS
        lids = FacePair.of(small, target, points).lids
        ratios = motion_ratios(lids, small.vertices, target.vertices, scale)
        assert 1.05 < ratios.max() < 1.2
        assert (ratios[away] == 1).all()
    lids = FacePair.of(large, small, (FACE_POINTS, FACE_POINTS)).lids
    assert (motion_ratios(lids, large.vertices, small.vertices, 1.0) == 1).all()


def test_margins_count_more_than_the_corners_they_stand_for() -> None:
    mesh, _, _ = face(8, 1.0)
    pair = FacePair.of(mesh, mesh, (FACE_POINTS, FACE_POINTS))
    assert len(pair.trust) == len(pair.with_margins(mesh, mesh)[0])
    corners, others = (
        [k for k, name in enumerate(FEATURE_POINT_NAMES) if name.startswith(kinds)]
        for kinds in (("eye",), ("nose", "mouth", "chin"))
    )
    assert pair.trust[corners].max() < pair.trust[others].min() < pair.trust[len(FACE_POINTS) :].min()
    assert FacePair(pair.points, ()).trust[corners].min() == 1


def test_points_that_somebody_has_placed_count_fully() -> None:
    mesh, _, _ = face(8, 1.0)
    pair = FacePair.of(mesh, mesh, (FACE_POINTS, FACE_POINTS), placed=True)
    assert (pair.trust[: len(FACE_POINTS)] == 1).all()


def test_margins_take_only_the_lids_along() -> None:
    source, target = face(8, 1.0), face(6, 1.4)
    lids = FacePair.of(source[0], target[0], (FACE_POINTS, FACE_POINTS)).lids[0]
    rest, half_shut = target[0].vertices, (target[0].vertices + target[1]) / 2
    made = LidMotion(source[0].vertices, rest, lids)(source[1], half_shut)
    moved = np.linalg.norm(made - half_shut, axis=1) > 1e-9
    assert moved.any()
    margins = np.concatenate([lids[1].upper.at(rest), lids[1].lower.at(rest)])
    away = np.linalg.norm(rest[moved, None] - margins, axis=2).min(1)
    assert away.max() < 0.25 * lids[1].width


def test_open_eyes_stay_as_they_are() -> None:
    source, target = face(8, 1.0), face(6, 1.4)
    pair = FacePair.of(source[0], target[0], (FACE_POINTS, FACE_POINTS))
    made = Transfer(source[0], target[0], link(source, target), face=pair)(source[0].vertices)
    assert_allclose(made, target[0].vertices, atol=1e-6)


def ball(middle: tuple[float, float, float], size: float) -> tuple[F64, Int]:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return np.array(middle) + size / 2 * corners, np.array(quads)


def with_parts(mesh: Mesh, parts: list[tuple[F64, Int]]) -> tuple[Mesh, list[Int]]:
    """The mesh with parts, and the vertices of each."""
    vertices, quads, ids = [mesh.vertices], [mesh.quads], []
    for at, faces in parts:
        count = sum(map(len, vertices))
        vertices.append(at)
        quads.append(faces + count)
        ids.append(np.arange(count, count + len(at)))
    return Mesh(np.concatenate(vertices), NO_TRIANGLES, np.concatenate(quads)), ids


def test_lower_teeth_go_with_the_jaw_and_upper_ones_and_eyes_stay() -> None:
    source = face(6, 1.0)
    target, (above, below, eye) = with_parts(
        source[0], [ball((0, -5.4, 1.2), 0.4), ball((0, -6.6, 1.2), 0.4), ball((3, 0, 1.5), 1.5)]
    )
    open_mouth = source[0].vertices.copy()
    open_mouth[source[0].vertices[:, 1] < -6] += (0, -1, -0.3)
    link_all = Correspondence.identity(len(target.vertices))
    corners = np.minimum(link_all.corners, len(source[0].vertices) - 1)
    found = np.arange(len(target.vertices)) < len(source[0].vertices)
    pair = FacePair.of(source[0], target, (FACE_POINTS, FACE_POINTS))
    made = Transfer(source[0], target, Correspondence(corners, link_all.weights, found), face=pair)(
        open_mouth
    )
    way = made - target.vertices
    assert_allclose(way[above], 0, atol=1e-5)
    assert_allclose(way[eye], 0, atol=1e-5)
    assert_allclose(way[below].mean(0), (0, -1, -0.3), atol=0.1)
    shape = np.linalg.norm(made[below] - made[below].mean(0), axis=1)
    assert_allclose(shape, np.linalg.norm(target.vertices[below] - target.vertices[below].mean(0), axis=1))


def test_parts_that_both_heads_have_move_as_the_sources() -> None:
    """Even an upper tooth, if the source's does."""
    skin = face(6, 1.0)[0]
    mesh, (tooth, other) = with_parts(skin, [ball((0, -5.4, 1.2), 0.4), ball((0.5, -5.4, 1.2), 0.4)])
    pair = FacePair.of(mesh, mesh, (FACE_POINTS, FACE_POINTS))
    shape = mesh.vertices.copy()
    shape[tooth] += (0.1, 0.2, 0.3)
    made = Transfer(mesh, mesh, Correspondence.identity(len(mesh.vertices)), face=pair)(shape)
    assert_allclose(made[tooth], shape[tooth], atol=1e-6)
    assert_allclose(made[other], mesh.vertices[other], atol=1e-6)


def test_a_face_knows_what_lies_in_its_mouth() -> None:
    frame = FaceFrame.of(FACE_POINTS)
    assert frame.in_mouth(np.array([0, -5.4, 1.0]))
    assert frame.in_upper_jaw(np.array([0, -5.4, 1.0]))
    assert not frame.in_upper_jaw(np.array([0, -6.5, 1.0]))
    assert not frame.in_mouth(np.array([0, -5.4, 4.0]))
    assert not frame.in_mouth(np.array([0, 0, 1.0]))
    assert frame.at_eye(np.array([3.0, 0, 1]))
    assert not frame.at_eye(np.array([0, 0, 1.0]))
