"""Faces at any roll: boxes of turned pictures, the landmarker, trackers of a face that rolls over, and covers."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from guise.aam.landmarks import Face, FaceTracker, interocular
from guise.aam.landmarks.boxes import no_boxes
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.detector import FaceDetector
from guise.aam.landmarks.face import BoxFit
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import (
    EVERY_ROLL,
    SCHEDULE_FRAMES,
    TURNED,
    UPRIGHT,
    RolledBoxes,
    detect_at_rolls,
    detect_on_schedule,
    nearest_quarter,
    turn_of,
)
from guise.aam.landmarks.schemes import IBUG68
from guise.app.media import Frame, open_input
from guise.app.people.faces import DetectedFrame, SegmentTracker, detect_faces
from guise.app.swapping.cover import cover

SAMPLES = Path(__file__).parents[1] / "sample_videos"
DEGREES = range(0, 360, 45)


@cache
def landmarker() -> BuiltinLandmarker:
    return BuiltinLandmarker()


@cache
def still(person: str = "p06") -> tuple[np.ndarray, np.ndarray]:
    """A frame, cut about the face, and its 81 points."""
    points = np.load(SAMPLES / person / "talk.npz")["landmarks"][0].astype(float)
    with open_input(SAMPLES / person / "talk.mp4") as source:
        rgb = next(iter(source)).rgb()
    low = np.maximum((points.mean(0) - 160).astype(int), 0)
    return rgb[low[1] : low[1] + 320, low[0] : low[0] + 320].copy(), points - low


def rolled(rgb: np.ndarray, points: np.ndarray, degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """A picture rolled clockwise about its middle."""
    height, width = rgb.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -degrees, 1.0)
    moved = cv2.warpAffine(rgb, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return moved, points @ matrix[:, :2].T + matrix[:, 2]


def error(points: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm(points - truth, axis=1)[IBUG68].mean() / interocular(truth))


class White:
    """A detector of the white rectangle in a black picture."""

    name, fit = "white", BoxFit()

    def __init__(self, score: float = 0.9) -> None:
        self.score, self.calls = score, 0

    def detect(self, image: np.ndarray) -> np.ndarray:
        return self.detect_scored(image)[0]

    def detect_scored(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.calls += 1
        rows, columns = np.nonzero(image[..., 0])
        if not len(rows):
            return no_boxes()
        box = np.array([[columns.min(), rows.min(), columns.max(), rows.max()]], np.float32)
        return box, np.array([self.score], np.float32)


def white(x0: int = 10, y0: int = 4, x1: int = 30, y1: int = 18) -> np.ndarray:
    picture = np.zeros((50, 90, 3), np.uint8)
    picture[y0 : y1 + 1, x0 : x1 + 1] = 255
    return picture


@pytest.mark.parametrize("quarter_turn", EVERY_ROLL)
def test_boxes_of_a_turned_picture_lie_where_they_are_in_the_picture(quarter_turn: int) -> None:
    found = detect_at_rolls(White(), white(), (quarter_turn,))
    np.testing.assert_array_equal(found.boxes, [[10, 4, 30, 18]])
    assert nearest_quarter(float(found.turns[0])) == quarter_turn


@pytest.mark.parametrize("quarter_turn", EVERY_ROLL)
def test_a_face_is_upright_in_the_picture_turned_for_it(quarter_turn: int) -> None:
    seen = []

    class Camera(White):
        def detect_scored(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            seen.append(image)
            return super().detect_scored(image)

    picture = white()
    detect_at_rolls(Camera(), np.ascontiguousarray(np.rot90(picture, -quarter_turn)), (quarter_turn,))
    np.testing.assert_array_equal(seen[0], picture)


def test_one_face_at_several_rolls_is_one_box_with_the_highest_score() -> None:
    found = detect_at_rolls(White(0.4), white(), UPRIGHT).and_others(
        detect_at_rolls(White(0.8), white(), TURNED)
    )
    assert len(found) == 4
    one = found.distinct()
    np.testing.assert_allclose(one.scores, [0.8])
    assert nearest_quarter(float(one.turns[0])) != 0
    assert len(RolledBoxes.none().distinct()) == 0


def test_what_looks_like_a_rolled_face_on_a_face_is_a_part_of_it() -> None:
    boxes = np.array([[0, 0, 100, 100], [65, 10, 95, 40], [65, 60, 95, 90], [120, 0, 150, 30]], np.float32)
    turns = np.array([0, np.pi, 0, np.pi], np.float32)
    found = RolledBoxes(boxes, np.array([0.9, 0.6, 0.6, 0.6], np.float32), turns).distinct()
    np.testing.assert_array_equal(found.boxes, boxes[[0, 2, 3]])


@pytest.mark.parametrize(("score", "most"), [(0.9, 3), (0.5, 5)])
def test_beside_a_sure_face_the_other_rolls_take_turns(score: float, most: int) -> None:
    searched = set()
    for index in range(7, 7 + SCHEDULE_FRAMES):
        detector = White(score)
        found = detect_on_schedule(detector, white(), index, 0.75)
        assert detector.calls <= most
        searched |= {nearest_quarter(turn) for turn in found.turns.tolist()}
    assert searched == set(EVERY_ROLL)


@pytest.mark.parametrize(
    ("score", "small", "calls"), [(0.9, False, [1, 1, 3]), (0.9, True, [2, 2, 3]), (0.5, False, [5] * 3)]
)
def test_beside_a_sure_large_face_only_that_is_searched_in_between(
    score: float, small: bool, calls: list[int]
) -> None:
    detectors = [White(score) for _ in calls]
    for index, detector in enumerate(detectors, 7):
        found = detect_on_schedule(detector, white(), index, 0.75, small=small)
        upright = found.boxes[found.turns == 0]
        np.testing.assert_allclose(upright, detect_at_rolls(White(), white(), UPRIGHT).boxes, atol=1)
    assert [detector.calls for detector in detectors] == calls


def test_a_detector_whose_boxes_lie_above_the_landmarks_is_corrected_at_any_roll() -> None:
    fit, box = BoxFit(0.5, (0.0, 0.25)), np.array([0, 0, 8, 8])
    np.testing.assert_allclose(fit.apply(box, np.pi / 2), [0, 2, 4, 6], atol=1e-6)
    np.testing.assert_allclose(fit.apply(box, np.pi), [2, 0, 6, 4], atol=1e-6)


@pytest.mark.parametrize("degrees", DEGREES)
def test_a_face_is_found_at_any_roll_as_well_as_upright(degrees: int) -> None:
    upright = error(landmarker().detect(still()[0])[0].points, still()[1])
    rgb, truth = rolled(*still(), degrees)
    (face,) = landmarker().detect(rgb)
    assert face.confidence > 0.5
    assert error(face.points, truth) < 1.2 * upright + 0.005
    assert abs(np.angle(np.exp(1j * (turn_of(face.points) - np.radians(degrees))))) < 0.1


@pytest.mark.parametrize(
    ("person", "degrees", "shift"),
    [("p01", 210, (-0.2, 0.45)), ("p01", 195, (0.0, 0.45)), ("p06", 225, (-0.2, 0.3))],
)
def test_a_face_upside_down_in_the_box_of_an_upright_one_is_read_the_right_way_up(
    person: str, degrees: int, shift: tuple[float, float]
) -> None:
    rgb, truth = rolled(*still(person), degrees)
    low, high = truth[IBUG68].min(0), truth[IBUG68].max(0)
    centre = (low + high) / 2 + (high - low).max() * np.array(shift)
    half = 0.4 * (high - low).max()
    face = landmarker().points_in_box(rgb, np.concatenate([centre - half, centre + half]), 0.0)
    assert face is not None
    assert error(face.points, truth) < 0.06
    assert face.confidence > 0.9


def test_a_landmarker_of_upright_faces_does_not_turn_the_picture() -> None:
    rgb, _ = rolled(*still(), 180)
    assert not [f for f in BuiltinLandmarker(turned=()).detect(rgb) if f.confidence >= 0.5]


class Recording:
    """The built-in detector, and the pictures that it gets."""

    name, fit = "recording", BoxFit()

    def __init__(self) -> None:
        self.pictures: list[np.ndarray] = []

    def detect_scored(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.pictures.append(image)
        return FaceDetector().detect_scored(image)


@pytest.mark.parametrize(("degrees", "side"), [(0, None), (40, 1), (-40, 3)])
def test_beside_a_face_that_leans_that_side_is_searched_too(degrees: float, side: int | None) -> None:
    """Others in the picture may lean farther: cameras are held askew."""
    detector, (rgb, _) = Recording(), rolled(*still(), degrees)
    assert BuiltinLandmarker(detector).detect(rgb)[0].confidence > 0.5
    turned = [] if side is None else [np.rot90(rgb, side)]
    assert len(detector.pictures) == 1 + len(turned)
    for searched, picture in zip(detector.pictures[1:], turned, strict=True):
        np.testing.assert_array_equal(searched, picture)


def rolling(count: int = 48) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """A face that rolls over once."""
    for index in range(count):
        yield rolled(*still(), 360 * index / count)


def test_a_face_that_rolls_over_is_tracked_all_the_way() -> None:
    detections = []

    class Counting(BuiltinLandmarker):
        def detect(self, rgb: np.ndarray) -> list[Face]:
            detections.append(rgb)
            return super().detect(rgb)

    tracker = FaceTracker(Counting(), recheck=10)
    for rgb, truth in rolling():
        face = tracker.update(rgb)
        assert face is not None
        assert error(face.points, truth) < 0.08
    assert len(detections) <= 5


def test_a_rolled_face_is_kept_beside_an_upright_one() -> None:
    upside_down, truth = rolled(*still("p06"), 180)
    tracker = FaceTracker(BuiltinLandmarker(), recheck=1)
    beside = np.zeros_like(upside_down)
    face = tracker.update(np.concatenate([upside_down, beside], axis=1))
    for _ in range(5):
        face = tracker.update(np.concatenate([upside_down, still("p01")[0]], axis=1))
    assert face is not None
    assert error(face.points, truth) < 0.08


@pytest.mark.slow
def test_a_face_that_rolls_over_is_one_tracklet_with_its_turns() -> None:
    frames = [Frame.from_rgb(rgb, index=index) for index, (rgb, _) in enumerate(rolling())]
    found = detect_faces(frames)
    assert found.frame.tolist() == list(range(len(frames)))
    assert set(found.tracklet.tolist()) == {0}
    off = np.exp(1j * found.turn) / np.exp(2j * np.pi * found.frame / len(frames))
    assert np.abs(np.angle(off)).max() < 0.15


def test_a_wrong_roll_with_a_higher_score_leaves_no_bystander_on_a_tracked_face() -> None:
    rgb, truth = rolled(*still(), 180)
    inner = truth[IBUG68]
    box = np.concatenate([inner.min(0), inner.max(0)])
    hair = np.add(box, (0, 40, 0, 40))
    boxes = np.array([box, box + 4, hair], np.float32)
    scores = np.array([0.9, 0.8, 0.6], np.float32)
    found = RolledBoxes(boxes, scores, np.array([0, np.pi, 0], np.float32))
    tracker = SegmentTracker(landmarker())
    for index in range(3):
        tracker.update(DetectedFrame(index, rgb, found, np.zeros((18, 32), np.uint8)))
    assert tracker.faces().frame.tolist() == [0, 1, 2]
    assert len(tracker.faces().bystander_frame) == 0


def test_an_upside_down_face_beside_an_upright_one_is_found_in_every_frame() -> None:
    both = np.concatenate([still("p01")[0], rolled(*still("p06"), 180)[0]], axis=1)
    found = detect_faces([Frame.from_rgb(both, index=index) for index in range(SCHEDULE_FRAMES)])
    assert sorted(found.frame.tolist()) == sorted([*range(SCHEDULE_FRAMES)] * 2)
    assert {nearest_quarter(turn) for turn in found.turn.tolist()} == {0, 2}


@pytest.mark.parametrize("degrees", range(0, 360, 15))
@pytest.mark.parametrize("person", ["p01", "p02", "p06"])
def test_a_cover_hides_all_points_of_a_face_at_any_roll(person: str, degrees: int) -> None:
    _, points = rolled(*still(person), degrees)
    points = points - points.mean(0) + 250
    box = np.concatenate([points[IBUG68].min(0), points[IBUG68].max(0)])
    frame = Frame.from_rgb(np.full((500, 500, 3), 255, np.uint8))
    cover(frame, region(box, turn=np.radians(degrees)), "solid")
    x, y = np.round(points).astype(int).T
    assert frame.rgb()[y, x].max() < 130
