"""Pictures of meshes: what is where, how it is lit, and in which colours."""

import numpy as np
import pytest
from test_render_visibility import sphere

from guise.render.errors import RendererError
from guise.render.shaded import Camera, exposure, shaded, vertex_normals

SIZE = (81, 101)
RED, BLUE = (0.9, 0.05, 0.05), (0.05, 0.05, 0.9)


def ball() -> tuple[np.ndarray, np.ndarray]:
    """Seen from outside: normals point outwards."""
    return sphere(40, 80, 3.0)


def test_normals_of_a_ball_point_away_from_its_middle() -> None:
    points, triangles = ball()
    around = (vertex_normals(points, triangles) * points).sum(1) / 3
    assert around.min() > 0.98


def test_the_head_stands_in_the_middle_and_leaves_a_margin() -> None:
    points, triangles = ball()
    picture = shaded(points + np.array([50, -7, 3]), triangles, SIZE)
    assert picture.shape == (101, 81, 3)
    backdrop = shaded(points * 1e-6 + np.array([1, 1, 0]), triangles, SIZE, camera=Camera.around(points))
    rows, columns = np.nonzero((picture != backdrop).any(2))
    assert abs(rows.mean() - 50) < 0.5
    assert abs(columns.mean() - 40) < 0.5
    assert 0.85 * 81 < np.ptp(columns) < 0.95 * 81


def test_the_key_light_comes_from_the_upper_left() -> None:
    picture = shaded(*ball(), SIZE).mean(2)
    assert picture[35, 25] > picture[65, 55] + 40


def test_yaw_turns_the_head_to_the_viewers_right_and_pitch_up() -> None:
    points, triangles = ball()
    nose = np.where(points[:, 2:] > 2.8, RED, BLUE)
    for turn, place in (({}, (50, 40)), ({"yaw": 40}, (50, 63)), ({"pitch": 40}, (27, 40))):
        picture = shaded(points, triangles, SIZE, colours=nose, **turn).astype(int)
        rows, columns = np.nonzero(picture[..., 0] > picture[..., 2] + 40)
        np.testing.assert_allclose((rows.mean(), columns.mean()), place, atol=3)


def test_a_hollow_is_darker_than_what_stands_out() -> None:
    y, x = np.mgrid[-1:1:101j, -1:1:101j]
    a = (np.arange(100)[:, None] * 101 + np.arange(100)).ravel()
    faces = np.concatenate([np.stack([a, a + 101, a + 1], 1), np.stack([a + 1, a + 101, a + 102], 1)])
    faces = faces[:, ::-1]
    bump = 0.3 * np.exp(-(x**2 + y**2) / 0.02)
    middles = []
    for sign in (-1, 1):
        points = np.stack([x, y, sign * bump], -1).reshape(-1, 3)
        middles.append(shaded(points, faces, (101, 101))[49:52, 49:52].mean())
    assert middles[0] < middles[1] - 10


def test_the_inner_side_of_a_surface_is_dark() -> None:
    points, triangles = ball()
    front = points[triangles].mean(1)[:, 2] > 0
    outside = shaded(points, triangles[front], SIZE)[50, 40].mean()
    camera = Camera.around(points, yaw=180)
    assert shaded(points, triangles[front], SIZE, camera=camera)[50, 40].mean() < 0.7 * outside


def test_a_closed_in_surface_is_not_exposed_and_light_can_be_kept_from_it() -> None:
    points, triangles = ball()
    count = len(points)
    both = np.concatenate([points, points / 2])
    light = exposure(both, np.concatenate([triangles, triangles + count]))
    assert light[:count].min() > 0.6
    assert light[:count].mean() > 0.95
    assert light[count:].max() < 0.2
    inner = shaded(points, triangles, SIZE, light=light[count:])
    assert inner[50, 40].mean() < 0.6 * shaded(points, triangles, SIZE, light=light[:count])[50, 40].mean()


def test_faces_that_are_all_turned_inwards_are_drawn_as_if_they_were_not() -> None:
    points, triangles = ball()
    turned = triangles[:, ::-1]
    np.testing.assert_allclose(exposure(points, turned), exposure(points, triangles))
    apart = np.abs(shaded(points, turned, SIZE).astype(int) - shaded(points, triangles, SIZE))
    assert (apart > 2).mean() < 0.02  # the outline


def test_paint_is_sharp_where_colours_of_vertices_blur() -> None:
    points, triangles = sphere(5, 9, 3.0)
    step = shaded(points, triangles, SIZE, colours=points, paint=lambda p: np.where(p[:, :1] > 0, RED, BLUE))
    row = step[50].astype(int)
    red = row[:, 0] > row[:, 2]
    assert not red[10:39].any()
    assert red[42:71].all()


def test_one_camera_keeps_pictures_together() -> None:
    points, triangles = ball()
    camera = Camera.around(points)
    small = shaded(points / 2, triangles, SIZE, camera=camera)
    large = shaded(points, triangles, SIZE, camera=camera)
    assert (shaded(points / 2, triangles, SIZE) != small).any()
    widths = [np.ptp(np.flatnonzero(np.abs(np.diff(p[50].mean(1))) > 8)) for p in (small, large)]
    assert abs(widths[0] / widths[1] - 0.5) < 0.05


@pytest.mark.parametrize(
    ("vertices", "colours", "says"),
    [
        (np.zeros((3, 2)), None, r"vertices must be \(N, 3\)"),
        (np.full((3, 3), np.nan), None, "finite"),
        (np.eye(3), np.zeros((2, 3)), r"colours must be \(3, d\)"),
        (np.eye(3), np.full((3, 3), np.nan), "finite"),
    ],
)
def test_mistakes_are_one_sentence(vertices: np.ndarray, colours: np.ndarray | None, says: str) -> None:
    with pytest.raises(RendererError, match=says):
        shaded(vertices, [[0, 1, 2]], SIZE, colours=colours)
