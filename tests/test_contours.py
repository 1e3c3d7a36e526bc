"""Guides along cheeks, jaw and neck, on made-up heads."""

import numpy as np
from numpy.testing import assert_allclose

from guise.analogy.contours import find_contours, outline
from guise.analogy.deform import CurveConstraints
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.geometry import Surface
from guise.analogy.mesh import Mesh
from guise.analogy.registration import register
from guise.common.arrays import F64, Int

SIZE = np.array([0.78, 1.1, 0.95])
PLACES = {
    "mouth_corner_right": (-0.22, -0.38), "mouth_corner_left": (0.22, -0.38), "upper_lip_top": (0, -0.3),
    "lower_lip_bottom": (0, -0.46), "upper_lip_inner": (0, -0.37), "lower_lip_inner": (0, -0.39),
    "nose_tip": (0, -0.05), "nose_bridge": (0, 0.25), "nose_base": (0, -0.18), "nose_wing_right": (-0.13, -0.12),
    "nose_wing_left": (0.13, -0.12), "eye_right_outer": (-0.4, 0.25), "eye_right_inner": (-0.16, 0.25),
    "eye_left_inner": (0.16, 0.25), "eye_left_outer": (0.4, 0.25), "chin": (0, -0.8),
    "brow_right_outer": (-0.38, 0.4), "brow_right_inner": (-0.13, 0.4), "brow_left_inner": (0.13, 0.4),
    "brow_left_outer": (0.38, 0.4),
}  # fmt: skip
STRETCH = np.array([1.0, 1.25, 1.0])


def bumps(ways: F64) -> F64:
    """The radius (n,) of a head in directions (n, 3): a nose, two ears, and eyes as hollows."""
    radius = np.ones(len(ways))
    for at, height, wide in (
        ((0, -0.05, 1), 0.25, 0.01), ((1, 0.02, 0.05), 0.2, 0.012), ((-1, 0.02, 0.05), 0.2, 0.012),
        ((0.3, 0.25, 0.95), -0.08, 0.01), ((-0.3, 0.25, 0.95), -0.08, 0.01), ((0, -0.38, 0.9), -0.04, 0.01),
    ):  # fmt: skip
        way = np.array(at) / np.linalg.norm(at)
        radius += height * np.exp(-((ways - way) ** 2).sum(1) / wide / 2)
    return radius


def sphere(rows: int) -> tuple[F64, Int]:
    """Directions (n, 3) and triangles, with poles above and below."""
    up, around = (
        np.linspace(0, np.pi, rows)[1:-1],
        np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False),
    )
    tilt, turn = (x.ravel() for x in np.meshgrid(up, around, indexing="ij"))
    ways = np.stack([np.sin(tilt) * np.sin(turn), np.cos(tilt), np.sin(tilt) * np.cos(turn)], axis=1)
    ways = np.concatenate([ways, [(0, 1, 0), (0, -1, 0)]])
    ids = np.arange(len(up) * len(around)).reshape(len(up), len(around))
    a, b = ids, np.roll(ids, -1, axis=1)
    quads = np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=-1).reshape(-1, 4)
    top, low = len(ways) - 2, len(ways) - 1
    caps = [(top, i, j) for i, j in zip(a[0], b[0], strict=True)]
    caps += [(low, j, i) for i, j in zip(a[-1], b[-1], strict=True)]
    return ways, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]], np.array(caps)])


def head(rows: int, stretch: F64) -> tuple[Mesh, F64]:
    """A head and its feature points."""
    ways, faces = sphere(rows)
    flat = np.array([PLACES[name] for name in FEATURE_POINT_NAMES]) / SIZE[:2]
    seen = np.column_stack([flat, np.sqrt(1 - (flat**2).sum(1))])
    vertices, points = (stretch * SIZE * at * bumps(at)[:, None] for at in (ways, seen))
    return Mesh.of_triangles(vertices, faces), points


