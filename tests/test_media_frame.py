"""Frames: rectangles, points, colour matrices and orientation on planes of every native format."""

from __future__ import annotations

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from guise.app.media.colour import (
    BT709,
    BT2020_NCL,
    FULL,
    LIMITED,
    SMPTE170M,
    UNSPECIFIED,
    gbr_matrix,
    yuv_matrix,
)
from guise.app.media.frame import Frame, plane_arrays
from guise.app.media.orientation import AS_STORED, Orientation, parse_display_matrix
from guise.app.media.pixel_formats import NATIVE_FORMATS, SHALLOW_FORMATS

ORIENTATIONS = [Orientation(t, x, y) for t in (False, True) for x in (False, True) for y in (False, True)]
TICK = Fraction(1, 30)


def noise_frame(fmt: str, width: int = 37, height: int = 23, orientation: Orientation = AS_STORED) -> Frame:
    video = av.VideoFrame(width, height, fmt)
    rng = np.random.default_rng(5)
    for plane in plane_arrays(video):
        plane[:] = rng.integers(0, 256, plane.shape)
    return Frame(video, pts=3, time_base=TICK, index=0, orientation=orientation)


def stored(frame: Frame) -> list[np.ndarray]:
    assert frame.video_frame is not None
    return [plane.copy() for plane in plane_arrays(frame.video_frame)]


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
@pytest.mark.parametrize("fmt", SHALLOW_FORMATS)
def test_shown_planes_have_what_a_rectangle_has(fmt: str, orientation: Orientation) -> None:
    frame = noise_frame(fmt, orientation=orientation)
    planes = frame.shown_planes()
    assert planes is not None
    luma, first, second, (across, down, left, top) = planes
    rows = np.rint((np.arange(frame.height)[:, None] - top) * down).astype(int) % len(first)
    columns = np.rint((np.arange(frame.width) - left) * across).astype(int) % first.shape[1]
    whole = frame.read_roi(0, 0, frame.width, frame.height)
    np.testing.assert_array_equal(whole, np.dstack([luma, first[rows, columns], second[rows, columns]]))


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
@pytest.mark.parametrize("fmt", SHALLOW_FORMATS)
def test_unmodified_round_trip_is_bit_identical(fmt: str, orientation: Orientation) -> None:
    frame = noise_frame(fmt, orientation=orientation)
    before = stored(frame)
    for corners in [
        (0, 0, 999, 999),
        (3, 5, 12, 14),
        (1, 1, 2, 2),
        (frame.width - 1, frame.height - 1, 99, 99),
    ]:
        x, y, w, h = frame.align_roi(*corners)
        frame.write_roi(x, y, frame.read_roi(x, y, w, h))
        frame.write_roi(2, 3, frame.read_roi(2, 3, 5, 4))  # cuts chroma cells
    for old, new in zip(before, stored(frame), strict=True):
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
@pytest.mark.parametrize("fmt", SHALLOW_FORMATS)
def test_write_changes_nothing_outside_the_rectangle(fmt: str, orientation: Orientation) -> None:
    frame = noise_frame(fmt, orientation=orientation)
    before = frame.read_roi(0, 0, frame.width, frame.height)
    x, y, w, h = frame.align_roi(6.5, 3.5, 15.2, 12)
    frame.write_roi(x, y, np.full((h, w, 3), 77, np.uint8))
    after = frame.read_roi(0, 0, frame.width, frame.height)
    inside = np.zeros(after.shape[:2], bool)
    inside[y : y + h, x : x + w] = True
    np.testing.assert_array_equal(before[~inside], after[~inside])
    assert (after[inside][:, : 1 if fmt == "gray" else 3] == 77).all()


@pytest.mark.parametrize("fmt", ["yuv420p", "yuv422p", "yuv444p", "nv12", "gray"])
def test_read_gives_the_planes_with_chroma_replicated(fmt: str) -> None:
    frame = noise_frame(fmt)
    luma, *chroma = stored(frame)
    sx, sy = NATIVE_FORMATS[fmt]
    roi = frame.read_roi(4, 6, 20, 10)
    np.testing.assert_array_equal(roi[..., 0], luma[6:16, 4:24])
    for channel, plane in enumerate(chroma, start=1):
        full = plane.repeat(1 << sy, axis=0).repeat(1 << sx, axis=1)
        np.testing.assert_array_equal(roi[..., channel], full[6:16, 4:24])
    if not chroma:
        assert (roi[..., 1:] == 128).all()


