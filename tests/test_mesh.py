"""Meshes to compute with, and what cleaning leaves of a file's vertices."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from guise.analogy.cleaning import CleanedMesh
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.normals import StoredNormals, polygon_vertex_normals, unit_vectors
from guise.common.arrays import F64, Int

SIDE = 9
HEADS = Path(__file__).parents[2] / "shared" / "data" / "mesh"
NO_TRIANGLES, NO_QUADS = np.zeros((0, 3), np.intp), np.zeros((0, 4), np.intp)


def grid(side: int = SIDE) -> Int:
    """Quads (q, 4) of a sheet of side * side vertices."""
    at = np.arange(side * side).reshape(side, side)
    return np.stack([c.ravel() for c in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1])], axis=1)


def sheet(bend: float = 0.3) -> F64:
    """A curved sheet; x, y from -1 to 1 and z up."""
    u, v = np.meshgrid(np.linspace(-1, 1, SIDE), np.linspace(-1, 1, SIDE))
    return np.stack([u, v, -bend * (u**2 + v**2)], axis=2).reshape(-1, 3)


def slit(vertices: F64, quads: Int, row: int = SIDE // 2) -> tuple[F64, Int, Int]:
    """The sheet cut open along a row but for its ends: vertices, quads, and the vertex each one copies."""
    cut = np.arange(row * SIDE + 1, row * SIDE + SIDE - 1)
    origin = np.concatenate([np.arange(len(vertices)), cut])
    new = np.arange(len(vertices))
    new[cut] = len(vertices) + np.arange(len(cut))
    above = (quads >= row * SIDE).all(axis=1)
    faces = np.where(above[:, None], new[quads], quads)
    return vertices[origin], faces, origin


def folded(vertices: F64) -> F64:
    """The sheet bent sharply in along its middle row, as two lips that meet."""
    return np.stack([vertices[:, 0], vertices[:, 1], 3 * np.abs(vertices[:, 1])], axis=1)


def test_a_mesh_knows_its_faces_rings_and_parts() -> None:
    quads = np.concatenate([grid(), grid() + SIDE * SIDE])
    mesh = Mesh(np.concatenate([sheet(), sheet() + 5]), NO_TRIANGLES, quads)
    assert mesh.faces.shape == (2 * len(quads), 3)
    assert_array_equal(mesh.faces[0], quads[0, :3])
    assert_array_equal(mesh.components, np.repeat([0, 1], SIDE * SIDE))
    assert mesh.with_vertices(mesh.vertices + 1).rings is mesh.rings


@pytest.mark.parametrize(
    ("vertices", "triangles", "said"),
    [
        (np.zeros((4, 2)), [[0, 1, 2]], r"vertices must be \(4, 3\), got \(4, 2\)"),
        (np.diag([1.0, np.inf, np.nan]), [[0, 1, 2]], "2 of 3 vertices are not finite"),
        (np.eye(3), [[0, 1, 3]], "triangles must hold ids from 0 to 2"),
        (np.eye(3), [[0, 1, -1]], "triangles must hold ids from 0 to 2"),
        (np.eye(3), [[0, 1]], r"triangles must be \(n, 3\), got \(1, 2\)"),
        (np.eye(3), NO_TRIANGLES, "no faces"),
    ],
)
def test_a_mesh_that_is_none_is_refused(vertices: F64, triangles: object, said: str) -> None:
    with pytest.raises(MeshError, match=said):
        Mesh(vertices, np.array(triangles, np.intp), NO_QUADS)


def test_other_vertices_must_be_as_many_and_finite() -> None:
    mesh = Mesh(sheet(), NO_TRIANGLES, grid())
    with pytest.raises(MeshError, match=r"vertices must be \(81, 3\), got \(80, 3\)"):
        mesh.with_vertices(sheet()[1:])
    with pytest.raises(MeshError, match="81 of 81 vertices are not finite"):
        mesh.with_vertices(sheet() * np.nan)


def test_a_clean_mesh_is_left_as_it_is() -> None:
    found = CleanedMesh.of(sheet(), Polygons.of(grid()))
    assert_array_equal(found.mesh.vertices, sheet())
    assert_array_equal(found.mesh.quads, grid())
    assert_array_equal(found.kept, found.ids)


def test_a_seam_is_closed() -> None:
    """Cut where nothing but texture coordinates tells the sides apart, or nothing that is known."""
    vertices, quads, origin = slit(sheet(), grid())
    uvs = np.arange(2.0 * len(vertices)).reshape(-1, 2)
    for apart in (uvs, None):
        found = CleanedMesh.of(vertices, Polygons.of(quads), apart=apart)
        assert_array_equal(found.mesh.vertices, sheet())
        assert_array_equal(found.ids, origin)
        assert_array_equal(np.sort(found.mesh.quads), np.sort(grid()))


def test_lips_that_touch_stay_apart() -> None:
    """The surface folds back where they meet, or nothing says why the file has their vertices twice."""
    lips, quads, origin = slit(folded(sheet()), grid())
    found = CleanedMesh.of(lips, Polygons.of(quads), apart=np.arange(2.0 * len(lips)).reshape(-1, 2))
    assert len(found.mesh.vertices) == len(lips)
    flat, quads, origin = slit(sheet(), grid())
    found = CleanedMesh.of(flat, Polygons.of(quads), apart=sheet()[origin][:, :2])
    assert len(found.mesh.vertices) == len(flat)


def test_what_a_rig_moves_apart_stays_apart() -> None:
    vertices, quads, _ = slit(sheet(), grid())
    opening = np.zeros_like(vertices)
    opening[SIDE * SIDE :] = (0, 0.1, 0)
    assert len(CleanedMesh.of(vertices, Polygons.of(quads)).mesh.vertices) == SIDE * SIDE
    found = CleanedMesh.of(vertices, Polygons.of(quads), together=opening)
    assert len(found.mesh.vertices) == len(vertices)


def test_lips_with_a_mouth_behind_them_do_not_grow_together() -> None:
    """Two sheets that touch along a row inside both: no border there, so no edge gets four faces."""
    valley = sheet()
    valley[:, 2] = valley[:, 1] ** 2
    vertices = np.concatenate([valley, valley * (1, 1, -1)])
    quads = np.concatenate([grid(), grid()[:, ::-1] + SIDE * SIDE])
    found = CleanedMesh.of(vertices, Polygons.of(quads))
    assert len(found.mesh.vertices) == 2 * SIDE * SIDE
    assert found.mesh.components.max() == 1


def test_a_soup_of_triangles_becomes_a_surface() -> None:
    corners = np.concatenate([grid()[:, [0, 1, 2]], grid()[:, [0, 2, 3]]])
    soup = sheet()[corners.ravel()]
    found = CleanedMesh.of(
        soup, Polygons.of(np.arange(len(soup)).reshape(-1, 3)), apart=np.zeros((len(soup), 2))
    )
    assert len(found.mesh.vertices) == SIDE * SIDE
    assert_array_equal(found.mesh.vertices[found.ids], soup)


def test_what_is_useless_is_left_out_and_moves_with_the_nearest() -> None:
    """A lone vertex, a face without area and its vertex, a face twice."""
    vertices = np.concatenate([sheet(), [[1.1, 1.1, -0.6], [0.0, 0.0, 5.0], [2.0, -1.0, -0.6]]])
    line = [SIDE - 1, SIDE - 1, SIDE * SIDE + 2]
    corners = np.concatenate([grid().ravel(), grid()[3], line])
    sizes = np.array([4] * len(grid()) + [4, 3])
    found = CleanedMesh.of(vertices, Polygons(corners.astype(np.intp), sizes))
    assert_array_equal(found.mesh.vertices, sheet())
    assert_array_equal(found.mesh.quads, grid())
    assert_array_equal(found.ids[SIDE * SIDE :], [SIDE * SIDE - 1, SIDE * SIDE // 2, SIDE - 1])


def test_polygons_of_many_sides_are_fans() -> None:
    angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    hexagon = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    found = CleanedMesh.of(hexagon, Polygons(np.arange(6), np.array([6])))
    assert_array_equal(found.mesh.triangles, [[0, k, k + 1] for k in range(1, 5)])


def test_a_quad_with_a_flat_half_is_its_other_half() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    found = CleanedMesh.of(square, Polygons.of(np.array([[0, 1, 2, 3]])))
    assert len(found.mesh.quads) == 0
    assert_array_equal(found.kept[found.mesh.triangles], [[0, 2, 3]])


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (np.zeros((0, 3)), NO_TRIANGLES, "no vertices"),
        (sheet(), NO_TRIANGLES, "81 vertices but no faces"),
        (sheet() * (1, 0, 0), grid(), "all of its faces have zero area"),
        (np.where(sheet() == 1, np.inf, sheet()), grid(), "17 of its 81 vertices are not finite"),
    ],
)
def test_what_cannot_be_cleaned_is_said(vertices: F64, faces: Int, said: str) -> None:
    with pytest.raises(MeshError, match=said):
        CleanedMesh.of(vertices, Polygons.of(faces))


@given(st.lists(st.integers(3, 7), min_size=1, max_size=6))
def test_areas_of_polygons_are_those_of_their_fans(sizes: list[int]) -> None:
    generator = np.random.default_rng(sum(sizes))
    vertices = generator.normal(size=(20, 3))
    polygons = Polygons(generator.integers(0, 20, sum(sizes)), np.array(sizes, np.intp))
    wanted, start = [], 0
    for size in sizes:
        ring = vertices[polygons.corners[start : start + size]]
        wanted.append(np.cross(ring - ring[0], np.roll(ring - ring[0], -1, axis=0)).sum(0) / 2)
        start += size
    np.testing.assert_allclose(polygons.area_vectors(vertices), wanted, atol=1e-12)


@pytest.mark.skipif(not HEADS.is_dir(), reason="the shared heads are not there")
@pytest.mark.parametrize("name", ["ict_head_dev", "makehuman_head_dev", "mediapipe_canonical"])
@pytest.mark.parametrize("told", ["nothing", "uvs", "normals", "both"])
def test_real_heads_cut_into_islands_are_put_together(name: str, told: str) -> None:
    """Split along the borders of 25 patches, as of an atlas; the head's own borders stay open."""
    with np.load(HEADS / f"{name}.npz") as held:
        vertices, triangles = held["V"].astype(np.float32).astype(np.float64), held["T"]
    centres = vertices[triangles].mean(axis=1)
    seeds = np.random.default_rng(0).choice(centres, 25, replace=False)
    patch = ((centres[:, None] - seeds) ** 2).sum(axis=2).argmin(axis=1)
    split, first, ids = np.unique(triangles * 25 + patch[:, None], return_index=True, return_inverse=True)
    origin = triangles.ravel()[first]
    normals = polygon_vertex_normals(vertices, Polygons.of(triangles))[origin]
    found = CleanedMesh.of(
        vertices[origin],
        Polygons.of(ids.reshape(-1, 3)),
        normals=normals if told in ("normals", "both") else None,
        apart=split[:, None] % 25.0 if told in ("uvs", "both") else None,
    )
    assert len(split) > 1.05 * len(vertices)
    assert len(found.mesh.vertices) == len(vertices)
    assert_array_equal(found.mesh.vertices[found.ids], vertices[origin])


