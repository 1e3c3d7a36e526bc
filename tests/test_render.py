"""The two compositors keep their contract and agree with each other and with plain arithmetic."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import Delaunay

import guise.render.compositor
from guise.render import Compositor, GLInfo, GLMissing, RendererError, feather, make_compositor
from guise.render.gl import GLCompositor

LANDMARKS = Path(__file__).parents[1] / "sample_videos" / "p01" / "talk.npz"
GRID = (220, 200)
BOTH = [pytest.param("gl", marks=pytest.mark.egl), "cpu"]
QUAD = np.array([[0, 1, 2], [2, 1, 3]], np.int32)

Make = Callable[..., Compositor]


@pytest.fixture
def make() -> Iterator[Make]:
    """make_compositor whose results are closed, and free of GL errors, at the end."""
    made: list[Compositor] = []

    def build(*arguments: object) -> Compositor:
        made.append(make_compositor(*arguments))
        return made[-1]

    yield build
    for compositor in made:
        if isinstance(compositor, GLCompositor):
            assert compositor.context.error == "GL_NO_ERROR"
        compositor.close()


def fit(points: np.ndarray, height: int, width: int, margin: float) -> np.ndarray:
    """Landmarks scaled into a picture, keeping their aspect."""
    points = points - points.min(0)
    scale = min((width - 2 * margin) / points[:, 0].max(), (height - 2 * margin) / points[:, 1].max())
    return (points * scale + margin).astype(np.float32)


def face(frame: int, height: int, width: int, margin: float = 4) -> np.ndarray:
    with np.load(LANDMARKS) as data:
        return fit(data["landmarks"][frame], height, width, margin)


def face_mesh() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles, uv and feathered alpha of a real face on GRID."""
    uv = face(0, *GRID)
    mask = np.zeros(GRID, np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(uv).astype(np.int32), 1)
    return Delaunay(uv).simplices.astype(np.int32), uv, feather(mask > 0, 6)


def picture(seed: int, height: int, width: int, channels: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, channels), dtype=np.uint8)


def quad(height: int, width: int) -> np.ndarray:
    """The outer corners of a picture's pixels, in the order that QUAD joins."""
    right, bottom = width - 0.5, height - 0.5
    return np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]], np.float32)


def assert_agree(first: np.ndarray, second: np.ndarray, inside: np.ndarray) -> None:
    difference = np.abs(first.astype(int) - second)
    assert difference[~inside].max(initial=0) == 0
    if inside.any():
        assert difference.max() <= 4
        assert difference[inside].mean() <= 1


def compare(gl: Compositor, cpu: Compositor, roi: np.ndarray, *rest: object) -> np.ndarray:
    """Assert that the compositors agree on one picture; the pixels inside the mask."""
    warps = [c.warp(roi.shape[:2], *rest[:2]) for c in (gl, cpu)]
    assert ((warps[0] == 0).all(-1) == (warps[1] == 0).all(-1)).mean() > 0.999
    inside = (warps[0][..., 3] > 0) | (warps[1][..., 3] > 0)
    results = [c.composite(roi, *rest) for c in (gl, cpu)]
    assert_agree(*results, inside)
    return inside


@pytest.mark.egl
@pytest.mark.parametrize("size", [(320, 320), (480, 600), (97, 81)])
@pytest.mark.parametrize("frame", [0, 100, 250])
@pytest.mark.slow
def test_twins_agree_on_a_face_of_noise(make: Make, size: tuple[int, int], frame: int) -> None:
    mesh = face_mesh()
    inside = compare(
        make("gl", *mesh), make("cpu", *mesh), picture(1, *size), picture(2, *GRID), face(frame, *size)
    )
    assert inside.mean() > 0.3


