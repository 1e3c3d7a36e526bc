"""The surface between the 81 points: nothing changes from the front, and a turned cheek reaches the silhouette."""

import cv2
import numpy as np
import pytest

from guise.aam.landmarks.schemes import JAW, LEFT_MOUTH_CORNER, MIRROR, NOSE_TIP, RIGHT_MOUTH_CORNER
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.relief import STRAIGHT, Relief
from guise.aam.solid_shape import HeadPose, Sight, SolidPrior
from guise.render import make_compositor

FRAME = ReferenceFrame.canonical(96)
RELIEF = Relief.shipped(FRAME)
FACE = SolidPrior.shipped().mean


def head(yaw: float) -> HeadPose:
    y = np.radians(yaw)
    rotation = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    return HeadPose(rotation, 120.0, np.array([100.0, 110.0]))


def test_the_triangles_fill_the_same_face() -> None:
    corners = RELIEF.points[RELIEF.triangles]
    (ux, uy), (vx, vy) = ((corners[:, k] - corners[:, 0]).T for k in (1, 2))
    whole = FRAME.points[FRAME.triangles]
    (px, py), (qx, qy) = ((whole[:, k] - whole[:, 0]).T for k in (1, 2))
    assert np.abs(ux * vy - uy * vx).sum() == pytest.approx(np.abs(px * qy - py * qx).sum(), rel=1e-4)
    assert set(RELIEF.triangles.ravel()) == set(range(len(RELIEF.points)))


def test_from_the_front_the_picture_is_that_of_the_flat_triangles() -> None:
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 256, (*FRAME.size, 3)).astype(np.uint8)
    mesh = FRAME.points + 10 + rng.normal(0, 1.5, FRAME.points.shape)  # an expression
    whole, pictures = np.ones(FRAME.size, np.float32), []
    for relief in (RELIEF, Relief.flat(FRAME)):
        with make_compositor("cpu", relief.triangles, relief.points.astype(np.float32), whole) as compositor:
            pictures.append(compositor.warp((150, 140), texture, relief.seen(mesh, STRAIGHT)).astype(int))
    assert (np.abs(pictures[0] - pictures[1]).max(2) > 12).mean() < 0.01


def test_what_is_seen_is_the_solid_relief_in_the_pose() -> None:
    pose = head(40)
    seen = RELIEF.seen(pose.apply(FACE), pose.linear[2])
    true = pose.apply(RELIEF.solid(FACE))
    exact = np.abs(seen - true).max(1) < 1e-3
    assert exact.mean() > 0.85
    hull = cv2.convexHull(pose.apply(FACE).astype(np.float32))
    beyond = [-cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in seen]
    assert max(beyond) < 0.02 * pose.scale
    assert (
        np.array([-cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in true[~exact]]) > 0
    ).all()


def test_cheeks_bulge_and_the_relief_is_symmetric() -> None:
    corners = FRAME.points[[RIGHT_MOUTH_CORNER, LEFT_MOUTH_CORNER]]
    cheeks = (FRAME.points[[JAW[3], JAW[-4]]] + corners) / 2
    assert (RELIEF.at(cheeks) < -0.1).all()
    added = RELIEF.points[len(FRAME.points) :]
    across = MeshSampler.build(FRAME, added).positions(FRAME.points[list(MIRROR)])
    np.testing.assert_allclose(
        RELIEF.at(across.astype(np.float64)), RELIEF.depth[len(FRAME.points) :], atol=0.03
    )


def test_the_far_cheek_of_a_turned_head_lies_beyond_the_jaw_line() -> None:
    """Flat triangles end at the jaw's points, far inside the head."""
    pose = head(45)
    flat = pose.apply(FACE)
    seen = RELIEF.seen(flat, pose.linear[2])[len(flat) :]
    beside = seen[(seen[:, 1] > flat[NOSE_TIP, 1]) & (seen[:, 1] < flat[LEFT_MOUTH_CORNER, 1])]
    assert beside[:, 0].max() > flat[JAW[-5:], 0].max() + 0.05 * pose.scale


def test_a_pose_like_the_one_enrolled_moves_nothing() -> None:
    pose, given = head(30), (RELIEF.normals(FACE), RELIEF.frontal_cosines)
    assert np.abs(Sight.of(*given, pose, pose.linear[2]).across).max() < 1e-9
    assert np.abs(Sight.of(*given, pose).across).max() > 20
    assert np.abs(Sight.of(*given, head(5)).across).max() == 0
