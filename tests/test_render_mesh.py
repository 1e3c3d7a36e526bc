"""Rasterisation against plain integer arithmetic."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from guise.render.mesh import SUBPIXELS, Box, TexturedMesh, bounding_box, rasterise, snap, texture_gradients

WIDTH, HEIGHT = 13, 11


def covers(corners: list[tuple[int, int]], x: int, y: int) -> bool:
    """Whether a triangle (1/256 pixels) owns the pixel centre (x, y): inside, or on a left or top edge."""
    (ax, ay), (bx, by), (cx, cy) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0:
        return False
    if area < 0:
        return covers([corners[0], corners[2], corners[1]], x, y)
    for (px, py), (qx, qy) in zip(corners, corners[1:] + corners[:1], strict=True):
        side = (qx - px) * (y * SUBPIXELS - py) - (qy - py) * (x * SUBPIXELS - px)
        owned = qy < py or (qy == py and qx > px)
        if side < 0 or (side == 0 and not owned):
            return False
    return True


def draw(snapped: np.ndarray, triangles: np.ndarray, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    ids = np.full((height, width), 255, np.uint8)
    rasterise(snapped, triangles, ids)
    return ids


coordinate = st.one_of(
    st.integers(-6 * SUBPIXELS, 18 * SUBPIXELS), st.integers(-6, 18).map(lambda pixel: pixel * SUBPIXELS)
)
corner = st.tuples(coordinate, coordinate)


@settings(max_examples=150, deadline=None)
@given(st.lists(corner, min_size=3, max_size=7), st.randoms(use_true_random=False))
@pytest.mark.slow
def test_every_pixel_holds_the_last_triangle_that_covers_it(
    points: list[tuple[int, int]], random: object
) -> None:
    triangles = np.array([[random.randrange(len(points)) for _ in range(3)] for _ in range(6)], np.int32)
    expected = np.full((HEIGHT, WIDTH), 255, np.uint8)
    for number, triangle in enumerate(triangles):
        for y in range(HEIGHT):
            for x in range(WIDTH):
                if covers([points[i] for i in triangle], x, y):
                    expected[y, x] = number
    np.testing.assert_array_equal(draw(np.array(points, float), triangles), expected)


@pytest.mark.parametrize("snapped_to", [1, SUBPIXELS])
def test_neighbours_leave_no_hole_and_share_no_pixel(snapped_to: int) -> None:
    rng = np.random.default_rng(0)
    border = [[-1, -1], [40, -1], [-1, 40], [40, 40]]
    points = np.concatenate([border, rng.uniform(0, 39, (60, 2))]) * SUBPIXELS
    points = np.rint(points / snapped_to) * snapped_to  # whole pixels put many centres onto edges
    triangles = Delaunay(points).simplices.astype(np.int32)
    counts = np.zeros((40, 40), int)
    for triangle in triangles:
        counts += draw(points, triangle[None], 40, 40) == 0
    np.testing.assert_array_equal(counts, 1)


def test_gradients_take_each_corner_to_its_texture_pixel() -> None:
    rng = np.random.default_rng(1)
    uv = rng.uniform(0, 30, (12, 2)).astype(np.float32)
    mesh = TexturedMesh(Delaunay(uv).simplices, uv, 31, 31)
    vertices = rng.uniform(-20, 90, (12, 2))
    snapped = snap(vertices, 12)
    a, b, c, d, e, f = texture_gradients(snapped, mesh.triangles, mesh.grid)
    for corner_number in range(3):
        vertex = mesh.triangles[:, corner_number]
        x, y = snapped[vertex].T / SUBPIXELS
        np.testing.assert_allclose(a * x + b * y + c, uv[vertex, 0], atol=1e-6)
        np.testing.assert_allclose(d * x + e * y + f, uv[vertex, 1], atol=1e-6)


def test_gradients_of_a_triangle_without_area_are_zero() -> None:
    uv = np.array([[0, 0], [4, 0], [0, 4]], np.float32)
    mesh = TexturedMesh(np.array([[0, 1, 2]]), uv, 9, 9)
    assert not texture_gradients(snap(np.ones((3, 2)), 3), mesh.triangles, mesh.grid).any()


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([[1.0, 2.0], [5.5, 2.5], [3.0, 6.0]], Box(1, 2, 6, 7)),
        ([[1.2, 2.0], [5.9, 2.5], [3.0, 6.1]], Box(2, 2, 6, 7)),
        ([[-9.0, -9.0], [90.0, 2.0], [3.0, 90.0]], Box(0, 0, WIDTH, HEIGHT)),
    ],
)
def test_box_holds_the_pixel_centres_between_the_outermost_vertices(
    points: list[list[float]], expected: Box
) -> None:
    assert bounding_box(snap(np.array(points), 3), WIDTH, HEIGHT) == expected


def test_box_beside_the_picture_is_empty() -> None:
    assert bounding_box(snap(np.full((3, 2), -7.5), 3), WIDTH, HEIGHT).empty
    assert bounding_box(snap(np.full((3, 2), 70.5), 3), WIDTH, HEIGHT).empty


def test_mesh_keeps_read_only_copies() -> None:
    uv = np.array([[0, 0], [4, 0], [0, 4]], np.float32)
    mesh = TexturedMesh(np.array([[0, 1, 2]]), uv, 9, 9)
    uv[:] = 3
    assert mesh.uv[1, 0] == 4
    with pytest.raises(ValueError, match="read-only"):
        mesh.uv[0] = 1
