"""Another head in place of the source's: what goes, what stays, and when a head isn't known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import guise.app
from guise.aam.model import Identity
from guise.aam.parsing import CELLS, FaceClass, FaceParser, FaceParsing
from guise.app.media import Frame
from guise.app.swapping.head import (
    HeadPainter,
    Plate,
    _without_background,
    gone,
    knows_head,
    matte,
    parse_head,
)

GALLERY = Path(guise.app.__file__).parent / "gallery"


@pytest.fixture(scope="module")
def source() -> Identity:
    return Identity.load(GALLERY / "p03.guise")


@pytest.fixture(scope="module")
def parsing(source: Identity) -> FaceParsing:
    return parse_head(FaceParser(), Frame.from_rgb(source.rest_frame.picture), source.rest_frame.shape)


def changed(parsing: FaceParsing, kind: FaceClass, part: tuple[slice, slice]) -> FaceParsing:
    shares = parsing.shares.copy()
    shares[:, *part] = 0
    shares[kind, *part] = 1
    return FaceParsing(shares, parsing.to_picture, parsing.irises)


def test_a_frontal_head_with_long_hair_is_known(source: Identity, parsing: FaceParsing) -> None:
    assert knows_head(parsing, source.rest_frame.shape)


@pytest.mark.parametrize(
    ("kind", "part"),
    [
        (FaceClass.OCCLUDER, np.s_[25:40, 20:40]),  # a hand
        (FaceClass.HAIR, np.s_[:50, :]),  # hair as large as what is seen
    ],
)
def test_a_head_behind_a_hand_or_beyond_the_crop_is_not_known(
    source: Identity, parsing: FaceParsing, kind: FaceClass, part: tuple[slice, slice]
) -> None:
    assert not knows_head(changed(parsing, kind, part), source.rest_frame.shape)


def test_all_hair_above_the_chin_goes_and_the_neck_stays(source: Identity, parsing: FaceParsing) -> None:
    away = gone(parsing, source.rest_frame.shape)
    hair = parsing.share(FaceClass.HAIR) > 0.5
    assert hair.sum() > 200
    inside = np.zeros_like(hair)
    inside[2:-2, 2:-2] = True  # not at the crop's rim
    assert away[hair & inside].min() > 0.99
    assert away[-6:-3, CELLS // 2 - 2 : CELLS // 2 + 2].max() < 0.1


def test_the_matte_is_the_head_without_background_and_body(source: Identity) -> None:
    still = source.rest_frame
    alpha = matte(FaceParser(), still)
    x, y = still.shape.mean(0).round().astype(int)
    assert alpha[y, x] == 1
    assert alpha[:, :40].max() == 0
    assert alpha[-20:].max() == 0
    above = int(still.shape[:, 1].min()) - 30
    assert alpha[above, x] == 1  # hair


def test_the_head_is_drawn_and_the_swapped_face_is_kept(source: Identity, parsing: FaceParsing) -> None:
    still = source.rest_frame
    frame = Frame.from_rgb(still.picture)
    with HeadPainter(Identity.load(GALLERY / "p02.guise"), "cpu") as painter:
        painter.draw(frame, still.shape, still.shape, parsing, None)
    made, before = frame.rgb().astype(int), still.picture.astype(int)
    x, y = still.shape.mean(0).round().astype(int)
    np.testing.assert_array_equal(
        made[y - 20 : y + 20, x - 20 : x + 20], before[y - 20 : y + 20, x - 20 : x + 20]
    )
    away = gone(parsing, still.shape)
    cells = np.argwhere((parsing.share(FaceClass.HAIR) > 0.9) & (away > 0.9))[:, ::-1]
    points = (cells @ parsing.to_picture[:, :2].T + parsing.to_picture[:, 2]).round().astype(int)
    inside = ((points >= 0) & (points < (640, 480))).all(1)
    px, py = points[inside].T
    assert np.median(np.abs(made[py, px] - before[py, px]).max(1)) > 20
    np.testing.assert_array_equal(made[:, :20], before[:, :20])


def test_a_plate_is_known_where_the_pictures_agree_without_heads() -> None:
    rng = np.random.default_rng(0)
    wall = rng.integers(0, 255, (60, 80, 3)).astype(np.uint8)
    pictures, heads = [], []
    for k in range(8):
        picture, head = wall.copy(), np.zeros((60, 80), np.uint8)
        head[20:40, 5 * k : 5 * k + 20] = 1
        picture[head > 0] = 0
        picture[45:, :] = 30 * k  # something that moves
        pictures.append(picture)
        heads.append(head)
    plate = Plate.of(pictures, heads)
    np.testing.assert_array_equal(plate.picture[20:40, 5:40], wall[20:40, 5:40])
    assert plate.known[22:38, 10:40].min() > 0.9
    assert plate.known[50:].max() < 0.1
    assert Plate.of(pictures, [np.ones_like(h) for h in heads]).known.max() == 0


def test_a_still_without_its_background_has_the_colours_of_the_head_only() -> None:
    picture = np.full((20, 30, 3), (250, 240, 230), np.uint8)
    picture[5:15, 8:22] = np.random.default_rng(0).integers(20, 90, (10, 14, 3))
    alpha = np.zeros((20, 30), np.float32)
    alpha[4:16, 7:23] = 0.5
    alpha[5:15, 8:22] = 1
    made = _without_background(picture, alpha)
    np.testing.assert_array_equal(made[5:15, 8:22], picture[5:15, 8:22])
    assert made.max() < 90
