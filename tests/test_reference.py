"""The reference frame: its id, its grid, its sampler, and the yaw it reads off a shape."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import SAMPLES
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.landmarks import MIRROR
from guise.aam.landmarks.schemes import BROWS, JAW, LIPS, NOSE_ROOT, RIGID_WEIGHTS
from guise.aam.reference import MARGIN_GRID_PIXELS, MeshSampler, ReferenceFrame
from guise.aam.similarity import Similarity

FRAME = ReferenceFrame.canonical(64)


def ramp(height: int, width: int) -> np.ndarray:
    """A picture (h, w, 2) float32 whose value at a pixel is its x and y: bilinear samples of it are exact."""
    ys, xs = np.mgrid[:height, :width]
    return np.stack([xs, ys], axis=-1).astype(np.float32)


def bent(seed: int, reference: ReferenceFrame = FRAME) -> np.ndarray:
    """The reference points, each moved a little, as a shape in a picture."""
    rng = np.random.default_rng(seed)
    return reference.points * 1.5 + 20 + rng.normal(size=reference.points.shape)


def test_the_id_is_the_geometry_that_models_were_made_with() -> None:
    """A change here makes every model file unusable: raise the format version with it."""
    ids = {r: ReferenceFrame.canonical(r).id for r in (64, 96, 160)}
    assert ids == {64: "b4e0d4961c9b", 96: "c696328461de", 160: "bf194b8ecbbc"}


def test_the_id_differs_with_anything_that_sampling_depends_on() -> None:
    moved = ReferenceFrame(FRAME.points + np.array([0, 0.01]), FRAME.triangles, FRAME.size)
    other = ReferenceFrame(FRAME.points, FRAME.triangles[::-1].copy(), FRAME.size)
    larger = ReferenceFrame(FRAME.points, FRAME.triangles, (FRAME.size[0] + 1, FRAME.size[1]))
    same = ReferenceFrame(FRAME.points.copy(), FRAME.triangles.copy(), FRAME.size)
    assert same.id == FRAME.id
    assert len({FRAME.id, moved.id, other.id, larger.id}) == 4


def test_the_canonical_frame_is_made_once_and_read_only() -> None:
    assert ReferenceFrame.canonical(64) is ReferenceFrame.canonical(64)
    with pytest.raises(ValueError, match="read-only"):
        FRAME.points[0] = 0


@pytest.mark.parametrize("resolution", [32, 64, 160, 512])
def test_resolution_is_pixels_across_the_face_and_the_grid_holds_it(resolution: int) -> None:
    reference = ReferenceFrame.canonical(resolution)
    assert reference.resolution == resolution
    assert reference.points.min() >= MARGIN_GRID_PIXELS
    assert (reference.points.max(0) <= np.array(reference.size[::-1]) - 1 - 1e-9).all()


@pytest.mark.parametrize("resolution", [0, 31, 513])
def test_resolutions_out_of_range_are_named(resolution: int) -> None:
    with pytest.raises(ValueError, match=f"must be 32 to 512 pixels across the face, got {resolution}"):
        ReferenceFrame.canonical(resolution)


def test_points_are_symmetric() -> None:
    axis = FRAME.points[NOSE_ROOT, 0]
    flipped = FRAME.points[list(MIRROR)] * [-1, 1] + [2 * axis, 0]
    assert_allclose(flipped, FRAME.points, atol=0.01)


def test_rigid_weights_ignore_what_expression_moves() -> None:
    assert RIGID_WEIGHTS.sum() == pytest.approx(1)
    lips_brows_jaw = [*LIPS, *BROWS, *JAW[1:-1]]
    assert not RIGID_WEIGHTS[lips_brows_jaw].any()
    lids = [37, 38, 40, 41, 43, 44, 46, 47]
    assert not RIGID_WEIGHTS[lids].any()


def test_triangle_map_names_the_triangle_that_holds_the_pixel() -> None:
    ys, xs = np.nonzero(FRAME.mask)
    corners = FRAME.points[FRAME.triangles[FRAME.triangle_map[ys, xs]]]
    assert_barycentric(corners, np.column_stack([xs, ys]), slack=0.75)


def assert_barycentric(corners: np.ndarray, places: np.ndarray, slack: float) -> None:
    """Places lie inside their triangles (n, 3, 2), or at most `slack` pixels outside an edge."""
    middle = corners.mean(1)
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        normal = np.stack([a[:, 1] - b[:, 1], b[:, 0] - a[:, 0]], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        inwards = np.sign(((middle - a) * normal).sum(1))
        assert (((places - a) * normal).sum(1) * inwards).min() > -slack


def test_mask_is_the_triangles_together_with_no_holes() -> None:
    assert_array_equal(FRAME.mask, FRAME.triangle_map >= 0)
    canvas = np.zeros(FRAME.size, np.uint8)
    cv2.fillConvexPoly(canvas, cv2.convexHull(np.round(FRAME.points).astype(np.int32)), 1)
    assert (FRAME.mask != (canvas > 0)).mean() < 0.02
    assert_array_equal(FRAME.pixels, np.flatnonzero(FRAME.mask))


def test_triangles_cover_the_hull_once() -> None:
    a, b, c = (FRAME.points[FRAME.triangles[:, k]] for k in range(3))
    areas = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])) / 2
    hull = cv2.contourArea(cv2.convexHull(FRAME.points.astype(np.float32)))
    assert areas.sum() == pytest.approx(hull, rel=1e-5)


@given(st.integers(0, 1000))
def test_landmarks_are_sampled_exactly_at_the_landmarks(seed: int) -> None:
    shape = bent(seed)
    at_points = MeshSampler.build(FRAME, FRAME.points)
    assert_allclose(at_points.positions(shape), shape, atol=1e-4)


def test_the_reference_shape_samples_the_grid_itself() -> None:
    ys, xs = np.divmod(FRAME.pixels, FRAME.size[1])
    assert_allclose(FRAME.sampler.positions(FRAME.points), np.column_stack([xs, ys]), atol=1e-4)
    assert_allclose(
        FRAME.sampler.sample(ramp(*FRAME.size), FRAME.points), np.column_stack([xs, ys]), atol=1e-3
    )


def test_a_moved_shape_samples_where_an_affine_map_says() -> None:
    ys, xs = np.divmod(FRAME.pixels, FRAME.size[1])
    linear, offset = np.array([[1.2, 0.3], [-0.2, 0.9]]), np.array([30.0, 20.0])
    expected = np.column_stack([xs, ys]) @ linear + offset
    assert_allclose(FRAME.sampler.positions(FRAME.points @ linear + offset), expected, atol=1e-3)


@given(st.integers(0, 1000))
def test_positions_are_affine_in_every_triangle(seed: int) -> None:
    shape, sampler = bent(seed), FRAME.sampler
    places = sampler.positions(shape)
    own = np.linalg.lstsq(
        np.column_stack([FRAME.points[sampler.vertices[:, 0]], np.ones(3)]),
        shape[sampler.vertices[:, 0]],
        rcond=None,
    )[0]
    same = (sampler.vertices == sampler.vertices[:, :1]).all(0)
    ys, xs = np.divmod(FRAME.pixels[same], FRAME.size[1])
    assert_allclose(places[same], np.column_stack([xs, ys, np.ones(len(xs))]) @ own, atol=1e-3)


def test_part_of_a_sampler_samples_that_part() -> None:
    subset = np.array([5, 0, 17, 5])
    shape = bent(1)
    assert_array_equal(FRAME.sampler[subset].positions(shape), FRAME.sampler.positions(shape)[subset])


def test_weights_outside_the_hull_still_sum_to_one() -> None:
    sampler = MeshSampler.build(FRAME, np.array([[0.0, 0.0], [60.0, 2.0], [-3.0, 90.0]]))
    assert_allclose(sampler.weights.sum(0), 1, atol=1e-5)


@given(st.floats(-40, 40), st.floats(0.2, 5), st.floats(-500, 500), st.integers(0, 100))
def test_alignment_undoes_pose(angle: float, scale: float, shift: float, seed: int) -> None:
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    pose = Similarity(scale, np.array([[c, -s], [s, c]]), np.array([shift, -shift / 2]))
    shape = bent(seed)
    assert_allclose(FRAME.align(pose.apply(shape)), FRAME.align(shape), atol=1e-6)


def test_the_reference_shape_is_aligned_and_faces_forward() -> None:
    assert_allclose(FRAME.align(FRAME.points), FRAME.points, atol=1e-9)
    assert FRAME.yaw(FRAME.points) == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize("clip", ["p01/talk", "p01/talk2", "p02/talk", "p02/talk2", "p06/talk", "p06/talk2"])
def test_yaw_is_read_off_shapes(clip: str) -> None:
    truth = np.load(SAMPLES / f"{clip}.npz")
    yaw = truth["yaw_pitch_roll_deg"][:, 0]
    read = np.array([FRAME.yaw(FRAME.align(s)) for s in truth["landmarks"].astype(float)])
    assert np.corrcoef(yaw, read)[0, 1] > 0.95
    assert np.abs(read - yaw).mean() < 2


def test_a_mirrored_head_is_turned_the_other_way_and_a_broad_one_is_not_turned() -> None:
    turned = FRAME.points + 10 * FRAME.yaw_mode
    mirrored = turned[list(MIRROR)] * [-1, 1] + [2 * FRAME.points[NOSE_ROOT, 0], 0]
    assert FRAME.yaw(FRAME.align(turned)) == pytest.approx(10, abs=1)
    assert FRAME.yaw(FRAME.align(mirrored)) == pytest.approx(-FRAME.yaw(FRAME.align(turned)), abs=0.2)
    broad = (FRAME.points - FRAME.points[NOSE_ROOT]) * [1.15, 1] + FRAME.points[NOSE_ROOT]
    assert FRAME.yaw(FRAME.align(broad)) == pytest.approx(0, abs=0.1)


def test_scatter_puts_a_texture_on_the_grid() -> None:
    texture = np.random.default_rng(0).normal(size=(len(FRAME.pixels), 3)).astype(np.float32)
    picture = FRAME.scatter(texture, fill=-7)
    assert picture.shape == (*FRAME.size, 3)
    assert_array_equal(picture[FRAME.mask], texture)
    assert (picture[~FRAME.mask] == -7).all()
