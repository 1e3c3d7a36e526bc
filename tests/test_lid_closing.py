"""Lids that were left apart are shut where the parsing sees no eye between them."""

import numpy as np
import pytest
from made_up import SAMPLES
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import (
    EYES,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_LIDS,
    RIGHT_EYE,
    RIGHT_LOWER_LID,
    RIGHT_UPPER_LID,
    UPPER_LIDS,
)
from guise.aam.lid_closing import LidCloser
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.app.media import open_input
from guise.common.arrays import F64, Bool


@pytest.fixture(scope="module")
def seen() -> tuple[FaceParsing, F64]:
    """A parsed frame of the first sample person with open eyes, and the true landmarks."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    points = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(np.float64)
    return FaceParser().parse(rgb, points), points


def with_skin_for_eyes(parsing: FaceParsing, where: Bool) -> FaceParsing:
    """The same with skin in some of the columns (64,) where eyes are."""
    shares = parsing.shares.copy()
    shares[FaceClass.SKIN][:, where] += shares[FaceClass.EYES][:, where]
    shares[FaceClass.EYES][:, where] = 0
    return FaceParsing(shares, parsing.to_picture, parsing.irises)


def test_open_eyes_stay_as_they_are(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    closer = LidCloser()
    closer.see(parsing, points)
    assert_allclose(closer(points), points)


def test_lids_shut_when_the_eyes_are_no_longer_seen_and_open_again(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    closer, everywhere = LidCloser(), np.ones(parsing.shares.shape[2], bool)
    closer.see(parsing, points)
    closer.see(with_skin_for_eyes(parsing, everywhere), points)
    shut = closer(points)
    assert_allclose(shut[UPPER_LIDS], points[LOWER_LIDS])
    others = np.setdiff1d(np.arange(len(points)), UPPER_LIDS)
    assert (shut[others] == points[others]).all()
    closer.see(parsing, points)
    assert_allclose(closer(points), points)


def test_each_eye_is_judged_by_itself(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    middle = parsing.to_cells[:, :2] @ points[EYES].mean(0) + parsing.to_cells[:, 2]
    right_side = np.arange(parsing.shares.shape[2]) < middle[0]
    closer = LidCloser()
    closer.see(parsing, points)
    closer.see(with_skin_for_eyes(parsing, right_side), points)
    assert_allclose(closer(points)[RIGHT_UPPER_LID], points[RIGHT_LOWER_LID])
    assert_allclose(closer(points)[LEFT_UPPER_LID], points[LEFT_UPPER_LID])
    assert (points[LEFT_LOWER_LID] != points[LEFT_UPPER_LID]).all()


def test_eyes_of_which_nothing_was_ever_seen_are_left_alone(seen: tuple[FaceParsing, F64]) -> None:
    """Behind dark glasses the parsing tells nothing."""
    parsing, points = seen
    closer = LidCloser()
    closer.see(with_skin_for_eyes(parsing, np.ones(parsing.shares.shape[2], bool)), points)
    assert_allclose(closer(points), points)
    assert_allclose(closer(points)[RIGHT_EYE], points[RIGHT_EYE])


def test_of_a_small_face_lids_stay_as_they_were_found(seen: tuple[FaceParsing, F64]) -> None:
    """The parsing saw a blurred eye 12 pixels wide for a second and then never again."""
    parsing, points = seen
    small, unseen = 0.2 * points, with_skin_for_eyes(parsing, np.ones(parsing.shares.shape[2], bool))
    closer = LidCloser()
    for one in (parsing, unseen):
        closer.see(FaceParsing(one.shares, 0.2 * one.to_picture, one.irises), small)
    assert_allclose(closer(small), small)
