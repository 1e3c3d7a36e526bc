"""Correcting landmarks by hand: edits and undo, symmetry, propagation, doubtful frames, the saved file."""

from pathlib import Path

import clips
import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks import LandmarkError, interocular, load_annotations, open_landmarker
from guise.aam.landmarks import mirror as mirrored
from guise.aam.landmarks.schemes import OUTER_LIPS
from guise.app.media import open_input
from guise.app.studio.landmark_correction import (
    CORRECTED,
    DETECTED,
    PROPAGATED,
    Correction,
    find_landmarks,
    load_correction,
    propagated,
    reflection,
    save_correction,
)

TRUTH = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"].astype(np.float32)
EYE, OTHER_EYE, NOSE = 36, 45, 30


def made(points: np.ndarray = TRUTH[:40]) -> Correction:
    count = len(points)
    origin = np.full(count, DETECTED, np.uint8)
    confidence = np.where(np.isfinite(points).all((1, 2)), 0.99, np.nan).astype(np.float32)
    return Correction(points.copy(), points.copy(), origin, confidence, 512 * np.arange(count))


def turned(points: np.ndarray, degrees: float) -> np.ndarray:
    angle = np.radians(degrees)
    return points @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def test_a_move_touches_one_point_of_one_frame_and_is_undone_and_redone() -> None:
    correction = made()
    correction.move(3, EYE, (10.25, 20.5))
    expected = TRUTH[:40].copy()
    expected[3, EYE] = 10.25, 20.5
    assert np.array_equal(correction.points, expected)
    assert correction.origin[3] == CORRECTED
    assert (np.delete(correction.origin, 3) == DETECTED).all()
    assert correction.undo() == 3
    assert np.array_equal(correction.points, TRUTH[:40])
    assert correction.origin[3] == DETECTED
    assert correction.undo() is None
    assert correction.redo() == 3
    assert np.array_equal(correction.points, expected)
    assert correction.redo() is None


def test_nudges_of_one_point_are_one_step_and_a_new_change_forgets_what_was_undone() -> None:
    correction = made()
    for _ in range(5):
        correction.nudge(0, NOSE, (0.2, 0))
    correction.nudge(0, EYE, (0, 1))
    assert correction.points[0, NOSE] == pytest.approx(TRUTH[0, NOSE] + (1, 0), abs=1e-4)
    correction.undo()
    correction.undo()
    assert np.array_equal(correction.points, TRUTH[:40])
    assert correction.can_redo
    correction.nudge(0, OTHER_EYE, (1, 1))
    assert not correction.can_redo
    assert correction.undo() == 0
    assert not correction.can_undo


def test_it_knows_what_is_not_saved() -> None:
    correction = made()
    assert not correction.unsaved
    correction.nudge(0, EYE, (1, 0))
    assert correction.unsaved
    correction.mark_saved()
    assert not correction.unsaved
    correction.nudge(0, EYE, (1, 0))
    assert correction.unsaved
    correction.undo()
    assert not correction.unsaved
    assert correction.points[0, EYE] == pytest.approx(TRUTH[0, EYE] + (1, 0), abs=1e-4)
    correction.undo()
    assert correction.unsaved


def test_mirroring_gives_the_other_side_the_same_correction() -> None:
    correction = made()
    face = correction.found[0]
    axis = face[OTHER_EYE] - face[EYE]
    out = axis / np.linalg.norm(axis)
    correction.move(0, EYE, face[EYE] - 4 * out)
    correction.move(0, NOSE, face[NOSE] + (0, 3))
    correction.mirror(0, EYE)
    moved = correction.points[0] - face
    assert moved[OTHER_EYE] == pytest.approx(4 * out, abs=0.3)
    assert moved[EYE] == pytest.approx(-4 * out, abs=1e-3)
    assert moved[NOSE] == pytest.approx((0, 3), abs=1e-3)
    assert np.abs(np.delete(moved, [EYE, OTHER_EYE, NOSE], axis=0)).max() < 1e-3
    correction.undo()
    assert np.array_equal(correction.points[0, OTHER_EYE], face[OTHER_EYE])


def test_mirroring_keeps_the_turn_of_a_head() -> None:
    """A correction equal on both sides of a turned head stays as it is when one side is copied to the other."""
    correction = made(TRUTH[60:100])
    face = correction.found[0]
    for point, other in ((EYE, OTHER_EYE), (4, 12)):
        axis = face[OTHER_EYE] - face[EYE]
        correction.move(0, point, face[point] + 0.05 * axis)
        correction.move(0, other, face[other] - 0.05 * axis)
    before = correction.points[0].copy()
    correction.mirror(0, OTHER_EYE)
    assert correction.points[0] == pytest.approx(before, abs=0.5)


@pytest.mark.parametrize("degrees", [0, 25, -100])
def test_the_reflection_turns_with_the_face(degrees: float) -> None:
    face = (TRUTH[0] + mirrored(TRUTH[0], 1280)) / 2 - 300
    out = turned(np.array([1.0, 0.0]), degrees)
    down = turned(np.array([0.0, 1.0]), degrees)
    linear = reflection(turned(face, degrees))
    assert linear @ out == pytest.approx(-out, abs=1e-5)
    assert linear @ down == pytest.approx(down, abs=1e-5)


def test_mirroring_needs_a_side() -> None:
    with pytest.raises(LandmarkError, match="axis of the face"):
        made().mirror(0, NOSE)


