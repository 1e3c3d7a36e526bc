"""What hides a face is found, light and shadow aren't, and its pixels come back unchanged."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from drawing import pass_time
from made_up import SAMPLES
from models import model_file
from numpy.testing import assert_array_equal
from worn_rims import lenses, with_rims

from guise.aam import rims
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
    Group,
)
from guise.aam.mask import soft_parts
from guise.aam.model import Identity
from guise.aam.parameters import ParameterEstimator
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.face import PAUSE_SECONDS, FaceInFrame, Seen
from guise.app.drawing.look import DISGUISE, PAPER, SWAP, Look
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes import cover
from guise.app.drawing.passes.cover import LIMITS, Cover, shown_mask
from guise.app.media import Frame, open_input
from guise.common.arrays import F32, F64, U8
from guise.common.decay import FRAME_SECONDS

BLACK = np.zeros((8, 8, 3), np.uint8)
BLUE = np.array([30, 60, 200], np.uint8)
FRAMES = 6  # by which the memory has faded
PAUSE_FRAMES = round(PAUSE_SECONDS / FRAME_SECONDS)
SKIN_COLOUR, HAND_COLOUR = (200, 150, 130), (190, 145, 120)
HAIR_COLOUR, WALL_COLOUR = (50, 40, 35), (120, 140, 150)


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


class Watch:
    """A cover with what it remembers, looking frame by frame."""

    def __init__(
        self,
        person: Identity,
        *,
        only_objects: bool = False,
        beyond: F32 | None = None,
        watches_eyes: bool = True,
    ) -> None:
        self.reference, self.texels = person.reference, ParameterEstimator(person.appearance).sampler
        self.cover = Cover(
            self.reference, self.texels, only_objects=only_objects, beyond=beyond, watches_eyes=watches_eyes
        )
        self.memory = Memory()

    def __call__(
        self, rgb: U8, shape: F64, mesh: F64 | None = None, seconds: float = FRAME_SECONDS
    ) -> F32 | None:
        """What is left (h, w) of a face drawn at a mesh (81, 2), by default on the head itself."""
        pass_time(self.memory, seconds)
        frame, places = Frame.from_rgb(rgb), self.texels.positions(shape)
        colours = frame.sample_rgb(places)
        face = self.face = FaceInFrame(frame, shape, shape, seen=Seen(places, colours, colours))
        self.cover.look(face, self.memory)
        face.mesh = shape if mesh is None else mesh
        self.cover.share(face, self.memory)
        return face.canvas.share

    @property
    def visible(self) -> F32:
        assert self.face.seen.visible is not None
        return self.face.seen.visible


class Scene:
    """A frame of the first person with anything drawn over it, and what is found in front of the face."""

    def __init__(self, person: Identity) -> None:
        self.person, self.reference = person, person.reference
        self.watch = Watch(person)
        with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
            self.rgb = next(iter(clip)).rgb()
        self.shape = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][0].astype(np.float64)
        self.places = self.watch.texels.positions(self.shape)

    def show(self, rgb: U8, frames: int = 1) -> F32 | None:
        """Of the drawn face, what is left (h, w)."""
        for _ in range(frames):
            left = self.watch(rgb, self.shape)
        return left

    def with_object(self) -> tuple[U8, int]:
        """A blue square from the upper lip down; and its upper edge."""
        rgb = self.rgb.copy()
        x, y = square(self.shape)
        rgb[y:, x - 45 : x + 45] = BLUE
        return rgb, y


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


@pytest.mark.parametrize(("sides", "worn"), [((RIGHT_EYE,), False), ((RIGHT_EYE, LEFT_EYE), True)])
def test_glasses_are_worn_before_both_eyes(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, sides: tuple[Group, ...], worn: bool
) -> None:
    plain = cover.parse_frame(FaceParser(), Frame.from_rgb(scene.rgb), scene.shape)
    shares = np.zeros_like(plain.shares)
    for eye in sides:
        lens = cv2.convexHull(scene.shape[eye].astype(np.float32))[:, 0]
        lens = (2 * lens - lens.mean(0)) @ plain.to_cells[:, :2].T + plain.to_cells[:, 2]
        cv2.fillConvexPoly(shares[FaceClass.GLASSES], np.round(lens).astype(np.int32), 1.0)
    parsing = FaceParsing(shares, plain.to_picture, plain.irises)
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    left = scene.show(scene.rgb)
    assert (left is not None and left.min() < 0.1) == worn


def frames_with_an_object() -> tuple[list[U8], F64]:
    """Frames of the first person's second clip with a blue square over mouth and chin; and the true landmarks."""
    shapes = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"].astype(np.float64)
    pictures = []
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        for frame in clip:
            rgb = frame.rgb()
            if frame.index:
                x, y = square(shapes[frame.index])
                rgb[y:, x - 30 : x + 30] = BLUE
            pictures.append(rgb)
            if frame.index == FRAMES:
                return pictures, shapes
    raise AssertionError


