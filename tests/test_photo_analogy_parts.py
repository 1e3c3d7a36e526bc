"""The parts of an expression analogy between photographs: motion, template, heights, light, mouth."""

import cv2
import numpy as np
import scipy.sparse as sp
from drawn_faces import NEUTRAL, OTHER, S1, SIZE, S, smiling
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse.linalg import spsolve

from guise.aam.landmarks.schemes import (
    LOWER_INNER_LIP,
    UPPER_LIP_INNER,
)
from guise.aam.reference import ReferenceFrame
from guise.analogy.photo.flow import residual_flow
from guise.analogy.photo.grid import face_mask
from guise.analogy.photo.height_field import (
    K_PIXELS,
    _height_gain,
    edge_differences,
    log_luminance,
    target_edge_changes,
)
from guise.analogy.photo.landmark_motion import LandmarkMotion
from guise.analogy.photo.luminance_change import (
    CHANGE,
    change_gain,
    limit_change,
    registered_share,
    relight,
    similarity_fields,
    subtract_light_plane,
)
from guise.analogy.photo.mouth import limit_teeth, mouth_fill_share
from guise.analogy.photo.pictures import LUMINANCE
from guise.analogy.photo.poisson import integrate_edges
from guise.analogy.photo.ratio import correlation, smoothed_ratio
from guise.analogy.photo.template import anchor_ring, face_template
from guise.analogy.tents import Rings, VertexTents
from guise.common.arrays import F32, F64, Bool


def test_the_template_follows_affine_motions_and_holds_its_landmarks() -> None:
    mesh, around = face_template(), anchor_ring(NEUTRAL)
    held = np.concatenate([NEUTRAL, around])
    matrix, shift = np.array([[1.2, 0.3], [-0.1, 0.9]]), np.array([4.0, -2.0])
    vertices = mesh.vertices(NEUTRAL, around)
    assert_allclose(vertices[: len(held)], held, atol=1e-8)
    moved = mesh.vertices(NEUTRAL @ matrix.T + shift, around @ matrix.T + shift)
    assert_allclose(moved, vertices @ matrix.T + shift, atol=1e-8)


def test_lips_move_apart_in_the_template() -> None:
    points = ReferenceFrame.canonical(96).points
    mesh, around = face_template(), anchor_ring(points)
    moved = points.copy()
    moved[LOWER_INNER_LIP] += (0, 10)
    way = (mesh.vertices(moved, around) - mesh.vertices(points, around))[:, 1]
    lips = set(mesh.triangles[mesh.parts == 0].ravel())
    near = np.linalg.norm(mesh.vertices(points, around) - points[UPPER_LIP_INNER], axis=1) < 3
    upper = [k for k in lips if near[k]]
    assert len(upper) >= 1
    assert np.abs(way[upper]).max() < 1.5


def test_heights_agree_with_tents_of_any_mesh() -> None:
    rng = np.random.default_rng(0)
    before, after = (
        cv2.GaussianBlur(rng.normal(0, 1, (16, 18)).astype(np.float32), (0, 0), 2) * 10 for _ in range(2)
    )
    at = np.arange(16 * 18).reshape(16, 18)
    corners = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    rings = Rings.of(16 * 18, (), np.stack([c.ravel() for c in corners], axis=1))
    y, x = np.mgrid[:16, :18]
    one, two = (np.column_stack([x.ravel(), y.ravel(), z.ravel()]).astype(float) for z in (before, after))
    share = VertexTents(one, rings).transformations(two)[:, 2, 2].reshape(16, 18)
    inner = np.s_[1:-1, 1:-1]
    assert_allclose(_height_gain(before, after)[inner], share[inner], atol=0.03)
    assert np.abs(share[inner] - 1).max() > 0.5


