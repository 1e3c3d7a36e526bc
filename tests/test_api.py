"""`import guise`: quick, complete, and each function does what its command does."""

import asyncio
import multiprocessing
import re
import subprocess
import sys
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from clips import cut
from made_up import SAMPLES
from models import model_file
from PIL import Image

import guise

# The names of types that calls give; the page shows what they hold.
GIVEN = {"Face", "Hidden", "VideoFace", "VideoLandmarks"}


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[np.ndarray]:
    path = cut("p01", tmp_path_factory.mktemp("api") / "clip.mp4", 6)
    capture = cv2.VideoCapture(str(path))
    return [capture.read()[1][..., ::-1].copy() for _ in range(6)]


def test_all_names_are_there_and_documented() -> None:
    names = set(guise.__all__)
    assert len(names) == len(guise.__all__) > 30
    assert set(dir(guise)) == names | {"__version__"}
    assert all(getattr(guise, name).__doc__ for name in names)
    page = (Path(__file__).parents[1] / "docs" / "api.md").read_text(encoding="utf-8")
    assert [name for name in names - GIVEN if not re.search(rf"guise\.{name}\b|`{name}`", page)] == []


def test_other_names_are_not_there() -> None:
    with pytest.raises(AttributeError, match="module 'guise' has no attribute 'swap_everyone'"):
        guise.swap_everyone  # noqa: B018


def test_the_former_name_of_enroll_warns_each_time() -> None:
    for _ in range(2):
        with pytest.warns(DeprecationWarning, match=r"^guise\.enrol is now guise\.enroll$"):
            assert guise.enrol is guise.enroll


def test_the_version_is_that_of_the_distribution() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "guise", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"guise {guise.__version__}\n"


@pytest.mark.slow
def test_a_swapper_leaves_its_input_as_it_was(frames: list[np.ndarray]) -> None:
    with guise.Swapper(model_file("p06"), source=model_file("p01"), renderer="cpu") as swapper:
        for frame in frames:
            before = frame.copy()
            frame.setflags(write=False)
            swapped = swapper(frame)
            assert swapper.outcome == "swapped"
            np.testing.assert_array_equal(frame, before)
            assert swapped.shape == frame.shape
            assert swapped.dtype == np.uint8
            changed = (swapped != frame).any(2)
            assert 0.01 < changed.mean() < 0.6


@pytest.mark.slow
def test_a_swapper_takes_views_and_says_what_is_lost(frames: list[np.ndarray]) -> None:
    with guise.Swapper(
        guise.load(model_file("p06")), guise.load(model_file("p01")), renderer="cpu"
    ) as swapper:
        nobody = np.full_like(frames[0], 90)
        np.testing.assert_array_equal(swapper(nobody), nobody)
        assert swapper.outcome == "lost"
        assert swapper(frames[0][..., ::-1][..., ::-1]).shape == frames[0].shape


@pytest.mark.parametrize(
    ("frame", "got"),
    [
        (np.zeros((8, 8), np.uint8), r"\(8, 8\) uint8"),
        (np.zeros((8, 8, 3), np.float32), r"\(8, 8, 3\) float32"),
        ([[0]], "list"),
    ],
)
@pytest.mark.slow
def test_a_frame_of_another_kind_is_one_sentence(frame: object, got: str) -> None:
    with (
        guise.Swapper(model_file("p06"), model_file("p01"), renderer="cpu") as swapper,
        pytest.raises(guise.GuiseError, match=rf"must be an RGB array \(h, w, 3\) of uint8, got {got}"),
    ):
        swapper(frame)  # type: ignore[arg-type]


def test_landmarks_of_an_array_an_image_and_a_video(frames: list[np.ndarray], tmp_path: Path) -> None:
    [face] = guise.landmarks(frames[0])
    truth = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][0]
    eyes = np.linalg.norm(truth[45] - truth[36])
    assert np.linalg.norm(face.points - truth, axis=1).mean() < 0.06 * eyes
    cv2.imwrite(str(tmp_path / "a.png"), frames[0][..., ::-1])
    [[again]] = guise.landmarks(tmp_path / "a.png")
    np.testing.assert_allclose(again.points, face.points, atol=1e-3)
    video = list(guise.landmarks(cut("p01", tmp_path / "a.mp4", 3)))
    assert [len(faces) for faces in video] == [1, 1, 1]
    assert guise.landmarks(np.zeros((90, 120, 3), np.uint8)) == []