def square(shape: F64) -> tuple[int, int]:
    """The middle of the upper edge of the object."""
    x, y = (shape[NOSE_TIP] + shape[LOWER_LIP_BOTTOM]) / 2
    return round(x), round(y)


def drawn(source: Identity, look: Look) -> tuple[U8, U8, F64]:
    """The last frame before and after a swap by p06, and its true landmarks."""
    pictures, shapes = frames_with_an_object()
    with Engine(source, Donor.of(Identity.load(model_file("p06"))), None, look) as engine:
        for rgb, shape in zip(pictures, shapes, strict=False):
            frame = Frame.from_rgb(rgb.copy())
            engine.draw(frame, shape)
    return pictures[-1], frame.rgb(), shapes[len(pictures) - 1]


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


def test_in_a_disguise_an_object_may_stay_in_front(p01: Identity) -> None:
    before, after, shape = drawn(p01, replace(DISGUISE, renderer="cpu"))
    x, y = square(shape)
    assert_array_equal(after[y + 20 : y + 30, x - 12 : x + 12], before[y + 20 : y + 30, x - 12 : x + 12])


def test_the_colours_of_an_object_do_not_reach_the_drawn_face(p01: Identity) -> None:
    look = replace(DISGUISE, renderer="cpu")
    pictures, shapes = frames_with_an_object()
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        plain = [frame.rgb() for frame, _ in zip(clip, pictures, strict=False)]
    faces = []
    for shown in (plain, pictures):
        with Engine(p01, Donor.of(Identity.load(model_file("p06"))), None, look) as engine:
            for rgb, shape in zip(shown, shapes, strict=False):
                frame = Frame.from_rgb(rgb.copy())
                engine.draw(frame, shape)
        faces.append(frame.rgb().astype(float))
    x, y = np.round(shapes[len(pictures) - 1][NOSE_ROOT]).astype(int)
    without, behind = (one[y - 30 : y, x - 30 : x + 30].mean((0, 1)) for one in faces)
    assert np.abs(without - behind).max() < 8


@pytest.fixture
def wary(p01: Identity) -> Watch:
    """Only objects that reach in from beyond the face stay in front."""
    return Watch(p01, only_objects=True, watches_eyes=False)


def fake_parsing(shown: FaceClass, x: slice, y: slice) -> FaceParsing:
    """Cells that lie on the reference frame's 64 x 64 first pixels: skin, and a rectangle of something else."""
    shares = np.zeros((len(FaceClass), 64, 64), np.float32)
    shares[FaceClass.SKIN] = 1
    shares[FaceClass.SKIN, y, x] = 0
    shares[shown, y, x] = 1
    return FaceParsing(shares, np.eye(2, 3), np.zeros((2, 4)))


