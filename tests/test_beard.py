"""A beard is told by the frame at rest; the drawn chin hides the person's, and the donor's is drawn to the jaw line."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from models import model_file

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.beard import beard
from guise.aam.landmarks.schemes import CHIN, JAW, LOWER_LIP_BOTTOM, NOSE_TIP
from guise.aam.light import LUMA
from guise.aam.model import Identity
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.media import Frame
from guise.common.arrays import F64, U8

DARK = 0.35  # of the skin's brightness
CHINS = np.r_[JAW[6:11], LOWER_LIP_BOTTOM]


def goatee(size: tuple[int, ...], shape: F64) -> np.ndarray:
    """(h, w) bool: from the lower lip to the chin of a face (81, 2)."""
    area = np.zeros(size, np.uint8)
    cv2.fillConvexPoly(area, cv2.convexHull(np.round(shape[CHINS]).astype(np.int32)), 1)
    return area > 0


def with_goatee(name: str) -> Identity:
    """Somebody with a dark chin."""
    bare = Identity.load(model_file(name))
    rest, reference = bare.rest_frame, bare.reference
    picture = rest.picture.copy()
    picture[goatee(picture.shape[:2], rest.shape)] = picture[goatee(picture.shape[:2], rest.shape)] * DARK
    neutral = bare.appearance.neutral.copy()
    dark = goatee(reference.size, reference.points)[reference.mask]
    neutral[SHAPE_ENTRIES:].reshape(-1, 3)[dark] *= DARK
    appearance = replace(bare.appearance, neutral=neutral)
    return replace(bare, appearance=appearance, rest_frame=replace(rest, picture=picture))


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Goatees are parsed as such, which the network does of hair, not of dark skin."""

    def parsed(self: FaceParser, rgb: U8, points: F64) -> FaceParsing:
        made = parse(self, rgb, points)
        cells = np.stack(np.meshgrid(np.arange(64), np.arange(64)), -1).reshape(1, -1, 2).astype(np.float64)
        x, y = np.round(cv2.transform(cells, made.to_picture)[0]).astype(int).T
        h, w = rgb.shape[:2]
        luma = (rgb @ LUMA)[np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)]
        hull = goatee((h, w), points)[np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)]
        skin = float(rgb[tuple(np.round(points[NOSE_TIP]).astype(int)[::-1])] @ LUMA)
        hairy = (hull & (luma < 0.6 * skin)).reshape(64, 64)
        shares = made.shares * ~hairy
        shares[FaceClass.FACIAL_HAIR] += hairy
        return replace(made, shares=np.asarray(shares, np.float32))

    parse = FaceParser.parse
    monkeypatch.setattr(FaceParser, "parse", parsed)


def drawn(person: Identity, donor: Identity) -> np.ndarray:
    """(h, w) brightness of the person's frame at rest with the donor's face."""
    frame = Frame.from_rgb(person.rest_frame.picture.copy())
    with Engine(person, Donor.of(donor), None) as engine:
        engine.draw(frame, person.rest_frame.shape)
    return np.asarray(frame.rgb() @ LUMA)


def above_chin(person: Identity) -> tuple[slice, slice]:
    """A patch of the picture at rest, of the last of the chin."""
    shape = person.rest_frame.shape
    (x, y), width = shape[CHIN], np.ptp(shape[:, 0])
    reach = 0.04 * width
    return np.s_[int(y - 2 * reach) : int(y - 0.2 * reach), int(x - reach) : int(x + reach)]


@pytest.mark.usefixtures("seen")
def test_a_beard_is_where_it_is_and_ends_with_the_face() -> None:
    person = with_goatee("p02")
    share, goes_on = beard(person.rest_frame, person.reference)
    x, y = np.round(person.reference.points[[CHIN, NOSE_TIP]]).astype(int).T
    assert share[y[0] - 8, x[0]] == 1
    assert share[y[1], x[1]] == 0
    assert not goes_on


def test_who_has_none_has_none() -> None:
    person = Identity.load(model_file("p02"))
    share, goes_on = beard(person.rest_frame, person.reference)
    assert share.max() < 0.1
    assert not goes_on


def test_a_beard_of_the_neck_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def everywhere(self: FaceParser, rgb: U8, points: F64) -> FaceParsing:
        made = parse(self, rgb, points)
        shares = np.zeros_like(made.shares)
        shares[FaceClass.FACIAL_HAIR] = 1
        return replace(made, shares=shares)

    parse = FaceParser.parse
    monkeypatch.setattr(FaceParser, "parse", everywhere)
    person = Identity.load(model_file("p02"))
    assert beard(person.rest_frame, person.reference)[1]


def test_less_of_the_persons_beard_is_left_under_a_bare_chin(request: pytest.FixtureRequest) -> None:
    person, donor = with_goatee("p02"), Identity.load(model_file("p01"))
    patch = above_chin(person)
    skin = drawn(Identity.load(model_file("p02")), donor)[patch].mean()
    taken_for_skin = drawn(person, donor)[patch].mean()
    request.getfixturevalue("seen")
    left = drawn(person, donor)[patch].mean()
    assert skin - left < 0.4 * (skin - taken_for_skin)


@pytest.mark.usefixtures("seen")
def test_a_beard_of_the_donor_is_drawn_to_the_jaw_line() -> None:
    person, donor = Identity.load(model_file("p02")), with_goatee("p01")
    bare = Identity.load(model_file("p01"))
    patch = above_chin(person)
    with_beard, without = (drawn(person, one)[patch].mean() for one in (donor, bare))
    assert with_beard < 0.62 * without
