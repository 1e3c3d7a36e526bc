"""Song's correspondence: exact on itself, blind to pose and tessellation, seamless, honest about what is missing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from guise.analogy.cylinder import (
    Cylinder,
    MeshImage,
    PiecewiseAffineMap,
    cylindrical_correspondence,
    unroll_faces,
)
from guise.analogy.mesh import Mesh
from guise.analogy.registration import RegistrationError

NO_QUADS = np.empty((0, 4), np.intp)
HIGH = 1.25  # a head is so much higher than wide
# Places (u in radians, v in -1..1) of feature points: brows, eyes, nose, mouth, chin, ears.
FACE = np.array(
    [(-0.5, 0.35), (0.5, 0.35), (-0.4, 0.2), (0.4, 0.2), (0, 0), (-0.25, -0.3), (0.25, -0.3), (0, -0.6),
     (-1.6, 0), (1.6, 0)]
)  # fmt: skip


def surface(u: np.ndarray, v: np.ndarray, size: float = 1.0) -> np.ndarray:
    """The place of a made-up head at u (radians around), v (-1 chin .. 1 crown): an egg with a nose."""
    around = np.sqrt(np.maximum(1 - v**2, 0))
    nose = 0.25 * np.exp(-((u / 0.3) ** 2) - ((v - 0.05) / 0.25) ** 2)
    out = (around + nose)[..., None] * np.stack([np.sin(u), np.zeros_like(u), np.cos(u)], -1)
    out[..., 1] = HIGH * v
    return size * out


def grid(rows: int, columns: int, low: float = -0.9, high: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) u, v of vertices, and faces (m, 3), closed around, open at both ends."""
    v, u = np.meshgrid(np.linspace(low, high, rows), 2 * np.pi * np.arange(columns) / columns, indexing="ij")
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns)).ravel()
    b = (np.arange(rows - 1)[:, None] * columns + (np.arange(columns) + 1) % columns).ravel()
    faces = np.concatenate([np.stack([a, b, a + columns], 1), np.stack([b, b + columns, a + columns], 1)])
    return np.stack([(u.ravel() + np.pi) % (2 * np.pi) - np.pi, v.ravel()], 1), faces


def head(rows: int = 40, columns: int = 60, **ends: float) -> tuple[Mesh, np.ndarray]:
    """A head, and the u, v of its vertices."""
    places, faces = grid(rows, columns, **ends)
    return Mesh(surface(*places.T), faces, NO_QUADS), places


def points() -> np.ndarray:
    return surface(*FACE.T)


def turned(degrees: float) -> np.ndarray:
    s, c = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def test_a_head_corresponds_to_itself() -> None:
    mesh, _ = head()
    found = cylindrical_correspondence(mesh, mesh, points(), points())
    assert found.found.all()
    np.testing.assert_allclose(found.interpolate(mesh.vertices), mesh.vertices, atol=1e-6)


def test_another_tessellation_of_the_same_surface_finds_the_same_places() -> None:
    source, _ = head(45, 70)
    target, _ = head(38, 53)
    found = cylindrical_correspondence(source, target, points(), points())
    assert found.found.mean() > 0.99
    apart = np.linalg.norm(found.interpolate(source.vertices) - target.vertices, axis=1)
    assert apart.max() < 0.01


def test_turn_place_and_scale_of_the_target_change_nothing() -> None:
    source, _ = head(45, 70)
    target, _ = head(38, 53)
    plain = cylindrical_correspondence(source, target, points(), points())
    rotation = turned(20) @ np.array([[0.96, -0.28, 0], [0.28, 0.96, 0], [0, 0, 1]])
    moved = 1.3 * target.vertices @ rotation.T + (5, -7, 9)
    other = cylindrical_correspondence(
        source, target.with_vertices(moved), points(), 1.3 * points() @ rotation.T + (5, -7, 9)
    )
    assert (other.found == plain.found).mean() > 0.999  # pixels differ at the border
    np.testing.assert_allclose(
        other.interpolate(source.vertices), plain.interpolate(source.vertices), atol=1e-3
    )


def test_heads_that_stand_on_z_are_the_same() -> None:
    source, _ = head(45, 70)
    target, _ = head(38, 53)
    up = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # x, -z, y: looks along -y
    lying = source.with_vertices(source.vertices @ up.T), target.with_vertices(target.vertices @ up.T)
    plain = cylindrical_correspondence(source, target, points(), points())
    other = cylindrical_correspondence(*lying, points() @ up.T, points() @ up.T)
    np.testing.assert_allclose(
        other.interpolate(source.vertices), plain.interpolate(source.vertices), atol=1e-3
    )