def test_an_outline_is_the_outermost_cut() -> None:
    ways, faces = sphere(40)
    both = np.concatenate([ways, 0.5 * ways + (0.1, 0, 0)])
    everything = np.concatenate([faces, faces + len(ways)])
    angles = np.linspace(0.01, 3, 30)
    axes = np.array([(0.0, 0, 1), (0.6, 0.8, 0)])
    corners, weights, places = outline(both, everything, np.zeros(3), axes, angles)
    assert corners.max() < len(ways)
    assert_allclose(np.einsum("kc,kci->ki", weights, both[corners]), places)
    wanted = np.cos(angles)[:, None] * axes[0] + np.sin(angles)[:, None] * axes[1]
    assert_allclose(places, wanted, atol=0.01)


def test_an_outline_leaves_out_what_an_open_surface_lacks() -> None:
    ways, faces = sphere(40)
    front = faces[(ways[faces][:, :, 2] > 0).all(1)]
    axes = np.array([(1.0, 0, 0), (0, 0, 1)])
    places = outline(ways, front, np.zeros(3), axes, np.linspace(-1.5, 1.5, 31))[2]
    assert len(places) == 15
    assert places[:, 2].min() > 0


def test_guides_run_along_planes_through_the_ears_of_both_heads() -> None:
    (source, own), (target, points) = head(50, np.ones(3)), head(60, STRETCH)
    guides = find_contours(
        (source.vertices, source.faces, own), Surface(target.vertices, target.faces, 0.0), points,
        STRETCH * source.vertices,
    )  # fmt: skip
    assert guides is not None
    at = np.einsum("kc,kci->ki", guides.weights, source.vertices[guides.corners])
    away = np.linalg.norm(guides.at(STRETCH * at).positions - STRETCH * at, axis=1)
    jaw = np.isin(
        guides.number, (2, 3)
    )  # both sides; a stretch takes planes through the same places to each other
    assert away[jaw].max() < 0.05
    assert np.linalg.norm(at[jaw] - own[FEATURE_POINT_NAMES.index("chin")], axis=1).min() < 0.03


def test_a_head_without_ears_has_no_guides() -> None:
    mesh, points = head(40, np.ones(3))
    faces = mesh.faces[(mesh.vertices[mesh.faces][:, :, 2] > 0.5).all(1)]
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = mesh.vertices[used], faces.reshape(-1, 3)
    assert find_contours((vertices, faces, points), Surface(vertices, faces, 0.0), points, vertices) is None


def test_points_slide_along_their_curve() -> None:
    line = np.column_stack([np.linspace(0, 1, 101), np.zeros((101, 2))])
    one = CurveConstraints(
        np.zeros((2, 3), np.intp), np.zeros((2, 3)), np.ones(2), np.zeros(2, np.intp), (line,)
    )
    held = one.at(np.array([(0.2, 0.5, 0), (0.7, -0.1, 0.3)]))
    assert_allclose(held.positions, [(0.2, 0, 0), (0.7, 0, 0)], atol=0.006)


def with_another_jaw(places: F64) -> F64:
    """Places (n, 3) of a head, turned about its ears: at most below the chin, and not above them."""
    ears = np.array([0, -0.05, 0.05])
    side, up, forward = (places - ears).T
    radius, down = np.hypot(up, forward), np.arctan2(-up, forward)
    share = np.clip(down / 1.2, 0, 1) * np.clip((2.9 - down) / 0.9, 0, 1)
    down = down + 0.3 * share**2 * (3 - 2 * share)
    return ears + np.column_stack([side, -radius * np.sin(down), radius * np.cos(down)])


def test_another_jaw_slides_less_with_guides() -> None:
    (source, own), (plain, points) = head(50, np.ones(3)), head(60, np.ones(3))
    target, points = plain.with_vertices(with_another_jaw(plain.vertices)), with_another_jaw(points)
    jaw = (source.vertices[:, 1] < -0.25) & (source.vertices[:, 2] > -0.1)
    free, guided = (
        np.linalg.norm(
            register(source, target, (own, points), contours=contours).fitted
            - with_another_jaw(source.vertices),
            axis=1,
        )[jaw].mean()
        for contours in (None, (own, points))
    )
    assert guided < 0.6 * free
