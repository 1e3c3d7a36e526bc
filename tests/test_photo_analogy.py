"""Properties of expression analogy between photographs, on drawn faces and on rendered people."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse.linalg import spsolve

from guise.aam.landmarks.schemes import (
    BROWS,
    IBUG68,
    INNER_LIPS,
    JAW,
    LEFT_BROW,
    LEFT_EYE,
    LOWER_INNER_LIP,
    LOWER_LIP_INNER,
    NOSE_ROOT,
    OUTER_LIPS,
    RIGHT_BROW,
    RIGHT_EYE,
    UPPER_INNER_LIP,
    UPPER_LIP_INNER,
)
from guise.aam.reference import ReferenceFrame
from guise.analogy.photo import METHODS, Method, PhotoAnalogy, PhotoError
from guise.analogy.photo.eyes import lid_shares, reopen_eyes
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
from guise.common.arrays import F32, F64, U8, Bool

Picture = U8

SIZE = (230, 200)
NEUTRAL = ReferenceFrame.canonical(96).points + np.array([50, 45])
NEUTRAL[UPPER_INNER_LIP] += (0, 3.6)  # the canonical mouth is open
NEUTRAL[list(INNER_LIPS[7:4:-1])] -= (0, 3.6)
PEOPLE = Path(__file__).parents[2] / "shared" / "data" / "synthetic" / "people"


def drawn(points: F64, seed: int, skin: float = 0.6, furrow: float = 0.0) -> F32:
    """A face (230, 200, 3) in 0 .. 1 with brows, eyes and lips at the landmarks, and a furrow on its brow."""
    noise = np.random.default_rng(seed).normal(0, 1, SIZE).astype(np.float32)
    shade = cv2.GaussianBlur(noise, (0, 0), 6) + 0.02 * noise
    picture = np.full((*SIZE, 3), 0.4, np.float32)
    tone = np.array([1, 0.8, 0.7]) * skin
    for part, colour in (
        ((*JAW, *range(80, 67, -1)), tone),
        (RIGHT_EYE, (0.9, 0.9, 0.9)),
        (LEFT_EYE, (0.9, 0.9, 0.9)),
        (OUTER_LIPS, tone * (0.9, 0.6, 0.6)),
        (INNER_LIPS, (0.2, 0.1, 0.1)),
        (RIGHT_BROW, tone * 0.4),
        (LEFT_BROW, tone * 0.4),
    ):
        corners = np.rint(points[list(part)] * 16).astype(np.int32)
        cv2.fillPoly(picture, [corners], [float(c) for c in colour], cv2.LINE_AA, 4)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    middle = points[NOSE_ROOT] - (0, 22)
    dark = np.exp(-(((x - middle[0]) / 14) ** 2) - ((y - middle[1]) / 2) ** 2)
    lit = cv2.GaussianBlur(picture, (0, 0), 0.7) * (1 + 0.1 * shade - furrow * dark)[:, :, None]
    return np.asarray(np.clip(lit, 0, 1), np.float32)


def smiling(points: F64, much: float = 1.0) -> F64:
    """Mouth corners out and up, lower lip down, brows up."""
    out = points.copy()
    out[[OUTER_LIPS[0], INNER_LIPS[0]]] += np.array([-4, -4]) * much
    out[[OUTER_LIPS[6], INNER_LIPS[4]]] += np.array([4, -4]) * much
    out[[*OUTER_LIPS[7:], *INNER_LIPS[5:]]] += np.array([0, 5]) * much
    out[BROWS] += np.array([0, -4]) * much
    return out


def eight(picture: F32) -> Picture:
    return np.asarray(np.rint(255 * picture), np.uint8)


OTHER = (NEUTRAL - NEUTRAL.mean(0)) * (1.05, 0.95) + NEUTRAL.mean(0) + (2, 1)
S, T = eight(drawn(NEUTRAL, 0)), eight(drawn(OTHER, 1, 0.45))
S1 = eight(drawn(smiling(NEUTRAL), 0, furrow=0.4))


def carry(method: Method = "tents", target: Picture = T) -> PhotoAnalogy:
    return PhotoAnalogy(S, NEUTRAL, target, OTHER, method)


# -- the whole ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_no_expression_gives_the_target(method: Method) -> None:
    assert_array_equal(carry(method)(S, NEUTRAL), T)


@pytest.mark.parametrize("method", METHODS)
def test_strength_0_gives_the_target(method: Method) -> None:
    assert_array_equal(carry(method)(S1, smiling(NEUTRAL), 0.0), T)


def test_the_expression_moves_the_face_and_nothing_beyond_the_ring() -> None:
    made = carry()(S1, smiling(NEUTRAL))
    mask = np.zeros(SIZE, np.uint8)
    cv2.fillPoly(mask, [np.ceil(anchor_ring(OTHER)).astype(np.int32)], (1,))
    beyond = cv2.dilate(mask, np.ones((3, 3), np.uint8)) == 0
    assert beyond.sum() > 5000
    assert_array_equal(made[beyond], T[beyond])
    assert np.abs(made.astype(int) - T)[mask > 0].mean() > 1


def test_the_landmarks_of_the_result_are_the_targets_moved_as_the_sources() -> None:
    motion = LandmarkMotion(NEUTRAL, OTHER)
    made = motion(smiling(NEUTRAL), 1.0) - OTHER
    assert_allclose(made, motion.to_target.scale * (smiling(NEUTRAL) - NEUTRAL), atol=0.3)


def test_a_moved_head_is_no_expression() -> None:
    angle = np.deg2rad(8)
    turn = 1.1 * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = NEUTRAL @ turn.T + (5, -7)
    assert_allclose(LandmarkMotion(NEUTRAL, OTHER)(turned, 1.0), OTHER, atol=1e-6)


@pytest.mark.parametrize("method", ["tents", "ratio"])
def test_a_furrow_is_carried_and_a_warp_has_none(method: Method) -> None:
    place = np.rint(OTHER[NOSE_ROOT] - (0, 21)).astype(int)
    at = np.s_[place[1] - 2 : place[1] + 3, place[0] - 5 : place[0] + 6]
    made, bare = (carry(m)(S1, smiling(NEUTRAL))[at].mean() for m in (method, METHODS[2]))
    assert made < 0.93 * bare


def test_onto_itself_it_is_its_own_answer() -> None:
    points = smiling(NEUTRAL)
    inside = cv2.erode(face_mask(points, SIZE[::-1]).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    errors = [
        np.abs(PhotoAnalogy(S, NEUTRAL, S, NEUTRAL, m)(S1, points).astype(float) - S1)[inside].mean()
        for m in METHODS
    ]
    assert errors[0] < 1.0
    assert errors[0] < 0.5 * errors[1] < 0.5 * errors[2]


def test_half_the_strength_lies_between() -> None:
    whole = carry()
    made = [whole(S1, smiling(NEUTRAL), k).astype(float) for k in (0.0, 0.5, 1.0)]
    low, high = (np.abs(made[1] - made[k]).mean() for k in (0, 2))
    assert max(low, high) < np.abs(made[2] - made[0]).mean()
    assert min(low, high) > 0.1 * np.abs(made[2] - made[0]).mean()


def test_other_light_on_the_source_changes_little() -> None:
    brighter = [np.asarray(np.rint(np.clip(p * 0.7 + 12, 0, 255)), np.uint8) for p in (S, S1)]
    plain = carry()(S1, smiling(NEUTRAL))
    lit = PhotoAnalogy(brighter[0], NEUTRAL, T, OTHER)(brighter[1], smiling(NEUTRAL))
    changed = np.abs(plain.astype(float) - T).mean()
    assert np.abs(plain.astype(float) - lit).mean() < 0.15 * changed


def test_a_dimmer_expressive_picture_does_not_dim_the_target() -> None:
    dim = np.asarray(np.rint(S1 * 0.7), np.uint8)
    plain, lit = (carry()(p, smiling(NEUTRAL)).astype(float) for p in (S1, dim))
    shift = (lit - plain)[face_mask(OTHER, SIZE[::-1])].mean()
    assert abs(shift) < 3
    by_ratio = [carry("ratio")(p, smiling(NEUTRAL)).astype(float) for p in (S1, dim)]
    assert (by_ratio[1] - by_ratio[0])[face_mask(OTHER, SIZE[::-1])].mean() < -15


@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("method", METHODS)
def test_flat_pictures_stay_finite(method: Method, level: int) -> None:
    flat = np.full((*SIZE, 3), level, np.uint8)
    made = PhotoAnalogy(flat / 255.0, NEUTRAL, flat / 255.0, OTHER, method)(flat / 255.0, smiling(NEUTRAL))
    assert np.isfinite(made).all()
    assert_allclose(made, level / 255, atol=0.01)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32, np.float64])
def test_type_and_size_are_the_targets(kind: type) -> None:
    top = np.iinfo(kind).max if np.issubdtype(kind, np.integer) else 1
    target = np.asarray(T / 255.0 * top, kind)
    made = carry(target=target)(S1, smiling(NEUTRAL))
    assert made.dtype == kind
    assert made.shape == T.shape
    assert_allclose(made / top, carry()(S1, smiling(NEUTRAL)) / 255, atol=0.02)


def test_a_grey_target_stays_grey() -> None:
    made = carry(target=cv2.cvtColor(T, cv2.COLOR_RGB2GRAY))(S1, smiling(NEUTRAL))
    assert made.shape == SIZE


def test_a_source_of_another_size_gives_about_the_same() -> None:
    large = [cv2.resize(p, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC) for p in (S, S1)]
    points = [(p + 0.5) * 2 - 0.5 for p in (NEUTRAL, smiling(NEUTRAL))]
    made = PhotoAnalogy(large[0], points[0], T, OTHER)(large[1], points[1])
    plain = carry()(S1, smiling(NEUTRAL))
    assert np.abs(made.astype(float) - plain).mean() < 0.1 * np.abs(plain.astype(float) - T).mean()


@pytest.mark.slow
def test_a_large_target_is_computed_on_a_coarser_grid() -> None:
    large = cv2.resize(T, None, fx=6, fy=6, interpolation=cv2.INTER_CUBIC)
    whole = PhotoAnalogy(S, NEUTRAL, large, (OTHER + 0.5) * 6 - 0.5)
    made = whole(S1, smiling(NEUTRAL))
    assert made.shape == large.shape
    assert_array_equal(whole(S, NEUTRAL), large)
    small = cv2.resize(made, SIZE[::-1], interpolation=cv2.INTER_AREA)
    plain = carry()(S1, smiling(NEUTRAL))
    assert np.abs(small.astype(float) - plain).mean() < 0.2 * np.abs(plain.astype(float) - T).mean()


def test_a_face_partly_outside_its_picture() -> None:
    cut = np.ascontiguousarray(T[70:, 60:])
    made = PhotoAnalogy(S, NEUTRAL, cut, OTHER - (60, 70))(S1, smiling(NEUTRAL))
    assert made.shape == cut.shape
    assert np.abs(made.astype(float) - cut).mean() > 0.5


# -- mouth and eyes ----------------------------------------------------------------------------------------


def test_the_inside_of_a_mouth_that_opens_is_the_sources() -> None:
    points = smiling(NEUTRAL, 2.0)
    expressive = drawn(points, 0)
    cv2.fillPoly(expressive, [np.rint(points[list(INNER_LIPS)]).astype(np.int32)], (0.1, 0.8, 0.1))
    middle = np.rint(
        LandmarkMotion(NEUTRAL, OTHER)(points, 1.0)[[UPPER_LIP_INNER, LOWER_LIP_INNER]].mean(0)
    ).astype(int)
    colours = [
        PhotoAnalogy(S, NEUTRAL, T, OTHER, mouth=mouth)(eight(expressive), points)[middle[1], middle[0]]
        for mouth in ("fill", "none")
    ]
    assert colours[0][1] > 2.0 * colours[0][0]
    assert colours[1][1] < 1.5 * colours[1][0]


def test_how_far_a_mouth_opens() -> None:
    assert mouth_fill_share(NEUTRAL, NEUTRAL, 1.0) == 0
    assert mouth_fill_share(NEUTRAL, smiling(NEUTRAL), 1.0) == 1
    assert mouth_fill_share(NEUTRAL, smiling(NEUTRAL), 0.5) == 1
    assert mouth_fill_share(NEUTRAL, smiling(NEUTRAL), 0.0) == 0


def test_eyes_that_close_take_their_lids_from_the_source() -> None:
    points = NEUTRAL.copy()
    for eye in (RIGHT_EYE, LEFT_EYE):
        points[eye[1:3]] = points[[eye[5], eye[4]]] - (0, 0.3)
    assert_allclose(lid_shares(NEUTRAL, points, 1.0), 1)
    assert_allclose(lid_shares(NEUTRAL, points, 0.3), 0)
    assert_allclose(reopen_eyes(points, NEUTRAL, np.ones(2)), NEUTRAL)
    blinking = eight(drawn(points, 0))
    made = carry()(blinking, points)
    eye = OTHER[list(RIGHT_EYE)].mean(0).astype(int)
    assert T[eye[1], eye[0]].min() > 200
    assert made[eye[1], eye[0]].max() < 150


# -- the parts ---------------------------------------------------------------------------------------------


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


def test_a_coarser_grid_gives_nearly_the_same_picture() -> None:
    """As in clips, where light is computed on fewer pixels."""
    picture = np.random.default_rng(2).integers(90, 160, (*SIZE[::-1], 3), dtype=np.uint8)
    picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 4), np.uint8)
    fine, coarse = (
        PhotoAnalogy(picture, NEUTRAL, picture, NEUTRAL, max_face_px=most)(picture, NEUTRAL).astype(int)
        for most in (512, 48)
    )
    assert np.abs(fine - coarse).mean() < 1


def test_ratio_images_are_smoothed_where_nothing_correlates() -> None:
    rng = np.random.default_rng(5)
    one = np.asarray(0.5 + 0.1 * rng.normal(0, 1, SIZE), np.float32)
    other = np.asarray(0.5 + 0.1 * rng.normal(0, 1, SIZE), np.float32)
    assert_allclose(correlation(one, 0.8 * one), 1, atol=1e-3)
    assert_allclose(smoothed_ratio(one, 0.8 * one, 96.0), 0.8, atol=0.05)
    assert smoothed_ratio(one, other, 96.0).std() < 0.4 * (other / one).std()


# -- mistakes ----------------------------------------------------------------------------------------------


def test_mistakes_are_one_sentence() -> None:
    with pytest.raises(
        PhotoError, match=r"source_points must be \(81, 2\) landmarks of scheme face81, got \(68, 2\)"
    ):
        PhotoAnalogy(S, NEUTRAL[IBUG68], T, OTHER)
    with pytest.raises(PhotoError, match="points must be finite"):
        carry()(S1, np.full((81, 2), np.nan))
    with pytest.raises(PhotoError, match="the landmarks do not form a face"):
        PhotoAnalogy(S, np.ones((81, 2)), T, OTHER)
    with pytest.raises(PhotoError, match="target's face is 10 pixels wide, but at least 32"):
        PhotoAnalogy(S, NEUTRAL, T, NEUTRAL * 10 / np.ptp(NEUTRAL[:, 0]))
    with pytest.raises(PhotoError, match="target's landmarks lie outside its picture"):
        PhotoAnalogy(S, NEUTRAL, T, OTHER + 1000)
    with pytest.raises(PhotoError, match=r"source must be \(h, w\) or \(h, w, 3\), got \(4, 4, 4\)"):
        PhotoAnalogy(np.zeros((4, 4, 4), np.uint8), NEUTRAL, T, OTHER)
    with pytest.raises(PhotoError, match="expressive holds values outside 0 to 1"):
        carry()(S1.astype(float), NEUTRAL)
    with pytest.raises(PhotoError, match="expressive must be uint8, uint16 or float in 0 to 1, got int64"):
        carry()(S1.astype(np.int64), NEUTRAL)
    with pytest.raises(PhotoError, match="method must be one of"):
        PhotoAnalogy(S, NEUTRAL, T, OTHER, "cloning")  # type: ignore[arg-type]


# -- rendered people ---------------------------------------------------------------------------------------


@pytest.mark.skipif(not PEOPLE.exists(), reason="the rendered people are not beside the repository")
@pytest.mark.parametrize("name", ["smile", "blink"])
def test_across_rendered_people_tents_come_nearest(name: str) -> None:
    (s, ps), (s1, p1) = still("p01", "neutral"), still("p01", name)
    (t, pt), (truth, points) = still("p05", "neutral"), still("p05", name)
    inside = face_mask(points, (truth.shape[1], truth.shape[0]))
    errors = [
        float(((PhotoAnalogy(s, ps, t, pt, m)(s1, p1).astype(float) - truth)[inside] ** 2).mean())
        for m in METHODS
    ]
    assert errors[0] < min(errors[1:])


def still(person: str, name: str) -> tuple[Picture, F64]:
    with np.load(PEOPLE / person / "stills.npz") as stills:
        points = stills["landmarks"][list(stills["names"]).index(name)].astype(np.float64)
    picture = cv2.imread(str(PEOPLE / person / f"{name}.jpg"))
    assert picture is not None
    return np.ascontiguousarray(picture[:, :, ::-1]), points