@pytest.mark.slow
def test_swap_file_from_paths_and_models_of_different_resolutions(tmp_path: Path) -> None:
    other = guise.enroll(cut("p02", tmp_path / "p02.mp4", 40, clip="talk.mp4"), frames=16, resolution=48)
    assert str(other).startswith("p02: ")
    output = tmp_path / "out.mp4"
    clip = cut("p01", tmp_path / "clip.mp4", 8)
    report = guise.swap_file(clip, other, output, source=model_file("p01"), renderer="cpu")
    assert report.swapped == report.frames == 8
    with pytest.raises(guise.GuiseError, match="exists"):
        guise.swap_file(clip, other, output, source=model_file("p01"))


@pytest.mark.slow
def test_a_swapper_never_takes_somebody_else_for_the_person(frames: list[np.ndarray], tmp_path: Path) -> None:
    """Both of the other people are followed by the person's tracker; the recogniser tells them from the person."""
    for other in ("p02", "p06"):
        with guise.Swapper("Mei", source=model_file(other), renderer="cpu") as swapper:
            covered = swapper(frames[0])
            assert swapper.outcome == "covered"
            assert 0.01 < (covered != frames[0]).any(2).mean() < 0.6
    with guise.Swapper("Mei", source=model_file("p02"), unsure="leave", renderer="cpu") as swapper:
        np.testing.assert_array_equal(swapper(frames[0]), frames[0])
        assert swapper.outcome == "lost"


@pytest.mark.slow
def test_a_lost_face_is_held_for_as_long_as_was_asked_for(frames: list[np.ndarray]) -> None:
    nobody, held = np.full_like(frames[0], 90), {}
    then = {"cover": ["covered", "lost"], "hold": ["lost"]}
    for unsure in ("cover", "hold"):
        with guise.Swapper("Mei", model_file("p01"), unsure=unsure, fps=10, renderer="cpu") as swapper:  # type: ignore[arg-type]
            swapper(Image.fromarray(frames[0]))
            assert swapper.outcome == "swapped"
            outcomes = [(swapper(nobody), swapper.outcome)[1] for _ in range(13)]
            held[unsure] = outcomes.count("held")
            assert [one for one, _ in groupby(outcomes)] == ["held", *then[unsure]]
            with pytest.raises(guise.GuiseError, match="seconds must be later than that of the frame before"):
                swapper(nobody, seconds=0.5)
    assert held == {"cover": 1, "hold": 10}


@pytest.mark.slow
def test_a_swapper_may_be_called_from_any_thread_until_it_is_closed(frames: list[np.ndarray]) -> None:
    async def from_threads(swapper: guise.Swapper) -> list[np.ndarray]:
        return [await asyncio.to_thread(swapper, frame) for frame in frames]

    with guise.Swapper("Mei", model_file("p01")) as swapper:
        expected = [swapper(frame) for frame in frames]
    with guise.Swapper("Mei", model_file("p01")) as swapper:
        np.testing.assert_array_equal(asyncio.run(from_threads(swapper)), expected)
    with pytest.raises(guise.GuiseError, match="this Swapper is closed"):
        swapper(frames[0])
    swapper.close()  # once more does no harm


@pytest.mark.slow
def test_functions_run_in_several_threads_at_once_and_in_another_process(frames: list[np.ndarray]) -> None:
    alone = [guise.landmarks(frame)[0].points for frame in frames[:4]]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda frame: guise.landmarks(frame)[0].points, frames[:4]))
    np.testing.assert_array_equal(together, alone)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as processes:
        [face] = processes.submit(guise.landmarks, frames[0]).result()
    np.testing.assert_array_equal(face.points, alone[0])


@pytest.mark.slow
def test_a_call_that_is_cancelled_says_so_and_leaves_nothing(tmp_path: Path) -> None:
    clip, output, cancel = (
        cut("p01", tmp_path / "clip.mp4", 20),
        tmp_path / "out" / "out.mp4",
        threading.Event(),
    )
    output.parent.mkdir()

    def half(stage: str, share: float) -> None:
        if share >= 0.3:
            cancel.set()

    with pytest.raises(guise.Cancelled, match="nothing was written"):
        guise.swap_file(
            clip, "Mei", output, source=model_file("p01"), renderer="cpu", progress=half, cancel=cancel
        )
    with pytest.raises(guise.Cancelled):
        guise.deidentify(clip, output, renderer="cpu", workers=1, cancel=cancel)
    assert [path.name for path in output.parent.iterdir() if path.suffix == ".mp4"] == []


