"""Joint refinement of generic landmarks: noise goes; the mean shape, blinks and speech stay."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from clips import cut as cut_clip
from made_up import SAMPLES
from models import SMALL
from numpy.testing import assert_allclose

import guise.app.enrolment.enrol
from guise.aam.appearance import openness
from guise.aam.landmarks import Face, interocular
from guise.aam.landmarks.schemes import BROWS
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.refinement import Refined, anchored, refine_shapes
from guise.aam.similarity import Failed
from guise.aam.tracker import Crop, Fit, cut
from guise.app.cli.main import main
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.media import open_input

FRAME = ReferenceFrame.canonical(48)
EVERY = 4


@cache
def talk() -> tuple[list[np.ndarray], np.ndarray]:
    """Luma of every fourth frame of the first sample person's clip, and the true landmarks."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as source:
        luma = [reference.luma.copy() for reference in source if reference.index % EVERY == 0]
    return luma, truth()[::EVERY]


def truth(clip: str = "talk") -> np.ndarray:
    return np.asarray(np.load(SAMPLES / "p01" / f"{clip}.npz")["landmarks"], np.float64)


def noise(shapes: np.ndarray, sd: float = 0.012, seed: int = 0) -> np.ndarray:
    """Noise of shapes (n, 81, 2) that differs from point to point and from frame to frame; sd in face sizes."""
    rng = np.random.default_rng(seed)
    return np.asarray(sd * interocular(shapes)[:, None, None] * rng.normal(size=shapes.shape))


def crops_of(luma: list[np.ndarray], shapes: np.ndarray) -> list[Crop]:
    crops = [cut(image, shape, FRAME) for image, shape in zip(luma, shapes, strict=True)]
    return [crop for crop in crops if not isinstance(crop, Failed)]


@cache
def noisy_and_refined() -> tuple[np.ndarray, Refined]:
    luma, shapes = talk()
    noisy = shapes + noise(shapes)
    return noisy, refine_shapes(crops_of(luma, noisy), noisy)


