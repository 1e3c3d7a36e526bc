"""The identity's iris on the source's eyeballs."""

import numpy as np
import pytest
from models import model_file

from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.aam.model import Identity
from guise.aam.parsing import FaceParser
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.iris import LIMITS, Gaze, IrisChange, Irises, IrisTint, in_eye, whole_width
from guise.common.arrays import F32

HEIGHT, WIDTH, EYE = 40, 76, 52.0
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
LIDS = ((((COLUMNS - 38) / 26) ** 2 + ((ROWS - 20) / 13) ** 2) < 1).astype(np.float32)
PLACES = np.dstack([COLUMNS - 38, ROWS - 20]) / np.float32(EYE)
BROWN, GREEN, CYAN, WHITE, SKIN = (
    np.float32(c) for c in ((60, 40, 36), (80, 95, 70), (135, 165, 165), (200, 195, 190), (190, 140, 120))
)
RADIUS, PUPIL = 13, 4
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


def tint(own: F32, other: F32, seen_at: float = 38) -> IrisTint:
    """Of the right eye, whose iris the parsing has found at a column."""
    gaze = Gaze(np.array([[(seen_at - 38) / EYE, 0.0], [0.0, 0.0]]))
    return IrisTint(LIDS, IrisChange(irises(own), irises(other), SHAPE, gaze), 0)


def test_places_in_an_eye_do_not_depend_on_where_it_is() -> None:
    outline = np.array([[10, 20], [12, 24], [14, 26], [16, 28], [0, 0], [0, 0]], float)
    places = in_eye([[10, 20], [16, 28], [13, 24], [9, 27]], outline)
    assert places == pytest.approx(np.array([[-0.5, 0], [0.5, 0], [0, 0], [0, 0.5]]), abs=1e-6)


def test_an_iris_of_a_turned_head_stays_round() -> None:
    turned = SHAPE * (0.6, 1.0)
    middle = turned[RIGHT_EYE][[0, 3]].mean(0)
    radius = 0.2 * float(np.linalg.norm(np.diff(SHAPE[RIGHT_EYE][[0, 3]], axis=0)))
    rim = middle + radius * np.array([[0.6, 0.0], [0.0, 1.0]])
    places = in_eye(rim, turned[RIGHT_EYE], whole_width(RIGHT_EYE, turned, SHAPE))
    assert np.hypot(*places.T) == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize("light", [0.4, 1.0])
@pytest.mark.parametrize(("own", "other"), [(BROWN, GREEN), (GREEN, BROWN), (CYAN, BROWN), (CYAN, GREEN)])
def test_an_iris_takes_the_other_colour_in_its_own_light(own: F32, other: F32, light: float) -> None:
    made = tint(own, other, 41).apply(eye(own, 42, light), PLACES)
    ring = (np.hypot(COLUMNS - 42, ROWS - 20) > 6) & (np.hypot(COLUMNS - 42, ROWS - 20) < 9) & (ROWS > 20)
    before, after = (np.abs(p[ring].mean(0) - light * other).max() for p in (eye(own, 42, light), made))
    assert after < 0.35 * before


@pytest.mark.parametrize("own", [BROWN, GREEN])
@pytest.mark.parametrize("x", [35, 38, 41])
def test_an_iris_is_found_near_where_the_parsing_saw_it(own: F32, x: int) -> None:
    change = IrisChange(irises(own), irises(CYAN), SHAPE, Gaze(np.zeros((2, 2))))
    IrisTint(LIDS, change, 0).apply(eye(own, x), PLACES)
    assert EYE * change.gaze.places[0, 0] == pytest.approx((x - 38) * (1 - LIMITS.memory), abs=1.5)
    assert not change.gaze.places[1].any()


@pytest.mark.parametrize("own", [GREEN, CYAN])
def test_white_pupil_and_catch_light_stay(own: F32) -> None:
    source = eye(own, 36)
    made = tint(own, BROWN, 36).apply(source, PLACES)
    beside = (np.hypot(COLUMNS - 36, ROWS - 20) > 17) & (LIDS > 0)
    assert np.abs(made - source)[beside].max() < 4
    assert made[20, 36].max() < 20
    assert made[16, 41].min() > 1.8 * made[24, 31].max()


@pytest.mark.parametrize("colour", [BROWN, GREEN, CYAN])
def test_the_same_colours_change_nothing(colour: F32) -> None:
    source = eye(colour, 40)
    assert np.abs(tint(colour, colour, 40).apply(source, PLACES) - source).max() < 1e-2


def test_a_lighter_iris_leaves_the_shade_of_the_lids() -> None:
    shade = np.where(ROWS < 14, np.float32(0.6), np.float32(1))[..., None]
    source = eye(BROWN, 38) * shade
    made = tint(BROWN, CYAN).apply(source, PLACES)
    beside = (np.hypot(COLUMNS - 38, ROWS - 20) > 14.5) & (LIDS > 0)
    assert np.abs(made - source)[beside].max() < 4


def test_a_shut_eye_keeps_its_colours() -> None:
    source = eye(GREEN, 41)
    assert np.array_equal(tint(GREEN, BROWN).apply(source, PLACES, np.zeros_like(LIDS)), source)


def test_no_eye_is_seen_through_lids_of_no_height() -> None:
    change = IrisChange(irises(GREEN), irises(BROWN), SHAPE, Gaze(np.zeros((2, 2))))
    source = eye(GREEN)
    assert np.array_equal(IrisTint(np.zeros_like(LIDS), change, 0).apply(source, PLACES), source)


def test_a_gaze_is_steady_but_follows_a_leap() -> None:
    gaze = Gaze(np.zeros((2, 2)))
    (first, last), (left, right) = (SHAPE[group][[0, 3]] for group in (RIGHT_EYE, LEFT_EYE))
    middles = np.array([(first + last) / 2, (left + right) / 2])
    moves = np.array([0.04 * (last - first), 0.2 * (right - left)])
    gaze.see(middles + moves, SHAPE, SHAPE)
    assert gaze.parsed[0] == pytest.approx([0.04 * (1 - LIMITS.memory), 0], abs=1e-5)
    assert gaze.parsed[1] == pytest.approx([0.2, 0], abs=1e-5)
    gaze.reset()
    assert not gaze.parsed.any()


def test_a_persons_irises_are_known_from_the_model() -> None:
    person = Identity.load(model_file("p01"))
    known = Irises.at_rest(person, FaceParser())
    assert LIMITS.radii[0] <= known.radius <= LIMITS.radii[1] + 1e-6
    assert np.abs(known.places).max() < 0.15
    assert known.colour.min() > 0
    assert known.colour.max() < 1.0
    inner, rim = known.at(np.array([0.4, 0.7], np.float32)).T  # the grid is too coarse for the pupil
    assert inner.mean() < rim.mean()
