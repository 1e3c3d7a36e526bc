"""What hides a face is found, light and shadow aren't, and its pixels come back unchanged."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from models import model_file
from numpy.testing import assert_array_equal
from watched_cover import (
    BLACK,
    PAUSE_FRAMES,
    Scene,
    Watch,
    between_eyes,
    drawn,
    fake_parsing,
    square,
)

from guise.aam.landmarks.schemes import (
    BROWS,
    CHIN,
    HAIRLINE,
    LEFT_EYE,
    LOWER_LIP_BOTTOM,
    NOSE,
    NOSE_ROOT,
    NOSE_TIP,
    OUTER_LIPS,
    RIGHT_EYE,
)
from guise.aam.mask import soft_parts
from guise.aam.model import Identity
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.face import PAUSE_SECONDS
from guise.app.drawing.look import PAPER, SWAP
from guise.app.drawing.passes import cover
from guise.app.drawing.passes.cover import shown_mask
from guise.app.media import Frame
from guise.common.arrays import U8


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


@pytest.fixture
def scene(p01: Identity) -> Scene:
    return Scene(p01)


def test_nothing_hides_the_inner_face_in_plain_view(scene: Scene) -> None:
    left = scene.show(scene.rgb)
    assert scene.watch.visible.mean() > 0.98
    if left is not None:
        inner = soft_parts(scene.reference, (RIGHT_EYE, LEFT_EYE, OUTER_LIPS, NOSE), 0.02) > 0.5
        assert left[inner].min() > 0.95


def test_a_shadow_is_not_taken_for_an_object(scene: Scene) -> None:
    shadow = np.where(np.arange(scene.rgb.shape[1])[None, :, None] > scene.shape[NOSE_TIP, 0], 0.5, 1.0)
    scene.show(np.asarray(scene.rgb * shadow, np.uint8))
    assert scene.watch.visible.mean() > 0.95


def test_an_object_hides_what_is_behind_it_and_nothing_else(scene: Scene) -> None:
    rgb, y = scene.with_object()
    left = scene.show(rgb)
    visible, places = scene.watch.visible, scene.places
    assert left is not None
    behind = (places[:, 1] > y + 8) & (np.abs(places[:, 0] - scene.shape[NOSE_TIP, 0]) < 30)
    assert visible[behind].mean() < 0.1
    assert visible[places[:, 1] < y - 25].mean() > 0.97
    assert left.min() < 0.05


def test_an_object_that_leaves_leaves_nothing(scene: Scene) -> None:
    rgb, _ = scene.with_object()
    scene.show(rgb)
    scene.show(scene.rgb, 8)
    assert scene.watch.visible.mean() > 0.98


def test_the_colours_behind_an_object_are_those_seen_before(scene: Scene) -> None:
    rgb, y = scene.with_object()
    scene.show(scene.rgb)
    before = scene.watch.face.seen.clear
    scene.watch.memory.cover.due = 0.0  # it comes in a frame that is parsed
    scene.show(rgb, 2 * PAUSE_FRAMES)
    after = scene.watch.face.seen.clear
    assert np.abs(after - before).mean() < 3
    blue = scene.places[:, 1] > y + 8
    assert np.abs(after - before)[blue].mean() < 12
    assert np.abs(scene.watch.face.seen.rgb - before)[blue].mean() > 20


def test_the_share_follows_the_mesh_that_is_drawn(scene: Scene) -> None:
    rgb, _ = scene.with_object()
    still = scene.show(rgb)
    per_grid_pixel = np.ptp(scene.shape[:, 0]) / scene.reference.resolution
    lower = Watch(scene.person)(rgb, scene.shape, scene.shape + np.array([0, 5 * per_grid_pixel]))
    assert still is not None
    assert lower is not None
    away = np.abs(lower[20:-20, 30:-30] - still[25:-15, 30:-30])
    assert away.mean() < 0.03


def test_only_some_frames_are_parsed_while_nothing_in_front_moves(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    real = cover.parse_frame
    monkeypatch.setattr(cover, "parse_frame", lambda *given: calls.append(1) or real(*given))
    every = PAUSE_FRAMES
    scene.show(scene.rgb, 2 * every)
    assert len(calls) == 2
    rgb, y = scene.with_object()
    scene.show(rgb, 1 + 2 * every)  # it is new in the first of them, and lies still from then on
    assert len(calls) == 2 + 1 + 2
    for rise in range(5, 30, 5):
        rgb[y - rise : y] = rgb[y : y + rise]
        scene.show(rgb)
    scene.show(rgb)
    assert len(calls) >= 2 + 1 + 2 + 6 - (PAUSE_FRAMES - 1)


def test_a_frame_is_parsed_when_the_eyes_move(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    real = cover.parse_frame
    monkeypatch.setattr(cover, "parse_frame", lambda *given: calls.append(1) or real(*given))

    def show(rgb: U8) -> int:
        before = len(calls)
        scene.show(rgb)
        return len(calls) - before

    aside = scene.rgb.copy()
    x0, y0 = np.floor(scene.shape[list(LEFT_EYE)].min(0)).astype(int)
    x1, y1 = np.ceil(scene.shape[list(LEFT_EYE)].max(0)).astype(int)
    aside[y0:y1, x0:x1] = np.roll(scene.rgb[y0:y1, x0:x1], (x1 - x0) // 5, axis=1)
    assert [show(rgb) for rgb in (scene.rgb, scene.rgb, aside, aside, scene.rgb)] == [1, 0, 1, 0, 1]
    darker = np.uint8(0.8 * scene.rgb)
    assert show(darker) == 0


@pytest.mark.parametrize(("radius_face_widths", "parsed"), [(0.025, 2), (0.1, 6)])
def test_only_a_large_object_that_moves_beside_the_face_has_every_frame_parsed(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, radius_face_widths: float, parsed: int
) -> None:
    plain = cover.parse_frame(FaceParser(), Frame.from_rgb(scene.rgb), scene.shape)
    low, high = scene.shape.min(0), scene.shape.max(0)
    x, y = plain.to_cells @ [low[0], high[1], 1]  # the lower left corner of the face's box
    radius = radius_face_widths * (high - low)[0] * np.hypot(*plain.to_cells[:, 0])
    calls: list[int] = []

    def parsing(*_: object) -> FaceParsing:
        shares = np.zeros_like(plain.shares)
        place = round(x), round(y - 2 * radius * (len(calls) % 2))
        cv2.circle(shares[FaceClass.OCCLUDER], place, round(radius), 1.0, -1)
        calls.append(1)
        return FaceParsing(shares, plain.to_picture, plain.irises)

    monkeypatch.setattr(cover, "parse_frame", parsing)
    scene.show(scene.rgb, 2 * (PAUSE_FRAMES))
    assert len(calls) == parsed


@pytest.mark.parametrize("renderer", ["cpu", pytest.param("gl", marks=pytest.mark.egl)])
def test_the_pixels_of_an_object_come_back_unchanged(p01: Identity, renderer: str) -> None:
    before, after, shape = drawn(p01, replace(SWAP, renderer=renderer))
    x, y = square(shape)
    chin = int(shape[CHIN, 1])
    assert chin - y > 30
    assert_array_equal(after[y + 20 : chin, x - 12 : x + 12], before[y + 20 : chin, x - 12 : x + 12])
    root = np.round(shape[NOSE_ROOT]).astype(int)
    assert (
        np.abs(
            after[root[1] - 5 : root[1] + 5, root[0] - 5 : root[0] + 5].astype(int)
            - before[root[1] - 5 : root[1] + 5, root[0] - 5 : root[0] + 5]
        ).mean()
        > 1
    )


@pytest.mark.egl
def test_both_renderers_draw_an_occlusion_alike(p01: Identity) -> None:
    on_cpu, on_gl = (drawn(p01, replace(SWAP, renderer=r))[1].astype(int) for r in ("cpu", "gl"))
    assert np.abs(on_cpu - on_gl).max() <= 4


def test_by_the_papers_formulas_everything_is_covered(p01: Identity) -> None:
    before, after, shape = drawn(p01, replace(PAPER, renderer="cpu"))
    x, y = square(shape)
    assert (after[y + 20 : y + 30, x - 12 : x + 12] != before[y + 20 : y + 30, x - 12 : x + 12]).any()


def test_brows_are_shown_whatever_the_sources_mask_says() -> None:
    reference = ReferenceFrame.canonical(64)
    nothing = np.zeros(reference.size, bool)
    shown = shown_mask(nothing, reference)
    x, y = np.round(reference.points[BROWS]).astype(int).T
    assert shown[y, x].all()
    x, y = np.round(reference.points[HAIRLINE]).astype(int)
    assert not shown[y + 2, x]
    assert shown_mask(reference.mask, reference)[reference.mask].all()


@pytest.mark.parametrize("rate", [25, 30, 60])
def test_frames_are_parsed_as_often_at_any_frame_rate(
    p01: Identity, monkeypatch: pytest.MonkeyPatch, rate: int
) -> None:
    shape, calls = p01.reference.points * (64 / p01.reference.resolution), []
    parsing = fake_parsing(FaceClass.SKIN, slice(0, 64), slice(0, 64))
    monkeypatch.setattr(cover, "parse_frame", lambda *_: calls.append(1) or parsing)
    watch = Watch(p01, watches_eyes=False)
    for _ in range(2 * rate):
        watch(BLACK, shape, seconds=1 / rate)
    assert 0.8 * 2 / PAUSE_SECONDS <= len(calls) <= 2 / PAUSE_SECONDS


@pytest.mark.parametrize(("rows", "stays"), [(slice(20, 34), False), (slice(0, 34), True)])
def test_only_what_reaches_in_from_beyond_the_face_stays_in_front(
    p01: Identity, monkeypatch: pytest.MonkeyPatch, rows: slice, *, stays: bool
) -> None:
    watch = Watch(p01, watches_eyes=False)
    parsing = fake_parsing(FaceClass.OCCLUDER, slice(28, 36), rows)
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    left = watch(BLACK, watch.reference.points * (64 / watch.reference.resolution))
    assert (left is not None and left[between_eyes(watch)] < 0.1) == stays


def test_what_is_taken_for_an_object_once_is_none(p01: Identity, monkeypatch: pytest.MonkeyPatch) -> None:
    watch = Watch(p01, watches_eyes=False)
    shape = watch.reference.points * (64 / watch.reference.resolution)
    shown = [fake_parsing(FaceClass.OCCLUDER, slice(28, 36), slice(rows)) for rows in (0, 34, 34)]
    monkeypatch.setattr(cover, "parse_frame", lambda *_: shown.pop(0))
    hidden = []
    while shown:
        watch.memory.cover.due = 0.0
        left = watch(BLACK, shape)
        hidden.append(left is not None and bool(left[between_eyes(watch)] < 0.1))
    assert hidden == [False, False, True]


@pytest.mark.parametrize(
    ("first", "bearded", "stays"), [(50, True, False), (50, False, True), (0, True, True)]
)
def test_what_lies_in_the_persons_beard_is_no_object(
    p01: Identity, monkeypatch: pytest.MonkeyPatch, first: int, *, bearded: bool, stays: bool
) -> None:
    """But what reaches far beyond it is, a hand before the chin say."""
    reference = p01.reference
    scale = 50 / reference.resolution  # the chin lies on row 60
    beard = np.zeros(reference.size, np.float32)
    beard[round(49 / scale) :] = 1
    watch = Watch(p01, watches_eyes=False, beard=beard if bearded else None)
    parsing = fake_parsing(FaceClass.OCCLUDER, slice(22, 32), slice(first, 64))
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    left = watch(BLACK, reference.points * scale)
    x, y = np.round((reference.points[CHIN] + reference.points[LOWER_LIP_BOTTOM]) / 2).astype(int)
    assert (left is not None and bool(left[y, x] < 0.1)) == stays
