"""A person in plain view is never lost: a landmarker's points carry the track where the tracker fails."""

from dataclasses import replace
from itertools import pairwise
from typing import cast

import cv2
import numpy as np
import pytest

from guise.aam.landmarks import Face, Landmarker, open_landmarker
from guise.aam.landmarks.schemes import OUTER_EYE_CORNERS
from guise.aam.model import Identity
from guise.aam.person_tracker import LIMITS, PersonTracker
from guise.aam.similarity import Failed
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.aam.tracker import Fit, Tracker
from guise.common.arrays import F64, U8

Clip = tuple[list[np.ndarray], np.ndarray]


class Blinded(Tracker):
    """A person's tracker that recognises nobody while `blind` is true."""

    blind = True
    residual = 1.0  # of what it is shown meanwhile, in lost thresholds

    def fit(self, luma: U8, start: F64) -> Fit | Failed:
        return Failed("blind") if self.blind else super().fit(luma, start)

    def measured(self, luma: U8, shape: F64) -> Fit | Failed:
        fit = super().measured(luma, shape)
        assert isinstance(fit, Fit)
        return replace(fit, residual=self.residual * self.quality.threshold, carried=True)


@pytest.fixture
def blinded(p01: Identity) -> Blinded:
    return Blinded(**{name: getattr(p01.tracker, name) for name in p01.tracker.__dataclass_fields__})


def error(fit: Fit | Failed, truth: np.ndarray) -> float:
    """Mean distance of the points, inter-ocular distances."""
    assert isinstance(fit, Fit)
    a, b = truth[OUTER_EYE_CORNERS]
    return float(np.linalg.norm(fit.shape - truth, axis=1).mean() / np.linalg.norm(a - b))


def test_who_is_not_recognised_is_carried_by_the_landmarker(blinded: Blinded, talk2: Clip) -> None:
    luma, truth = talk2
    tracker = PersonTracker(blinded, open_landmarker("builtin"))
    fits = [tracker.update(frame) for frame in luma[:25]]
    assert all(isinstance(fit, Fit) and fit.carried for fit in fits)
    assert np.mean([error(fit, points) for fit, points in zip(fits, truth, strict=False)]) < 0.05
    assert tracker.lost_frames == 0


class Unsure:
    """A landmarker that always finds the same face, with a confidence of its own."""

    def __init__(self, points: F64, confidence: float) -> None:
        self._face = Face.around(points, confidence)

    def refine(self, rgb: U8, previous: Face) -> Face:
        offset = previous.points.mean(0) - self._face.points.mean(0)
        return Face.around(self._face.points + offset, self._face.confidence)

    def detect(self, rgb: U8) -> list[Face]:
        return []


@pytest.mark.parametrize(
    ("yaw", "confidence", "followed"),
    [(0, 0.6, True), (0, 0.3, False), (35, 0.4, False), (50, 0.3, True), (57, 0.1, True), (57, 0.05, False)],
)
def test_a_followed_head_may_turn_though_the_landmarker_is_less_sure(
    blinded: Blinded, talk2: Clip, yaw: float, confidence: float, followed: bool
) -> None:
    turn = np.radians(yaw)
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    points = HeadPose(rotation, 150.0, np.array([320.0, 240.0])).apply(SolidPrior.shipped().mean)
    tracker = PersonTracker(blinded, None, points, landmarker=cast(Landmarker, Unsure(points, confidence)))
    assert isinstance(tracker.update(talk2[0][0]), Fit) is followed


def test_who_is_recognised_is_not_carried(p01: Identity, talk2: Clip) -> None:
    tracker = PersonTracker(p01.tracker, open_landmarker("builtin"))
    fits = [tracker.update(frame) for frame in talk2[0][:20]]
    assert all(isinstance(fit, Fit) and not fit.carried for fit in fits)


def test_between_tracker_and_landmarker_the_points_do_not_jump(blinded: Blinded, talk2: Clip) -> None:
    luma, truth = talk2
    tracker, fits = PersonTracker(blinded, open_landmarker("builtin")), []
    for number, frame in enumerate(luma[:24]):
        blinded.blind = 8 <= number < 16
        fits.append(tracker.update(frame))
    carried = [isinstance(fit, Fit) and fit.carried for fit in fits]
    assert carried == [8 <= number < 16 for number in range(24)]
    a, b = truth[0][OUTER_EYE_CORNERS]
    true_steps = np.abs(np.median(np.diff(truth[:24], axis=0), axis=1)).max(1) / np.linalg.norm(a - b)
    for (old, new), true_step in zip(pairwise(fits), true_steps, strict=True):
        assert isinstance(old, Fit)
        assert isinstance(new, Fit)
        step = np.abs(np.median(new.shape - old.shape, axis=0)).max() / np.linalg.norm(a - b)
        assert step < true_step + 0.015


def test_an_empty_picture_is_a_loss(blinded: Blinded, talk2: Clip) -> None:
    nobody = np.full_like(talk2[0][0], 90)
    tracker = PersonTracker(blinded, open_landmarker("builtin"))
    fits = [tracker.update(frame) for frame in [*talk2[0][:3], nobody, nobody]]
    assert [isinstance(fit, Fit) for fit in fits] == [True, True, True, False, False]
    assert tracker.lost_frames == 2


@pytest.mark.parametrize(("residual", "taken"), [(LIMITS.max_carried_residual + 0.2, False), (1.1, True)])
def test_after_a_long_loss_only_a_likely_face_is_carried(
    blinded: Blinded, talk2: Clip, residual: float, taken: bool
) -> None:
    nobody = np.full_like(talk2[0][0], 90)
    tracker = PersonTracker(blinded, open_landmarker("builtin"))
    blinded.blind = False
    assert isinstance(tracker.update(talk2[0][0]), Fit)
    blinded.blind, blinded.residual = True, residual
    for _ in range(LIMITS.eager_lost_frames + 2):
        assert not isinstance(tracker.update(nobody), Fit)
    fits = [tracker.update(frame) for frame in talk2[0][1:7]]
    assert any(isinstance(fit, Fit) for fit in fits) is taken


def test_without_a_landmarker_nothing_is_carried(blinded: Blinded, talk2: Clip) -> None:
    tracker = PersonTracker(blinded, None, start=talk2[1][0])
    assert not isinstance(tracker.update(talk2[0][0]), Fit)


def rolled(luma: np.ndarray, points: np.ndarray, degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """A frame (h, w) rolled clockwise about its middle, with its points."""
    height, width = luma.shape
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -degrees, 1.0)
    picture = cv2.warpAffine(luma, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(picture), points @ matrix[:, :2].T + matrix[:, 2]


@pytest.mark.parametrize("start", [0, 90, 180, 270])
def test_who_rolls_on_from_any_roll_is_tracked(p01: Identity, talk2: Clip, start: int) -> None:
    tracker = PersonTracker(p01.tracker, open_landmarker("builtin"))
    for number, (luma, truth) in enumerate(zip(*talk2, strict=True)):
        if number == 12:
            return
        frame, points = rolled(luma, truth, start + 8 * number)
        assert error(tracker.update(frame), points) < 0.06
