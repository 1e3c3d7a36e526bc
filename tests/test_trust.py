"""A face is trusted when it is the person's: whole or partly behind an object, but not from the object alone."""

import cv2
import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import BROWS, CHIN, NOSE_BASE, NOSE_ROOT
from guise.aam.model import Identity
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.aam.tracker import Tracker
from guise.app.media import Frame, open_input
from guise.app.swapping.trust import TrustJudge, _frontal_trust
from guise.common.arrays import F64, U8

BLUE = (30, 60, 200)


@pytest.fixture(scope="module")
def tracker() -> Tracker:
    return Identity.load(model_file("p01")).tracker


@pytest.fixture(scope="module")
def judge() -> TrustJudge:
    return TrustJudge()


def face_of(person: str) -> tuple[U8, F64]:
    """The first frame (h, w, 3) of a person's second clip, and its true landmarks (81, 2)."""
    with open_input(SAMPLES / person / "talk2.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    return rgb, np.load(SAMPLES / person / "talk2.npz")["landmarks"][0].astype(np.float64)


def behind_a_box(rgb: U8, shape: F64, top: float) -> Frame:
    """The frame with a blue box in front of the face, from a height down to below the picture's edge."""
    hidden = rgb.copy()
    x0, x1 = shape[:, 0].min(), shape[:, 0].max()
    hidden[round(top) :, round(x0 + 0.1 * (x1 - x0)) : round(x1 - 0.1 * (x1 - x0))] = BLUE
    return Frame.from_rgb(hidden)


def test_a_person_is_trusted_on_their_own_face_and_not_on_another_one(
    tracker: Tracker, judge: TrustJudge
) -> None:
    (own, own_shape), (other, other_shape) = face_of("p01"), face_of("p02")
    there = judge.locate(tracker, Frame.from_rgb(own), own_shape, 1.0)
    elsewhere = judge.locate(tracker, Frame.from_rgb(other), other_shape, 1.0)
    assert there.confidence > 0.5
    assert elsewhere.confidence < 0.5
    assert np.linalg.norm(there.shape - own_shape, axis=1).mean() < 0.05 * interocular(own_shape)


def test_a_person_is_trusted_behind_an_object(tracker: Tracker, judge: TrustJudge) -> None:
    rgb, shape = face_of("p01")
    assert judge.trust(tracker, behind_a_box(rgb, shape, shape[NOSE_BASE, 1]), shape) > 0.5


def test_a_face_of_which_hardly_anything_shows_is_not_trusted(tracker: Tracker, judge: TrustJudge) -> None:
    rgb, shape = face_of("p01")
    assert judge.trust(tracker, behind_a_box(rgb, shape, shape[BROWS, 1].min()), shape) < 0.5


def test_another_face_behind_an_object_is_not_trusted(tracker: Tracker, judge: TrustJudge) -> None:
    rgb, shape = face_of("p02")
    assert judge.trust(tracker, behind_a_box(rgb, shape, shape[NOSE_BASE, 1]), shape) < 0.5


def test_an_object_alone_is_not_trusted(tracker: Tracker, judge: TrustJudge) -> None:
    rgb, shape = face_of("p01")
    assert judge.trust(tracker, Frame.from_rgb(np.full_like(rgb, BLUE)), shape) < 0.5


def test_half_a_face_smeared_away_is_not_trusted(tracker: Tracker, judge: TrustJudge) -> None:
    """What neither the person's texture explains nor the parsing takes for an object."""
    rgb, shape = face_of("p01")
    rows = slice(round(shape[NOSE_ROOT, 1]), round(shape[CHIN, 1]))
    x0, x1 = round(shape[:, 0].min()), round(shape[:, 0].max())
    rgb[rows, x0:x1] = rgb[rows, x0:x1].mean((0, 1)).astype(np.uint8)
    assert judge.trust(tracker, Frame.from_rgb(rgb), shape) < 0.5


def test_a_landmarker_of_low_confidence_is_not_trusted(tracker: Tracker, judge: TrustJudge) -> None:
    rgb, shape = face_of("p01")
    assert judge.locate(tracker, Frame.from_rgb(rgb), shape, 0.2).confidence < 0.5


@pytest.mark.parametrize(("yaw", "trusted"), [(0, True), (-22, True), (31, True), (50, False), (-65, False)])
def test_a_head_is_trusted_up_to_a_turn(yaw: float, trusted: bool) -> None:
    about_y, _ = cv2.Rodrigues(np.array([0, -np.radians(yaw), 0]))
    pose = HeadPose(about_y, 150.0, np.array([320.0, 240.0]))
    assert pose.angles[0] == pytest.approx(yaw)
    assert (_frontal_trust(pose.apply(SolidPrior.shipped().mean)) > 0.9) == trusted
