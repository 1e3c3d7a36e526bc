"""The identity's iris on the source's eyeballs."""

import numpy as np
import pytest
from drawing import RGB

from guise.aam.irises import LIMITS, Irises
from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.aam.parsing import FaceParsing
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.memory import GazeMemory, Memory
from guise.app.drawing.passes.irises import LIMITS as TINT
from guise.app.drawing.passes.irises import Gaze, IrisChange, IrisTint
from guise.app.media import Frame
from guise.common.arrays import F32, F64
from guise.common.decay import FRAME_SECONDS

HEIGHT, WIDTH, EYE = 40, 76, 52.0
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
LIDS = ((((COLUMNS - 38) / 26) ** 2 + ((ROWS - 20) / 13) ** 2) < 1).astype(np.float32)
PLACES = np.dstack([COLUMNS - 38, ROWS - 20]) / np.float32(EYE)
BROWN, GREEN, CYAN, WHITE, SKIN = (
    np.float32(c) for c in ((60, 40, 36), (80, 95, 70), (135, 165, 165), (200, 195, 190), (190, 140, 120))
)
RADIUS, PUPIL = 13, 4
WIDTHS = np.array([[0, 0], [1, 0], [0, 1]], np.float32)  # the places are in the eye already
SHAPE = ReferenceFrame.canonical(96).points


def eye(iris: F32, x: float = 38, light: float = 1.0) -> F32:
    """An eye that looks at a column, with a pupil and a catch-light."""
    away = np.hypot(COLUMNS - x, ROWS - 20)[..., None]
    picture = np.where(away < RADIUS, iris, WHITE)
    picture = np.where(away < PUPIL, np.float32(15), picture)
    picture = np.where(np.hypot(COLUMNS - x - 5, ROWS - 16)[..., None] < 1.5, np.float32(250), picture)
    return np.asarray(light * np.where(LIDS[..., None] > 0, picture, SKIN), np.float32)


def irises(colour: F32) -> Irises:
    """Of the person with these eyes."""
    away = (np.arange(LIMITS.rings) + 0.5) * LIMITS.reach / LIMITS.rings
    rings = [15 / WHITE if r < PUPIL / RADIUS else (colour if r < 1 else WHITE) / WHITE for r in away]
    return Irises(RADIUS / EYE, np.array(rings, np.float32), np.zeros((2, 2)))


class Tinted:
    """The right eye of somebody, whose iris the parsing has found at a column."""

    def __init__(self, own: F32, other: F32, seen_at: float = 38, lids: F32 = LIDS) -> None:
        change = IrisChange(irises(own), irises(other))
        self.tint = IrisTint(change, lids, 0)
        found = np.array([[(seen_at - 38) / EYE, 0.0], [0.0, 0.0]])
        self.gaze = GazeMemory(found, found.copy())

    def apply(self, picture: F32, shown: float = 1.0, seconds: float = FRAME_SECONDS) -> F32:
        made = picture.copy()
        self.tint.apply(made, PLACES.reshape(-1, 2), WIDTHS, None, RGB, self.gaze, shown, seconds)
        return made


def tint(own: F32, other: F32, seen_at: float = 38) -> Tinted:
    return Tinted(own, other, seen_at)


@pytest.mark.parametrize("light", [0.4, 1.0])
@pytest.mark.parametrize(("own", "other"), [(BROWN, GREEN), (GREEN, BROWN), (CYAN, BROWN), (CYAN, GREEN)])
def test_an_iris_takes_the_other_colour_in_its_own_light(own: F32, other: F32, light: float) -> None:
    made = tint(own, other, 41).apply(eye(own, 42, light))
    ring = (np.hypot(COLUMNS - 42, ROWS - 20) > 6) & (np.hypot(COLUMNS - 42, ROWS - 20) < 9) & (ROWS > 20)
    before, after = (np.abs(p[ring].mean(0) - light * other).max() for p in (eye(own, 42, light), made))
    assert after < 0.35 * before


@pytest.mark.parametrize("own", [BROWN, GREEN])
@pytest.mark.parametrize("x", [35, 38, 41])
def test_an_iris_is_found_near_where_the_parsing_saw_it(own: F32, x: int) -> None:
    tinted = Tinted(own, CYAN)
    tinted.apply(eye(own, x))
    kept = TINT.memory.over(FRAME_SECONDS)
    assert EYE * tinted.gaze.places[0, 0] == pytest.approx((x - 38) * (1 - kept), abs=1.5)
    assert not tinted.gaze.places[1].any()


@pytest.mark.parametrize("own", [GREEN, CYAN])
def test_white_pupil_and_catch_light_stay(own: F32) -> None:
    source = eye(own, 36)
    made = tint(own, BROWN, 36).apply(source)
    beside = (np.hypot(COLUMNS - 36, ROWS - 20) > 17) & (LIDS > 0)
    assert np.abs(made - source)[beside].max() < 4
    assert made[20, 36].max() < 20
    assert made[16, 41].min() > 1.8 * made[24, 31].max()


