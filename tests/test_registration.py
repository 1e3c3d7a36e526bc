"""Properties of closest places, of the registration and of the correspondence, on made-up masks."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from guise.aam.similarity import Similarity
from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_point_search import refine_feature_points
from guise.analogy.geometry import (
    Surface,
    barycentric,
    border_mask,
    geodesic_patch,
    vertex_areas,
    vertex_normals,
)
from guise.analogy.mesh import Mesh
from guise.analogy.registration import Registration, RegistrationError, register, skin_mask
from guise.common.arrays import F64, Int

PAIRS = Path(__file__).parents[2] / "shared" / "data" / "mesh"
NO_QUADS = np.empty((0, 4), np.intp)
MARKS = np.array([(0.0, 0.0), (0.6, 0.0), (-0.6, 0.0), (0.0, 0.7), (0.3, -0.6), (-0.3, -0.6)])


def relief(u: F64, v: F64, nose: float) -> F64:
    """A mask (n, 3): a vault with a nose and two sockets; `nose` is how far it stands out."""
    z = -0.6 * (u**2 + 0.7 * v**2) + nose * np.exp(-(u**2 + v**2) / 0.03)
    z -= 0.12 * (
        np.exp(-((u - 0.4) ** 2 + (v - 0.3) ** 2) / 0.02) + np.exp(-((u + 0.4) ** 2 + (v - 0.3) ** 2) / 0.02)
    )
    return np.stack([u, v, z], axis=1)


def mask(side: int, nose: float = 0.3, wide: float = 1.0) -> Mesh:
    """The mask over a grid of quads."""
    u, v = (x.ravel() for x in np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side)))
    at = np.arange(side * side).reshape(side, side)
    quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    return Mesh(relief(u, v, nose) * (wide, 1, 1), np.empty((0, 3), np.intp), quads)


def marks(nose: float = 0.3, wide: float = 1.0) -> F64:
    return relief(MARKS[:, 0], MARKS[:, 1], nose) * (wide, 1, 1)


def ball(radius: float, centre: tuple[float, float, float]) -> tuple[F64, Int]:
    """An octahedron."""
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    return radius * corners + centre, np.array(faces, np.intp)


def joined(mesh: Mesh, vertices: F64, faces: Int) -> Mesh:
    both = np.concatenate([mesh.vertices, vertices])
    return Mesh(both, np.concatenate([mesh.triangles, faces + len(mesh.vertices)]), mesh.quads)


SOURCE, TARGET = mask(24), mask(31, nose=0.36, wide=1.15)
POINTS = (marks(), marks(0.36, 1.15))
TRUTH = mask(24, nose=0.36, wide=1.15).vertices


@pytest.fixture(scope="module")
def done() -> Registration:
    return register(SOURCE, TARGET, POINTS)


def test_the_closest_place_on_a_triangle_beats_every_other_place() -> None:
    rng = np.random.default_rng(0)
    triangles, points = rng.normal(size=(200, 3, 3)), rng.normal(size=(200, 3)) * 2
    weights = barycentric(points, triangles)
    assert (weights >= 0).all()
    assert_allclose(weights.sum(1), 1)
    best = np.linalg.norm(np.einsum("nk,nki->ni", weights, triangles) - points, axis=1)
    for other in rng.dirichlet(np.ones(3), 300):
        far = np.linalg.norm(np.einsum("k,nki->ni", other, triangles) - points, axis=1)
        assert (best <= far + 1e-9).all()


def test_closest_places_of_a_ball_lie_where_its_radii_meet_it() -> None:
    corners, faces = ball(1.0, (0, 0, 0))
    directions = np.random.default_rng(1).normal(size=(50, 3))
    onto = directions / np.abs(directions).sum(1, keepdims=True)  # |x| + |y| + |z| = 1
    normals = np.sign(directions) / np.sqrt(3)
    places = Surface(corners, faces, 0.0).closest_points(onto + 0.05 * normals, normals)
    assert_allclose(places.positions, onto, atol=1e-9)


def test_of_two_skins_back_to_back_the_one_that_faces_the_same_way_is_found() -> None:
    front = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]])
    surface = Surface(np.concatenate([front, front - (0, 0, 0.01)]), faces, 0.2)
    point, up = np.array([[0.5, 0.4, -0.01]]), np.array([[0.0, 0, 1]])
    assert surface.closest_points(point, up).faces[0] in (0, 1)
    assert surface.closest_points(point, -up).faces[0] in (2, 3)


def test_borders_areas_and_patches_of_a_sheet() -> None:
    u, v = (x.ravel() for x in np.meshgrid(np.arange(9.0), np.arange(9.0)))
    flat = Mesh(np.stack([u, v, 0 * u], 1), np.empty((0, 3), np.intp), mask(9).quads)
    assert border_mask(flat.faces, 81).sum() == 32
    assert vertex_areas(flat.vertices, flat.faces).sum() == pytest.approx(64)
    assert_allclose(vertex_normals(flat.vertices, flat.faces), np.tile((0.0, 0, 1), (81, 1)))
    patch = geodesic_patch(flat.vertices, flat.faces, 40, 1.0)
    assert patch[0] == 40
    assert set(patch.tolist()) == {40, 31, 49, 39, 41}


def test_vertices_come_to_their_true_places(done: Registration) -> None:
    before = np.linalg.norm(done.similarity.apply(SOURCE.vertices) - TRUTH, axis=1).mean()
    after = np.linalg.norm(done.fitted - TRUTH, axis=1)
    assert after.mean() < 0.4 * before
    assert np.percentile(after, 95) < 0.06


def test_the_report_tells_a_good_fit_from_a_bad_one(done: Registration) -> None:
    assert done.quality.matched > 0.95
    assert done.quality.p95 < 0.02
    assert done.quality.folded == 0
    assert 1 <= done.quality.stretch < 1.6
    off = Registration(SOURCE, TARGET, done.fitted + np.array([0, 0, 0.5]), done.similarity)
    assert off.quality.matched < 0.5
    mirrored = Registration(SOURCE, TARGET, done.fitted * (1, 1, -1) * (1, -1, -1), done.similarity)
    assert mirrored.quality.folded > 0.5


def test_what_is_carried_stands_on_the_target(done: Registration) -> None:
    link = done.correspondence()
    assert_allclose(link.weights.sum(1), 1)
    off = np.linalg.norm(link.interpolate(done.fitted) - TARGET.vertices, axis=1)[link.found]
    assert off.mean() < 0.01
    sides = link.interpolate(SOURCE.vertices[:, 0])
    assert np.corrcoef(sides, TARGET.vertices[:, 0])[0, 1] > 0.995


@pytest.mark.parametrize("seed", [0, 1])
def test_the_targets_place_turn_and_scale_change_nothing_else(done: Registration, seed: int) -> None:
    away = Similarity(3.7, Rotation.random(random_state=seed).as_matrix(), np.array([5.0, -3, 11]))
    other = register(
        SOURCE, TARGET.with_vertices(away.apply(TARGET.vertices)), (POINTS[0], away.apply(POINTS[1]))
    )
    assert np.linalg.norm(away.inverse().apply(other.fitted) - done.fitted, axis=1).max() < 0.02


def test_a_mesh_onto_itself_stays() -> None:
    at = SOURCE.vertices[::50]
    same = register(SOURCE, SOURCE, (at, at))
    assert_allclose(same.fitted, SOURCE.vertices, atol=1e-5)


def test_meshes_that_stand_alike_need_no_points() -> None:
    fitted = register(SOURCE, TARGET).fitted
    assert np.linalg.norm(fitted - TRUTH, axis=1).mean() < 0.06


def test_points_pull_to_where_they_belong(done: Registration) -> None:
    other = POINTS[1].copy()
    other[0] += (0.1, 0, 0)
    nose = int(np.abs(SOURCE.vertices[:, :2]).sum(1).argmin())
    moved = register(SOURCE, TARGET, (POINTS[0], other)).fitted[nose, 0] - done.fitted[nose, 0]
    assert moved > 0.005
    less = register(SOURCE, TARGET, (POINTS[0], other), np.full(len(other), 0.05)).fitted[nose, 0]
    assert less - done.fitted[nose, 0] < 0.5 * moved


def test_what_the_source_lacks_is_not_found() -> None:
    large = mask(31, nose=0.36, wide=1.15)
    keep = np.abs(SOURCE.vertices[SOURCE.quads][:, :, 1]).max(1) < 0.75
    ids, quads = np.unique(SOURCE.quads[keep], return_inverse=True)
    small = Mesh(SOURCE.vertices[ids], np.empty((0, 3), np.intp), quads.reshape(-1, 4))
    link = register(small, large, POINTS).correspondence()
    rim, middle = np.abs(large.vertices[:, 1]) > 0.95, np.abs(large.vertices[:, 1]) < 0.5
    assert not link.found[rim].any()
    assert link.found[middle].mean() > 0.95
    assert np.isfinite(link.interpolate(small.vertices)).all()


def test_eyes_follow_the_skin_and_keep_their_form() -> None:
    eyes, faces = ball(0.08, (0.4, 0.3, -0.3))
    source = joined(SOURCE, eyes, faces)
    target = joined(TARGET, eyes * (1.15, 1, 1), faces)
    assert skin_mask(source).sum() == len(SOURCE.vertices)
    done = register(source, target, POINTS)
    eye = done.fitted[-6:]
    centre = eye.mean(0)
    assert_allclose(centre, (0.46, 0.3, -0.3), atol=0.06)
    radii = np.linalg.norm(eye - centre, axis=1)
    assert_allclose(radii, radii[0], rtol=1e-6)
    corners = done.correspondence().corners
    assert (corners[:-6] < len(SOURCE.vertices)).all()
    assert (corners[-6:] >= len(SOURCE.vertices)).all()


@pytest.mark.parametrize(
    ("first", "second", "sentence"),
    [
        (POINTS[0][:2], POINTS[1][:2], "2 points are too few"),
        (POINTS[0], POINTS[1][:3], r"points must be \(k, 3\) on both"),
        (POINTS[0] * 0, POINTS[1], "points on the source coincide"),
        (POINTS[0], POINTS[1] * (1, 0, 0), "points on the target coincide or lie on a line"),
        (POINTS[0] * np.nan, POINTS[1], "must be finite"),
        (POINTS[0], POINTS[1][[3, 4, 0, 1, 5, 2]], "do not correspond"),
    ],
)
def test_wrong_points_are_one_sentence(first: F64, second: F64, sentence: str) -> None:
    with pytest.raises(RegistrationError, match=sentence):
        register(SOURCE, TARGET, (first, second))


def test_meshes_that_do_not_stand_alike_ask_for_points() -> None:
    turned = TARGET.vertices @ Rotation.from_euler("x", 180, degrees=True).as_matrix().T
    with pytest.raises(RegistrationError, match="not roughly aligned: give corresponding points"):
        register(SOURCE, TARGET.with_vertices(turned + np.array([0, 0, 4])))


def test_a_correspondence_checks_its_shapes() -> None:
    with pytest.raises(ValueError, match=r"weights must be \(2, 3\), got \(1, 3\)"):
        Correspondence(np.zeros((2, 3), np.intp), np.ones((1, 3)), np.ones(2, bool))
    link = Correspondence(np.array([[0, 1, 2]]), np.array([[0.5, 0.25, 0.25]]), np.ones(1, bool))
    values = np.array([4.0, 8.0, 0.0])
    assert link.interpolate(values).tolist() == [4.0]
    assert (link.matrix(3) @ values).tolist() == [4.0]


@pytest.mark.skipif(not PAIRS.is_dir(), reason="the pairs of heads are not beside the checkout")
@pytest.mark.slow
def test_a_real_pair_of_heads() -> None:
    z, head, remesh = (
        np.load(PAIRS / f"{n}.npz") for n in ("pair_P_7678_to_37500", "ict_head_dev", "ict_remesh_7678")
    )
    places = (head["V"] + head["ID"][1]).astype(np.float64)[head["T"][remesh["tri"]]]
    truth = np.einsum("nk,nki->ni", remesh["bary"], places)
    source, target = (Mesh(z[f"{k}V"], z[f"{k}T"].astype(np.intp), NO_QUADS) for k in "st")
    done = register(
        source, target, (source.vertices[z["markers"][:, 0]], target.vertices[z["markers"][:, 1]])
    )
    assert np.linalg.norm(done.fitted - truth, axis=1).mean() < 0.18
    assert done.quality.folded < 0.001


@pytest.mark.slow
def test_feature_points_that_started_beside_their_places_come_nearer() -> None:
    places = np.concatenate(
        [[(0.0, 0.0), (0.4, 0.3), (-0.4, 0.3)], MARKS[1:]]
    )  # nose, sockets, and on the vault
    true = relief(places[:, 0], places[:, 1], 0.3)
    start = true.copy()
    start[:3] += [(0.04, 0.03, 0), (-0.03, 0.02, 0), (0.03, 0.02, 0)]
    before = np.linalg.norm(start - true, axis=1)[:3]
    for passes in (1, 2):
        found = refine_feature_points(mask(61), true, mask(71), start, passes, radius=0.03)
        assert (np.linalg.norm(found - true, axis=1)[:3] < 0.5 * before).all()
