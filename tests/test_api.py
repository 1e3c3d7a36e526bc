"""`import guise`: quick, complete, and each function does what its command does."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from clips import cut
from made_up import SAMPLES
from models import model_file

import guise

NAMES = {
    "Face", "GuiseError", "Identity", "Swapper", "deidentify", "enroll", "landmarks", "load", "measure", "swap_file",
    "transfer_mesh", "transfer_photo",
}  # fmt: skip


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[np.ndarray]:
    path = cut("p01", tmp_path_factory.mktemp("api") / "clip.mp4", 6)
    capture = cv2.VideoCapture(str(path))
    return [capture.read()[1][..., ::-1].copy() for _ in range(6)]


def test_all_names_are_there_and_documented() -> None:
    assert set(guise.__all__) == NAMES
    assert set(dir(guise)) == NAMES | {"__version__"}
    assert all(getattr(guise, name).__doc__ for name in NAMES)
    page = (Path(__file__).parents[1] / "docs" / "api.md").read_text(encoding="utf-8")
    assert all(name in page for name in NAMES - {"Face"})


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
    [again] = guise.landmarks(tmp_path / "a.png")
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
