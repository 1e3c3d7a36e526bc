"""Swapping files by the library: what is changed, kept, counted and marked."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from clips import cut, empty_scene, pictures, tags
from made_up import SAMPLES
from models import model_file
from threadpoolctl import threadpool_info

from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import SWAP
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.media import EncodeOptions, open_input
from guise.app.media.synthetic import DIGITAL_SOURCE_TYPE
from guise.app.media.time_range import TimeRange
from guise.app.swapping.file import swap_file
from guise.app.swapping.report import SwapError, SwapSettings
from guise.common.threads import one_thread
from guise.common.version import VERSION

LOSSLESS = SwapSettings(replace(SWAP, renderer="cpu"), EncodeOptions(lossless=True))


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


@pytest.fixture(scope="module")
def p06() -> Identity:
    return Identity.load(model_file("p06"))


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return cut("p01", tmp_path / "clip.mp4", 12)


def test_only_the_face_is_changed(tmp_path: Path, clip: Path, p01: Identity, p06: Identity) -> None:
    report = swap_file(clip, p06, tmp_path / "out.mp4", source=p01, settings=LOSSLESS)
    truth = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"]
    assert (report.frames, report.swapped, report.held, report.lost) == (12, 12, 0, 0)
    for i, (before, after) in enumerate(zip(pictures(clip), pictures(tmp_path / "out.mp4"), strict=True)):
        x0, y0 = np.floor(truth[i].min(0)).astype(int) - 6
        x1, y1 = np.ceil(truth[i].max(0)).astype(int) + 7
        outside = np.ones(before.shape, bool)
        outside[y0:y1, x0:x1] = False
        np.testing.assert_array_equal(after[outside], before[outside])
        nose = np.s_[y0 + (y1 - y0) // 3 : y1 - 20, x0 + 20 : x1 - 20]
        assert np.abs(after[nose].astype(int) - before[nose]).mean() > 2


def test_tracking_ahead_gives_the_same_bytes_as_frame_by_frame(
    tmp_path: Path, clip: Path, p01: Identity, p06: Identity
) -> None:
    swap_file(clip, p06, tmp_path / "out.mp4", source=p01, settings=LOSSLESS)
    with (
        one_thread(),
        Engine(p01, Donor.of(p06), LOSSLESS.face_finder(), LOSSLESS.look) as engine,
        open_input(clip) as source,
        open_input(tmp_path / "out.mp4") as made,
    ):
        for frame, written in zip(source, made, strict=True):
            assert engine.swap(frame).outcome == "swapped"
            rectangle = 0, 0, frame.width, frame.height
            np.testing.assert_array_equal(written.read_roi(*rectangle), frame.read_roi(*rectangle))


def test_the_file_says_that_the_face_is_synthetic(
    tmp_path: Path, clip: Path, p01: Identity, p06: Identity
) -> None:
    swap_file(clip, p06, tmp_path / "out.mp4", source=p01)
    found = tags(tmp_path / "out.mp4")
    assert found["comment"] == f"Synthetic face: made with Guise {VERSION}"
    assert found["digital_source_type"] == DIGITAL_SOURCE_TYPE
    assert DIGITAL_SOURCE_TYPE.startswith("http://cv.iptc.org/newscodes/digitalsourcetype/")


def test_sound_and_times_are_kept(tmp_path: Path, clip: Path, p01: Identity, p06: Identity) -> None:
    swap_file(clip, p06, tmp_path / "out.mp4", source=p01)
    with open_input(clip) as old, open_input(tmp_path / "out.mp4") as new:
        assert new.has_audio
        assert [f.pts * f.time_base for f in new] == [f.pts * f.time_base for f in old]


@pytest.mark.slow
def test_lost_frames_are_untouched_and_counted(tmp_path: Path, p01: Identity, p06: Identity) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    with open_input(SAMPLES / "p01" / "talk2.mp4") as source:
        for frame in source:
            shown = frame.rgb() if frame.index < 4 else np.full((480, 640, 3), 70, np.uint8)
            cv2.imwrite(str(frames / f"{frame.index:03d}.png"), shown[..., ::-1])
            if frame.index == 13:
                break
    leave = replace(LOSSLESS, unsure="leave")
    report = swap_file(frames, p06, tmp_path / "out", source=p01, settings=leave)
    assert (report.swapped, report.held, report.covered, report.lost) == (4, 4, 0, 6)
    last = cv2.imread(str(tmp_path / "out" / "013.png"))
    assert (last == 70).all()
    hold = replace(LOSSLESS, unsure="hold")
    report = swap_file(frames, p06, tmp_path / "held", source=p01, settings=hold)
    assert (report.swapped, report.held, report.covered, report.lost) == (4, 10, 0, 0)
    report = swap_file(frames, p06, tmp_path / "covered", source=p01, settings=LOSSLESS)
    assert (report.swapped, report.held, report.covered, report.lost) == (4, 4, 6, 0)


@pytest.mark.parametrize("graded", [True, False])
def test_a_swap_is_graded_if_the_settings_say_so(
    graded: bool, tmp_path: Path, clip: Path, p01: Identity, p06: Identity
) -> None:
    report = swap_file(clip, p06, tmp_path / "out.mp4", source=p01, settings=replace(LOSSLESS, graded=graded))
    assert (report.grade is not None) == graded


def test_one_image(tmp_path: Path, p01: Identity, p06: Identity) -> None:
    with open_input(SAMPLES / "p01" / "talk2.mp4") as source:
        rgb = next(iter(source)).rgb()
    cv2.imwrite(str(tmp_path / "one.png"), rgb[..., ::-1])
    report = swap_file(tmp_path / "one.png", p06, tmp_path / "two.png", source=p01)
    assert (report.frames, report.swapped) == (1, 1)
    assert b"digital_source_type" in (tmp_path / "two.png").read_bytes()


def test_a_video_without_the_person_leaves_nothing(tmp_path: Path, p01: Identity, p06: Identity) -> None:
    scene = empty_scene(tmp_path / "scene.mp4")
    with pytest.raises(SwapError, match="no face of the source person"):
        swap_file(scene, p06, tmp_path / "out.mp4", source=p01)
    assert list(tmp_path.iterdir()) == [scene]


def test_several_faces_are_reported_once(tmp_path: Path, p01: Identity, p06: Identity) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    with open_input(SAMPLES / "p01" / "talk2.mp4") as one, open_input(SAMPLES / "p02" / "talk2.mp4") as two:
        for left, right in zip(one, two, strict=True):
            both = np.concatenate([left.rgb(), right.rgb()], axis=1)
            cv2.imwrite(str(frames / f"{left.index:03d}.png"), both[..., ::-1])
            if left.index == 3:
                break
    said: list[str] = []
    report = swap_file(frames, p06, tmp_path / "out", source=p01, settings=SwapSettings(say=said.append))
    assert (report.swapped, report.faces) == (4, 2)
    assert said == [
        "frames: up to 2 faces were seen in a frame; the largest one that the source model knows was taken"
    ]


@pytest.mark.slow
@pytest.mark.usefixtures("quick_training")
def test_without_a_model_the_person_is_enrolled_first(tmp_path: Path, p06: Identity) -> None:
    clip = cut("p01", tmp_path / "clip.mp4", 40, clip="talk.mp4")
    landmarks = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][:40]
    np.savez(tmp_path / "clip.landmarks.npz", landmarks=landmarks)
    said: list[str] = []
    settings = SwapSettings(say=said.append)
    report = swap_file(clip, p06, tmp_path / "out.mp4", source=LandmarkSource(), settings=settings)
    assert report.swapped >= 38
    assert said[:2] == [
        "enrolling the person in clip.mp4",
        "landmarks of clip.mp4 from clip.landmarks.npz beside it",
    ]


def test_the_person_of_a_video_is_enrolled_once(
    tmp_path: Path, clip: Path, p01: Identity, p06: Identity, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GUISE_PEOPLE", str(tmp_path / "people"))
    monkeypatch.setattr("guise.app.enrolment.enrol.enrol", lambda *_, **__: p01)
    said: list[str] = []
    settings = replace(LOSSLESS, keep_people=True, say=said.append)
    for name in ("first.mp4", "second.mp4"):
        swap_file(clip, p06, tmp_path / name, source=LandmarkSource(), settings=settings)
    assert [text.split(" clip.mp4")[0] for text in said] == [
        "enrolling the person in",
        "Saved the model of the person in",
        "Using the saved model 'p01' for the person in",
    ]
    assert (tmp_path / "first.mp4").read_bytes() == (tmp_path / "second.mp4").read_bytes()
    assert len(list((tmp_path / "people").iterdir())) == 1


def test_one_thread_is_for_the_block_only() -> None:
    def threads() -> list[int]:
        return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]

    in_opencv, in_blas = cv2.getNumThreads(), threads()
    with one_thread():
        assert cv2.getNumThreads() == 1
        assert set(threads()) == {1}
    assert (cv2.getNumThreads(), threads()) == (in_opencv, in_blas)


@pytest.mark.slow
def test_outside_a_part_frames_are_kept_bit_by_bit_or_cut(
    tmp_path: Path, clip: Path, p01: Identity, p06: Identity
) -> None:
    part = replace(LOSSLESS, part=TimeRange(Fraction(4, 30), Fraction(8, 30)))
    kept = swap_file(clip, p06, tmp_path / "kept.mp4", source=p01, settings=part)
    assert (kept.frames, kept.swapped, kept.untouched) == (12, 4, 8)
    before, after = list(pictures(clip)), list(pictures(tmp_path / "kept.mp4"))
    assert [bool((a != b).any()) for a, b in zip(before, after, strict=True)] == [False] * 4 + [True] * 4 + [
        False
    ] * 4
    cut_off = swap_file(
        clip,
        p06,
        tmp_path / "cut.mp4",
        source=p01,
        settings=replace(part, part=replace(part.part, cuts=True)),
    )
    assert (cut_off.frames, cut_off.swapped, cut_off.untouched) == (4, 4, 0)
    assert len(list(pictures(tmp_path / "cut.mp4"))) == 4
    late = replace(LOSSLESS, part=TimeRange(Fraction(9)))
    with pytest.raises(SwapError, match="shows no frame from 9 s"):
        swap_file(clip, p06, tmp_path / "late.mp4", source=p01, settings=late)
    assert not (tmp_path / "late.mp4").exists()
