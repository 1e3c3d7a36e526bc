"""Enrolment from clips: landmarks beside them, wrong ones, and what is reported."""

import json
from pathlib import Path

import numpy as np
import pytest
from clips import cut, empty_scene
from made_up import SAMPLES
from models import SMALL

from guise.aam.landmarks import LandmarkError
from guise.aam.model import Identity
from guise.aam.training import TrainingError, TrainingOptions
from guise.app.cli.main import main
from guise.app.enrolment.enrol import EnrolError
from guise.app.enrolment.file import enrol_file
from guise.app.enrolment.landmark_source import LandmarkSource, landmark_file
from guise.app.enrolment.options import TrainingChoices
from guise.common.errors import OutputError

TRUTH = SAMPLES / "p01" / "talk.npz"


def landmarks(path: Path, frames: int) -> Path:
    np.savez(path, landmarks=np.load(TRUTH)["landmarks"][:frames])
    return path


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return cut("p01", tmp_path / "clip.mp4", 30, clip="talk.mp4")


@pytest.mark.parametrize("name", ["clip.landmarks.npz", "clip.npz", "clip.landmarks.json", "clip.json"])
def test_landmarks_beside_a_clip_are_found(tmp_path: Path, name: str) -> None:
    assert landmark_file(tmp_path / "clip.mp4") is None
    (tmp_path / name).touch()
    assert landmark_file(tmp_path / "clip.mp4") == tmp_path / name


@pytest.mark.slow
def test_the_report_and_the_file_agree(tmp_path: Path, clip: Path) -> None:
    landmarks(tmp_path / "clip.landmarks.npz", 30)
    said: list[str] = []
    stages: dict[str, float] = {}
    report = enrol_file(
        [clip], tmp_path / "a.guise", LandmarkSource(), name="A", options=SMALL, progress=stages.__setitem__,
        say=said.append,
    )  # fmt: skip
    identity = Identity.load(tmp_path / "a.guise")
    assert said == ["landmarks of clip.mp4 from clip.landmarks.npz beside it"]
    assert stages == {"frames": 1.0, "training": 1.0}
    assert (report.name, report.clips, report.resolution) == ("A", ("clip.mp4",), 64)
    assert report.modes == identity.appearance.components.modes
    assert report.size == (tmp_path / "a.guise").stat().st_size
    assert 0 < report.held_out_error < 5


@pytest.mark.slow
def test_landmarks_beside_a_clip_without_a_face_are_found_anew_and_named_ones_refused(
    tmp_path: Path, clip: Path
) -> None:
    nobody = tmp_path / "clip.landmarks.npz"
    np.savez(nobody, landmarks=np.full((30, 81, 2), np.nan))
    said: list[str] = []
    enrol_file([clip], tmp_path / "a.guise", LandmarkSource(), name="A", options=SMALL, say=said.append)
    assert said[0] == "clip.landmarks.npz beside clip.mp4 has no face in it: detecting the face instead"
    with pytest.raises(LandmarkError, match="must hold a face in at least one frame"):
        enrol_file([clip], tmp_path / "b.guise", LandmarkSource([nobody]), name="B", options=SMALL)


@pytest.mark.slow
def test_two_clips_train_one_model(tmp_path: Path, clip: Path) -> None:
    second = cut("p01", tmp_path / "more.mp4", 20)
    files = [landmarks(tmp_path / "l1.npz", 30), tmp_path / "l2.npz"]
    np.savez(files[1], landmarks=np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][:20])
    source = LandmarkSource(files)
    report = enrol_file([clip, second], tmp_path / "a.guise", source, name="A", options=SMALL)
    assert report.clips == ("clip.mp4", "more.mp4")
    assert report.frames > 20


def test_landmarks_of_another_length(tmp_path: Path, clip: Path) -> None:
    source = LandmarkSource([landmarks(tmp_path / "long.npz", 50)])
    with pytest.raises(EnrolError) as error:
        enrol_file([clip], tmp_path / "a.guise", source, name="A", options=SMALL)
    assert str(error.value) == (
        f"the landmarks of {clip} are for 50 frames, the clip has 30; give the landmarks of this very clip"
    )
    assert not (tmp_path / "a.guise").exists()


@pytest.mark.slow
def test_a_clip_without_landmarks_gets_them_from_the_built_in_landmarker(tmp_path: Path, clip: Path) -> None:
    report = enrol_file([clip], tmp_path / "a.guise", LandmarkSource(), name="A", options=SMALL)
    assert report.frames > 20
    assert (tmp_path / "a.guise").exists()


def test_too_few_frames(tmp_path: Path) -> None:
    short = cut("p01", tmp_path / "short.mp4", 5, clip="talk.mp4")
    source = LandmarkSource([landmarks(tmp_path / "short.npz", 5)])
    with pytest.raises(TrainingError) as error:
        enrol_file([short], tmp_path / "a.guise", source, name="A")
    assert str(error.value) == (
        "a model needs at least 12 frames with a face, got 5; use a longer or clearer clip"
    )


def test_a_landmarker_that_finds_nobody(tmp_path: Path) -> None:
    class Blind:
        name = "blind"

        def detect(self, rgb: np.ndarray) -> list[object]:
            return []

        def refine(self, rgb: np.ndarray, previous: object) -> None:
            return None

    scene = empty_scene(tmp_path / "scene.mp4")
    with pytest.raises(EnrolError) as error:
        enrol_file([scene], tmp_path / "a.guise", LandmarkSource(landmarker=Blind()), name="A")
    assert str(error.value) == (f"no face found in {scene}; use a clip that shows the face from the front")


def test_an_existing_model_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "a.guise").write_bytes(b"precious")
    with pytest.raises(OutputError, match=r"a\.guise exists: use --force to replace it"):
        enrol_file([tmp_path / "no such clip.mp4"], tmp_path / "a.guise", LandmarkSource(), name="A")
    assert (tmp_path / "a.guise").read_bytes() == b"precious"


@pytest.mark.slow
def test_a_failed_save_leaves_nothing(tmp_path: Path, clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    landmarks(tmp_path / "clip.npz", 30)
    before = sorted(tmp_path.iterdir())

    def full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        enrol_file([clip], tmp_path / "a.guise", LandmarkSource(), name="A", options=SMALL)
    assert sorted(tmp_path.iterdir()) == before


def test_modes_go_before_the_retained_variance() -> None:
    assert TrainingChoices(modes=5, retain=0.9).training().retain == 5
    assert TrainingChoices(modes=60).training().max_modes == 60
    assert TrainingChoices(retain=0.9).training().retain == 0.9
    assert TrainingChoices().training() == TrainingOptions()


@pytest.mark.slow
def test_the_command(tmp_path: Path, clip: Path, capsys: pytest.CaptureFixture[str]) -> None:
    landmarks(tmp_path / "clip.json.npz", 30)
    output = tmp_path / "anna.guise"
    choices = ["--frames", "20", "--resolution", "48", "--modes", "4", "--name", "Anna"]
    beside = str(tmp_path / "clip.json.npz")
    code = main(["enroll", str(clip), "-o", str(output), "--landmarks", beside, "--json", *choices])
    said = capsys.readouterr()
    assert code == 0
    assert {json.loads(line)["event"] for line in said.err.splitlines()} == {"progress"}
    report = json.loads(said.out)
    assert (report["name"], report["modes"], report["resolution"]) == ("Anna", 4, 48)
    assert report["size"] == output.stat().st_size
