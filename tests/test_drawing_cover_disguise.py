"""Where no part of the person may show, only objects stay in front."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file
from numpy.testing import assert_array_equal
from watched_cover import (
    BLACK,
    HAIR_COLOUR,
    HAND_COLOUR,
    SKIN_COLOUR,
    WALL_COLOUR,
    Watch,
    drawn,
    fake_parsing,
    frames_with_an_object,
    square,
)

from guise.aam.landmarks.schemes import (
    NOSE_ROOT,
)
from guise.aam.model import Identity
from guise.aam.parsing import FaceClass
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import DISGUISE
from guise.app.drawing.passes import cover
from guise.app.media import Frame, open_input


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


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


def test_what_lies_between_bars_is_skin_and_no_object(wary: Watch, monkeypatch: pytest.MonkeyPatch) -> None:
    scale = 64 / wary.reference.resolution
    parsing = fake_parsing(FaceClass.OCCLUDER, slice(0, 35), slice(25, 35))
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    shape = wary.reference.points * scale
    plain = np.full((64, 64, 3), 150, np.uint8)
    bars = plain.copy()
    bars[:, np.arange(64) % 12 < 4] = 40
    assert wary(bars, shape) is None
    assert wary(plain, shape) is not None


@pytest.mark.parametrize(
    ("shown", "x", "kept"),
    [
        (FaceClass.OCCLUDER, slice(0, 35), True),
        (FaceClass.OCCLUDER, slice(25, 35), False),
        (FaceClass.HAIR, slice(0, 35), True),
        (FaceClass.HAIR, slice(25, 35), False),
        (FaceClass.GLASSES, slice(0, 64), False),
    ],
    ids=["a hand", "a patch within the face", "hair", "hair within the face", "glasses"],
)
def test_in_a_disguise_hair_stays_in_front_that_reaches_in_and_glasses_do_not(
    p01: Identity, monkeypatch: pytest.MonkeyPatch, shown: FaceClass, x: slice, kept: bool
) -> None:
    watch = Watch(p01, only_objects=True, keeps_hair=True, watches_eyes=False)
    parsing = fake_parsing(shown, x, slice(25, 35))
    monkeypatch.setattr(cover, "parse_frame", lambda *_: parsing)
    left = watch(BLACK, watch.reference.points * (64 / watch.reference.resolution))
    assert (left is not None and left.min() < 0.1) == kept


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