@pytest.mark.parametrize(("own", "other"), [(GREEN, BROWN), (BROWN, CYAN), (CYAN, GREEN)])
def test_a_reflection_on_glasses_is_not_painted(own: F32, other: F32) -> None:
    glare = (LIDS > 0) & (COLUMNS > 40)
    source = np.where(glare[..., None], np.float32(250), eye(own, 38, 0.6))
    made = tint(own, other).apply(source)
    assert np.abs(made - source)[glare].max() < 1
    assert np.abs(made - source)[(np.hypot(COLUMNS - 34, ROWS - 20) < 4)].max() > 10


@pytest.mark.parametrize("colour", [BROWN, GREEN, CYAN])
def test_the_same_colours_change_nothing(colour: F32) -> None:
    source = eye(colour, 40)
    assert np.abs(tint(colour, colour, 40).apply(source) - source).max() < 1e-2


def test_a_lighter_iris_leaves_the_shade_of_the_lids() -> None:
    shade = np.where(ROWS < 14, np.float32(0.6), np.float32(1))[..., None]
    source = eye(BROWN, 38) * shade
    made = tint(BROWN, CYAN).apply(source)
    beside = (np.hypot(COLUMNS - 38, ROWS - 20) > 14.5) & (LIDS > 0)
    assert np.abs(made - source)[beside].max() < 4


def test_a_shut_eye_keeps_its_colours() -> None:
    source = eye(GREEN, 41)
    assert np.array_equal(tint(GREEN, BROWN).apply(source, 0.0), source)


def test_no_eye_is_seen_through_lids_of_no_height() -> None:
    source = eye(GREEN)
    assert np.array_equal(Tinted(GREEN, BROWN, lids=np.zeros_like(LIDS)).apply(source), source)


def followed(moves: F64, seconds: float = FRAME_SECONDS, memory: Memory | None = None) -> Memory:
    """What is remembered of a gaze whose irises the parsing finds at places (2, 2) in the eyes, eye widths."""
    memory = Memory() if memory is None else memory
    memory.clock.step = seconds
    (first, last), (left, right) = (SHAPE[group][[0, 3]] for group in (RIGHT_EYE, LEFT_EYE))
    middles = np.array([(first + last) / 2, (left + right) / 2])
    along = np.array([last - first, right - left])
    found = np.column_stack([middles + moves[:, :1] * along, np.zeros((2, 2))])
    parsing = FaceParsing(np.zeros((1, 64, 64), np.float32), np.eye(2, 3), found)
    face = FaceInFrame(Frame.from_rgb(np.zeros((8, 8, 3), np.uint8)), SHAPE, SHAPE, parsing=parsing)
    Gaze(irises(GREEN), SHAPE).follow(face, memory)
    return memory


def test_a_gaze_is_steady_but_follows_a_leap() -> None:
    gaze = followed(np.array([[0.04, 0], [0.2, 0]])).gaze
    assert gaze.parsed[0] == pytest.approx([0.04 * (1 - TINT.memory.over(FRAME_SECONDS)), 0], abs=1e-5)
    assert gaze.parsed[1] == pytest.approx([0.2, 0], abs=1e-5)


def test_a_new_face_looks_as_at_rest_until_it_is_parsed() -> None:
    memory, nobody = Memory(), FaceInFrame(Frame.from_rgb(np.zeros((8, 8, 3), np.uint8)), SHAPE, SHAPE)
    at_rest = Irises(0.2, irises(GREEN).profile, np.array([[0.03, 0.01], [-0.02, 0.0]]))
    Gaze(at_rest, SHAPE).follow(nobody, memory)
    np.testing.assert_array_equal(memory.gaze.parsed, at_rest.places)
    memory.gaze.parsed += 1
    assert np.abs(at_rest.places).max() < 0.1  # the person's own stay


def test_a_gaze_moves_as_fast_at_any_frame_rate() -> None:
    places = []
    for rate in (25, 30, 60):
        memory = followed(np.zeros((2, 2)))
        for _ in range(rate // 5):
            followed(np.array([[0.04, 0], [0.04, 0]]), 1 / rate, memory)
        places.append(memory.gaze.parsed[0, 0])
    assert places == pytest.approx([places[1]] * 3, abs=1e-5)


@pytest.mark.parametrize(
    ("pixels", "darker", "lighter"), [(18.0, False, False), (26.0, True, False), (40.0, True, True)]
)
def test_an_iris_that_a_clip_shows_in_few_pixels_is_not_known(
    pixels: float, *, darker: bool, lighter: bool
) -> None:
    for own, other, is_known in ((GREEN, BROWN, darker), (BROWN, GREEN, lighter)):
        assert IrisChange(irises(own), irises(other)).is_known(pixels) == is_known
