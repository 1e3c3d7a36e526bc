"""Faces through a video: detection, refinement, losses, cuts, look-back; by scripted landmarkers."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from guise.aam.landmarks import Face, FaceTracker, interocular, load_annotations, open_landmarker, track_video
from guise.aam.landmarks.plausible import bend, is_plausible_motion, shape_confidence, visible_share
from guise.aam.landmarks.rolls import RolledBoxes
from guise.aam.landmarks.schemes import INNER51, LIPS, mean_geometry
from guise.aam.landmarks.tracking import MultiFaceTracker, TrackingLimits

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_videos"
PFLD = ROOT.parent / "shared" / "models" / "pfld.onnx"


def face_at(x: float, y: float = 50.0, size: float = 20.0, confidence: float = 0.9) -> Face:
    mean = mean_geometry().mean
    return Face.around(np.stack([mean.real, mean.imag], axis=-1) * size + (x, y), confidence)


class Scripted:
    """A landmarker whose faces of frame i are scripted; frame i is a picture filled with i."""

    name = "scripted"

    def __init__(self, detected: list[list[Face]], refined: list[Face | None]) -> None:
        self.detected, self.refined = detected, refined
        self.calls: list[str] = []

    def detect(self, rgb: np.ndarray) -> list[Face]:
        self.calls.append(f"detect {rgb[0, 0, 0]}")
        return self.detected[rgb[0, 0, 0]]

    def refine(self, rgb: np.ndarray, previous: Face) -> Face | None:
        self.calls.append(f"refine {rgb[0, 0, 0]}")
        return self.refined[rgb[0, 0, 0]]


def frames(count: int) -> list[np.ndarray]:
    return [np.full((2, 2, 3), i, np.uint8) for i in range(count)]


def places(points: np.ndarray) -> list[float | None]:
    return [None if np.isnan(p).any() else round(float(p.mean(axis=0)[0])) for p in points]


def middle(face: Face) -> int:
    return round(float(face.points.mean(axis=0)[0]))


def test_detects_once_and_refines_after() -> None:
    script = Scripted([[face_at(10)]] * 3, [face_at(10 + i) for i in range(3)])
    points = track_video(script, frames(3))
    assert points.shape == (3, 81, 2)
    assert points.dtype == np.float32
    assert script.calls == ["detect 0", "refine 1", "refine 2"]


class Overshooting:
    """A landmarker that finds a face at rest as far beyond its place as it is looked for before it."""

    name = "overshooting"

    def detect(self, rgb: np.ndarray) -> list[Face]:
        return [face_at(51)]

    def refine(self, rgb: np.ndarray, previous: Face) -> Face | None:
        return Face.around(2 * face_at(50).points - previous.points, 0.9)


@pytest.mark.parametrize("several", [False, True])
def test_points_do_not_swing_to_and_fro_on_a_face_at_rest(several: bool) -> None:
    """After the last frame alone they would for good, from 51 to 49 and back."""
    found: list[Face] = []
    if several:
        many = MultiFaceTracker(Overshooting())
        found = [many.update(picture)[0] for picture in frames(20)]
    else:
        one = FaceTracker(Overshooting(), recheck=0)
        found = [face for face in map(one.update, frames(20)) if face is not None]
    assert len(found) == 20
    np.testing.assert_allclose(found[-1].points, face_at(50).points, atol=0.01)


def test_a_face_found_elsewhere_is_not_looked_for_between_there_and_here() -> None:
    script = Scripted([[face_at(10)], [face_at(70)]], [None, None, face_at(71), face_at(72)])
    starts: list[int] = []
    refine = script.refine

    def watched(rgb: np.ndarray, previous: Face) -> Face | None:
        starts.append(middle(previous))
        return refine(rgb, previous)

    script.refine = watched  # type: ignore[method-assign]
    tracker = FaceTracker(script)
    assert all(map(tracker.update, frames(4)))
    assert starts[:2] == [middle(face_at(10)), middle(face_at(70))]


@pytest.mark.parametrize(
    "bad",
    [None, face_at(12, confidence=0.2), face_at(70), face_at(11, size=40), face_at(11, size=3)],
    ids=["lost", "unsure", "jumped", "grown", "tiny"],
)
def test_detects_again_where_refinement_fails(bad: Face | None) -> None:
    script = Scripted([[face_at(10 + i)] for i in range(3)], [None, bad, face_at(12)])
    points = track_video(script, frames(3))
    assert script.calls == ["detect 0", "refine 1", "detect 1", "refine 2"]
    assert places(points) == [middle(face_at(10 + i)) for i in range(3)]


def test_frames_without_a_face_are_nan() -> None:
    script = Scripted([[], [face_at(10)], [], []], [None] * 4)
    points = track_video(script, frames(4))
    assert places(points) == [None, middle(face_at(10)), None, None]


def test_no_frames_give_an_empty_result() -> None:
    assert track_video(Scripted([], []), []).shape == (0, 81, 2)


def test_largest_face_is_taken_and_reported_once() -> None:
    both = [face_at(60, size=30), face_at(10)]
    notes: list[str] = []
    points = track_video(Scripted([both] * 3, [None] * 3), frames(3), report=notes.append)
    assert notes == ["frame 0 has 2 faces; the largest one is taken"]
    assert places(points)[0] == middle(face_at(60, size=30))


def test_lost_face_is_found_again_where_it_was() -> None:
    detected = [[face_at(10)], [face_at(80, size=30), face_at(11)]]
    points = track_video(Scripted(detected, [None, None]), frames(2))
    assert places(points) == [middle(face_at(10)), middle(face_at(11))]


def test_recheck_gives_up_a_track_that_the_detector_denies_three_times() -> None:
    there, elsewhere = face_at(10), face_at(90)
    detected = [[there], [there], [elsewhere], [elsewhere], [elsewhere], [elsewhere]]
    script = Scripted(detected, [there] * 5 + [elsewhere])
    points = track_video(script, frames(6), recheck=2)
    assert places(points) == [middle(there)] * 4 + [middle(elsewhere)] * 2
    never = Scripted(detected, [there] * 6)
    assert places(track_video(never, frames(6), recheck=0)) == [middle(there)] * 6


def test_recheck_keeps_a_track_that_the_detector_misses() -> None:
    there = face_at(10)
    script = Scripted([[there]] + [[]] * 5, [there] * 6)
    assert places(track_video(script, frames(6), recheck=2)) == [middle(there)] * 6


def test_a_motion_that_no_head_makes_is_refused() -> None:
    before = face_at(100, size=50).points
    rng = np.random.default_rng(0)
    assert is_plausible_motion(before, before)
    assert is_plausible_motion(before, before * 1.05 + 10)
    assert not is_plausible_motion(before, before + 50)
    assert not is_plausible_motion(before, before * 1.5)
    assert not is_plausible_motion(before, before + rng.normal(0, 15, before.shape))
    assert not is_plausible_motion(before, np.zeros_like(before))


def test_bend_knows_only_shape() -> None:
    before = face_at(100, size=50).points
    turn = np.array([[0.8, -0.6], [0.6, 0.8]]) * 1.7
    assert bend(before, before @ turn.T + 30) < 1e-5
    moved = before.copy()
    moved[LIPS] += (0, 10)
    assert 0.02 < bend(before, moved) < 0.2


def test_confidence_of_no_face_is_zero() -> None:
    assert shape_confidence(np.full((81, 2), np.nan)) == 0
    assert shape_confidence(np.zeros((81, 2))) == 0
    squashed = face_at(0).points * (1, 0.2)
    assert shape_confidence(squashed) < 0.5 < shape_confidence(face_at(0).points)


def test_confidence_of_every_true_face_is_high() -> None:
    for clip in SAMPLES.glob("*/*.npz"):
        points = load_annotations(clip).points
        assert min(shape_confidence(p) for p in points[::10]) > 0.9


def test_visible_share_counts_points_inside() -> None:
    points = np.array([[-0.5, 0], [9.5, 4.5], [9.6, 0], [0, -0.6]])
    assert visible_share(points, 10, 5) == 0.5


@pytest.mark.skipif(not PFLD.is_file(), reason="the PFLD model is not there")
def test_pfld_tracks_a_sample_clip(tmp_path: Path) -> None:
    card = tmp_path / "pfld.toml"
    card.write_text(
        f'model = "{PFLD}"\nscheme = "ibug68"\n[input]\nsize = [112, 112]\n[crop]\nenlarge = 1.1\n'
    )
    capture = cv2.VideoCapture(str(SAMPLES / "p06" / "talk2.mp4"))
    images = [cv2.cvtColor(capture.read()[1], cv2.COLOR_BGR2RGB) for _ in range(60)]
    capture.release()
    images[20] = np.full_like(images[20], 80)
    truth = load_annotations(SAMPLES / "p06" / "talk2.npz").points[:60]
    tracker = FaceTracker(open_landmarker(str(card)))
    faces = [tracker.update(image) for image in images]
    assert [i for i, face in enumerate(faces) if face is None] == [20]
    for face, points in zip(faces, truth, strict=True):
        if face is not None:
            error = np.linalg.norm(face.points - points, axis=-1)[INNER51].mean() / interocular(points)
            assert error < 0.06


# -- several faces, with the boxes of a detector that runs on every frame ----------------------------------------------


class Moving:
    """A landmarker that finds the face at x = 10 plus the frame's number from nearby, where `seen` says that it can."""

    name = "moving"

    def __init__(self, seen: set[int]) -> None:
        self.seen = seen

    def detect(self, rgb: np.ndarray) -> list[Face]:
        raise AssertionError("the boxes are given")

    def refine(self, rgb: np.ndarray, previous: Face) -> Face | None:
        return self.there(rgb)

    def in_box(self, rgb: np.ndarray, box: np.ndarray, turn: float) -> Face | None:
        return self.there(rgb)

    def there(self, rgb: np.ndarray) -> Face | None:
        index = int(rgb[0, 0, 0])
        return face_at(10 + index) if index in self.seen else None


