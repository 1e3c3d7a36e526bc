"""What a face's surroundings show and where the irises are: in place, at any size and roll, and objects are objects."""

import cv2
import numpy as np
import pytest
from made_up import SAMPLES
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import (
    CHIN,
    HAIRLINE,
    LEFT_EYE,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_LIP_BOTTOM,
    NOSE_TIP,
    OUTER_LIPS,
    RIGHT_BROW,
    RIGHT_EYE,
)
from guise.aam.parsing import CELLS, FaceClass, FaceParser, FaceParsing
from guise.app.media import open_input
from guise.common.arrays import F64, U8

PARSER = FaceParser()


@pytest.fixture(scope="module")
def face() -> tuple[U8, F64]:
    """A frame of the first sample person, and the true landmarks."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    return rgb, np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(np.float64)


def share(parsing: FaceParsing, place: F64, *classes: FaceClass) -> float:
    return float(parsing.at(np.atleast_2d(place), parsing.share(*classes))[0])


def test_the_parts_lie_where_the_landmarks_say(face: tuple[U8, F64]) -> None:
    rgb, points = face
    parsing = PARSER.parse(rgb, points)
    assert parsing.shares.shape == (len(FaceClass), CELLS, CELLS)
    assert_allclose(parsing.shares.sum(0), 1, atol=1e-3)
    assert share(parsing, points[NOSE_TIP], FaceClass.SKIN) > 0.8
    assert share(parsing, points[RIGHT_EYE].mean(0), FaceClass.EYES) > 0.5
    assert share(parsing, points[OUTER_LIPS].mean(0), FaceClass.LIPS, FaceClass.INNER_MOUTH) > 0.7
    assert share(parsing, points[RIGHT_BROW].mean(0), FaceClass.BROWS) > 0.4
    up = points[HAIRLINE] - points[NOSE_TIP]
    above = points[HAIRLINE] + np.linspace(0, 0.15, 8)[:, None] * up
    assert parsing.at(above, parsing.share(FaceClass.HAIR)).max() > 0.6
    assert parsing.share(FaceClass.OCCLUDER).max() < 0.5


def test_each_iris_lies_in_its_eye(face: tuple[U8, F64]) -> None:
    rgb, points = face
    irises = PARSER.parse(rgb, points).irises
    for iris, eye in zip(irises, (RIGHT_EYE, LEFT_EYE), strict=True):
        width = np.ptp(points[eye, 0])
        assert np.abs(iris[:2] - points[eye].mean(0)).max() < 0.3 * width
        assert 0.12 * width < iris[2] < 0.35 * width
        assert 0 < iris[3] < 0.3 * width


def test_the_iris_of_a_shut_eye_is_not_seen(face: tuple[U8, F64]) -> None:
    rgb, points = face
    parsing, shut = PARSER.parse(rgb, points), points.copy()
    assert_allclose(parsing.open_irises(points), parsing.irises[:, :3])
    shut[LEFT_UPPER_LID] = shut[LEFT_LOWER_LID]
    seen = parsing.open_irises(shut)
    assert np.isfinite(seen[0]).all()
    assert np.isnan(seen[1]).all()
    assert np.isnan(parsing.open_irises(points + 200)).all()


@pytest.mark.parametrize(("scale", "degrees"), [(0.5, 0), (1.7, 0), (1, 30), (1, 180)])
def test_size_and_roll_of_the_face_change_little(face: tuple[U8, F64], scale: float, degrees: float) -> None:
    rgb, points = face
    upright = PARSER.parse(rgb, points)
    h, w = rgb.shape[:2]
    matrix = cv2.getRotationMatrix2D((w / 2, h / 2), degrees, scale)
    matrix[:, 2] += (max(scale, 1) - 1) * 0.5 * np.array([w, h])
    size = int(w * max(scale, 1)), int(h * max(scale, 1))
    moved = cv2.warpAffine(rgb, matrix, size, flags=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    parsing = PARSER.parse(np.asarray(moved, np.uint8), points @ matrix[:, :2].T + matrix[:, 2])
    inner = (slice(None), slice(12, -8), slice(12, -12))  # beyond it the picture may end
    same = parsing.shares[inner].argmax(0) == upright.shares[inner].argmax(0)
    assert same.mean() > 0.9
    back = upright.irises[:, :2] @ matrix[:, :2].T + matrix[:, 2]
    assert np.linalg.norm(parsing.irises[:, :2] - back, axis=1).max() < 0.15 * scale * np.ptp(
        points[RIGHT_EYE, 0]
    )
    assert_allclose(parsing.irises[:, 2], scale * upright.irises[:, 2], rtol=0.15)


def test_an_object_before_the_mouth_is_an_object(face: tuple[U8, F64]) -> None:
    rgb, points = face[0].copy(), face[1]
    x, y = np.round((points[NOSE_TIP] + points[LOWER_LIP_BOTTOM]) / 2).astype(int)
    bottom = int(points[CHIN, 1]) + 40
    rgb[y:bottom, x - 40 : x + 40] = (30, 60, 200)
    parsing = PARSER.parse(rgb, points)
    assert share(parsing, np.array([x, (y + points[CHIN, 1]) / 2]), FaceClass.OCCLUDER) > 0.6
    assert share(parsing, points[RIGHT_EYE].mean(0), FaceClass.OCCLUDER) < 0.2


def test_maps_are_read_between_cells_and_are_zero_beyond_them() -> None:
    shares = np.zeros((len(FaceClass), CELLS, CELLS), np.float32)
    shares[FaceClass.HAIR] = np.arange(CELLS)
    to_picture = np.array([[3.0, 0.0, 10.0], [0.0, 3.0, 20.0]])
    parsing = FaceParsing(shares, to_picture, np.zeros((2, 4)))
    hair = parsing.share(FaceClass.HAIR)
    inside = np.array([[10.0, 20.0], [10 + 3 * 5.5, 50.0], [10 + 3 * 63, 20 + 3 * 63]])
    assert_allclose(parsing.at(inside, hair), [0, 5.5, 63], atol=0.05)
    assert_allclose(parsing.at(np.array([[-50.0, 20.0], [10.0, 900.0]]), hair), 0)
    both = parsing.at(inside, np.dstack([hair, 2 * hair]))
    assert_allclose(both[:, 1], 2 * both[:, 0], atol=1e-3)


def test_a_face_outside_the_picture_is_not_a_mistake(face: tuple[U8, F64]) -> None:
    rgb, points = face
    parsing = PARSER.parse(rgb, points + 5000)
    assert np.isfinite(parsing.shares).all()
