"""What about a clip will weaken a swap: each fault is named, and a good clip has none."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file
from worn_glasses import with_glasses

from guise.aam.landmarks.schemes import BROWS, LEFT_EYE, LOWER_LIP_INNER, RIGHT_EYE, UPPER_LIP_INNER
from guise.aam.model import Identity
from guise.app.enrolment.quality import longest_rest, sharpness, weaknesses


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    """(n, 81, 2) of a clip with speech, some frames without a face."""
    truth = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"].astype(float)
    truth[5] = np.nan
    return truth


def test_a_good_clip_has_no_weakness(p01: Identity, points: np.ndarray) -> None:
    assert weaknesses(points, p01) == []


def gap_of(points: np.ndarray, least: float) -> np.ndarray:
    """With the lips at least so many pixels apart."""
    wide = points.copy()
    wide[:, LOWER_LIP_INNER, 1] = np.maximum(wide[:, LOWER_LIP_INNER, 1], wide[:, UPPER_LIP_INNER, 1] + least)
    return wide


def test_each_fault_of_movement_is_named(p01: Identity, points: np.ndarray) -> None:
    shut = points.copy()
    shut[:, LOWER_LIP_INNER] = shut[:, UPPER_LIP_INNER]
    assert weaknesses(gap_of(points, 15), p01)[0].startswith("the mouth is never shut")
    assert weaknesses(shut, p01)[0].startswith("the mouth never opens")
    assert weaknesses(points / 6, p01)[0].startswith("the face is only 31 pixels wide")


def test_a_face_that_never_rests_is_named(p01: Identity, points: np.ndarray) -> None:
    talking = points.copy()
    for first in range(0, len(points), 4):  # the lips part in every fourth frame
        talking[first] = gap_of(points[first : first + 1], 12)[0]
    assert weaknesses(talking, p01)[0].startswith("the face is never at rest")
    assert longest_rest(talking[np.isfinite(talking).all((1, 2))]) < 5
    assert longest_rest(np.repeat(points[:1], 40, axis=0)) in (0, 40)
    assert weaknesses(talking[:20], p01) == []  # too few frames, such as photos, say nothing


def test_a_fringe_is_named(p01: Identity, points: np.ndarray) -> None:
    rest = p01.rest_frame
    picture, width = rest.picture.copy(), np.ptp(rest.shape[:, 0])
    (x0, _), (x1, y1) = rest.shape[BROWS].min(0), rest.shape[BROWS].max(0)
    top = int(rest.shape[:, 1].min() - 0.3 * width)
    rng = np.random.default_rng(1)
    for x in np.arange(x0 - 0.1 * width, x1 + 0.1 * width, 1.0):  # strands down to the eyes
        end = int(y1 + 0.06 * width + rng.normal(0, 3))
        shade = int(rng.integers(30, 70))
        cv2.line(
            picture,
            (round(x), top),
            (round(x + rng.normal(0, 4)), end),
            (shade, shade * 2 // 3, shade // 2),
            2,
        )
    hung = replace(p01, rest_frame=replace(rest, picture=picture))
    assert any(sentence.startswith("hair hangs over the brows") for sentence in weaknesses(points, hung))


def test_each_fault_of_light_is_named(p01: Identity, points: np.ndarray) -> None:
    rest = p01.rest_frame
    dark = replace(p01, rest_frame=replace(rest, picture=(rest.picture // 6).astype(np.uint8)))
    assert weaknesses(points, dark) == ["the face is dark: turn towards a window or a lamp"]
    middle = round(float(rest.shape[:, 0].mean()))
    half = rest.picture.copy()
    half[:, :middle] //= 4
    lit = replace(p01, rest_frame=replace(rest, picture=half))
    assert weaknesses(points, lit) == ["the light comes from one side: turn towards it"]


def test_glasses_are_named(p01: Identity, points: np.ndarray) -> None:
    rest = p01.rest_frame
    worn = replace(p01, rest_frame=replace(rest, picture=with_glasses(rest.picture, rest.shape)))
    assert weaknesses(points, worn) == [
        "the person wears glasses, of which traces stay in the face: take them off, or swap with --glasses keep"
    ]


def test_dark_lashes_are_not_taken_for_glasses(p01: Identity, points: np.ndarray) -> None:
    rest = p01.rest_frame
    picture = rest.picture.copy()
    for eye in (RIGHT_EYE, LEFT_EYE):
        cv2.polylines(picture, [np.round(rest.shape[eye]).astype(np.int32)], True, (20, 15, 15), 4)
    assert weaknesses(points, replace(p01, rest_frame=replace(rest, picture=picture))) == []


def test_a_soft_picture_is_named_whatever_its_size(p01: Identity, points: np.ndarray) -> None:
    rest = p01.rest_frame
    soft = np.asarray(cv2.GaussianBlur(rest.picture, (0, 0), 2.5), np.uint8)
    assert weaknesses(points, replace(p01, rest_frame=replace(rest, picture=soft)))[0].startswith(
        "the picture of"
    )
    large = np.asarray(cv2.resize(rest.picture, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), np.uint8)
    shape = (rest.shape + 0.5) * 2 - 0.5
    assert sharpness(replace(rest, picture=large, shape=shape)) == pytest.approx(sharpness(rest), rel=0.15)