@pytest.mark.egl
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.slow
def test_twins_agree_on_random_meshes_that_leave_the_rectangle(make: Make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    uv = rng.uniform(0, 99, (40, 2)).astype(np.float32)
    mesh = Delaunay(uv).simplices.astype(np.int32), uv, rng.random((100, 100), dtype=np.float32)
    vertices = uv * rng.uniform(0.5, 3, 2) + rng.uniform(-60, 60, 2) + rng.normal(0, 1.0, uv.shape)
    roi = picture(seed, 150, 170)
    inside = compare(make("gl", *mesh), make("cpu", *mesh), roi, picture(seed + 1, 100, 100), vertices, 0.7)
    assert inside.any()


@pytest.mark.egl
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.slow
def test_twins_draw_folded_meshes_in_the_same_order(make: Make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    uv = rng.uniform(0, 99, (30, 2)).astype(np.float32)
    mesh = Delaunay(uv).simplices.astype(np.int32), uv, np.ones((100, 100), np.float32)
    vertices = rng.uniform(-20, 180, uv.shape)  # the mesh covers itself many times
    smooth = cv2.GaussianBlur(picture(seed, 100, 100), (0, 0), 4)  # and is shrunk up to 50 times
    compare(make("gl", *mesh), make("cpu", *mesh), picture(seed, 160, 160), smooth, vertices)


@pytest.mark.parametrize("renderer", BOTH)
def test_later_triangles_cover_earlier_ones(make: Make, renderer: str) -> None:
    uv = np.concatenate([quad(8, 8), quad(8, 8)])
    texture = np.zeros((8, 16, 3), np.uint8)
    texture[:, :8], texture[:, 8:] = 10, 200
    uv[4:, 0] += 8
    triangles = np.concatenate([QUAD, QUAD + 4])
    vertices = np.concatenate([quad(8, 8), quad(8, 8)])
    roi = np.zeros((8, 8, 3), np.uint8)
    for order, value in ((triangles, 200), (triangles[::-1], 10)):
        compositor = make(renderer, order, uv, np.ones((8, 16), np.float32))
        assert np.median(compositor.composite(roi, texture, vertices)) == value


@pytest.mark.egl
@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (4, 1), (1, 4), (63, 64), (65, 129), (700, 900)])
@pytest.mark.slow
def test_twins_agree_at_every_size(make: Make, size: tuple[int, int]) -> None:
    mesh = face_mesh()
    vertices = face(30, 700, 900) - (450 - size[1] / 2, 350 - size[0] / 2)  # the face's middle in the middle
    inside = compare(make("gl", *mesh), make("cpu", *mesh), picture(3, *size), picture(4, *GRID), vertices)
    assert inside.any()


@pytest.mark.egl
def test_growing_and_shrinking_rectangles_leave_no_trace(make: Make) -> None:
    mesh = face_mesh()
    gl, cpu = make("gl", *mesh), make("cpu", *mesh)
    for side in (40, 300, 60, 301, 45, 130):
        compare(gl, cpu, picture(side, side, side + 9), picture(5, *GRID), face(10, side, side + 9, 2))


@pytest.mark.egl
def test_twins_agree_with_more_triangles_than_a_byte_counts(make: Make) -> None:
    rng = np.random.default_rng(5)
    uv = rng.uniform(0, 99, (300, 2)).astype(np.float32)
    mesh = Delaunay(uv).simplices.astype(np.int32), uv, np.ones((100, 100), np.float32)
    assert len(mesh[0]) > 500
    compare(make("gl", *mesh), make("cpu", *mesh), picture(6, 200, 200), picture(7, 100, 100), uv * 1.9)


@pytest.mark.egl
def test_two_gl_compositors_may_take_turns(make: Make) -> None:
    mesh = face_mesh()
    first, second, cpu = make("gl", *mesh), make("gl", *mesh), make("cpu", *mesh)
    for seed in range(3):
        for gl in (first, second):
            compare(gl, cpu, picture(seed, 120, 110), picture(seed + 9, *GRID), face(seed, 120, 110))


@pytest.mark.parametrize("renderer", BOTH)
def test_identity_reproduces_the_texture(make: Make, renderer: str) -> None:
    compositor = make(renderer, QUAD, quad(50, 70), np.ones((50, 70), np.float32))
    texture = picture(8, 50, 70)
    np.testing.assert_array_equal(compositor.composite(picture(9, 50, 70), texture, quad(50, 70)), texture)