def at(*boxes: np.ndarray) -> RolledBoxes:
    """What a detector found, upright."""
    count = len(boxes)
    return RolledBoxes(np.array(boxes, np.float32).reshape(-1, 4), np.ones(count), np.zeros(count))


LIMITS = TrackingLimits(max_missed_frames=2, max_undetected_frames=3)


def boxed(seen: set[int], **options: Any) -> MultiFaceTracker:
    landmarker = Moving(seen)
    return MultiFaceTracker(landmarker, LIMITS, face_in_box=landmarker.in_box, **options)


def started(seen: set[int], count: int) -> tuple[MultiFaceTracker, list[np.ndarray]]:
    """A tracker of the face of the first frame, and the frames after it."""
    tracker, (first, *others) = boxed(seen), frames(count)
    assert tracker.update(first, at()) == {}
    assert tracker.start(face_at(10)) == 0
    return tracker, others


def test_where_only_a_box_was_detected_the_face_has_no_points() -> None:
    tracker, others = started({2}, 3)
    box = face_at(12).box
    assert np.isnan(tracker.update(others[0], at(box))[0].points).all()
    np.testing.assert_array_equal(tracker.boxes, [box])
    assert middle(tracker.update(others[1], at(box))[0]) == middle(face_at(12))


def test_a_face_that_is_lost_is_refined_on_and_then_given_up() -> None:
    tracker, others = started({1, 4}, 9)
    assert [list(tracker.update(frame, at())) for frame in others] == [[0], [], [], [0], [], [], [], []]
    assert tracker.start(face_at(10)) == 1


