"""One face through a video: detection, refinement, losses, cuts; by a scripted landmarker."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from guise.aam.landmarks import Face, Follower, interocular, load_annotations, open_landmarker, track_video
from guise.aam.landmarks.plausible import bend, followed, shape_confidence, visible_share
from guise.aam.landmarks.schemes import INNER51, LIPS, mean_geometry

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


def test_largest_face_is_taken_and_told_once() -> None:
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


def test_a_step_that_no_head_makes_is_refused() -> None:
    before = face_at(100, size=50).points
    rng = np.random.default_rng(0)
    assert followed(before, before)
    assert followed(before, before * 1.05 + 10)
    assert not followed(before, before + 50)
    assert not followed(before, before * 1.5)
    assert not followed(before, before + rng.normal(0, 15, before.shape))
    assert not followed(before, np.zeros_like(before))


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
def test_pfld_follows_a_sample_clip(tmp_path: Path) -> None:
    card = tmp_path / "pfld.toml"
    card.write_text(
        f'model = "{PFLD}"\nscheme = "ibug68"\n[input]\nsize = [112, 112]\n[crop]\nenlarge = 1.1\n'
    )
    capture = cv2.VideoCapture(str(SAMPLES / "p06" / "talk2.mp4"))
    images = [cv2.cvtColor(capture.read()[1], cv2.COLOR_BGR2RGB) for _ in range(60)]
    capture.release()
    images[20] = np.full_like(images[20], 80)
    truth = load_annotations(SAMPLES / "p06" / "talk2.npz").points[:60]
    follower = Follower(open_landmarker(str(card)))
    faces = [follower.step(image) for image in images]
    assert [i for i, face in enumerate(faces) if face is None] == [20]
    for face, points in zip(faces, truth, strict=True):
        if face is not None:
            error = np.linalg.norm(face.points - points, axis=-1)[INNER51].mean() / interocular(points)
            assert error < 0.06