@pytest.mark.parametrize("renderer", BOTH)
@pytest.mark.parametrize("shift", [(7, 11), (-5, 3), (90, 0), (-70, -50)])
def test_integer_translation_is_exact(make: Make, renderer: str, shift: tuple[int, int]) -> None:
    compositor = make(renderer, QUAD, quad(50, 70), np.ones((50, 70), np.float32))
    texture, roi = picture(8, 50, 70), picture(9, 80, 100)
    expected = np.pad(roi, ((50, 50), (70, 70), (0, 0)))
    x, y = 70 + shift[0], 50 + shift[1]
    expected[y : y + 50, x : x + 70] = texture
    result = compositor.composite(roi, texture, quad(50, 70) + np.float32(shift))
    np.testing.assert_array_equal(result, expected[50:-50, 70:-70])


@pytest.mark.parametrize("renderer", BOTH)
def test_pixel_centres_are_at_integers(make: Make, renderer: str) -> None:
    """Texture pixel u comes to lie at 2 u, so pixel x shows the texture at x / 2, where it is 4 x."""
    ramp = np.zeros((30, 30, 3), np.uint8)
    ramp[..., 0], ramp[..., 1] = np.arange(30) * 8, np.arange(30)[:, None] * 8
    compositor = make(renderer, QUAD, quad(30, 30), np.ones((30, 30), np.float32))
    result = compositor.composite(np.zeros((59, 59, 3), np.uint8), ramp, 2 * quad(30, 30))
    expected = np.arange(59) * 4
    assert np.abs(result[..., 0].astype(int) - expected).max() <= 1
    assert np.abs(result[..., 1].astype(int) - expected[:, None]).max() <= 1


@pytest.mark.parametrize("renderer", BOTH)
def test_beyond_the_last_texel_the_edge_is_repeated(make: Make, renderer: str) -> None:
    texture = np.zeros((4, 4, 3), np.uint8)
    texture[:, 0], texture[:, -1] = 40, 240
    compositor = make(renderer, QUAD, quad(4, 4), np.ones((4, 4), np.float32))
    result = compositor.composite(np.zeros((40, 40, 3), np.uint8), texture, quad(40, 40) * 1.0)
    assert (result[:, :5] == 40).all()
    assert (result[:, -5:] == 240).all()


@pytest.mark.parametrize("renderer", BOTH)
def test_triangles_without_area_draw_nothing(make: Make, renderer: str) -> None:
    triangles, uv, alpha = face_mesh()
    flat = np.array([[0, 0, 1], [5, 5, 5], [2, 3, 2]], np.int32)
    roi, texture, vertices = picture(1, 90, 90), picture(2, *GRID), face(40, 90, 90)
    plain = make(renderer, triangles, uv, alpha).composite(roi, texture, vertices)
    more = make(renderer, np.concatenate([flat, triangles, flat]), uv, alpha).composite(
        roi, texture, vertices
    )
    np.testing.assert_array_equal(more, plain)


@pytest.mark.parametrize("renderer", BOTH)
@pytest.mark.parametrize(
    "vertices",
    [np.full((81, 2), 12.5), np.full((81, 2), -900.0), np.linspace(0, 99, 162).reshape(81, 2)],
    ids=["a point", "far outside", "a line"],
)
def test_a_mesh_that_covers_nothing_changes_nothing(make: Make, renderer: str, vertices: np.ndarray) -> None:
    roi = picture(1, 100, 100)
    result = make(renderer, *face_mesh()).composite(roi, picture(2, *GRID), vertices)
    np.testing.assert_array_equal(result, roi)


@pytest.mark.parametrize("renderer", BOTH)
def test_result_is_bit_identical_where_alpha_is_zero(make: Make, renderer: str) -> None:
    triangles, uv, alpha = face_mesh()
    every_value = np.arange(300 * 300 * 3, dtype=np.uint32).astype(np.uint8).reshape(300, 300, 3)
    compositor = make(renderer, triangles, uv, alpha)
    texture, vertices = picture(2, *GRID), face(100, 300, 300)
    outside = compositor.warp((300, 300), texture, vertices)[..., 3] == 0
    result = compositor.composite(every_value, texture, vertices)
    np.testing.assert_array_equal(result[outside], every_value[outside])
    assert (result != every_value).any()
    compositor.set_alpha(np.zeros(GRID, np.float32))
    np.testing.assert_array_equal(compositor.composite(every_value, texture, vertices), every_value)


