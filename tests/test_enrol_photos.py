"""People learned from photos: marked as such, and mistakes in one sentence."""

from pathlib import Path

import pytest
from clips import cut, tags
from made_up import SAMPLES

from guise.aam.model import Identity
from guise.aam.recognition import cosine_similarity, signature
from guise.aam.tracker_training import TrackerOptions
from guise.aam.training import TrainingOptions
from guise.app.cli.main import main
from guise.app.media import open_input
from guise.app.media.pictures import save_picture
from guise.app.photos import enrol_photos as module
from guise.app.photos.enrol_photos import are_photos, enrol_photos
from guise.app.swapping.donors import open_donor
from guise.app.swapping.file import swap_file
from guise.common.samples import samples_folder

SMALL = TrainingOptions(frames=14, resolution=96, tracker=TrackerOptions(stages=2, copies=4, folds=2))


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """p06, at rest."""
    path = tmp_path_factory.mktemp("photo") / "ann.png"
    with open_input(SAMPLES / "p06" / "talk.mp4") as source:
        save_picture(path, next(iter(source)).rgb())
    return path


@pytest.fixture
def short_driver(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Two seconds of the sample clip, with landmarks that are detected."""
    folder = tmp_path_factory.mktemp("samples")
    (folder / "p01").mkdir()
    driver = cut("p01", folder / "p01" / "talk.mp4", 40, clip="talk.mp4")
    monkeypatch.setattr(module, "samples_folder", lambda: folder)
    monkeypatch.setattr(module, "landmark_file", lambda clip: None)
    assert driver.is_file()


@pytest.mark.usefixtures("short_driver")
@pytest.mark.slow
def test_a_photo_becomes_a_model_and_says_so(photo: Path, tmp_path: Path) -> None:
    said: list[str] = []
    report = enrol_photos([photo], tmp_path / "ann.guise", name="Ann", options=SMALL, say=said.append)
    made = Identity.load(tmp_path / "ann.guise")
    assert (report.clips, made.name, made.facts["made_from"]) == (("ann.png",), "Ann", "one photo")
    assert said[0].startswith("learned from one photo: teeth, shut lids and turned views are guessed")
    own, others = (cosine_similarity(signature(made), signature(open_donor(p))) for p in ("p06", "p03"))
    assert own > others

    clip = cut("p01", tmp_path / "clip.mp4", 4)
    swap_file(clip, made, tmp_path / "out.mp4", source=Identity.load(tmp_path / "ann.guise"))
    assert tags(tmp_path / "out.mp4")["comment"].endswith("from one photo")


def test_the_driver_comes_with_guise() -> None:
    driver = samples_folder() / module.DRIVER
    assert driver.is_file()
    assert driver.with_suffix(".npz").is_file()


def test_what_counts_as_photos(photo: Path, tmp_path: Path) -> None:
    assert are_photos([photo])
    assert are_photos([photo] * 9)
    assert not are_photos([photo] * 10)
    assert not are_photos([photo, SAMPLES / "p06" / "talk.mp4"])
    assert not are_photos([tmp_path / "missing.png"])


def test_a_picture_without_a_face_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with open_input(SAMPLES / "p06" / "talk.mp4") as source:
        save_picture(tmp_path / "wall.png", next(iter(source)).rgb()[:60, :60])
    assert main(["enroll", str(tmp_path / "wall.png"), "-o", str(tmp_path / "wall.guise")]) == 2
    assert "error: " in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["wall.png"]


def test_options_of_landmarks_do_not_go_with_photos(photo: Path, tmp_path: Path) -> None:
    assert main(["enroll", str(photo), "-o", str(tmp_path / "a.guise"), "--landmarker", "builtin"]) == 2
