"""Faces of a segment, on the sample people: all frames, both directions of time, and nobody where there is nobody."""

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from clips import empty_scene
from made_up import SAMPLES

from guise.aam.landmarks import interocular
from guise.aam.landmarks.rolls import RolledBoxes
from guise.aam.landmarks.schemes import IBUG68, INNER51
from guise.app.deidentify.stages.smooth import smooth
from guise.app.media import Frame, open_input
from guise.app.people import faces
from guise.app.people.faces import (
    Candidate,
    DetectedFrame,
    SegmentTracker,
    confirmed,
    detect_faces,
)
from guise.app.people.skin import FaceShares


def some(person: str, clip: str = "talk2.mp4", *, count: int = 30) -> list[Frame]:
    with open_input(SAMPLES / person / clip) as source:
        return [frame for frame, _ in zip(source, range(count), strict=False)]


def truth(person: str, count: int = 30) -> np.ndarray:
    return np.load(SAMPLES / person / "talk2.npz")["landmarks"][:count]


@pytest.mark.parametrize("person", ["p01", "p02", "p06"])
@pytest.mark.slow
def test_a_person_is_one_tracklet_in_every_frame(person: str) -> None:
    found = detect_faces(some(person))
    assert found.frame.tolist() == list(range(30))
    assert set(found.tracklet.tolist()) == {0}
    off = np.linalg.norm(found.points - truth(person), axis=-1)[:, INNER51].mean(1) / interocular(
        truth(person)
    )
    assert off.max() < 0.08
    assert len(found.cuts) == 0