@pytest.mark.parametrize("renderer", BOTH)
@pytest.mark.parametrize("opacity", [0.0, 0.25, 1.0])
def test_opacity_scales_alpha(make: Make, renderer: str, opacity: float) -> None:
    compositor = make(renderer, QUAD, quad(20, 20), np.full((20, 20), 0.6, np.float32))
    roi, texture = np.full((20, 20, 3), 200, np.uint8), np.full((20, 20, 3), 100, np.uint8)
    result = compositor.composite(roi, texture, quad(20, 20), opacity)
    assert np.abs(result - (200 - 60 * opacity)).max() <= 0.75
    if opacity == 0:
        np.testing.assert_array_equal(result, roi)


@pytest.mark.parametrize("renderer", BOTH)
def test_blend_is_alpha_arithmetic(make: Make, renderer: str) -> None:
    alpha = 0.1 + 0.9 * np.random.default_rng(3).random((40, 40), dtype=np.float32)
    compositor = make(renderer, QUAD, quad(40, 40), alpha)
    roi, texture = picture(1, 40, 40), picture(2, 40, 40)
    expected = texture * alpha[..., None] + roi * (1 - alpha[..., None])
    assert np.abs(compositor.composite(roi, texture, quad(40, 40)) - expected).max() < 1.05


@pytest.mark.parametrize("renderer", BOTH)
def test_where_the_mesh_ends_alpha_ends_within_a_pixel(make: Make, renderer: str) -> None:
    compositor = make(renderer, QUAD, quad(20, 20), np.ones((20, 20), np.float32))
    roi, texture = np.zeros((30, 30, 3), np.uint8), np.full((20, 20, 3), 255, np.uint8)
    row = compositor.composite(roi, texture, quad(20, 20) + 5)[15, :, 0]
    assert row[:5].tolist() == row[25:].tolist() == [0] * 5
    assert row[6:24].tolist() == [255] * 18
    steep = compositor.composite(
        roi, texture, quad(20, 20) * (1, 0.3) @ np.array([[1, 0.6], [0, 1]]) + (5, 5)
    )
    assert ((steep > 40) & (steep < 215)).any(2).sum() > 20  # no steps


@pytest.mark.parametrize("renderer", BOTH)
def test_float_textures_are_rounded_and_saturated(make: Make, renderer: str) -> None:
    compositor = make(renderer, QUAD, quad(2, 3), np.ones((2, 3), np.float32))
    texture = np.array([-20, 0.4, 0.6, 99.49, 254.7, 400], np.float32).reshape(2, 3, 1).repeat(3, 2)
    result = compositor.composite(np.zeros((2, 3, 3), np.uint8), texture, quad(2, 3))
    assert result[..., 0].ravel().tolist() == [0, 0, 1, 99, 255, 255]


@pytest.mark.parametrize("renderer", BOTH)
def test_compositing_in_place_of_a_slice_touches_nothing_else(make: Make, renderer: str) -> None:
    compositor = make(renderer, *face_mesh())
    frame, texture, vertices = picture(1, 200, 260), picture(2, *GRID), face(5, 120, 130)
    before = frame.copy()
    roi = frame[30:150, 50:180]
    expected = compositor.composite(roi, texture, vertices)
    np.testing.assert_array_equal(frame, before)
    assert compositor.composite(roi, texture, vertices, out=roi) is roi
    before[30:150, 50:180] = expected
    np.testing.assert_array_equal(frame, before)
    other = np.empty_like(expected)
    assert compositor.composite(before[30:150, 50:180], texture, vertices, out=other) is other


