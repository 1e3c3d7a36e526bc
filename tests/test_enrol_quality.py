"""What about a clip will weaken a swap: each fault is named, and a good clip has none."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import LEFT_EYE, LOWER_LIP_INNER, RIGHT_EYE, UPPER_LIP_INNER
from guise.aam.model import Identity
from guise.app.enrolment.quality import weaknesses


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
    picture, size = rest.picture.copy(), float(interocular(rest.shape))
    for eye in (RIGHT_EYE, LEFT_EYE):
        x, y = rest.shape[eye].mean(0)
        cv2.ellipse(
            picture, (round(x), round(y)), (round(0.27 * size), round(0.2 * size)), 0, 0, 360, (20, 20, 20), 5
        )
    worn = replace(p01, rest_frame=replace(rest, picture=picture))
    assert weaknesses(points, worn) == [
        "the person wears glasses, which leave traces in the face: take them off"
    ]
