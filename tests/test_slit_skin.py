"""Skin around eyes and lips: smoothed displacements, no face turned over, and nothing else touched."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from guise.analogy.correspondence import Correspondence
from guise.analogy.geometry import face_normals
from guise.analogy.mesh import Mesh
from guise.analogy.slit_skin import SLIT_SKIN, SlitSkin
from guise.analogy.transfer import Transfer
from guise.common.arrays import F64, Int

STEPS = 24
EYES: list[tuple[F64, float]] = [(np.zeros(3), 2.0)]


def sheet() -> Mesh:
    """A flat sheet of 6 x 6 around an eye of width 2."""
    line = np.linspace(-3, 3, STEPS + 1)
    x, y = np.meshgrid(line, line)
    first = (np.arange(STEPS)[:, None] * (STEPS + 1) + np.arange(STEPS)).ravel()
    quads = np.stack([first, first + 1, first + STEPS + 2, first + STEPS + 1], axis=1)
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return Mesh(vertices, np.empty((0, 3), np.intp), quads)


def slit_skin(mesh: Mesh) -> SlitSkin:
    return SlitSkin(mesh, np.ones(len(mesh.vertices), bool), EYES, mesh.vertices, own_triangles(mesh))


def own_triangles(mesh: Mesh) -> Int:
    """(N, 3) a triangle at each vertex: the mesh is its own source."""
    matched = np.zeros((len(mesh.vertices), 3), np.intp)
    for corner in range(3):
        matched[mesh.faces[:, corner]] = mesh.faces
    return matched


def away(mesh: Mesh) -> F64:
    return np.asarray(np.linalg.norm(mesh.vertices, axis=1))


def test_a_motion_of_all_stays_and_noise_shrinks_only_near_the_eye() -> None:
    mesh = sheet()
    skin = slit_skin(mesh)
    moved = mesh.vertices + np.array([0.1, -0.5, 0.2])
    assert_allclose(skin.smoothed(moved)[away(mesh) < 1], moved[away(mesh) < 1], atol=1e-9)
    noise = np.random.default_rng(1).normal(0, 0.05, moved.shape)
    made = skin.smoothed(moved + noise)
    beyond = away(mesh) >= SLIT_SKIN.reach_widths[1] * 2
    assert beyond.any()
    assert_array_equal(made[beyond], (moved + noise)[beyond])
    near = away(mesh) < 1
    assert (made - moved)[near].std() < 0.95 * noise[near].std()


def test_vertices_out_of_order_are_put_in_order() -> None:
    mesh = sheet()
    skin = slit_skin(mesh)
    made = mesh.vertices.copy()
    middle = int(away(mesh).argmin())
    made[middle] += (0.6, 0, 0)  # beyond its neighbour
    over = (face_normals(made, mesh.faces) * face_normals(mesh.vertices, mesh.faces)).sum(1) < 0
    assert over.any()
    done = skin.without_folds(made, mesh.vertices)
    assert (face_normals(done, mesh.faces) * face_normals(mesh.vertices, mesh.faces)).sum(1).min() > 0
    changed = (done != made).any(axis=1)
    assert changed.any()
    assert away(mesh)[changed].max() < 1


def test_what_is_not_folded_stays_to_the_bit() -> None:
    mesh = sheet()
    skin = slit_skin(mesh)
    bent = mesh.vertices + np.column_stack(
        [np.zeros((len(mesh.vertices), 2)), 0.1 * mesh.vertices[:, 0] ** 2]
    )
    assert_array_equal(skin.without_folds(bent, mesh.vertices), bent)


def test_eyes_far_from_the_mesh_change_nothing() -> None:
    mesh = sheet()
    far = [(np.array([0, 0, 50.0]), 2.0)]
    skin = SlitSkin(mesh, np.ones(len(mesh.vertices), bool), far, mesh.vertices, own_triangles(mesh))
    moved = mesh.vertices + 1
    assert_array_equal(skin.without_folds(skin.smoothed(moved), moved), moved)


def test_what_turns_as_far_on_the_source_is_no_fold() -> None:
    mesh = sheet()
    skin = slit_skin(mesh)
    rolled = mesh.vertices.copy()
    lid = (np.abs(rolled[:, 0]) < 0.6) & (rolled[:, 1] > 0)
    rolled[lid, 1] *= -1  # a strip that is turned over whole
    assert_array_equal(skin.without_folds(rolled, rolled), rolled)
    assert (skin.without_folds(rolled, mesh.vertices) != rolled).any()


@pytest.mark.parametrize("shift", [0.0, 0.3])
@pytest.mark.slow
def test_only_what_is_matched_by_surface_is_smoothed(shift: float) -> None:
    """Vertex to vertex nothing slips, and a head gets exactly its own expression."""
    from test_lids import FACE_POINTS, face

    from guise.analogy.lids import FacePair

    mesh = face(6, 1.0)[0]
    link = Correspondence.identity(len(mesh.vertices))
    corners = mesh.faces[np.array([np.flatnonzero((mesh.faces == k).any(1))[0] for k in link.corners[:, 0]])]
    weights = (1 - shift) * (corners == link.corners[:, :1]) + shift / 3
    pair = FacePair.of(mesh, mesh, (FACE_POINTS, FACE_POINTS))
    transfer = Transfer(mesh, mesh, Correspondence(corners, weights, link.found), face=pair)
    wave = mesh.vertices + np.column_stack(
        [np.zeros((len(mesh.vertices), 2)), 0.1 * (-1.0) ** link.corners[:, 0]]
    )
    off = np.abs(transfer(wave) - wave).max()
    assert (off < 1e-6) == (shift == 0)


@pytest.mark.slow
def test_lips_are_smoothed_around_the_corners_of_the_mouth_alone() -> None:
    from test_lids import FACE_POINTS, face

    from guise.analogy.lids import FacePair

    mesh = face(6, 1.0)[0]
    corners = mesh.faces[
        np.array([np.flatnonzero((mesh.faces == k).any(1))[0] for k in range(len(mesh.vertices))])
    ]
    weights = 0.9 * (corners == np.arange(len(corners))[:, None]) + 0.1 / 3
    link = Correspondence(corners, weights, np.ones(len(corners), bool))
    pair = FacePair((FACE_POINTS, FACE_POINTS), ())
    wave = mesh.vertices.copy()
    wave[:, 2] += 0.1 * (-1.0) ** np.arange(len(wave))
    plain, smooth = (Transfer(mesh, mesh, link, face=known)(wave) for known in (None, pair))
    slits = pair.slits(mesh.vertices)
    assert len(slits) == 2
    away = np.min([np.linalg.norm(mesh.vertices - middle, axis=1) / width for middle, width in slits], axis=0)
    near, beyond = away < SLIT_SKIN.reach_widths[0], away > SLIT_SKIN.reach_widths[1]
    assert (smooth - mesh.vertices)[near].std() < 0.95 * (plain - mesh.vertices)[near].std()
    assert_allclose(smooth[beyond], plain[beyond], atol=1e-9)
