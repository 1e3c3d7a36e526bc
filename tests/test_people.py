"""People kept between runs: names, damage, renaming, deleting."""

import json
import stat
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from models import model_file

from guise.aam.model import Identity
from guise.app.cli.main import main
from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.run.checks import checked
from guise.app.people.kept import PeopleError, cached, delete, everybody, keep, named, rename, video_key
from guise.app.swapping.donors import open_face
from guise.common.errors import GuiseError


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where people are kept."""
    monkeypatch.setenv("GUISE_PEOPLE", str(tmp_path / "people"))
    return tmp_path / "people"


@pytest.fixture(scope="module")
def person() -> Identity:
    return Identity.load(model_file("p01"))


def test_what_is_kept_comes_back(person: Identity) -> None:
    assert cached("Camera 0") is None
    keep("Camera 0", person)
    again = cached("Camera 0")
    assert again is not None
    assert again.name == "p01"
    assert np.array_equal(again.tracker.pixels, person.tracker.pixels)
    assert cached("camera 0") is None


def test_a_newer_model_takes_the_place_of_the_older(person: Identity, home: Path) -> None:
    keep("camera", person)
    rename("p01", "Ann")
    keep("camera", replace(person, facts={"made": "later"}))
    again = cached("camera")
    assert again is not None
    assert again.facts["made"] == "later"
    assert again.name == "Ann"  # as the user called them
    assert len(list(home.iterdir())) == 1  # the model, no part


def test_everybody_is_listed_with_what_they_are_kept_for(person: Identity, home: Path) -> None:
    assert everybody() == []
    keep("camera", person)
    keep("video 0f", person, "talk.mp4")
    (home / "note.guise").write_text("no model")
    assert [(p.name, p.origin) for p in everybody()] == [("p01", "camera"), ("p01 2", "talk.mp4")]
    assert all(p.size == p.path.stat().st_size for p in everybody())


def test_a_name_is_all_that_renaming_changes(person: Identity) -> None:
    before = Identity.load(keep("camera", person))
    assert rename("p01", " Ann  B ").name == "Ann B"
    after = Identity.load(named("Ann B").path)
    assert after.facts == before.facts
    assert np.array_equal(after.appearance.components.basis, before.appearance.components.basis)


def test_a_name_belongs_to_one_person(person: Identity) -> None:
    keep("one", person)
    keep("other", person)
    with pytest.raises(PeopleError, match="already somebody named p01 2"):
        rename("p01", "p01 2")
    with pytest.raises(PeopleError, match="at least one character"):
        rename("p01", "  ")
    with pytest.raises(PeopleError, match="nobody is kept under the name x: there are p01, p01 2"):
        rename("x", "y")


def test_deleting_is_all_or_nothing(person: Identity) -> None:
    keep("camera", person)
    with pytest.raises(PeopleError, match="nobody is kept under the name x"):
        delete(["p01", "x"])
    assert [p.name for p in everybody()] == ["p01"]
    assert [p.name for p in delete(["p01", "p01"])] == ["p01"]
    assert cached("camera") is None
    with pytest.raises(PeopleError, match="nobody is kept yet"):
        named("p01")


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "/dev/video0", "con", "камера", "", "a\0b", "x" * 500, "a/b", "a b"]
)
def test_any_name_of_a_camera_is_one_file_in_the_folder(name: str, person: Identity, home: Path) -> None:
    path = keep(name, person)
    assert path.parent == home
    assert path.name.isascii()
    assert len(path.name) < 80
    assert cached(name) is not None


def test_names_that_read_alike_are_kept_apart(person: Identity) -> None:
    assert keep("HD Webcam #1", person) != keep("HD Webcam (1)", person)


def test_a_damaged_model_is_a_note_and_no_model(person: Identity) -> None:
    path = keep("camera", person)
    path.write_bytes(path.read_bytes()[:1000])
    said: list[str] = []
    assert cached("camera", said.append) is None
    assert said == [
        f"A saved model is ignored: {path} is not a Guise model or is truncated; enroll the person again"
    ]
    keep("camera", person)
    assert cached("camera") is not None


def test_a_write_that_fails_leaves_the_older_model(person: Identity, monkeypatch: pytest.MonkeyPatch) -> None:
    path = keep("camera", person)

    def full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        keep("camera", replace(person, name="later"))
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    assert Identity.load(path).name == "p01"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows keeps the user's folders from others itself")
def test_nobody_else_may_read_the_models(person: Identity) -> None:
    folder = keep("camera", person).parent
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_video_is_known_by_what_it_holds(tmp_path: Path) -> None:
    clip, copy = tmp_path / "clip.mp4", tmp_path / "copy.mp4"
    clip.write_bytes(b"one")
    copy.write_bytes(b"one")
    assert video_key(clip, 160) == video_key(copy, 160)
    assert video_key(clip, 160) != video_key(clip, 96)
    copy.write_bytes(b"two")
    assert video_key(clip) != video_key(copy)
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    (pictures / "1.png").write_bytes(b"one")
    one = video_key(pictures)
    (pictures / "2.png").write_bytes(b"two")
    assert video_key(pictures) != one


def test_the_commands_list_rename_show_and_delete(
    person: Identity, capsys: pytest.CaptureFixture[str]
) -> None:
    keep("camera", person)
    assert main(["people", "rename", "p01", "Ann"]) == 0
    assert main(["people", "rename", "Ann", "p03"]) == 2
    capsys.readouterr()
    assert main(["people", "list", "--json"]) == 0
    assert [one["name"] for one in json.loads(capsys.readouterr().out)["people"]] == ["Ann"]
    assert main(["people", "show", "Ann"]) == 0
    assert "appearance modes" in capsys.readouterr().out
    assert main(["people", "delete"]) == 2
    assert main(["people", "delete", "--all"]) == 0
    assert everybody() == []


def test_a_face_is_named_by_file_gallery_or_person(person: Identity, tmp_path: Path) -> None:
    keep("camera", replace(person, name="Ann"))
    assert open_face("Ann").name == "Ann"
    assert open_face("p03").name == "Mei"
    assert open_face(str(model_file("p01"))).name == "p01"
    picture = tmp_path / "face.jpg"
    picture.write_bytes(b"")
    with pytest.raises(GuiseError, match=r"face.jpg is not an image that can be read"):
        open_face(str(picture))
    with pytest.raises(
        GuiseError, match=r"there is no face Bob: give NAME.guise, a photo, or one of Luca, .*, Omar, Ann"
    ):
        open_face("Bob")


def test_a_deidentification_takes_names_and_models_of_people(person: Identity) -> None:
    ann = keep("camera", replace(person, name="Ann"))
    named = checked(DeidentifyOptions("Ann", gallery=(Path("Kofi"), Path("Ann"))), [])
    assert named.donor == str(ann)
    assert named.gallery == (Path("p05"), ann)
    assert checked(DeidentifyOptions("mean:mei+Kofi"), []).donor == "mean:p03+p05"
    for choice in ("auto", "same", "average:2", "mean:2"):
        assert checked(DeidentifyOptions(choice), []).donor == choice
    with pytest.raises(GuiseError, match="there is no face Bob"):
        checked(DeidentifyOptions("auto", gallery=(Path("Bob"),)), [])