@pytest.mark.parametrize("renderer", BOTH)
def test_warp_keeps_colour_and_alpha_apart(make: Make, renderer: str) -> None:
    alpha = np.full((10, 10), 0.4, np.float32)
    compositor = make(renderer, QUAD, quad(10, 10), alpha)
    texture = picture(3, 10, 10)
    warped = compositor.warp((16, 18), texture, quad(10, 10) + 4)
    np.testing.assert_array_equal(warped[4:14, 4:14, :3], texture)
    assert (warped[4:14, 4:14, 3] == 102).all()
    warped[4:14, 4:14] = 0
    assert not warped.any()


@pytest.mark.parametrize("renderer", BOTH)
def test_results_belong_to_the_caller(make: Make, renderer: str) -> None:
    compositor = make(renderer, *face_mesh())
    roi, vertices = picture(1, 90, 90), face(5, 90, 90)
    first = compositor.composite(roi, picture(2, *GRID), vertices)
    kept = first.copy()
    compositor.composite(roi, picture(3, *GRID), vertices)
    np.testing.assert_array_equal(first, kept)


GOOD = {
    "roi": np.zeros((9, 9, 3), np.uint8),
    "texture": np.zeros((20, 20, 3), np.uint8),
    "vertices": quad(9, 9),
    "opacity": 1.0,
    "out": None,
}