def test_the_back_of_the_head_has_no_seam() -> None:
    source, _ = head(45, 70)
    target, places = head(38, 53)
    lopsided = FACE + np.where(FACE[:, :1] > 1, (0.2, 0.1), (0.0, 0.0))  # one ear elsewhere
    found = cylindrical_correspondence(source, target, points(), surface(*lopsided.T))
    v, u = places[:, 1].reshape(38, 53), places[:, 0].reshape(38, 53)
    carried = found.interpolate(source.vertices).reshape(38, 53, 3)
    order = np.argsort(u[0])
    assert (v[:, 0] == v[:, 1]).all()
    steps = np.linalg.norm(np.diff(carried[5:-5, order], axis=1, append=carried[5:-5, order[:1]]), axis=2)
    assert steps[:, -1].max() < 2 * np.median(steps)  # from the last column to the first


def test_feature_points_correspond_to_each_other() -> None:
    source, _ = head(60, 90)
    other = FACE * (1.0, 1.1) + (0, 0.03)  # a face set differently on the same head
    u, v = np.meshgrid(np.linspace(-2.8, 2.8, 60), np.linspace(-0.85, 0.9, 40))
    places = np.concatenate([np.stack([u.ravel(), v.ravel()], 1), other])
    target = Mesh(surface(*places.T), Delaunay(places).simplices.astype(np.intp), NO_QUADS)
    found = cylindrical_correspondence(source, target, points(), surface(*other.T))
    carried = found.interpolate(source.vertices)[-len(FACE) :]
    assert np.linalg.norm(carried - points(), axis=1).max() < 0.03


def test_a_lining_takes_the_lining() -> None:
    inner, faces = grid(20, 30, -0.5, 0.3)
    meshes = []
    for rows, columns in ((45, 70), (38, 53)):
        places, outer = grid(rows, columns)
        vertices = np.concatenate([surface(*places.T), surface(*inner.T, size=0.8)])
        inside = faces[:, ::-1] + len(places)  # faces inwards
        meshes.append(Mesh(vertices, np.concatenate([outer, inside]), NO_QUADS))
    found = cylindrical_correspondence(*meshes, points(), points())
    apart = np.linalg.norm(found.interpolate(meshes[0].vertices) - meshes[1].vertices, axis=1)
    assert found.found.mean() > 0.99
    assert apart.max() < 0.05


def lips(rows: int, columns: int) -> tuple[Mesh, np.ndarray]:
    """A head cut through at the mouth, where both sides are rolled inwards; and which vertices are the upper part's."""
    parts = []
    for low, high, edge in ((-0.9, -0.3, -1), (-0.3, 0.95, 0)):
        places, faces = grid(rows, columns, low, high)
        rim, _ = grid(2, columns, 0, 1)
        inner = surface(rim[:columns, 0], np.full(columns, -0.3), 0.9)
        inner[:, 1] = -0.3 * HIGH + (0.01 if edge == 0 else -0.01)
        outer = np.arange(len(places)).reshape(rows, columns)[edge]
        own = len(places) + np.arange(columns)
        roll = np.stack([np.roll(outer, -1), outer, own, np.roll(own, -1)], axis=1)
        roll = roll if edge == -1 else roll[:, ::-1]
        roll = np.concatenate([roll[:, [0, 1, 2]], roll[:, [0, 2, 3]]])
        parts.append((np.concatenate([surface(*places.T), inner]), np.concatenate([faces, roll])))
    (below, one), (above, other) = parts
    mesh = Mesh(np.concatenate([below, above]), np.concatenate([one, other + len(below)]), NO_QUADS)
    return mesh, np.arange(len(mesh.vertices)) >= len(below)


def test_upper_lips_are_not_matched_with_lower_ones() -> None:
    source, above = lips(20, 60)
    target, upper = lips(17, 53)
    found = cylindrical_correspondence(source, target, points(), points())
    from_above = found.interpolate(above.astype(float))
    rim = np.abs(target.vertices[:, 1] + 0.3 * HIGH) < 0.02
    assert rim.sum() == 4 * 53
    assert np.abs(from_above - upper)[rim].mean() < 0.05


def test_what_the_source_has_not_is_not_found() -> None:
    source, _ = head(45, 70, low=-0.7)
    target, places = head(38, 53, low=-0.9)
    found = cylindrical_correspondence(source, target, points(), points())
    below, above = places[:, 1] < -0.75, places[:, 1] > -0.65
    assert not found.found[below].any()
    assert found.found[above].all()
    carried = found.interpolate(source.vertices)
    assert np.isfinite(carried).all()
    assert np.abs(carried[below, 1] + 0.7 * HIGH).max() < 0.05  # at the source's border