@pytest.mark.slow
def test_a_face_is_learned_from_a_clip_in_memory_and_kept_by_name(tmp_path: Path) -> None:
    capture = cv2.VideoCapture(str(SAMPLES / "p02" / "talk.mp4"))
    clip = np.stack([capture.read()[1][..., ::-1] for _ in range(40)])
    made = guise.enroll(clip, name="Ann", frames=16, resolution=48, keep=True, output=tmp_path / "ann.guise")
    assert guise.load(tmp_path / "ann.guise").name == made.name == guise.load("Ann").name == "Ann"
    assert guise.info("Ann").frames == guise.info(tmp_path / "ann.guise").frames == made.facts["frames"]
    with pytest.raises(guise.GuiseError, match="use overwrite=True"):
        guise.enroll(clip, output=tmp_path / "ann.guise")
    assert guise.rename_person("Ann", "Ann B").name == "Ann B"
    assert "Ann B" in [person.name for person in guise.people()]
    assert [person.name for person in guise.delete_people("Ann B")] == ["Ann B"]
    with pytest.raises(guise.GuiseError, match=r"there is no face Ann B: give NAME\.guise"):
        guise.load("Ann B")


@pytest.mark.slow
def test_a_photo_in_memory_is_learned(frames: list[np.ndarray]) -> None:
    made = guise.enroll(Image.fromarray(frames[0]), name="p01")
    assert made.facts["made_from"] == "one photo"
    with pytest.raises(guise.GuiseError, match="photos are enrolled by the built-in landmarker"):
        guise.enroll(frames[0], person=2)


def test_faces_of_a_video_keep_their_tracks_and_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = cut("p01", tmp_path / "a.mp4", 4)
    found = list(guise.landmarks(clip))
    assert [faces.frame for faces in found] == [0, 1, 2, 3]
    assert [faces.seconds for faces in found] == pytest.approx(np.arange(4) / 30)
    assert [[face.track for face in faces] for faces in found] == [[0]] * 4
    rows = guise.landmarks(clip).to_arrays()
    np.testing.assert_array_equal(rows["points"], [faces[0].points for faces in found])
    np.testing.assert_array_equal(rows["track"], [0] * 4)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(guise.GuiseError, match="a table needs pandas"):
        guise.landmarks(clip).to_dataframe()
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=dict))
    table = guise.landmarks(clip).to_dataframe()
    assert {len(column) for column in table.values()} == {4}
    assert table["y80"][3] == found[3][0].points[80, 1]
    with pytest.raises(guise.GuiseError, match=r"nowhere\.mp4"):
        next(guise.landmarks(tmp_path / "nowhere.mp4"))


def test_files_of_landmarks_hold_what_the_iterator_gives(tmp_path: Path) -> None:
    clip = cut("p01", tmp_path / "a.mp4", 3)
    report = guise.landmarks_file(clip, tmp_path / "a.npz")
    assert (report.frames, report.faces) == (3, 3)
    written = np.load(tmp_path / "a.npz")["face81"].reshape(-1, 81, 2)
    np.testing.assert_allclose(written, guise.landmarks(clip).to_arrays()["points"], atol=1e-4)


@pytest.mark.slow
def test_pictures_are_hidden_in_memory_and_reviewed_in_files(
    frames: list[np.ndarray], tmp_path: Path
) -> None:
    hidden = guise.deidentify(Image.fromarray(frames[0]), renderer="cpu")
    assert hidden.picture.shape == frames[0].shape
    assert 0.01 < (hidden.picture != frames[0]).any(2).mean() < 0.6
    assert hidden.report["counts"]["swapped"] + hidden.report["counts"]["covered"] == 1
    clip, output, stages = cut("p01", tmp_path / "clip.mp4", 12), tmp_path / "out.mp4", set()

    def told(stage: str, share: float) -> None:
        stages.add(stage)

    guise.deidentify(clip, output, workers=1, review=True, progress=told)
    tracks = guise.read_tracks(output)
    tracks["tracks"][0]["action"] = "leave"
    [entry] = guise.deidentify(clip, output, workers=1, tracks=tracks, resume=True)
    assert guise.read_report(output)["counts"]["left"] == 12 == entry.counts["left"]
    assert len(stages) > 2
    with pytest.raises(guise.GuiseError, match="deidentify writes one beside each output"):
        guise.read_report(clip)


