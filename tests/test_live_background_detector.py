"""The background detector: boxes lie where the faces are, however the frame is stored."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks import iou
from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.rolls import nearest_quarter, turn_of
from guise.aam.landmarks.schemes import IBUG68
from guise.app.live.background_detector import LIMITS, BackgroundDetector, downscaled
from guise.app.media import Frame, open_input

HAND = Path(__file__).parents[2] / "shared/data/synthetic/hard/occlusion_hand.mp4"


@pytest.fixture
def detector() -> Iterator[BackgroundDetector]:
    with BackgroundDetector() as detector:
        yield detector


@pytest.fixture(scope="module")
def talk() -> Frame:
    with open_input(SAMPLES / "p01" / "talk.mp4") as source:
        return next(iter(source)).copy()


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """Box (4,) of the 68 points in that frame."""
    inner = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0, IBUG68]
    return np.concatenate([inner.min(0), inner.max(0)]).astype(np.float32)


def test_planes_and_rgb_give_the_true_box_and_points(
    detector: BackgroundDetector, talk: Frame, truth: np.ndarray
) -> None:
    for frame in (talk, Frame.from_rgb(talk.rgb())):
        detector.submit(frame)
        found = detector.found
        assert len(found) == 1
        assert found.scores[0] > 0.9
        assert iou(found.boxes[0], truth) > 0.8
        (face,) = detector.detect(np.zeros((1, 1, 3), np.uint8))
        inner = face.points[IBUG68]
        assert iou(np.concatenate([inner.min(0), inner.max(0)]), truth) > 0.9


@pytest.mark.parametrize(
    ("factor", "size"), [(1.5, (1280, 720)), (0.75, (480, 853)), (0.5, (320, 240)), (0.4, (700, 192))]
)
def test_boxes_are_those_of_the_picture_whatever_its_size(
    detector: BackgroundDetector, talk: Frame, truth: np.ndarray, factor: float, size: tuple[int, int]
) -> None:
    picture = np.full((*size[::-1], 3), 120, np.uint8)
    scaled = cv2.resize(talk.rgb(), None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    picture[: scaled.shape[0], : scaled.shape[1]] = scaled
    frame = Frame.from_rgb(picture)
    detector.submit(frame)
    assert iou(detector.found.boxes[0], ((truth + 0.5) * factor - 0.5).astype(np.float32)) > 0.8
    assert downscaled(frame).shape[0] == min(LIMITS.picture_height_pixels, size[1])


def test_an_upside_down_face_is_found_soon_and_then_in_every_frame(
    detector: BackgroundDetector, talk: Frame, truth: np.ndarray
) -> None:
    rgb = np.ascontiguousarray(talk.rgb()[::-1, ::-1])
    size = np.array(rgb.shape[1::-1])
    place = np.concatenate([size - 1 - truth[2:], size - 1 - truth[:2]]).astype(np.float32)
    hits = []
    for _ in range(12):
        detector.submit(Frame.from_rgb(rgb))
        turned = detector.found.boxes[np.abs(detector.found.turns) > 3]
        hits.append(any(iou(box, place) > 0.8 for box in turned))
        if hits[-1]:
            (face,) = detector.detect(np.zeros((1, 1, 3), np.uint8))
            assert iou(face.box, place) > 0.5
            assert nearest_quarter(turn_of(face.points)) == 2
    assert hits == sorted(hits)
    assert sum(hits) >= 4


def test_beside_an_upright_face_every_roll_takes_its_turn(detector: BackgroundDetector, talk: Frame) -> None:
    both = np.concatenate([talk.rgb(), talk.rgb()[::-1, ::-1]], axis=1)
    seen = []
    for _ in range(9):
        detector.submit(Frame.from_rgb(both))
        seen.append(2 in [nearest_quarter(turn) for turn in detector.found.turns.tolist()])
    assert seen == sorted(seen)
    assert any(seen)


def test_somebody_who_comes_in_is_found_in_that_very_frame(detector: BackgroundDetector, talk: Frame) -> None:
    alone = np.concatenate([np.full_like(talk.rgb(), 120), talk.rgb()], axis=1)
    small = cv2.resize(talk.rgb(), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    for wait in range(1, 5):
        for _ in range(wait):
            detector.submit(Frame.from_rgb(alone))
            assert len(detector.found) == 1
        both = alone.copy()
        both[100 : 100 + small.shape[0], 100 : 100 + small.shape[1]] = small
        detector.submit(Frame.from_rgb(both))
        assert (detector.found.scores >= 0.5).sum() == 2


def test_a_still_picture_of_one_face_is_searched_now_and_then(
    talk: Frame, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And one of two faces each time, or one that is not where somebody follows it."""
    searched = []

    def searching(self: FaceDetector, image: np.ndarray) -> Any:
        searched.append(image)
        return detect(self, image)

    detect = FaceDetector.detect_scored
    monkeypatch.setattr(FaceDetector, "detect_scored", searching)
    alone, two = talk.rgb(), np.concatenate([talk.rgb()] * 2, axis=1)
    for picture, followed, count in ((alone, None, 2), (alone, [], 9), (two, None, 9)):
        searched.clear()
        with BackgroundDetector() as detector:
            for _ in range(9):
                frame = Frame.from_rgb(picture)
                detector.submit(frame, followed)
                assert len(detector.found) > 0
        upright = downscaled(frame)
        assert sum(np.array_equal(image, upright) for image in searched) == count


def test_only_what_has_changed_is_searched_until_it_shows_somebody(
    detector: BackgroundDetector, talk: Frame, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched: list[int] = []
    detect = FaceDetector.detect_scored
    monkeypatch.setattr(
        FaceDetector,
        "detect_scored",
        lambda self, image: (searched.append(image.size), detect(self, image))[1],
    )
    alone = np.concatenate([np.full_like(talk.rgb(), 120), talk.rgb()], axis=1)
    book, both = alone.copy(), alone.copy()
    book[200:280, 200:280] = (90, 20, 160)
    small = cv2.resize(talk.rgb(), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    both[100 : 100 + small.shape[0], 100 : 100 + small.shape[1]] = small
    for picture, count, is_whole in ((alone, 1, True), (book, 1, False), (both, 2, True)):
        searched.clear()
        detector.submit(frame := Frame.from_rgb(picture))
        assert (detector.found.scores >= 0.5).sum() == count
        assert (downscaled(frame).size in searched) == is_whole
        assert searched


def test_drawing_into_a_submitted_frame_does_not_matter(detector: BackgroundDetector, talk: Frame) -> None:
    found = []
    for drawn in (False, True):
        frame = talk.copy()
        detector.submit(frame)
        if drawn:
            frame.write_roi(0, 0, np.zeros((frame.height, frame.width, 3), np.uint8))
        found.append(detector.found.boxes)
    np.testing.assert_array_equal(*found)


def test_before_the_first_frame_there_is_nobody(detector: BackgroundDetector) -> None:
    assert len(detector.found) == 0
    assert detector.detect(np.zeros((1, 1, 3), np.uint8)) == []


@pytest.mark.skipif(not HAND.is_file(), reason=f"{HAND.name} is not there")
def test_fingertips_are_not_faces(detector: BackgroundDetector) -> None:
    with open_input(HAND) as source:
        for frame in source:
            if frame.index in (30, 55, 90):
                detector.submit(frame)
                assert len(detector.found) == 1