def test_small_parts_are_not_found() -> None:
    source, _ = head(45, 70)
    places, faces = grid(38, 53)
    eye, round_it = grid(8, 12)
    vertices = np.concatenate([surface(*places.T), surface(*eye.T, size=0.1) + np.array([0.4, 0.2, 0.7])])
    target = Mesh(vertices, np.concatenate([faces, round_it + len(places)]), NO_QUADS)
    found = cylindrical_correspondence(source, target, points(), points()).found
    assert found[: len(places)].mean() > 0.99
    assert not found[len(places) :].any()


def test_points_that_fold_the_map_are_left_out() -> None:
    cylinder = Cylinder(np.eye(3), np.zeros(3), 1.0)
    crossed = FACE.copy()
    crossed[[2, 3]] = FACE[[3, 2]]  # the eyes are exchanged
    ends = -1.5, 1.5
    warp = PiecewiseAffineMap(cylinder, crossed, FACE, ends, ends)
    u, v = np.meshgrid(np.linspace(-1.5, 1.5, 60), np.linspace(-0.8, 0.8, 40))
    mapped = warp(np.stack([u.ravel(), v.ravel()], 1)).reshape(40, 60, 2)
    across, up = np.diff(mapped, axis=1)[:-1], np.diff(mapped, axis=0)[:, :-1]
    assert (across[..., 0] * up[..., 1] - across[..., 1] * up[..., 0] > 0).all()
    kept = np.linalg.norm(warp(FACE) - FACE, axis=1)
    assert (np.delete(kept, [2, 3]) < 1e-6).all()


@settings(max_examples=10)
@given(st.integers(0, 10_000))
def test_the_map_takes_points_to_points_and_is_the_identity_between_equal_ones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cylinder = Cylinder(np.eye(3), np.zeros(3), 1.0)
    moved = FACE + rng.uniform(-0.03, 0.03, FACE.shape)
    np.testing.assert_allclose(
        PiecewiseAffineMap(cylinder, moved, FACE, (-1.5, 1.5), (-1.5, 1.4))(FACE), moved, atol=1e-9
    )
    anywhere = np.stack([rng.uniform(-3.1, 3.1, 50), rng.uniform(-1.4, 1.4, 50)], 1)
    same = PiecewiseAffineMap(cylinder, FACE, FACE, (-1.5, 1.5), (-1.5, 1.5))(anywhere)
    np.testing.assert_allclose(same, anywhere, atol=1e-9)


def test_faces_across_the_seam_are_there_twice_and_around_the_axis_not_at_all() -> None:
    places = np.array([[3.0, 0], [-3.0, 0], [3.0, 1], [0.0, 0], [-2.0, 1], [2.0, 1]])
    faces = np.array([[0, 1, 2], [3, 4, 5], [0, 3, 5]])
    owners, corners, origins, flat = unroll_faces(places, faces, 2 * np.pi)
    assert owners.tolist() == [2, 0, 0]
    np.testing.assert_array_equal(origins[corners[1:]], [[0, 1, 2], [0, 1, 2]])
    right, left = flat[corners[1:], 0]
    np.testing.assert_allclose(right, [3.0, 2 * np.pi - 3.0, 3.0])
    np.testing.assert_allclose(left, right - 2 * np.pi)


def test_the_mesh_image_finds_every_vertex_of_an_open_head() -> None:
    mesh, places = head()
    cylinder = Cylinder.around(mesh, points())
    image = MeshImage(cylinder, mesh.vertices, mesh.faces)
    assert image.depth().max() < 0.02  # nothing lies under anything
    faces, weights, found = image.find(image.places + np.array([cylinder.length, 0]))  # once around more
    assert found.all()
    carried = np.einsum("nk,nkd->nd", weights, mesh.vertices[mesh.faces[faces]])
    np.testing.assert_allclose(carried, mesh.vertices, atol=1e-6)
    assert len(places) == len(found)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (points()[:2], "2 points"),
        (np.repeat(points()[:1], 4, axis=0), "coincide or lie on a line"),
        (np.full((4, 3), np.nan), "finite"),
    ],
)
def test_points_that_tell_nothing_are_refused(given: np.ndarray, says: str) -> None:
    mesh, _ = head(10, 12)
    with pytest.raises(RegistrationError, match=says):
        cylindrical_correspondence(mesh, mesh, given, given)


def test_points_far_from_the_source_are_refused() -> None:
    mesh, _ = head(10, 12)
    with pytest.raises(RegistrationError, match="do not lie on the source"):
        cylindrical_correspondence(mesh, mesh, points() + np.array([0, 50, 0]), points())