def test_a_row_is_reset_left_out_and_filled_from_the_nearest() -> None:
    points = TRUTH[:10].copy()
    points[2:5] = np.nan
    correction = made(points)
    with pytest.raises(LandmarkError, match="no points"):
        correction.move(3, EYE, (0, 0))
    with pytest.raises(LandmarkError, match="no points"):
        correction.mirror(3, EYE)
    correction.borrow(4)
    assert np.array_equal(correction.points[4], TRUTH[5])
    with pytest.raises(LandmarkError, match="no face was found"):
        correction.mirror(4, EYE)
    correction.clear(7)
    assert not correction.has_face(7)
    assert correction.origin[7] == CORRECTED
    correction.nudge(0, EYE, (5, 5))
    correction.reset(0)
    assert np.array_equal(correction.points[0], TRUTH[0])
    assert correction.origin[0] == DETECTED
    for _ in range(4):
        correction.undo()
    assert np.array_equal(correction.points, points, equal_nan=True)


def test_no_points_to_borrow_is_said() -> None:
    points = TRUTH[:3].copy()
    points[1:] = np.nan
    with pytest.raises(LandmarkError, match="no other frame"):
        made(points).borrow(0)


def test_propagation_stops_at_a_corrected_frame() -> None:
    correction = made()
    assert correction.propagation_end(0) == 40
    correction.nudge(9, EYE, (1, 0))
    correction.nudge(3, EYE, (1, 0))
    assert correction.propagation_end(0) == 3
    assert correction.propagation_end(3) == 9
    assert correction.propagation_end(9) == 40
    correction.propagate(4, TRUTH[4:9] + 1)
    assert (correction.origin[4:9] == PROPAGATED).all()
    assert correction.propagation_end(3) == 9
    assert correction.undo() == 4
    assert np.array_equal(correction.points[4:9], TRUTH[4:9])


def test_doubtful_are_slips_unsure_frames_and_those_without_a_face_until_they_are_corrected() -> None:
    points = TRUTH[:120].copy()
    eyes = float(interocular(points[0]))
    points[30, OUTER_LIPS] += (0.08 * eyes, 0)
    points[70:75, 0:8] -= (0.1 * eyes, 0)
    points[100] = np.nan
    correction = made(points)
    correction.confidence[50] = 0.6
    wrong = {30, 50, *range(70, 75), 100}
    doubtful = set(np.flatnonzero(correction.doubtful).tolist())
    assert wrong <= doubtful
    assert len(doubtful - wrong) <= 5
    correction.move(30, EYE, points[30, EYE])
    correction.propagate(70, TRUTH[70:75])
    assert not correction.doubtful[[30, 70, 71, 72, 73, 74]].any()


def test_propagated_points_follow_the_face_with_the_correction() -> None:
    """One corrected frame makes the following ones better than they were found, up to where the face is lost."""
    with open_input(SAMPLES / "p01" / "talk2.mp4") as source:
        pictures = [frame.rgb().copy() for frame, _ in zip(source, range(20), strict=False)]
    landmarker = open_landmarker("builtin")
    found = np.array([landmarker.detect(picture)[0].points for picture in pictures])
    blank = np.zeros_like(pictures[0])
    points = np.array(list(propagated(landmarker, [*pictures, blank, pictures[0]], TRUTH[0])))
    assert points.shape == (19, 81, 2)
    before = np.linalg.norm(found[1:] - TRUTH[1:20], axis=2).mean(1)
    after = np.linalg.norm(points - TRUTH[1:20], axis=2).mean(1)
    assert (after < before / 2).all()


def test_points_beyond_all_faces_are_not_propagated() -> None:
    picture = np.zeros((240, 320, 3), np.uint8)
    assert list(propagated(open_landmarker("builtin"), [picture, picture], TRUTH[0] / 4)) == []


def test_landmarks_are_found_corrected_saved_and_read(tmp_path: Path) -> None:
    clip, file = clips.cut("p01", tmp_path / "clip.mp4", 12), tmp_path / "clip.landmarks.npz"
    heard: list[float] = []
    count = find_landmarks(clip, file, open_landmarker("builtin"), lambda stage, share: heard.append(share))
    assert count == 12
    assert heard == sorted(heard)
    assert heard[-1] == 1
    before = load_annotations(file).points
    correction = load_correction(file)
    correction.move(4, EYE, before[4, EYE] + (3.5, -2.25))
    correction.clear(7)
    save_correction(file, correction)
    assert not correction.unsaved
    expected = before.copy()
    expected[4, EYE] += 3.5, -2.25
    expected[7] = np.nan
    assert np.array_equal(load_annotations(file).points, expected, equal_nan=True)
    again = load_correction(file)
    assert np.array_equal(again.points, expected, equal_nan=True)
    assert np.array_equal(again.found, before)
    assert np.flatnonzero(again.origin == CORRECTED).tolist() == [4, 7]
    again.reset(4)
    assert np.array_equal(again.points[4], before[4])
    with np.load(file) as stored:
        assert set(stored) >= {"about", "pts", "size", "track", "box", "confidence", "point_confidence"}
        assert stored["track"][:, 0].tolist() == [0] * 7 + [-1] + [0] * 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clip.landmarks.npz", "clip.mp4"]


def test_a_clip_without_a_face_is_said_and_leaves_nothing(tmp_path: Path) -> None:
    clip = clips.empty_scene(tmp_path / "clip.mp4")
    with pytest.raises(LandmarkError, match="no face was found in the clip"):
        find_landmarks(clip, tmp_path / "clip.npz", open_landmarker("builtin"), lambda stage, share: None)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clip.mp4"]