def error(shapes: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(n,) mean error without the constant part of each point, inter-ocular distances."""
    off = (shapes - true) / interocular(true)[:, None, None]
    return np.asarray(np.linalg.norm(off - off.mean(0), axis=2).mean(1))


def gain(shapes: np.ndarray, true: np.ndarray, column: int) -> float:
    """How much of an opening's variation is there: slope over the true one."""
    here, there = openness(shapes)[:, column], openness(true)[:, column]
    return float(np.polyfit(there, here, 1)[0])


@pytest.mark.slow
def test_independent_noise_is_removed() -> None:
    noisy, refined = noisy_and_refined()
    true = talk()[1]
    assert error(refined.shapes, true).mean() < 0.6 * error(noisy, true).mean()
    assert (error(refined.shapes, true) < error(noisy, true)).mean() > 0.95
    assert refined.residual[1] < refined.residual[0]
    assert refined.kept.all()


@pytest.mark.parametrize("column", [0, 1], ids=["mouth", "lids"])
@pytest.mark.slow
def test_speech_and_blinks_keep_their_size(column: int) -> None:
    noisy, refined = noisy_and_refined()
    true = talk()[1]
    assert gain(refined.shapes, true, column) > 0.97 * gain(noisy, true, column)
    assert gain(refined.shapes, true, column) > 0.9
    assert openness(true)[:, 1].min() < 0.3 * np.median(openness(true)[:, 1])


def test_the_mean_shape_stays() -> None:
    noisy, refined = noisy_and_refined()
    before = np.mean([FRAME.align(s) for s in noisy], axis=0)
    after = np.mean([FRAME.align(s) for s in refined.shapes], axis=0)
    assert np.abs(after - before).max() < 0.004 * FRAME.resolution


@pytest.mark.slow
def test_an_error_that_all_frames_share_stays() -> None:
    luma, shapes = talk()
    shapes, luma = shapes[::2], luma[::2]
    shift = np.zeros((81, 2))
    shift[BROWS, 1] = -0.05
    common = shapes + shift * interocular(shapes)[:, None, None]
    refined = refine_shapes(crops_of(luma, common), common).shapes
    left = ((refined - shapes) / interocular(shapes)[:, None, None]).mean(0)
    assert_allclose(left, shift, atol=0.01)


@pytest.mark.slow
def test_a_frame_with_wrong_landmarks_is_left_out() -> None:
    luma, shapes = talk()
    shapes = shapes.copy()
    shapes[20] += 0.5 * interocular(shapes[20])
    refined = refine_shapes(crops_of(luma, shapes), shapes)
    assert not refined.kept[20]
    assert refined.kept.mean() > 0.9


def test_anchored_changes_have_no_mean_and_do_not_depend_on_openings() -> None:
    before = talk()[1]
    after = before + noise(before) + 3 + 20 * openness(before)[:, :1, None]
    kept = np.ones(len(before), bool)
    changes = (anchored(before, after, kept) - before).reshape(len(before), -1)
    assert np.abs(changes).max() > 1
    sizes = interocular(before)[:, None]
    assert np.abs((changes / sizes).mean(0)).max() < 1e-3
    for opening in openness(before)[:, :2].T:
        assert np.abs((changes / sizes).T @ (opening - opening.mean())).max() < 1e-2


class Noisy:
    """A landmarker that sees the truth of a sample clip, in its order of frames, with noise."""

    name = "noisy"

    def __init__(self, points: np.ndarray) -> None:
        self._points = iter(points)

    def detect(self, rgb: np.ndarray) -> list[Face]:
        return [Face.around(next(self._points), 1.0)]

    def refine(self, rgb: np.ndarray, previous: Face) -> Face | None:
        return None


def enrolled(*, refine: bool) -> Identity:
    points = truth() + noise(truth(), 0.02)
    source = LandmarkSource(landmarker=Noisy(points), refine=refine)
    return enrol([SAMPLES / "p01" / "talk.mp4"], source, name="p01", options=SMALL)


def tracking_error(person: Identity, luma: list[np.ndarray], true: np.ndarray) -> float:
    """Mean error over another clip, each frame started from the truth of the one before."""
    fits = [person.tracker.fit(image, start) for image, start in zip(luma[1:], true[:-1], strict=True)]
    shapes = np.stack([fit.shape for fit in fits if isinstance(fit, Fit)])
    assert len(shapes) > 0.95 * len(fits)
    return float(error(shapes, true[1:][[isinstance(fit, Fit) for fit in fits]]).mean())


@pytest.mark.slow
def test_a_person_enrolled_on_refined_landmarks_is_tracked_better(
    talk2: tuple[list[np.ndarray], np.ndarray],
) -> None:
    with_it, without = (tracking_error(enrolled(refine=refine), *talk2) for refine in (True, False))
    assert with_it < 0.95 * without


@pytest.mark.slow
def test_landmarks_of_a_file_are_not_refined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> Refined:
        raise AssertionError("refined")

    monkeypatch.setattr(guise.app.enrolment.enrol, "refine_shapes", refused)
    clip = cut_clip("p01", tmp_path / "clip.mp4", 30, clip="talk.mp4")
    np.savez(tmp_path / "clip.npz", landmarks=truth()[:30])
    assert enrol([clip], LandmarkSource(), name="p01", options=SMALL).name == "p01"
    assert enrol([clip], LandmarkSource([tmp_path / "clip.npz"]), name="p01", options=SMALL).name == "p01"


def test_landmarks_of_the_built_in_landmarker_are_kept_by_default(tmp_path: Path) -> None:
    alone, noisy = tmp_path / "clip.mp4", Noisy(truth())
    assert not LandmarkSource().refines(alone)
    assert LandmarkSource(refine=True).refines(alone)
    assert LandmarkSource(landmarker=noisy).refines(alone)
    assert not LandmarkSource(landmarker=noisy, refine=False).refines(alone)
    assert not LandmarkSource([tmp_path / "points.npz"], refine=True).refines(alone)


@pytest.mark.parametrize(("switch", "wanted"), [([], None), (["--refine"], True), (["--no-refine"], False)])
def test_the_command_switches_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, switch: list[str], wanted: bool | None
) -> None:
    seen: list[bool | None] = []

    def stop(clips: object, output: object, landmarks: LandmarkSource, **_: object) -> None:
        seen.append(landmarks.refine)
        raise guise.app.enrolment.enrol.EnrolError("enough")

    monkeypatch.setattr("guise.app.enrolment.file.enrol_file", stop)
    main(["enroll", "clip.mp4", "-o", str(tmp_path / "a.guise"), *switch, "--quiet"])
    assert seen == [wanted]