@pytest.mark.parametrize(
    ("shown", "x", "kept"),
    [
        (FaceClass.OCCLUDER, slice(0, 35), True),
        (FaceClass.OCCLUDER, slice(25, 35), False),
        (FaceClass.HAIR, slice(0, 35), False),
        (FaceClass.GLASSES, slice(0, 35), False),
    ],
    ids=["a hand", "a patch within the face", "hair", "glasses"],
)
def test_where_no_part_of_the_person_may_show_only_objects_that_reach_in_stay_in_front(
    wary: Watch, monkeypatch: pytest.MonkeyPatch, shown: FaceClass, x: slice, kept: bool
) -> None:
    reference = ReferenceFrame.canonical(wary.reference.resolution)
    scale = 64 / reference.resolution
    parsing = fake_parsing(shown, x, slice(25, 35))
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    shape = reference.points * scale
    left = wary(BLACK, shape)
    assert (left is not None) == kept
    if left is not None:
        assert left.min() < 0.1


def test_where_no_part_of_the_person_may_show_hair_that_is_partly_taken_for_an_object_does_not(
    wary: Watch, monkeypatch: pytest.MonkeyPatch
) -> None:
    reference = wary.reference
    parsing = fake_parsing(FaceClass.OCCLUDER, slice(0, 35), slice(25, 35))
    parsing.shares[FaceClass.HAIR] = 0.2 * parsing.shares[FaceClass.OCCLUDER]
    parsing.shares[FaceClass.OCCLUDER] *= 0.8
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    shape = reference.points * (64 / reference.resolution)
    assert wary(BLACK, shape) is None


@pytest.mark.parametrize(
    ("shown", "colour", "last_row", "kept"),
    [
        (FaceClass.OCCLUDER, HAIR_COLOUR, 50, False),
        (FaceClass.OCCLUDER, HAND_COLOUR, 50, True),
        (FaceClass.OCCLUDER, HAIR_COLOUR, 35, True),
        (FaceClass.BACKGROUND, HAIR_COLOUR, 50, False),
        (FaceClass.BACKGROUND, WALL_COLOUR, 50, True),
    ],
    ids=[
        "a lock taken for an object",
        "a hand",
        "a board apart from the hair",
        "a lock taken for background",
        "background",
    ],
)
def test_where_no_part_of_the_person_may_show_what_has_the_hairs_colour_does_not(
    p01: Identity,
    monkeypatch: pytest.MonkeyPatch,
    shown: FaceClass,
    colour: tuple[int, ...],
    last_row: int,
    kept: bool,
) -> None:
    reference = p01.appearance.reference
    wary = Watch(p01, only_objects=True, beyond=np.ones(reference.size, np.float32), watches_eyes=False)
    parsing = fake_parsing(shown, slice(0, 35), slice(25, last_row))
    parsing.shares[:, 50:] = np.eye(len(FaceClass))[FaceClass.HAIR, :, None, None]
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    picture = np.full((64, 64, 3), SKIN_COLOUR, np.float64)
    picture[50:], picture[25:last_row, :35] = HAIR_COLOUR, colour
    picture += np.random.default_rng(0).normal(0, 4, picture.shape)
    shape = reference.points * (64 / reference.resolution)
    left = wary(np.clip(picture, 0, 255).astype(np.uint8), shape)
    hidden = 0.0 if left is None else float((left < 0.5).mean())
    assert hidden > 0.05 if kept else hidden < 0.005


def test_a_beard_of_the_hairs_colour_is_seen(wary: Watch, monkeypatch: pytest.MonkeyPatch) -> None:
    reference = wary.reference
    parsing = fake_parsing(FaceClass.FACIAL_HAIR, slice(0, 64), slice(30, 50))
    parsing.shares[:, 50:] = 0
    parsing.shares[FaceClass.HAIR, 60:], parsing.shares[FaceClass.FACIAL_HAIR, 50:60] = 1, 1
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    picture = np.full((64, 64, 3), SKIN_COLOUR, np.uint8)
    picture[30:] = HAIR_COLOUR
    shape = reference.points * (64 / reference.resolution)
    wary(picture, shape)
    places = wary.texels.positions(shape)
    assert wary.visible[places[:, 1] < 58].min() > 0.99