def rotation(degrees: float) -> F64:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def test_normals_turn_with_the_surface_and_stay_where_nothing_moves() -> None:
    polygons = Polygons.of(grid())
    own = unit_vectors(
        polygon_vertex_normals(sheet(), polygons) + np.random.default_rng(0).normal(0, 0.01, (SIDE * SIDE, 3))
    )
    normals = StoredNormals(own, polygons.corners, sheet(), polygons, np.arange(SIDE * SIDE))
    assert_array_equal(normals.updated(sheet()), own)
    turned = normals.updated(sheet() @ rotation(30).T)
    assert float((turned * (own @ rotation(30).T)).sum(1).min()) > np.cos(np.deg2rad(2))
    half = sheet()
    half[: 3 * SIDE] += (0, 0, 0.2)
    assert_array_equal(normals.updated(half)[5 * SIDE :], own[5 * SIDE :])


def test_a_hard_edge_stays_hard() -> None:
    """Each side of a fold has its own normals, though the vertices are one."""
    vertices = folded(sheet())
    polygons = Polygons.of(grid())
    faces = unit_vectors(polygons.area_vectors(vertices))
    flat = StoredNormals(faces, polygons.owners, vertices, polygons, np.arange(len(vertices)))
    np.testing.assert_allclose(flat.updated(vertices @ rotation(90).T), faces @ rotation(90).T, atol=1e-9)


