"""Feature points on the two sample heads, whose true vertices are known, and where lines of sight meet."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from guise.aam.similarity import Failed
from guise.analogy import face_views
from guise.analogy.face_views import FaceSearchSettings, _right_angle_rotations, _uniform_rotations
from guise.analogy.feature_points import (
    FEATURE_POINT_NAMES,
    FeaturePoints,
    FeaturePointsError,
    find_feature_points,
    load_feature_points,
)
from guise.analogy.formats.files import read_mesh
from guise.analogy.mesh import Mesh
from guise.analogy.triangulation import intersect_lines
from guise.analogy.views import OrthographicView, ViewedMesh
from guise.common.arrays import F64, Int

HEADS = Path(__file__).parents[1] / "sample_videos" / "heads"
TRUE = {
    "mean": "1377 3482 455 492 520 523 297 133 317 358 2530 21 1055 3160 2216 1692 178 181 2368 2365",
    "other": "1097 3217 233 461 340 337 204 86 212 209 2335 787 2105 4218 2907 1401 111 114 2241 2238",
}  # vertices, in the order of NAMES
MIRROR = [
    FEATURE_POINT_NAMES.index(name.replace("right", "?").replace("left", "right").replace("?", "left"))
    for name in FEATURE_POINT_NAMES
]


@cache
def head(name: str) -> Mesh:
    return read_mesh(HEADS / f"{name}.obj").mesh


@cache
def points(name: str) -> FeaturePoints:
    return found(head(name))


def found(mesh: Mesh) -> FeaturePoints:
    answer = find_feature_points(mesh)
    assert isinstance(answer, FeaturePoints), answer
    return answer


def faces(mesh: Mesh, triangles: Int) -> Mesh:
    return Mesh(mesh.vertices, triangles, np.empty((0, 4), np.intp))


def _ids(name: str) -> list[int]:
    return [int(number) for number in TRUE[name].split()]


def truth(name: str) -> F64:
    return head(name).vertices[_ids(name)]


def off(answer: FeaturePoints, places: F64) -> F64:
    """(20,) distances from places (20, 3), in eye widths."""
    return np.asarray(np.linalg.norm(answer.positions - places, axis=1) / answer.eye_width)


@pytest.mark.parametrize("name", ["mean", "other"])
@pytest.mark.slow
def test_points_are_where_they_are_known_to_be(name: str) -> None:
    errors = off(points(name), truth(name))
    assert np.count_nonzero(errors < 0.08) >= 18
    assert errors.mean() < 0.04
    assert points(name).confidence.min() > 0.5


def test_points_lie_on_the_surface_and_have_their_nearest_vertices() -> None:
    answer, mesh = points("mean"), head("mean")
    assert_allclose(ViewedMesh.of(mesh).closest_points(answer.positions), answer.positions, atol=1e-9)
    away = np.linalg.norm(mesh.vertices[None] - answer.positions[:, None], axis=2)
    assert_allclose(away[np.arange(20), answer.vertices], away.min(1))


@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.slow
def test_points_go_with_a_head_that_is_turned_scaled_and_moved(seed: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix() * 250.0
    moved = head("mean").with_vertices(head("mean").vertices @ turn.T + (3000, -4000, 10))
    assert off(found(moved), points("mean").positions @ turn.T + (3000, -4000, 10)).max() < 0.05


def test_left_and_right_change_places_in_a_mirror() -> None:
    mesh = head("other")
    mirrored = Mesh(mesh.vertices * (-1, 1, 1), mesh.triangles[:, ::-1], mesh.quads[:, ::-1])
    answer = found(mirrored)
    away = off(answer, (points("other").positions * (-1, 1, 1))[MIRROR])
    assert away.mean() < 0.03
    assert away.max() < 0.15  # an eye's width and more, if sides were confused
    errors = off(answer, (truth("other") * (-1, 1, 1))[MIRROR])
    assert np.count_nonzero(errors < 0.08) >= 18
    assert errors.mean() < 0.042


@pytest.mark.parametrize("damage", ["inside out", "half of the faces inside out", "holes", "noise", "mask"])
@pytest.mark.slow
def test_a_damaged_head_is_still_one(damage: str) -> None:
    mesh, rng = head("mean"), np.random.default_rng(0)
    triangles, middle = mesh.faces, mesh.vertices[mesh.faces].mean(1)
    if damage == "inside out":
        hurt = faces(mesh, triangles[:, ::-1])
    elif damage == "half of the faces inside out":
        flipped = rng.random(len(triangles)) < 0.5
        hurt = faces(mesh, np.where(flipped[:, None], triangles[:, ::-1], triangles))
    elif damage == "holes":
        near = np.linalg.norm(middle[:, None] - mesh.vertices[rng.integers(0, 4278, 15)], axis=2).min(1)
        hurt = faces(mesh, triangles[near > 0.1])
    elif damage == "noise":
        hurt = mesh.with_vertices(mesh.vertices + rng.normal(0, 0.01, mesh.vertices.shape))
    else:
        hurt = faces(mesh, triangles[middle[:, 2] > 0.6])
    assert np.count_nonzero(off(found(hurt), truth("mean")) < 0.08) >= 17


def test_a_ball_has_no_face(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(face_views, "FACE_SEARCH", FaceSearchSettings(extra_rotations=8))
    turn, rise = (a.ravel() for a in np.meshgrid(np.arange(24) * np.pi / 12, np.arange(1, 12) * np.pi / 12))
    ball = np.stack([np.sin(rise) * np.cos(turn), np.cos(rise), np.sin(rise) * np.sin(turn)], axis=1)
    corner = np.arange(240)
    after = corner // 24 * 24 + (corner + 1) % 24
    quads = np.stack([corner, after, after + 24, corner + 24], axis=1)
    answer = find_feature_points(Mesh(ball, np.empty((0, 3), np.intp), quads))
    assert isinstance(answer, Failed)
    assert answer.reason == (
        "no face was found on the mesh from any direction: give the points with --landmarks FILE"
    )


def test_a_saved_file_is_read_back(tmp_path: Path) -> None:
    points("mean").save(tmp_path / "points.json")
    read = load_feature_points(tmp_path / "points.json", head("mean"))
    assert_allclose(read.positions, points("mean").positions, rtol=1e-6)
    assert read.vertices.tolist() == points("mean").vertices.tolist()


def test_a_correction_replaces_only_what_it_names(tmp_path: Path) -> None:
    place = head("mean").vertices[1692].tolist()
    path = written(tmp_path, {"nose_tip": 297, "chin": place})
    read = load_feature_points(path, head("mean"), points("mean"))
    changed = np.array([name in ("nose_tip", "chin") for name in FEATURE_POINT_NAMES])
    assert_allclose(read.positions[~changed], points("mean").positions[~changed])
    assert_allclose(read.positions[changed], head("mean").vertices[[297, 1692]])
    assert read.vertices[changed].tolist() == [297, 1692]
    assert (read.confidence[changed] == 1).all()


WRONG: list[tuple[Any, str]] = [
    ({"nose": 3}, "'nose' is not a feature point; the names are mouth_corner_right, "),
    ({"chin": 4278}, "chin must be a vertex from 0 to 4277, got 4278"),
    ({"chin": -1}, "chin must be a vertex from 0 to 4277, got -1"),
    ({"chin": True}, "chin must be a vertex or three finite numbers [x, y, z], got True"),
    ({"chin": [0, 1]}, "chin must be a vertex or three finite numbers [x, y, z], got [0, 1]"),
    (
        {"chin": [0, 1, float("nan")]},
        "chin must be a vertex or three finite numbers [x, y, z], got [0, 1, nan]",
    ),
    (
        {"chin": [0, 0, 0]},
        "chin is 6.2 away from a mesh that is 3.79 across: does the file belong to another mesh?",
    ),
    ([1, 2], "must hold a JSON object, name -> vertex or [x, y, z], got a list"),
]


@pytest.mark.parametrize(("content", "message"), WRONG)
def test_a_wrong_file_is_one_sentence(tmp_path: Path, content: Any, message: str) -> None:
    with pytest.raises(FeaturePointsError) as error:
        load_feature_points(written(tmp_path, content), head("mean"), points("mean"))
    assert message in str(error.value)
    assert "points.json" in str(error.value)


def test_an_incomplete_missing_or_broken_file_is_one_sentence(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        {name: at for name, at in zip(FEATURE_POINT_NAMES, _ids("mean"), strict=True) if name != "chin"},
    )
    with pytest.raises(FeaturePointsError, match="must give all 20 feature points, chin missing"):
        load_feature_points(path, head("mean"))
    with pytest.raises(FeaturePointsError, match="cannot be read: give a JSON file of feature points"):
        load_feature_points(tmp_path / "none.json", head("mean"))
    path.write_text("{", encoding="utf-8")
    with pytest.raises(FeaturePointsError, match="must be JSON"):
        load_feature_points(path, head("mean"))


def written(folder: Path, content: Any) -> Path:
    path = folder / "points.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def lines_of_sight(places: F64) -> tuple[F64, F64]:
    rows = Rotation.random(9, random_state=2).as_matrix()[:, :2]
    return rows, np.asarray(np.einsum("vri,ki->vkr", rows, places))


def test_lines_of_sight_meet_where_they_came_from() -> None:
    places = np.random.default_rng(0).normal(size=(5, 3))
    answer, away = intersect_lines(*lines_of_sight(places))
    assert_allclose(answer, places, atol=1e-9)
    assert away.max() < 1e-9


def test_one_wrong_line_of_sight_changes_little_and_is_told() -> None:
    places = np.random.default_rng(0).normal(size=(5, 3))
    rows, lines = lines_of_sight(places)
    noisy = lines + np.random.default_rng(1).normal(0, 0.01, lines.shape)
    noisy[4, 2] += 3
    answer, away = intersect_lines(rows, noisy)
    plain = np.linalg.lstsq(rows.reshape(-1, 3), noisy[:, 2].ravel(), rcond=None)[0]
    assert np.linalg.norm(answer - places, axis=1).max() < 0.05 < np.linalg.norm(plain - places[2])
    assert away[4, 2] > 2 > away[np.arange(9) != 4].max()


def test_a_pixel_and_its_line_of_sight_agree() -> None:
    view = OrthographicView(
        Rotation.random(random_state=5).as_matrix(), np.array([1.0, 2, 3]), 2.0, 101
    ).rotated(20, -10)
    places = np.random.default_rng(0).normal(size=(6, 3))
    assert_allclose(view.unproject(view.project(places)[:, :2]), places @ view.axes[:2].T)
    assert_allclose(view.project(view.centre[None])[0], [50, 50, 0])
    nearer = view.project(np.array([view.centre + view.axes[2]]))[0]
    assert_allclose(nearer, [50, 50, -101 / 4], atol=1e-9)


def test_turning_a_view_shows_the_side_that_it_says() -> None:
    view = OrthographicView(np.eye(3), np.zeros(3), 1.0, 11)
    assert view.rotated(30, 0).axes[2][0] < 0  # towards a viewer at the picture's left
    assert view.rotated(0, 30).axes[2][1] > 0  # and above


def test_turns_are_rotations_and_all_differ() -> None:
    turns = np.concatenate([np.eye(3)[None], _right_angle_rotations(), _uniform_rotations()])
    assert_allclose(turns @ turns.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turns.shape), atol=1e-12)
    assert_allclose(np.linalg.det(turns), 1)
    traces = np.einsum("aij,bij->ab", turns, turns) - 3 * np.eye(len(turns))
    assert traces.max() < 2.99  # 3 is the same turn
    assert len(_right_angle_rotations()) == 23


def test_every_turn_is_near_one_that_is_tried() -> None:
    turns = _uniform_rotations()
    others = Rotation.random(200, random_state=0).as_matrix()
    nearest = np.einsum("aij,bij->ab", others, turns).max(1)
    assert np.degrees(np.arccos((nearest - 1) / 2)).max() < 50


def test_the_nearest_point_of_a_surface_beats_points_sampled_on_it() -> None:
    rng = np.random.default_rng(0)
    solid = ViewedMesh(rng.normal(size=(30, 3)), rng.integers(0, 30, (40, 3)).astype(np.intp), None)
    weights = rng.dirichlet(np.ones(3), (len(solid.faces), 400))
    samples = np.einsum("msk,mki->msi", weights, solid.vertices[solid.faces]).reshape(-1, 3)
    places = rng.normal(size=(20, 3)) * 1.5
    answer = np.linalg.norm(solid.closest_points(places) - places, axis=1)
    sampled = np.linalg.norm(samples[None] - places[:, None], axis=2).min(1)
    assert (answer <= sampled + 1e-12).all()
    assert (sampled - answer).max() < 0.1


def bowl() -> ViewedMesh:
    """A half of a ball, seen from outside along its third axis."""
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41)))
    corner = np.arange(41 * 40).reshape(40, 41)[:, :-1].ravel()
    quads = np.stack([corner, corner + 1, corner + 42, corner + 41], axis=1)
    places = np.stack([u, v, np.sqrt(np.clip(2.2 - u**2 - v**2, 0, None))], axis=1)
    return ViewedMesh.of(Mesh(places, np.empty((0, 3), np.intp), quads))


@pytest.mark.parametrize("solid", [bowl(), bowl().without_normals()], ids=["by normals", "by depths"])
def test_a_picture_is_lit_from_the_upper_right(solid: ViewedMesh) -> None:
    picture, seen = solid.render(solid.whole_view(np.eye(3), 64))
    assert picture[16, 48, 0] > picture[32, 32, 0] > picture[48, 16, 0]
    assert seen.covered[32, 32]
    assert not seen.covered[0, 0]
    assert picture[0, 0].tolist() == [128, 128, 128]


def test_the_inside_is_black_where_normals_tell_it() -> None:
    behind = np.diag([-1.0, 1, -1])
    assert bowl().render(bowl().whole_view(behind, 64))[0][20:44, 20:44].max() == 25
    assert bowl().without_normals().render(bowl().whole_view(behind, 64))[0][20:44, 20:44].min() > 70