def test_chroma_written_is_the_rounded_mean_of_its_cell() -> None:
    frame = noise_frame("yuv420p", 8, 8)
    yuv = np.random.default_rng(1).integers(0, 256, (4, 4, 3)).astype(np.uint8)
    frame.write_roi(2, 4, yuv)
    cells = yuv.astype(int).reshape(2, 2, 2, 2, 3).sum(axis=(1, 3))
    np.testing.assert_array_equal(stored(frame)[1][2:4, 1:3], (cells[..., 1] + 2) // 4)
    np.testing.assert_array_equal(stored(frame)[2][2:4, 1:3], (cells[..., 2] + 2) // 4)


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
@given(corners=st.tuples(*[st.floats(-20, 60)] * 4))
@settings(max_examples=40, deadline=None)
def test_align_covers_the_clipped_rectangle_and_whole_chroma_cells(
    orientation: Orientation, corners: tuple[float, float, float, float]
) -> None:
    frame = noise_frame("yuv420p", orientation=orientation)
    x0, y0, x1, y1 = corners
    x, y, w, h = frame.align_roi(x0, y0, x1, y1)
    assert x >= 0
    assert y >= 0
    assert x + w <= frame.width
    assert y + h <= frame.height
    if w and h:
        assert x <= max(x0, 0)
        assert x + w >= min(x1, frame.width)
        assert y <= max(y0, 0)
        assert y + h >= min(y1, frame.height)
        assert frame.align_roi(x, y, x + w, y + h) == (x, y, w, h)


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
def test_orientation_turns_luma_rgb_and_rectangles_alike(orientation: Orientation) -> None:
    frame, upright = noise_frame("yuv444p", orientation=orientation), noise_frame("yuv444p")
    assert (frame.width, frame.height) == orientation.size(37, 23)
    np.testing.assert_array_equal(frame.luma, orientation.view(upright.luma))
    np.testing.assert_array_equal(frame.rgb(), orientation.view(upright.rgb()))
    np.testing.assert_array_equal(orientation.stored_view(frame.luma), upright.luma)
    assert frame.luma.flags.c_contiguous or orientation.is_identity


@pytest.mark.parametrize(
    ("angle", "rotation"), [(0, 0), (90, 270), (180, 180), (-90, 90)]
)  # FFmpeg counts counter-clockwise
def test_display_matrix_gives_the_clockwise_turn(angle: int, rotation: int) -> None:
    turn = {0: (1, 0, 0, 1), 90: (0, -1, 1, 0), 180: (-1, 0, 0, -1), -90: (0, 1, -1, 0)}[angle]
    a, b, c, d = (value << 16 for value in turn)
    matrix = np.array([a, b, 0, c, d, 0, 0, 0, 1 << 30], np.int32)
    orientation = Orientation.from_display_matrix(parse_display_matrix(matrix.tobytes()))
    assert orientation.rotation == rotation
    picture = np.arange(6, dtype=np.uint8).reshape(2, 3)
    np.testing.assert_array_equal(orientation.view(picture), np.rot90(picture, -rotation // 90))


@pytest.mark.parametrize("colour_range", [LIMITED, FULL])
@pytest.mark.parametrize("matrix", [BT709, SMPTE170M, BT2020_NCL])
def test_matrix_agrees_with_swscale(matrix: int, colour_range: int) -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    converted = av.VideoFrame.from_ndarray(rgb, "rgb24").reformat(
        format="yuv444p", dst_colorspace=matrix, dst_color_range=colour_range
    )
    planes = np.dstack(plane_arrays(converted))
    ours = yuv_matrix(matrix, colour_range, 64)
    forward = cv2.transform(rgb, ours.from_rgb)
    assert np.abs(forward.astype(int) - planes).max() <= 2
    back = cv2.transform(planes, ours.to_rgb)
    assert np.abs(back.astype(int) - rgb).max() <= 4
    theirs = converted.to_ndarray(format="rgb24")
    assert np.abs(back.astype(int) - theirs).max() <= 2


@given(
    weights=st.sampled_from([BT709, SMPTE170M, BT2020_NCL, UNSPECIFIED]),
    colour_range=st.sampled_from([0, LIMITED, FULL]),
    height=st.integers(16, 2160),
)
def test_matrices_are_inverse_and_keep_grey_grey(weights: int, colour_range: int, height: int) -> None:
    matrix = yuv_matrix(weights, colour_range, height)
    product = matrix.to_rgb[:, :3] @ matrix.from_rgb[:, :3]
    np.testing.assert_allclose(product, np.eye(3), atol=1e-5)
    grey = matrix.from_rgb[:, :3] @ [100.0, 100, 100] + matrix.from_rgb[:, 3]
    np.testing.assert_allclose(grey[1:], 128, atol=1e-3)


def test_unspecified_colour_is_chosen_by_height() -> None:
    for height, standard in [(720, BT709), (576, SMPTE170M)]:
        chosen = yuv_matrix(UNSPECIFIED, 0, height)
        np.testing.assert_array_equal(chosen.to_rgb, yuv_matrix(standard, LIMITED, 10).to_rgb)


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
@pytest.mark.parametrize("fmt", ["yuv444p", "yuvj444p", "gray"])
def test_samples_at_pixel_centres_are_the_pixels(fmt: str, orientation: Orientation) -> None:
    frame = noise_frame(fmt, orientation=orientation)
    y, x = np.mgrid[: frame.height, : frame.width]
    values = frame.sample_rgb(np.stack([x, y], axis=-1).reshape(-1, 2))
    whole = frame.rgb().reshape(-1, 3)
    assert np.abs(values.clip(0, 255) - whole).max() <= 0.7  # cv2.transform works in fixed point


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
@pytest.mark.parametrize(
    ("fmt", "site"), [("yuv420p", 0.0), ("yuvj420p", 0.5), ("yuv422p", 0.0), ("nv12", 0.0)]
)
def test_samples_interpolate_chroma_at_its_site(fmt: str, site: float, orientation: Orientation) -> None:
    frame = noise_frame(fmt, 32, 24, orientation)
    luma, u, v = plane_arrays(frame.video_frame)
    sx, sy = NATIVE_FORMATS[fmt]
    luma[:] = 120
    u[:] = 100 + 3 * np.arange(u.shape[1]) + 2 * np.arange(u.shape[0])[:, None]
    v[:] = 128
    points = np.array([[6.25, 7.5], [10.0, 9.75]], np.float32)
    x, y = orientation.stored_points(points, frame.width, frame.height).T
    ramp = 100 + 3 * (x - site) / (1 << sx) + 2 * (y - (0.5 if sy else 0)) / (1 << sy)
    wanted = np.stack([np.full(2, 120), ramp, np.full(2, 128)], axis=1)
    rgb = wanted @ frame.colour.to_rgb[:, :3].T + frame.colour.to_rgb[:, 3]
    np.testing.assert_allclose(frame.sample_rgb(points), rgb, atol=0.35)  # cv2.remap steps by 1/32 pixel


def test_samples_outside_repeat_the_border() -> None:
    frame = noise_frame("yuv444p")
    outside = frame.sample_rgb([[-50.0, 4.0], [4.0, 500.0]])
    np.testing.assert_allclose(outside, frame.sample_rgb([[0.0, 4.0], [4.0, 22.0]]), atol=1e-3)
    assert frame.sample_rgb(np.zeros((0, 2))).shape == (0, 3)
    with pytest.raises(ValueError, match="finite"):
        frame.sample_rgb([[np.nan, 0.0]])


def test_rgb_frames_keep_pixels_and_answer_like_video_frames() -> None:
    rgb = np.random.default_rng(2).integers(0, 256, (15, 17, 3)).astype(np.uint8)
    frame = Frame.from_rgb(rgb, pts=4, index=2)
    np.testing.assert_array_equal(frame.rgb(), rgb)
    yuv = frame.read_roi(3, 4, 5, 6)
    np.testing.assert_array_equal(yuv[..., [2, 0, 1]], rgb[4:10, 3:8])
    np.testing.assert_array_equal(cv2.transform(yuv, frame.colour.to_rgb), rgb[4:10, 3:8])
    frame.write_roi(3, 4, yuv)
    np.testing.assert_array_equal(frame.rgb(), rgb)
    np.testing.assert_allclose(frame.sample_rgb([[3.0, 4.0]])[0], rgb[4, 3], atol=0.01)
    np.testing.assert_array_equal(frame.luma, cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
    np.testing.assert_array_equal(gbr_matrix().to_rgb[:, :3] @ gbr_matrix().from_rgb[:, :3], np.eye(3))


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
def test_a_turned_rgb_frame_answers_like_one_of_the_picture_as_it_is_shown(orientation: Orientation) -> None:
    stored = np.random.default_rng(3).integers(0, 256, (15, 17, 3)).astype(np.uint8)
    shown = Frame.from_rgb(np.ascontiguousarray(orientation.view(stored)))
    frame = Frame(stored.copy(), pts=0, time_base=TICK, index=0, orientation=orientation)
    points = np.random.default_rng(4).uniform(-2, 19, (300, 2))
    # cv2.remap takes 1/32 of a pixel, to which a mirrored point may be rounded the other way
    np.testing.assert_allclose(frame.sample_rgb(points), shown.sample_rgb(points), atol=17)
    np.testing.assert_array_equal(frame.read_roi(2, 3, 7, 5), shown.read_roi(2, 3, 7, 5))
    for one in (frame, shown):
        one.write_roi(2, 3, np.full((5, 7, 3), (1, 2, 3), np.uint8))
    np.testing.assert_array_equal(frame.rgb(), shown.rgb())


def test_from_rgb_owns_its_pixels() -> None:
    rgb = np.zeros((4, 4, 3), np.uint8)
    frame = Frame.from_rgb(rgb)
    frame.write_roi(0, 0, np.full((4, 4, 3), 9, np.uint8))
    assert not rgb.any()


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
def test_another_picture_is_shown_at_the_same_time_and_is_owned(orientation: Orientation) -> None:
    frame = noise_frame("yuv420p", orientation=orientation)
    before = frame.pts, frame.time_base, frame.index, frame.duration
    shown = np.random.default_rng(0).integers(0, 256, (6, 9, 3), np.uint8)
    rgb = shown.copy()
    frame.show(rgb)
    rgb[:] = 0
    assert (frame.width, frame.height) == (9, 6)
    assert (frame.pts, frame.time_base, frame.index, frame.duration) == before
    assert frame.luma.shape == (6, 9)
    np.testing.assert_array_equal(frame.rgb(), shown)
    np.testing.assert_array_equal(frame.copy().rgb(), shown)


def test_luma_is_a_read_only_view_and_follows_writes() -> None:
    frame = noise_frame("yuv420p")
    view = frame.luma
    assert not view.flags.writeable
    assert view.base is not None
    frame.write_roi(0, 0, np.full((4, 4, 3), 9, np.uint8))
    assert (frame.luma[:4, :4] == 9).all()
    assert (view[:4, :4] == 9).all()


@pytest.mark.parametrize("fmt", SHALLOW_FORMATS)
def test_copy_is_independent_and_equal(fmt: str) -> None:
    frame = noise_frame(fmt, orientation=Orientation(transpose=True))
    twin = frame.copy()
    np.testing.assert_array_equal(frame.rgb(), twin.rgb())
    twin.write_roi(0, 0, np.zeros((4, 4, 3), np.uint8))
    assert not np.array_equal(frame.luma, twin.luma)
    assert (twin.pts, twin.time_base, twin.index) == (frame.pts, frame.time_base, frame.index)


@pytest.mark.parametrize("box", [(-1, 0, 4, 4), (0, 0, 38, 4), (0, 20, 4, 4), (0, 0, 0, 4)])
def test_rectangles_outside_the_picture_are_refused(box: tuple[int, int, int, int]) -> None:
    with pytest.raises(ValueError, match="rectangle must lie in the 37 x 23 picture, got x"):
        noise_frame("yuv420p").read_roi(*box)


def test_wrong_arrays_are_refused() -> None:
    with pytest.raises(ValueError, match=r"rgb must be \(h, w, 3\) uint8, got \(4, 4\) float64"):
        Frame.from_rgb(np.zeros((4, 4)))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"yuv must be \(h, w, 3\) uint8"):
        noise_frame("yuv420p").write_roi(0, 0, np.zeros((4, 4), np.uint8))


def test_the_whole_picture_is_given_as_a_copy() -> None:
    frame = Frame.from_rgb(np.zeros((6, 8, 3), np.uint8))
    before = frame.rgb()
    frame.write_roi(0, 0, np.full((6, 8, 3), 200, np.uint8))
    assert before.max() == 0
    assert frame.rgb().min() == 200


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=str)
@pytest.mark.parametrize("fmt", SHALLOW_FORMATS)
def test_quick_rgb_is_near_rgb_also_after_a_change(fmt: str, orientation: Orientation) -> None:
    frame = noise_frame(fmt, 64, 48, orientation)
    x, y, w, h = frame.align_roi(0, 0, frame.width, frame.height)
    smooth = cv2.GaussianBlur(frame.read_roi(x, y, w, h), (0, 0), 6)
    frame.write_roi(x, y, np.asarray(smooth, np.uint8))
    away = np.abs(frame.quick_rgb().astype(int) - frame.rgb())
    assert frame.quick_rgb().shape == (frame.height, frame.width, 3)
    assert away.max() <= 6


def test_brightness_drawn_into_an_rgb_picture_is_grey_and_the_rest_is_untouched() -> None:
    rgb = np.random.default_rng(0).integers(60, 190, (6, 8, 3)).astype(np.uint8)
    frame = Frame.from_rgb(rgb)
    frame.write_yuv(1, 1, frame.read_yuv(1, 1, 6, 4))
    np.testing.assert_array_equal(frame.rgb(), rgb)
    brighter = frame.read_yuv(2, 1, 3, 2)
    brighter[..., 0] += 40
    frame.write_yuv(2, 1, brighter)
    change = frame.rgb().astype(int) - rgb
    assert np.abs(change[1:3, 2:5] - 40).max() <= 2
    change[1:3, 2:5] = 0
    assert not change.any()