def test_a_face_that_is_found_late_is_tracked_back_to_its_first_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from guise.aam.landmarks.detector import FaceDetector

    plain = FaceDetector.detect_scored
    calls: Iterator[int] = iter(range(1000))

    def late(self: FaceDetector, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        boxes, scores = plain(self, image)
        return (boxes, scores) if next(calls) >= 48 else (boxes[:0], scores[:0])

    monkeypatch.setattr(FaceDetector, "detect_scored", late)
    assert detect_faces(some("p01", count=20)).frame.tolist() == list(range(20))


def test_a_cut_ends_a_tracklet_and_begins_another() -> None:
    frames = some("p01", count=10) + some("p02", count=10)
    for index, frame in enumerate(frames):
        frame.index = index
    found = detect_faces(frames)
    assert found.cuts.tolist() == [10]
    assert found.frame[found.tracklet == 0].tolist() == list(range(10))
    assert found.frame[found.tracklet == 1].tolist() == list(range(10, 20))


@pytest.mark.parametrize(("width", "until"), [(640, 30), (160, 48)])
@pytest.mark.slow
def test_small_faces_are_searched_in_every_frame_while_there_are_any(
    width: int, until: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, searched = faces.detect_on_schedule, dict[int, bool]()

    def recorded(*arguments: object, small: bool) -> RolledBoxes:
        searched[int(arguments[2])] = small  # type: ignore[call-overload]
        return plain(*arguments, small=small)  # type: ignore[arg-type]

    def placed(frame: Frame) -> Frame:
        rgb = np.full((480, 640, 3), 90, np.uint8)
        small = cv2.resize(frame.rgb(), (width, width * 3 // 4), interpolation=cv2.INTER_AREA)
        rgb[: small.shape[0], : small.shape[1]] = small
        return Frame.from_rgb(rgb, index=frame.index)

    monkeypatch.setattr(faces, "detect_on_schedule", recorded)
    found = detect_faces([placed(frame) for frame in some("p01", count=48)])
    assert set(found.frame.tolist()) == set(range(48))
    assert [frame for frame, small in sorted(searched.items()) if small] == list(range(until))


def test_an_empty_scene_has_no_faces(tmp_path: object) -> None:
    with open_input(empty_scene(tmp_path / "empty.mp4")) as source:  # type: ignore[operator]
        found = detect_faces(source)
    assert len(found.frame) == 0
    assert len(found.bystander_frame) == 0


def test_no_frames_are_no_faces() -> None:
    assert len(detect_faces([]).frame) == 0


def test_a_doubtful_candidate_counts_when_it_is_seen_twice_more() -> None:
    box = np.array([0, 0, 20, 20], np.float32)
    seen = [Candidate(i, box, 0.5, confirmed=False) for i in (3, 5, 7, 30)]
    assert [one.frame for one in confirmed(seen)] == [3, 5, 7]
    assert len(confirmed([Candidate(1, box, 0.9, confirmed=True)])) == 1


def test_what_nothing_speaks_for_needs_a_likely_sight_at_its_place() -> None:
    box = np.array([10, 10, 40, 40], np.float32)
    pins = [Candidate(i, box, 0.5, confirmed=True, unlikely=True) for i in range(6)]
    assert confirmed(pins) == []
    likely = Candidate(8, box + 2, 0.5, confirmed=False)
    assert confirmed([*pins, likely]) == [*pins, likely]
    elsewhere = Candidate(8, box + 200, 0.5, confirmed=True)
    assert confirmed([*pins, elsewhere]) == [elsewhere]


@pytest.mark.parametrize(("turn", "likeness", "kept"), [(0, -2.3, 6), (np.pi, -2.3, 0), (np.pi, 2.0, 6)])
def test_a_certain_box_upside_down_must_also_look_like_a_face(
    turn: float, likeness: float, kept: int
) -> None:
    """A fold of clothes was covered with a score of 0.78."""
    tracker = SegmentTracker(_Unsure(likeness))  # type: ignore[arg-type]
    box = np.array([[10, 10, 90, 90]], np.float32)
    found = RolledBoxes(box, np.array([0.78], np.float32), np.array([turn], np.float32))
    for index in range(6):
        frame = DetectedFrame(index, np.zeros((100, 100, 3), np.uint8), found, np.zeros((18, 32), np.uint8))
        tracker.update(frame)
    assert len(tracker.faces().bystander_frame) == kept


@pytest.mark.parametrize(
    ("score", "likeness", "turn", "skin", "kept"),
    [
        (0.42, 4.3, 0, True, 0),
        (0.42, 6.5, 0, True, 1),
        (0.42, 6.5, 0, False, 0),
        (0.42, 8.5, 0, False, 1),
        (0.5, 1.0, 0, True, 0),
        (0.5, 2.5, 0, True, 1),
        (0.5, 2.5, 0, False, 0),
        (0.5, 2.5, np.pi, True, 0),
        (0.78, -1.0, 0, False, 1),
        (0.78, -5.0, 0, True, 0),
    ],
)
def test_what_is_seen_once_must_look_much_like_a_face_or_be_detected_well_upright(
    score: float, likeness: float, turn: float, skin: bool, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sleeve that was seen in one frame was covered for half a second."""
    monkeypatch.setattr(FaceShares, "has_face", lambda *_: skin)
    tracker = SegmentTracker(_Unsure(likeness))  # type: ignore[arg-type]
    box = np.array([[10, 10, 50, 50]], np.float32)
    for index in range(6):
        seen = RolledBoxes(box, np.array([score], np.float32), np.array([turn], np.float32))
        found = seen if index == 3 else RolledBoxes.none()
        tracker.update(
            DetectedFrame(index, np.zeros((100, 100, 3), np.uint8), found, np.zeros((18, 32), np.uint8))
        )
    assert len(tracker.faces().bystander_frame) == kept


def test_a_face_that_is_surely_followed_is_nobody_else_upside_down() -> None:
    """Blurred, its mirror image was found with a score of 0.76."""
    rgb, small = np.zeros((100, 100, 3), np.uint8), np.zeros((18, 32), np.uint8)
    tracker = SegmentTracker(_Same())  # type: ignore[arg-type]
    for index in range(6):
        box, turns = (
            np.array([[10, 10, 50, 50], [14, -16, 46, 14]], np.float32),
            np.array([0, np.pi], np.float32),
        )
        tracker.update(
            DetectedFrame(index, rgb, RolledBoxes(box, np.full(2, 0.78, np.float32), turns), small)
        )
    assert set(tracker.faces().tracklet.tolist()) == {0}


@pytest.mark.parametrize(
    ("box", "likeness", "kept"),
    [
        ((44, 76, 54, 86), 2.5, 0),
        ((44, 76, 54, 86), 8.5, 1),
        ((44, 76, 62, 94), 2.5, 1),
        ((84, 76, 94, 86), 2.5, 1),
        ((44, 2, 54, 12), 2.5, 1),
    ],
)
def test_what_is_too_small_for_a_face_on_a_body_needs_more_than_skin(
    box: tuple[int, ...], likeness: float, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tie with rings was covered for seconds; above a head, beside a body, or larger, it may be somebody."""
    monkeypatch.setattr(FaceShares, "has_face", lambda *_: True)

    class OnePerson(_Same):
        def look_in_box(self, rgb: np.ndarray, box: np.ndarray, turn: float) -> tuple[object, float]:
            return (_face(box), 9.0) if box[2] - box[0] > 30 else (None, likeness)

        def refine(self, rgb: np.ndarray, previous: object) -> object:
            return _face(np.array([30, 20, 70, 60]))

    tracker = SegmentTracker(OnePerson())  # type: ignore[arg-type]
    for index in range(6):
        boxes = np.array([[30, 20, 70, 60], box], np.float32)[: 1 + (index == 3)]
        found = RolledBoxes(
            boxes, np.array([0.9, 0.5], np.float32)[: len(boxes)], np.zeros(len(boxes), np.float32)
        )
        rgb = np.full((100, 100, 3), 10 * index, np.uint8)
        tracker.update(DetectedFrame(index, rgb, found, np.zeros((18, 32), np.uint8)))
    assert len(tracker.faces().bystander_frame) == kept


class _Unsure:
    """A landmarker that finds no points."""

    def __init__(self, likeness: float) -> None:
        self._likeness = likeness

    def look_in_box(self, rgb: np.ndarray, box: np.ndarray, turn: float) -> tuple[None, float]:
        return None, self._likeness


def test_of_two_trackers_of_one_face_one_stays() -> None:
    tracker = SegmentTracker(_Same())  # type: ignore[arg-type]
    small = np.zeros((18, 32), np.uint8)
    for index in range(6):
        rgb = np.full((100, 100, 3), 10 * index, np.uint8)
        boxes = np.array([[10, 10, 50, 50], [60, 10, 99, 50]], np.float32)[: 2 if index == 0 else 1]
        found = RolledBoxes(boxes, np.full(len(boxes), 0.9, np.float32), np.zeros(len(boxes), np.float32))
        tracker.update(DetectedFrame(index, rgb, found, small))
    found = tracker.faces()
    assert (found.frame[found.tracklet == 0]).tolist() == list(range(6))
    assert len(found.frame) <= 8


class _Same:
    """A landmarker that takes every face to the first one's place."""

    def points_in_box(self, rgb: np.ndarray, box: np.ndarray, turn: float) -> object:
        return _face(box)

    def refine(self, rgb: np.ndarray, previous: object) -> object:
        return _face(np.array([10, 10, 50, 50]) if previous.box[0] < 40 else np.array([20, 10, 60, 50]))  # type: ignore[attr-defined]

    def look_in_box(self, rgb: np.ndarray, box: np.ndarray, turn: float) -> tuple[object, float]:
        return _face(box), -10.0


def _face(box: np.ndarray) -> object:
    from guise.aam.landmarks import Face
    from guise.aam.reference import ReferenceFrame

    points = ReferenceFrame.canonical(48).points
    low, high = points[IBUG68].min(0), points[IBUG68].max(0)
    scaled = (points - low) / (high - low) * (box[2:] - box[:2]) + box[:2]
    return Face.around(scaled, 0.9)


# -- smoothing -------------------------------------------------------------------------------------


def test_smoothing_reduces_jitter_and_keeps_what_moves_in_its_place() -> None:
    rng = np.random.default_rng(0)
    still = truth("p01", 1)[0].astype(float)
    frames = np.arange(60)
    noisy = still + rng.normal(size=(60, 81, 2)) * 0.15
    calm = smooth(frames, noisy, [])
    assert np.abs(np.diff(calm, axis=0)).mean() < 0.3 * np.abs(np.diff(noisy, axis=0)).mean()
    step = still + 20.0 * (frames >= 30)[:, None, None]
    np.testing.assert_allclose(smooth(frames, step, [])[[25, 35]], step[[25, 35]], atol=1.0)


def test_smoothing_does_not_reach_over_gaps_and_cuts() -> None:
    still = truth("p01", 1)[0].astype(float)
    shapes = np.stack([still] * 10 + [still + 40] * 10)
    for frames, cuts in ((np.r_[:10, 20:30], []), (np.arange(20), [10])):
        np.testing.assert_allclose(smooth(frames, shapes, cuts), shapes, atol=1e-9)
