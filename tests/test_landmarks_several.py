"""Following several faces: numbers that stay, faces that come back, and when the detector runs."""

import numpy as np
import pytest
from discs import Disc, Discs, face_at, scene

from guise.aam.landmarks import Face
from guise.aam.landmarks.tracking import MultiFaceTracker, TrackingLimits


def numbers(tracker: MultiFaceTracker, scenes: list[list[Disc]]) -> list[list[int]]:
    return [list(tracker.update(scene(discs))) for discs in scenes]


def test_a_track_that_comes_back_soon_is_the_same_and_later_another() -> None:
    there: list[Disc] = [(80, 100, 30)]
    tracker = MultiFaceTracker(Discs(), TrackingLimits(max_missed_frames=6))
    assert numbers(tracker, [there, [], [], there, *[[]] * 6, there, there]) == [
        [0], [], [], [0], *[[]] * 6, [0], [0]
    ]  # fmt: skip
    assert numbers(tracker, [[]] * 7 + [there]) == [[]] * 7 + [[1]]


def test_a_jump_is_another_track() -> None:
    assert numbers(MultiFaceTracker(Discs()), [[(60, 60, 30)], [(240, 160, 30)]]) == [[0], [1]]


def test_the_detector_runs_now_and_then_and_when_a_face_is_missing() -> None:
    discs = Discs()
    tracker = MultiFaceTracker(discs, TrackingLimits(detection_frames=5))
    one, two = (60, 100, 30), (220, 100, 30)
    looks = []
    for present in [[one]] * 11 + [[one, two]] * 6 + [[one]] * 12:
        before = discs.detections
        tracker.update(scene(present))
        looks.append(discs.detections - before)
    assert looks[:11] == [1, 0, 0, 0, 0] * 2 + [1]
    assert sum(looks[11:17]) == 1
    assert looks[-12:-7] == [1] * 5  # lost a moment ago
    assert looks[22:] != [1] * 7


def test_two_tracks_never_stay_on_one_face() -> None:
    apart = [[(100 + 4 * i, 100, 30), (220 - 4 * i, 100, 30)] for i in range(12)]
    merged: list[list[Disc]] = [[(160, 100, 30)]] * 12
    for found in numbers(MultiFaceTracker(Discs()), apart + merged)[12:]:
        assert len(found) == 1


@pytest.mark.parametrize(("seen", "frames"), [([0], 15), ([0, 15], 40), ([0, 5], 40), ([0, 20], 30)])
def test_a_face_that_was_seen_once_only_is_given_up(seen: list[int], frames: int) -> None:
    class Once(Discs):
        frame = -1

        def detect(self, rgb: np.ndarray) -> list[Face]:
            there = [face_at(60, 100)] if self.frame in seen else []
            return [face_at(220, 100), *there]

        def refine(self, rgb: np.ndarray, previous: Face) -> Face:
            return previous

    once = Once()
    tracker = MultiFaceTracker(once, TrackingLimits(detection_frames=5))
    found = 0
    for once.frame in range(40):
        found += sum(face.points.mean() < 130 for face in tracker.update(scene([])).values())
    assert found == frames


def test_faces_of_low_confidence_are_not_tracked() -> None:
    class Unsure(Discs):
        def all(self, rgb: np.ndarray) -> list[Face]:
            return [face_at(80, 100, confidence=0.4)]

    assert numbers(MultiFaceTracker(Unsure(), TrackingLimits(0.5)), [[]] * 3) == [[]] * 3
    assert numbers(MultiFaceTracker(Unsure(), TrackingLimits(0.3)), [[]] * 3) == [[0]] * 3