@pytest.mark.slow
def test_several_people_get_faces_of_their_own(tmp_path: Path) -> None:
    clip = cut("p01", tmp_path / "clip.mp4", 24)
    found = guise.find_people(clip, output=tmp_path / "people.png")
    assert [person.number for person in found.people] == [1]
    assert (tmp_path / "people.png").is_file()
    face = guise.load(model_file("p06"))
    report = guise.swap_file(clip, None, tmp_path / "a.mp4", map={"left": face}, renderer="cpu")
    assert [(one.number, one.swapped) for one in report.people] == [(1, report.frames)]
    with pytest.raises(guise.GuiseError, match=r"choose from 1; guise\.find_people\(\) draws them"):
        guise.swap_file(clip, None, tmp_path / "b.mp4", map={"7": face})
    with pytest.raises(guise.GuiseError, match="give the face as identity, or map="):
        guise.swap_file(clip, None, tmp_path / "b.mp4")  # type: ignore[call-overload]


@pytest.mark.slow
def test_a_photo_is_swapped_in_memory(frames: list[np.ndarray]) -> None:
    one = guise.swap_photo(Image.fromarray(frames[0]), guise.load("Mei"), renderer="cpu")
    several = guise.swap_photo(frames[0], map={"1": "Mei"}, renderer="cpu")
    np.testing.assert_array_equal(one.picture, several.picture)
    assert 0.01 < (one.picture != frames[0]).any(2).mean() < 0.6
    assert one.people[0].swapped == 1
    with pytest.raises(guise.GuiseError, match="give the face as identity, or map="):
        guise.swap_photo(frames[0])


@pytest.mark.slow
def test_live_frames_come_from_a_program_and_go_to_it(frames: list[np.ndarray]) -> None:
    shown: list[guise.LiveFrame] = []
    live = guise.LiveSession(
        guise.load("Mei"), source=model_file("p01"), input=(frame for frame in frames), output=shown.append,
        renderer="cpu",
    )  # fmt: skip
    report = live.run()
    assert (report.stats.frames, report.stats.dropped, len(shown)) == (6, 0, 6)
    assert {one.outcome for one in shown} <= {"swapped", "covered", "lost"}
    assert all((one.picture != frame).any() for one, frame in zip(shown, frames, strict=True))
    endless = guise.LiveSession(
        "Mei", source=model_file("p01"), input=lambda: frames[0], output=lambda one: endless.stop()
    )
    assert endless.run().stats.frames >= 1
    with pytest.raises(guise.GuiseError, match="a session needs an output"):
        guise.LiveSession(output=())
    with pytest.raises(guise.GuiseError, match="there is no frame to begin with"):
        guise.LiveSession(input=[], output=shown.append).run()


def test_nothing_to_enroll_is_one_sentence() -> None:
    with pytest.raises(guise.GuiseError, match="at least one clip"):
        guise.enroll([])


def test_a_face_is_loaded_by_file_or_by_name(frames: list[np.ndarray]) -> None:
    assert guise.load(model_file("p01")).name == "p01"
    assert guise.load("Mei").name == "Mei"
    with pytest.raises(guise.GuiseError, match="there is no face Bob"):
        guise.load("Bob")
    with guise.Swapper("Mei", source=model_file("p01"), renderer="cpu") as swapper:
        swapper(frames[0])
        assert swapper.outcome == "swapped"


def test_the_former_name_of_the_faces_of_a_deidentification_warns(tmp_path: Path) -> None:
    clip = cut("p01", tmp_path / "clip.mp4", 2)
    with (
        pytest.warns(DeprecationWarning, match="^donor is now identity$"),
        pytest.raises(guise.GuiseError, match="there is no face Bob"),
    ):
        guise.deidentify(clip, donor="Bob")


def test_photos(tmp_path: Path) -> None:
    capture = cv2.VideoCapture(str(SAMPLES / "p01" / "talk.mp4"))
    pictures = [capture.read()[1] for _ in range(60)]
    for name, picture in (("s", pictures[0]), ("s1", pictures[59])):
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture)
    cv2.imwrite(str(tmp_path / "t.png"), cv2.VideoCapture(str(SAMPLES / "p02" / "talk.mp4")).read()[1])
    report = guise.transfer_photo(
        tmp_path / "s.png", tmp_path / "s1.png", tmp_path / "t.png", tmp_path / "t1.png"
    )
    assert (tmp_path / "t1.png").is_file()
    assert report.output.endswith("t1.png")
