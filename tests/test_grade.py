"""The grade of a swap: each figure counts as it should, and a worse picture gets a worse grade."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from models import model_file

from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.swapping.donors import open_donor
from guise.app.swapping.grade import WEIGHTS, Grade, grade


def graded(person: Identity, face: Identity) -> Grade:
    with Engine(person, Donor.of(face), None) as engine:
        found = grade(engine)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


@pytest.mark.slow
def test_a_face_over_itself_is_graded_best(p01: Identity) -> None:
    own, other = graded(p01, p01), graded(p01, open_donor("p05"))
    assert own.shape == 0
    assert own.score > other.score
    assert own.predicted < other.predicted - 0.1
    assert other.shape > 0.005


@pytest.mark.slow
def test_a_blurred_frame_and_a_sharp_face_are_told(p01: Identity) -> None:
    rest = p01.rest_frame
    blurred = np.asarray(cv2.GaussianBlur(rest.picture, (0, 0), 4.0), np.uint8)
    soft = replace(p01, rest_frame=replace(rest, picture=blurred))
    assert graded(soft, open_donor("p03")).sharpness > graded(p01, open_donor("p03")).sharpness + 0.3


def test_each_figure_lowers_the_score_and_the_largest_is_advised_about() -> None:
    fine = Grade(0.5, 0.5, 0.0, 0.005)
    assert (fine.word, fine.advice) == ("good", "")
    large = {"colour": 9.0, "light": 12.0, "sharpness": -0.9, "shape": 0.06}
    worse = [replace(fine, **{name: value}) for name, value in large.items()]
    assert all(one.predicted > fine.predicted + 0.1 for one in worse)
    assert all(one.score < fine.score for one in worse)
    words = ["colours differ", "light differs", "softer", "differ in shape"]
    bad = Grade(9.0, 12.0, -0.9, 0.06)
    for keep, word in zip(("colour", "light", "sharpness", "shape"), words, strict=True):
        weak = {"colour": 1.0, "light": 1.2, "sharpness": -0.3, "shape": 0.02}
        one = replace(bad, **{name: value for name, value in weak.items() if name != keep})
        assert word in one.advice


def test_too_sharp_a_face_costs_nothing_as_a_swap_softens_it() -> None:
    assert Grade(1, 1, 2.0, 0.01).predicted == Grade(1, 1, 0, 0.01).predicted


def test_a_figure_beyond_its_limit_counts_no_further() -> None:
    edge = WEIGHTS.most * WEIGHTS.light
    assert Grade(1, edge, 0, 0.01).predicted == Grade(1, 10 * edge, 0, 0.01).predicted