def test_a_source_is_its_own_answer_and_a_smooth_light_asks_nothing_more() -> None:
    before, after = (
        log_luminance(S @ np.float32([1, 1, 1]) / 765),
        log_luminance(S1 @ np.float32([1, 1, 1]) / 765),
    )
    for made, wanted in zip(
        target_edge_changes(before, after, before), edge_differences(after - before), strict=True
    ):
        assert_allclose(made, wanted, atol=1e-5)
    assert K_PIXELS > 0


def test_heights_come_back_from_their_slopes() -> None:
    rng = np.random.default_rng(2)
    shape = (61, 74)
    region = cv2.ellipse(np.zeros(shape, np.uint8), (36, 30), (30, 24), 15, 0, 360, (1,), -1) > 0
    right = rng.normal(0, 0.1, (61, 73)).astype(np.float32)
    down = rng.normal(0.05, 0.1, (60, 74)).astype(np.float32)
    made = integrate_edges(right, down, region)
    assert_allclose(made, least_squares(right, down, region), atol=0.03)
    assert_array_equal(made[~region], 0)


def least_squares(right: F32, down: F32, region: Bool) -> F64:
    """The same by a sparse direct solver."""
    index = np.arange(region.size).reshape(region.shape)
    pairs = [(index[:, :-1], index[:, 1:], right), (index[:-1], index[1:], down)]
    a, b, d = (np.concatenate([p[k].ravel() for p in pairs]) for k in range(3))
    rows = np.arange(len(a))
    edges = sp.csr_array((np.repeat([-1.0, 1.0], len(a)), (np.tile(rows, 2), np.r_[a, b])))
    free = np.flatnonzero(region)
    part = sp.csc_array(edges[:, free])
    out = np.zeros(region.size)
    out[free] = spsolve(part.T @ part, part.T @ d)
    return out.reshape(region.shape)


