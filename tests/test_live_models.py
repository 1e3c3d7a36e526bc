"""Models kept between runs: names, damage, forgetting."""

import os
import stat
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from models import model_file

from guise.aam.model import Identity
from guise.app.people import cache as models
from guise.app.people.cache import cached, file_key, forget, keep


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache folder."""
    monkeypatch.setattr(models, "user_cache_path", lambda *_, **__: tmp_path / "cache")
    return tmp_path / "cache"


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
    keep("camera", replace(person, name="later"))
    again = cached("camera")
    assert again is not None
    assert again.name == "later"
    assert len(list(home.rglob("*"))) == 2  # the folder and one model, no part


def test_forgetting(person: Identity) -> None:
    keep("camera", person)
    assert forget("camera")
    assert cached("camera") is None
    assert not forget("camera")


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "/dev/video0", "con", "камера", "", "a\0b", "x" * 500, "a/b", "a b"]
)
def test_any_name_of_a_camera_is_one_file_in_the_folder(name: str, person: Identity, home: Path) -> None:
    path = keep(name, person)
    assert path.parent == home / "people"
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
        f"the model kept for camera is not used: {path} is not a Guise model or is "
        "truncated; enrol the person again"
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


def test_another_file_under_the_same_name_has_another_key(tmp_path: Path) -> None:
    clip = tmp_path / "clip.mp4"
    clip.write_bytes(b"one")
    key = file_key(clip)
    assert file_key(clip) == key
    clip.write_bytes(b"three")
    assert file_key(clip) != key
    other = tmp_path / "other" / "clip.mp4"
    other.parent.mkdir()
    other.write_bytes(b"one")
    os.utime(other, ns=(0, 0))
    os.utime(clip, ns=(0, 0))
    assert file_key(other) != file_key(clip)