@pytest.mark.parametrize("renderer", BOTH)
@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("roi", np.zeros((9, 9), np.uint8), r"roi must be \(h, w, 3\) uint8, got \(9, 9\)"),
        ("roi", np.zeros((9, 9, 3)), "got .* float64"),
        ("roi", np.zeros((0, 9, 3), np.uint8), r"got \(0, 9, 3\)"),
        ("roi", np.zeros((9, 18, 3), np.uint8)[:, ::2], "side by side"),
        ("texture", np.zeros((20, 21, 3), np.uint8), r"texture must be \(20, 20, 3\), got \(20, 21, 3\)"),
        ("texture", np.zeros((20, 20, 3), np.int16), "texture must be uint8 or float32, got int16"),
        ("vertices", quad(9, 9)[:3], r"vertices must be \(4, 2\), got \(3, 2\)"),
        ("vertices", quad(9, 9) * np.nan, "vertices must be finite"),
        ("vertices", quad(9, 9) + 20_000, "within 8000 pixels"),
        ("opacity", 1.01, r"opacity must lie in \[0, 1\], got 1.01"),
        ("opacity", float("nan"), "opacity"),
        ("out", np.zeros((9, 8, 3), np.uint8), r"out must be \(9, 9, 3\) like roi, got \(9, 8, 3\)"),
        ("out", np.zeros((9, 9, 3)), "out must be .* uint8"),
    ],
)
@pytest.mark.slow
def test_bad_arguments_are_refused_in_one_sentence(
    make: Make, renderer: str, name: str, value: object, message: str
) -> None:
    compositor = make(renderer, QUAD, quad(20, 20), np.ones((20, 20), np.float32))
    compositor.composite(**GOOD)
    with pytest.raises(RendererError, match=message):
        compositor.composite(**{**GOOD, name: value})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("vulkan", QUAD, quad(9, 9), np.ones((9, 9))),
            "renderer must be one of auto, gl, cpu, got 'vulkan'",
        ),
        (("cpu", QUAD[:, :2], quad(9, 9), np.ones((9, 9))), r"triangles must be \(t, 3\)"),
        (("cpu", QUAD + 1, quad(9, 9), np.ones((9, 9))), "integers from 0 to 3"),
        (("cpu", QUAD * 1.0, quad(9, 9), np.ones((9, 9))), "integers from 0 to 3"),
        (("cpu", np.zeros((65535, 3), int), quad(9, 9), np.ones((9, 9))), "fewer than 65535"),
        (("cpu", QUAD, quad(9, 9)[:2], np.ones((9, 9))), r"uv must be \(v, 2\) with v >= 3, got \(2, 2\)"),
        (("cpu", QUAD, quad(9, 10), np.ones((9, 9))), "uv must lie on the texture of 9 x 9 texels"),
        (("cpu", QUAD, quad(9, 9), np.ones((9, 9), int)), r"alpha must be \(th, tw\) float"),
        (("cpu", QUAD, quad(9, 9), np.full((9, 9), 1.5)), r"alpha must lie in \[0, 1\]"),
        (("cpu", QUAD, quad(9, 9), np.full((9, 9), np.nan)), r"alpha must lie in \[0, 1\]"),
    ],
)
def test_bad_meshes_are_refused_in_one_sentence(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(RendererError, match=message):
        make_compositor(*arguments)


@pytest.mark.parametrize("renderer", BOTH)
def test_another_alpha_must_fit_the_texture(make: Make, renderer: str) -> None:
    compositor = make(renderer, QUAD, quad(9, 9), np.ones((9, 9), np.float32))
    with pytest.raises(RendererError, match=r"alpha must be \(9, 9\), got \(9, 8\)"):
        compositor.set_alpha(np.ones((9, 8), np.float32))


@pytest.mark.egl
def test_gl_refuses_another_thread(make: Make) -> None:
    compositor = make("gl", QUAD, quad(20, 20), np.ones((20, 20), np.float32))
    caught: list[str] = []

    def use() -> None:
        try:
            compositor.composite(**GOOD)
        except RendererError as error:
            caught.append(str(error))

    thread = threading.Thread(target=use)
    thread.start()
    thread.join()
    assert caught == ["a GL compositor must be used in the thread that made it"]


@pytest.mark.egl
def test_gl_refuses_work_after_close_and_closes_twice() -> None:
    with make_compositor("gl", QUAD, quad(20, 20), np.ones((20, 20), np.float32)) as compositor:
        compositor.composite(**GOOD)
    compositor.close()
    with pytest.raises(RendererError, match="closed"):
        compositor.composite(**GOOD)


@pytest.mark.egl
def test_gl_errors_are_raised_by_the_picture_they_belong_to(make: Make) -> None:
    compositor = make("gl", QUAD, quad(20, 20), np.ones((20, 20), np.float32))
    assert isinstance(compositor, GLCompositor)
    with compositor.context as context:
        context.viewport = (0, 0, -1, -1)
    with pytest.raises(RendererError, match="GL reported GL_INVALID_VALUE while compositing"):
        compositor.composite(**GOOD)
    compositor.composite(**GOOD)


def info(software: bool) -> GLInfo:
    return GLInfo("llvmpipe" if software else "Quick GPU", "vendor", "4.5", software)


@pytest.mark.parametrize(
    ("found", "words"),
    [(info(True), "GL is software, llvmpipe"), (GLMissing("no GL context could be made"), "no GL context")],
)
def test_auto_takes_the_cpu_without_hardware_gl_and_says_why(
    make: Make, monkeypatch: pytest.MonkeyPatch, found: GLInfo | GLMissing, words: str
) -> None:
    monkeypatch.setattr(guise.render.compositor, "may_have_hardware", lambda: True)
    monkeypatch.setattr(guise.render.compositor, "probe_gl", lambda: found)
    compositor = make("auto", QUAD, quad(20, 20), np.ones((20, 20), np.float32))
    assert compositor.name == "cpu"
    assert compositor.description.startswith("CPU: ")
    assert words in compositor.description


def test_auto_makes_no_context_where_there_is_no_graphics_device(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guise.render.context, "_DEVICES", ("no such device",))
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(guise.render.compositor, "probe_gl", None)
    compositor = make("auto", QUAD, quad(20, 20), np.ones((20, 20), np.float32))
    assert compositor.description.endswith("(auto: no graphics device)")


@pytest.mark.parametrize("system", ["linux", "darwin", "win32"])
def test_a_graphics_device_or_another_system_may_have_hardware(
    monkeypatch: pytest.MonkeyPatch, system: str
) -> None:
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.setattr(guise.render.context, "_DEVICES", ("null",) if system == "linux" else ())
    assert guise.render.context.may_have_hardware()


@pytest.mark.egl
def test_auto_takes_hardware_gl(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guise.render.compositor, "may_have_hardware", lambda: True)
    monkeypatch.setattr(guise.render.compositor, "probe_gl", lambda: info(False))
    compositor = make("auto", QUAD, quad(20, 20), np.ones((20, 20), np.float32))
    assert compositor.name == "gl"
    assert compositor.description.startswith("GL: ")
    assert "hardware" in compositor.description