def test_motion_that_landmarks_leave_is_found() -> None:
    field = log_luminance(np.asarray(S @ np.float32([1, 1, 1]) / 765, np.float32))
    field = field + cv2.GaussianBlur(
        np.random.default_rng(3).normal(0, 1, SIZE).astype(np.float32), (0, 0), 2
    )
    moved = np.roll(field, (1, 2), (0, 1))
    inside = face_mask(NEUTRAL, SIZE[::-1])
    found = residual_flow(moved, field, inside, 96.0)
    deep = cv2.erode(inside.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
    assert_allclose(np.median(found[deep], axis=0), (-2, -1), atol=0.3)
    assert np.abs(residual_flow(field, field, inside, 96.0)).max() < 0.05


def test_agreement_is_one_only_of_the_same() -> None:
    rng = np.random.default_rng(4)
    one, two = (cv2.GaussianBlur(rng.normal(0, 2, SIZE).astype(np.float32), (0, 0), 2) for _ in range(2))
    assert_allclose(similarity_fields(one, one + 0.5, 96.0)[1], 1, atol=1e-3)
    assert similarity_fields(one, two, 96.0)[1].mean() < 0.3
    assert_allclose(similarity_fields(one * 0, two * 0, 96.0)[0], 1)


def test_light_is_a_plane_that_an_expression_does_not_tilt() -> None:
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
    inside = face_mask(NEUTRAL, SIZE[::-1])
    dark = np.where((y > 150) & inside, np.float32(-0.5), np.float32(0))
    light = np.asarray(0.2 + 0.002 * x, np.float32)
    assert_allclose(subtract_light_plane(light + dark, inside, 0.0)[inside], dark[inside], atol=0.03)
    assert_allclose(subtract_light_plane(light + dark, inside, 1.0), light + dark, atol=1e-6)


def test_a_change_is_bounded_between_people_and_kept_for_the_same_person() -> None:
    change = np.float32([[-2.0, -0.02, 0.05, 2.0]])
    half = CHANGE.share_between_people
    expected = [[-CHANGE.max_darkening, -0.02 * half, 0.05 * half, CHANGE.max_brightening]]
    assert_allclose(limit_change(change, 0.0), expected, atol=0.01)
    assert_allclose(limit_change(change, 1.0), change)


def test_a_brow_that_was_not_followed_is_no_change_of_light_but_a_wrinkle_is() -> None:
    skin = np.zeros((120, 120), np.float32)
    brow, raised, wrinkle = skin.copy(), skin.copy(), skin.copy()
    brow[60:66], raised[48:54], wrinkle[60:63] = -1, -1, -0.12
    moved, wrinkled = registered_share(brow, raised, 160.0), registered_share(skin, wrinkle, 160.0)
    assert moved[63].max() < 0.2
    assert moved[51].max() < 0.2
    assert moved[100].min() > 0.95
    assert wrinkled.min() > 0.7
    assert_allclose(registered_share(brow, brow + 0.3, 160.0), 1, atol=1e-5)


def test_darker_skin_becomes_redder_at_the_luminance_that_was_asked() -> None:
    skin = np.full((4, 4, 3), (0.8, 0.6, 0.5), np.float32)
    made = relight(skin, change_gain(np.full((4, 4), -0.2, np.float32)))
    assert (made[..., 0] / made[..., 2] > 1.05 * skin[..., 0] / skin[..., 2]).all()
    assert_allclose(made @ LUMINANCE, np.exp(-0.2) * (skin @ LUMINANCE + 0.02) - 0.02, rtol=0.02)
    assert_allclose(
        relight(skin, change_gain(np.full((4, 4), 0.2, np.float32))),
        np.exp(0.2) * (skin + 0.02) - 0.02,
        rtol=1e-5,
    )


def test_teeth_are_no_brighter_than_the_whites_of_the_eyes_nor_darkened() -> None:
    teeth, mouth = np.full((9, 9, 3), 0.6, np.float32), np.ones((9, 9), np.float32)
    bright = np.full(3, 1.4, np.float32)
    assert_allclose(limit_teeth(bright, teeth, mouth, 0.7) * 0.6, 0.7, rtol=1e-5)
    assert_allclose(limit_teeth(bright, teeth, mouth, 0.9), bright)
    assert_allclose(limit_teeth(bright, teeth, mouth, 0.3), 1, rtol=1e-5)
    assert_allclose(limit_teeth(bright, teeth, 0 * mouth, 0.3), bright)


def test_ratio_images_are_smoothed_where_nothing_correlates() -> None:
    rng = np.random.default_rng(5)
    one = np.asarray(0.5 + 0.1 * rng.normal(0, 1, SIZE), np.float32)
    other = np.asarray(0.5 + 0.1 * rng.normal(0, 1, SIZE), np.float32)
    assert_allclose(correlation(one, 0.8 * one), 1, atol=1e-3)
    assert_allclose(smoothed_ratio(one, 0.8 * one, 96.0), 0.8, atol=0.05)
    assert smoothed_ratio(one, other, 96.0).std() < 0.4 * (other / one).std()


def test_the_landmarks_of_the_result_are_the_targets_moved_as_the_sources() -> None:
    motion = LandmarkMotion(NEUTRAL, OTHER)
    made = motion(smiling(NEUTRAL), 1.0) - OTHER
    assert_allclose(made, motion.to_target.scale * (smiling(NEUTRAL) - NEUTRAL), atol=0.3)


def test_a_moved_head_is_no_expression() -> None:
    angle = np.deg2rad(8)
    turn = 1.1 * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = NEUTRAL @ turn.T + (5, -7)
    assert_allclose(LandmarkMotion(NEUTRAL, OTHER)(turned, 1.0), OTHER, atol=1e-6)


def test_how_far_a_mouth_opens() -> None:
    assert mouth_fill_share(NEUTRAL, NEUTRAL, 1.0) == 0
    assert mouth_fill_share(NEUTRAL, smiling(NEUTRAL), 1.0) == 1
    assert mouth_fill_share(NEUTRAL, smiling(NEUTRAL), 0.5) == 1
    assert mouth_fill_share(NEUTRAL, smiling(NEUTRAL), 0.0) == 0