def test_normals_are_the_same_on_both_sides_of_a_seam() -> None:
    vertices, quads, origin = slit(sheet(), grid())
    polygons = Polygons.of(quads)
    own = polygon_vertex_normals(sheet(), Polygons.of(grid()))[origin]
    moved = StoredNormals(own, polygons.corners, vertices, polygons, origin).updated(folded(vertices))
    assert_array_equal(moved[SIDE * SIDE :], moved[origin[SIDE * SIDE :]])


@given(
    st.integers(0, 3),
    st.floats(1e-3, 1e3),
    st.tuples(*[st.floats(-100, 100)] * 3),
    st.booleans(),
    st.booleans(),
)
def test_a_mesh_that_is_inside_out_is_turned(
    ball: int, size: float, place: tuple[float, float, float], mirrored: bool, open_below: bool
) -> None:
    """A head mirrored with its winding kept, of any size, anywhere, with a neck or none, is wound as the other is."""
    made = trimesh.creation.icosphere(1 + ball)
    faces = made.faces[made.triangles_center[:, 2] > -0.8] if open_below else made.faces
    vertices = made.vertices * (1, 0.8, 1.3) * size * ((-1, 1, 1) if mirrored else 1) + np.array(place) * size
    found = CleanedMesh.of(vertices, Polygons.of(np.asarray(faces)))
    assert found.turned == mirrored
    assert not found.mesh.is_inside_out
    kept = found.kept[found.mesh.triangles]
    assert_array_equal(kept[:, ::-1] if mirrored else kept, faces)


@pytest.mark.parametrize("mirrored", [False, True])
def test_normals_of_the_outer_side_follow_a_mirrored_surface(mirrored: bool) -> None:
    """Whichever way the faces are wound, normals that point outwards turn with the surface."""
    ball = trimesh.creation.icosphere(2)
    faces = Polygons.of(np.asarray(ball.faces[:, ::-1] if mirrored else ball.faces))
    places = np.arange(len(ball.vertices))
    held = StoredNormals(np.array(ball.vertices), faces.corners, np.array(ball.vertices), faces, places)
    flat = held.updated(ball.vertices * (1, 1, 0.5))
    upright = ball.vertices[:, 2] > 0.5
    assert (flat[upright, 2] > ball.vertices[upright, 2] - 1e-9).all()
    assert (flat[upright, 2] > ball.vertices[upright, 2] + 1e-3).mean() > 0.9
