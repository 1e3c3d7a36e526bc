"""Pictures of heads: what stands where, what colours mean, and that a turning head is a video."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_render_visibility import sphere

from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.mesh import Mesh
from guise.app.media import MediaError, open_input
from guise.app.meshes import pictures
from guise.app.meshes.pictures import STYLE, DrawnHead, HeadView

SIZE = (130, 160)
NO_QUADS = np.empty((0, 4), np.intp)
SIDES = {
    "mouth_corner_left": (0.8, -1),
    "eye_left": (1, 1),
    "brow_left": (1, 1.5),
    "nose_wing_left": (0.4, 0),
}
HEIGHTS = {"upper_lip": -0.9, "lower_lip": -1.1, "chin": -1.8, "nose": 0.1}


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "STYLE", replace(STYLE, head_px=SIZE))


def head() -> Mesh:
    """A ball that looks along z."""
    points, triangles = sphere(24, 48, 3.0)
    return Mesh(points, triangles, NO_QUADS)


def face_points() -> np.ndarray:
    """Twenty feature points in the ball's front, left of the person to the viewer's right."""
    out = []
    for name in FEATURE_POINT_NAMES:
        left = name.replace("right", "left")
        x, y = next((v for k, v in SIDES.items() if left.startswith(k)), (0, None))
        y = next(v for k, v in HEIGHTS.items() if name.startswith(k)) if y is None else y
        out.append((-x if "right" in name else x, y, 2.5))
    return np.array(out, float)


def test_a_strip_has_a_column_for_each_head_and_a_row_for_each_side() -> None:
    mesh = head()
    view = HeadView.of(mesh.vertices)
    heads = [DrawnHead(mesh.vertices, mesh.faces, name, view) for name in ("a", "b", "c")]
    picture = pictures.draw_strip(heads, STYLE.yaws_deg)
    assert picture.shape == (STYLE.title_px + 2 * SIZE[1], 3 * SIZE[0], 3)
    left, right = picture[:, : SIZE[0]], picture[:, SIZE[0] : 2 * SIZE[0]]
    np.testing.assert_array_equal(left[STYLE.title_px :], right[STYLE.title_px :])
    assert (left[: STYLE.title_px] != right[: STYLE.title_px]).any()


def test_a_transfer_shows_source_and_target_before_and_after() -> None:
    mesh = head()
    smile = mesh.vertices * (1.1, 1, 1)
    picture = pictures.draw_transfer(mesh, smile, mesh, smile)[STYLE.title_px :]
    one, other = picture[:, : 2 * SIZE[0]], picture[:, 2 * SIZE[0] :]
    np.testing.assert_array_equal(one, other)
    assert (one[:, : SIZE[0]] != one[:, SIZE[0] :]).any()


def test_what_moves_far_is_dark_and_what_stays_is_light() -> None:
    mesh = head()
    after = mesh.vertices + np.where(mesh.vertices[:, :1] > 0, (0, 0.5, 0), 0)
    picture = pictures.draw_distances(mesh, after, unit="cm")
    assert picture.shape == (STYLE.title_px + len(STYLE.yaws_deg) * SIZE[1] + STYLE.scale_px, 3 * SIZE[0], 3)
    row = picture[STYLE.title_px + SIZE[1] // 2, 2 * SIZE[0] :].mean(1)
    middle = SIZE[0] // 2
    assert row[middle - 25] > row[middle + 25] + 60


def test_identical_heads_are_no_division_by_zero() -> None:
    mesh = head()
    assert pictures.draw_distances(mesh, mesh.vertices).max() > 0


def test_colours_darken_steadily() -> None:
    grey = pictures._heat_colours(np.linspace(0, 1, 101)) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(grey) < 0).all()


@pytest.mark.parametrize("value", [0.9e-4, 0.02, 0.031, 1.0, 7.3, 1200.0])
def test_scales_end_at_round_numbers_a_little_above(value: float) -> None:
    end = pictures.round_up(value)
    assert value <= end * (1 + 1e-9)
    assert end <= 2.5 * value
    assert f"{end:.1e}"[:3] in {"1.0", "2.0", "2.5", "5.0"}


def test_a_chessboard_carried_to_itself_is_the_same_and_what_is_not_found_is_grey() -> None:
    mesh = head()
    same = Correspondence.identity(len(mesh.vertices))
    picture = pictures.draw_chessboard(mesh, mesh, same)[STYLE.title_px :]
    source, target = picture[:, : SIZE[0]].astype(int), picture[:, SIZE[0] :].astype(int)
    np.testing.assert_array_equal(source, target)
    assert np.abs(np.diff(source[SIZE[1] // 2].mean(1))).max() > 60  # squares
    lost = Correspondence(same.corners, same.weights, np.zeros(len(mesh.vertices), bool))
    grey = pictures.draw_chessboard(mesh, mesh, lost)[STYLE.title_px :, SIZE[0] :].astype(int)
    middle = grey[SIZE[1] // 2 - 20 : SIZE[1] // 2, SIZE[0] // 2 - 20 : SIZE[0] // 2]
    assert np.ptp(middle, axis=2).max() < 40  # no colour


def test_feature_points_put_a_head_upright() -> None:
    mesh, points = head(), face_points()
    z_up = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    upright = HeadView.of(mesh.vertices, points)
    laid = HeadView.of(mesh.vertices @ z_up.T, points @ z_up.T)
    np.testing.assert_allclose(upright.turned, np.eye(3))
    np.testing.assert_allclose(laid.turned @ z_up, np.eye(3), atol=1e-9)


def test_feature_points_are_marked_where_they_are() -> None:
    mesh, points = head(), face_points()
    picture = pictures.draw_feature_points(mesh, points)
    assert picture.shape == (SIZE[1], 3 * SIZE[0], 3)
    middle = picture[:, SIZE[0] : 2 * SIZE[0]].astype(int)
    red = (middle[..., 0] > 200) & (middle[..., 1] < 120)
    camera = HeadView.of(mesh.vertices, points).camera
    x, y = np.rint(camera.project(points, SIZE)[:, :2]).astype(int).T
    assert red[y, x].all()
    assert red.sum() < 20 * 60


def test_points_behind_the_head_are_not_marked() -> None:
    mesh = head()
    plain = pictures.draw_strip([DrawnHead(mesh.vertices, mesh.faces, "", HeadView.of(mesh.vertices))])
    marked = DrawnHead(
        mesh.vertices, mesh.faces, "", HeadView.of(mesh.vertices), dots=np.array([[0, 0, -3.0]])
    )
    np.testing.assert_array_equal(pictures.draw_strip([marked]), plain)


def test_a_turning_head_is_a_video(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "STYLE", replace(pictures.STYLE, turn_frames=4))
    mesh = head()
    nose = np.where(mesh.vertices[:, 2:] > 2.5, (1.0, 0.1, 0.1), 0.7)
    one = DrawnHead(mesh.vertices, mesh.faces, "head", HeadView.of(mesh.vertices), nose)
    shares: list[float] = []
    pictures.write_turntable(tmp_path / "turn.mp4", [one, one], progress=shares.append)
    with open_input(tmp_path / "turn.mp4") as source:
        frames = [frame.rgb().astype(int) for frame in source]
        assert (source.width, source.height) == (2 * SIZE[0], SIZE[1] + STYLE.title_px)
    assert shares == [0.25, 0.5, 0.75, 1.0]
    red = [(f[..., 0] > f[..., 1] + 60).sum() for f in frames]
    assert red[0] > 100
    assert red[2] == 0  # its back
    assert 0 < red[1] < red[0]
    with pytest.raises(MediaError, match="exists"):
        pictures.write_turntable(tmp_path / "turn.mp4", [one])