@pytest.mark.parametrize(("confidence", "last"), [(0.9, 9), (0.7, 4)])
def test_a_face_without_boxes_ends_unless_its_points_are_confident(confidence: float, last: int) -> None:
    class Doubtful(Moving):
        def there(self, rgb: np.ndarray) -> Face | None:
            return face_at(10, confidence=confidence)

    tracker, (first, *others) = MultiFaceTracker(Doubtful(set()), LIMITS), frames(10)
    tracker.update(first, at())
    tracker.start(face_at(10))
    assert [i for i, frame in enumerate(others, 1) if tracker.update(frame, at())] == list(range(1, last + 1))


def test_a_face_is_not_tracked_twice() -> None:
    tracker, _ = started({0}, 1)
    assert tracker.start(face_at(11)) is None
    assert tracker.start(face_at(80)) == 1


def test_of_two_tracks_that_come_together_the_one_that_moved_less_stays_alone() -> None:
    tracker, others = started(set(range(9)), 4)
    tracker.start(face_at(24))
    assert [list(tracker.update(frame, at(face_at(12).box))) for frame in others] == [[0]] * 3


def test_a_new_face_is_tracked_backward_until_it_is_lost() -> None:
    tracker = boxed({2, 3, 4, 5}, lookback_bytes=1000)
    for frame in frames(6):
        tracker.update(frame, at())
    assert [middle(face) for face in tracker.look_back(face_at(15))] == [
        middle(face_at(x)) for x in (14, 13, 12)
    ]


@pytest.mark.parametrize(("bytes_kept", "back"), [(0, 0), (1, 1), (48, 3), (10**6, 5)])
def test_how_far_it_looks_back_is_bounded_by_the_memory_of_the_frames(bytes_kept: int, back: int) -> None:
    tracker = boxed(set(range(9)), lookback_bytes=bytes_kept)
    for frame in frames(6):  # 12 bytes each
        tracker.update(frame, at())
    assert len(list(tracker.look_back(face_at(15)))) == back


def test_after_a_restart_nobody_is_tracked_and_nothing_lies_behind() -> None:
    tracker = boxed({0, 1, 2}, lookback_bytes=1000)
    first, second = frames(2)
    tracker.update(first, at())
    tracker.start(face_at(10))
    tracker.restart()
    assert tracker.update(second, at()) == {}
    assert list(tracker.look_back(face_at(11))) == []
    assert tracker.start(face_at(11)) == 1
