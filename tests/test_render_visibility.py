"""What each pixel of a mesh shows: the NumPy twin against plain arithmetic, and GL against the twin."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guise.render.errors import RendererError
from guise.render.visibility import GLVisibility, Visibility, visible

BOTH = [pytest.param("gl", marks=pytest.mark.egl), "cpu"]
SLOPE = np.array([[0, 0, 0], [8, 0, 0], [0, 8, 8]])  # deeper downwards
WALL = np.array([[0, 0, 4], [8, 0, 4], [0, 8, 4]])


def both(points: np.ndarray, triangles: np.ndarray, size: tuple[int, int]) -> tuple[Visibility, Visibility]:
    return visible(points, triangles, size, "gl"), visible(points, triangles, size, "cpu")


def sphere(rows: int, columns: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A sphere around (0, 0, 0), open at the poles: vertices and triangles."""
    v, u = np.mgrid[0.02 : np.pi - 0.02 : rows * 1j, 0 : 2 * np.pi : columns * 1j]
    points = np.stack([np.sin(v) * np.cos(u), np.cos(v), np.sin(v) * np.sin(u)], -1).reshape(-1, 3)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + columns], 1), np.stack([a + 1, a + columns + 1, a + columns], 1)]
    )
    return points * radius, faces


@pytest.mark.parametrize("renderer", BOTH)
def test_the_nearer_of_two_triangles_is_seen(renderer: str) -> None:
    seen = visible(np.concatenate([SLOPE, WALL]), [[3, 4, 5], [0, 1, 2]], (8, 8), renderer)
    y, x = np.mgrid[:8, :8]
    inside = x + y < 8
    np.testing.assert_array_equal(seen.covered, inside)
    apart = inside & (y != 4)  # there both are equally deep
    np.testing.assert_array_equal(seen.triangle[apart], (y < 4)[apart])


def test_of_equally_near_triangles_the_first_is_seen() -> None:
    for order in ([0, 1, 2], [1, 2, 0]):
        seen = visible(WALL, [order, [2, 0, 1]], (8, 8), "cpu")
        assert set(np.unique(seen.triangle)) == {-1, 0}


@pytest.mark.parametrize("renderer", BOTH)
def test_weights_place_each_pixels_centre_in_its_triangle(renderer: str) -> None:
    points, triangles = sphere(20, 40, 25.3)
    points += (29.2, 31.9, 0)
    seen = visible(points, triangles, (64, 61), renderer)
    assert 0.4 < seen.covered.mean() < 0.7
    y, x = np.nonzero(seen.covered)
    place = seen.interpolated(points[:, :2], triangles)
    np.testing.assert_allclose(place, np.stack([x, y], 1), atol=0.01)  # vertices are snapped to 1/256 pixel
    assert seen.weights.min() > -1e-6
    np.testing.assert_allclose(seen.weights.sum(2), seen.covered, atol=1e-6)


@pytest.mark.parametrize("renderer", BOTH)
def test_the_front_of_a_sphere_hides_its_back(renderer: str) -> None:
    points, triangles = sphere(30, 60, 24)
    seen = visible(points + np.array([30, 30, 0]), triangles, (60, 60), renderer)
    assert seen.interpolated(points[:, 2:], triangles).max() < 1.5


@pytest.mark.egl
@pytest.mark.parametrize("size", [(64, 61), (33, 90)])
def test_gl_and_its_twin_see_the_same(size: tuple[int, int]) -> None:
    points, triangles = sphere(30, 60, 47)
    points = points * (1, 0.8, 1) + (40, 30, 1e4)  # beyond the picture's edges, far away
    gl, cpu = both(points, triangles, size)
    assert (gl.covered == cpu.covered).all()
    same = gl.triangle == cpu.triangle
    assert same.mean() > 0.995  # they may differ where two triangles are as good as equally deep
    np.testing.assert_array_equal(gl.weights[same], cpu.weights[same])


@pytest.mark.egl
def test_pictures_of_changing_size_from_one_context() -> None:
    with GLVisibility() as drawer:
        for side in (8, 3, 8):
            seen = drawer.draw(WALL[:, :2] * 256.0, WALL[:, 2] * 1.0, np.array([[0, 1, 2]]), (side, side))
            y, x = np.mgrid[:side, :side]
            np.testing.assert_array_equal(seen, np.where(x + y < 8, 0, -1))


coordinate = st.floats(-10, 20)


@pytest.mark.egl
@given(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=3, max_size=8))
def test_any_triangles_cover_the_same_pixels_in_gl(points: list[tuple[float, float, float]]) -> None:
    count = len(points)
    triangles = np.array([[k, (k + 1) % count, (k + 2) % count] for k in range(count)])
    gl, cpu = both(np.array(points), triangles, (12, 9))
    np.testing.assert_array_equal(gl.covered, cpu.covered)


def test_no_triangles_show_nothing() -> None:
    for triangles in (np.zeros((0, 3), int), np.array([[0, 0, 1]])):
        for renderer in ("auto", "cpu"):
            assert not visible(WALL, triangles, (4, 4), renderer).covered.any()


def test_triangles_outside_the_picture_show_nothing() -> None:
    assert not visible(WALL + np.array([100, 0, 0]), [[0, 1, 2]], (8, 8), "cpu").covered.any()


@pytest.mark.parametrize(
    ("points", "triangles", "size", "renderer", "says"),
    [
        (WALL[:, :2], [[0, 1, 2]], (8, 8), "cpu", r"points must be \(N, 3\), got \(3, 2\)"),
        (WALL, [[0, 1, 3]], (8, 8), "cpu", "integers from 0 to 2"),
        (WALL, [[0.0, 1.0, 2.0]], (8, 8), "cpu", "integers from 0 to 2"),
        (WALL, [[0, -1, 2]], (8, 8), "cpu", "integers from 0 to 2"),
        (WALL, [[0, 1]], (8, 8), "cpu", r"triangles must be \(t, 3\)"),
        (WALL, [[0, 1, 2]], (0, 8), "cpu", "size must be from 1"),
        (WALL * (1, np.nan, 1), [[0, 1, 2]], (8, 8), "cpu", "vertices must be finite"),
        (WALL * (1, 1, np.inf), [[0, 1, 2]], (8, 8), "cpu", "depths must be finite"),
        (WALL, [[0, 1, 2]], (8, 8), "vulkan", "one of auto, gl, cpu"),
    ],
)
def test_mistakes_are_one_sentence(
    points: np.ndarray, triangles: list[list[float]], size: tuple[int, int], renderer: str, says: str
) -> None:
    with pytest.raises(RendererError, match=says):
        visible(points, triangles, size, renderer)