@pytest.mark.parametrize("shown", [FaceClass.BACKGROUND, FaceClass.HAIR])
def test_what_is_drawn_beyond_the_persons_face_leaves_the_background(
    p01: Identity, monkeypatch: pytest.MonkeyPatch, shown: FaceClass
) -> None:
    reference = p01.appearance.reference
    beyond = np.zeros(reference.size, np.float32)
    beyond[:20] = 1
    wary = Watch(p01, only_objects=True, beyond=beyond, watches_eyes=False)
    parsing = fake_parsing(shown, slice(0, 64), slice(0, 64))
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    shape = reference.points * (64 / reference.resolution)
    left = wary(BLACK, shape)
    assert (left is not None) == (shown == FaceClass.BACKGROUND)
    if left is not None:
        middle = slice(reference.size[1] // 3, 2 * reference.size[1] // 3)
        assert left[2:17, middle].max() < 0.1
        assert left[24:].min() == 1


def test_brows_are_shown_whatever_the_sources_mask_says() -> None:
    reference = ReferenceFrame.canonical(64)
    nothing = np.zeros(reference.size, bool)
    shown = shown_mask(nothing, reference)
    x, y = np.round(reference.points[BROWS]).astype(int).T
    assert shown[y, x].all()
    x, y = np.round(reference.points[HAIRLINE]).astype(int)
    assert not shown[y + 2, x]
    assert shown_mask(reference.mask, reference)[reference.mask].all()


def test_what_is_worn_fades_as_fast_at_any_frame_rate(p01: Identity, monkeypatch: pytest.MonkeyPatch) -> None:
    shape = p01.reference.points * (64 / p01.reference.resolution)
    seconds, left = 0.6, []
    for rate in (25, 30, 60):
        watch = Watch(p01, watches_eyes=False)
        fringe = fake_parsing(FaceClass.HAIR, slice(0, 64), slice(0, 30))
        monkeypatch.setattr(cover, "parse_frame", lambda *_, parsing=fringe: parsing)
        hidden = watch(BLACK, shape, seconds=1 / rate)
        assert hidden is not None
        assert hidden.min() < 0.01
        bare = fake_parsing(FaceClass.SKIN, slice(0, 64), slice(0, 64))
        monkeypatch.setattr(cover, "parse_frame", lambda *_, parsing=bare: parsing)
        for _ in range(round(seconds * rate)):
            fading = watch(BLACK, shape, seconds=1 / rate)
        assert fading is not None
        left.append(float(fading.min()))
    assert left[1] == pytest.approx(1 - LIMITS.memory.over(seconds), abs=0.01)
    assert left == pytest.approx([left[1]] * 3, abs=0.01)


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


@pytest.mark.parametrize(("look", "kept"), [(SWAP, True), (DISGUISE, False)])
def test_rims_stay_in_front_of_the_drawn_face(
    scene: Scene, look: Look, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rims, "wears_glasses", lambda *_: True)
    source, target = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    rgb, shape = with_rims(scene.rgb, scene.shape, (40, 35, 30)), scene.shape
    frame = Frame.from_rgb(rgb)
    with Engine(source, Donor.of(target), None, replace(look, renderer="cpu")) as engine:
        engine.draw(frame, shape)
    lower = lenses(shape)[:, 15:45].reshape(-1, 2).round().astype(int)
    before, after = (picture[lower[:, 1], lower[:, 0]].mean() for picture in (rgb, frame.rgb()))
    bare = scene.rgb[lower[:, 1], lower[:, 0]].mean()
    assert (abs(after - before) < 0.25 * (bare - before)) == kept


def between_eyes(watch: Watch) -> tuple[int, int]:
    """Row and column on the reference grid."""
    x, y = np.round(watch.reference.points[NOSE_ROOT]).astype(int)
    return int(y), int(x)


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
