"""The studio's store: rows outlive it, names are text alone, one studio to a folder."""

import sqlite3
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from guise.app.people import kept
from guise.app.studio.store import (
    CLIP,
    CONFIDENTIAL,
    DATABASE,
    MAX_NAME_CHARACTERS,
    Person,
    Store,
    StudioError,
)
from guise.app.swapping.donors import open_donor
from guise.common.errors import GuiseError

TRICKS = [
    "../../evil",
    "/etc/passwd",
    "..\\..\\evil",
    "a/b",
    ".",
    "\0",
    "a\nb",
    "",
    "x" * 5000,
    "<script>",
    "'; DROP",
]


@pytest.fixture(autouse=True)
def people(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where people are kept."""
    monkeypatch.setenv("GUISE_PEOPLE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def model(person: Person) -> None:
    """Write the model of a person."""
    replace(open_donor("p01"), name=person.name).save(person.path)


def files(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file() and "studio.sqlite" not in path.name}


def test_what_was_kept_is_there_after_a_restart(tmp_path: Path) -> None:
    store = Store(tmp_path)
    clip = store.add_upload(CLIP, "Anna", ".mp4")
    clip.path.write_bytes(b"video")
    person = store.add_person("Anna", clip.id)
    model(person)
    job = store.add_job("enrol", {"clip": clip.id})
    store.change_job(job.id, state="failed", sentence="no face")
    store.remember("dark", True)
    store.close()
    again = Store(tmp_path)
    assert (again.clips(), again.people()) == ([clip], [person])
    assert again.job(job.id).sentence == "no face"
    assert again.job(job.id).about == {"clip": clip.id}
    assert (again.setting("dark"), again.setting("other")) == (True, None)
    again.close()


@pytest.mark.parametrize("name", TRICKS)
def test_a_name_is_no_part_of_a_path(tmp_path: Path, name: str) -> None:
    store = Store(tmp_path / "studio")
    clip, person = store.add_upload(CLIP, name, ".mp4"), store.add_person(name, None)
    clip.path.write_bytes(b"")
    model(person)
    for row in (clip, person):
        assert row.path.stem == row.id
        assert row.name
        assert row.name.isprintable()
        assert len(row.name) <= MAX_NAME_CHARACTERS
    assert {path.stem for path in files(tmp_path)} == {row.id for row in (*store.clips(), *store.people())}
    store.close()


def test_people_are_those_of_the_commands(tmp_path: Path, people: Path) -> None:
    """Somebody kept by a command is listed and renamed; somebody of an older studio's folder is moved."""
    (tmp_path / "studio" / "people").mkdir(parents=True)
    for file, name in (
        (kept.place_for("Anna"), "Anna"),
        (tmp_path / "studio" / "people" / "1.guise", "Anna"),
    ):
        replace(open_donor("p01"), name=name).save(file)
    store = Store(tmp_path / "studio")
    assert sorted(person.name for person in store.people()) == ["Anna", "Anna 2"]
    assert {person.path.parent for person in store.people()} == {people}
    assert not (tmp_path / "studio" / "people").exists()
    anna = next(person for person in store.people() if person.name == "Anna")
    with pytest.raises(GuiseError, match="already somebody named Anna 2"):
        store.rename_person(anna.id, "Anna 2")
    assert store.rename_person(anna.id, "Bea") == replace(anna, name="Bea")
    store.remove_person(anna.id)
    assert [person.name for person in kept.everybody()] == ["Anna 2"]
    store.close()


@pytest.mark.parametrize("suffix", ["", ".html", ".mp4/../x", ".guise", ".sqlite", "/"])
def test_only_videos_are_taken(tmp_path: Path, suffix: str) -> None:
    store = Store(tmp_path)
    with pytest.raises(StudioError, match=r"isn.t a video file"):
        store.add_upload(CLIP, "Anna", suffix)
    store.close()


def test_what_is_incomplete_is_not_listed(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.add_upload(CLIP, "Anna", ".mp4")
    store.add_person("Anna", None)
    assert (store.clips(), store.people()) == ([], [])
    store.close()


def test_removing_leaves_nothing(tmp_path: Path) -> None:
    store = Store(tmp_path)
    clip, other, person = (
        store.add_upload(CLIP, "a", ".mp4"),
        store.add_upload(CLIP, "b", ".mp4"),
        store.add_person("a", None),
    )
    job = store.add_job("enrol", {})
    store.folder_of(job.id).mkdir()
    for path in (clip.path, clip.path.with_suffix(".npz"), person.path, other.path):
        path.write_bytes(b"")
    (store.folder_of(job.id) / "part").write_bytes(b"")
    store.remove_upload(clip.id)
    store.remove_person(person.id)
    store.remove_job(job.id)
    assert files(tmp_path) == {other.path}
    assert store.clips() == [other]
    store.close()


@pytest.mark.parametrize("id", ["../clips", "nobody", "%"])
def test_an_unknown_id_is_a_sentence(tmp_path: Path, id: str) -> None:
    store = Store(tmp_path)
    store.add_job("enrol", {})
    for look in (
        store.upload,
        store.person,
        store.job,
        store.folder_of,
        store.remove_upload,
        store.remove_person,
    ):
        with pytest.raises(StudioError, match="no longer exists"):
            look(id)
    store.close()


def test_a_folder_has_one_studio(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with pytest.raises(StudioError, match="used by another studio"):
        Store(tmp_path)
    store.close()
    Store(tmp_path).close()


def test_a_folder_that_cannot_be_used_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "studio.sqlite").write_text("no base " * 200)
    for name in ("file", "damaged"):
        with pytest.raises(StudioError, match="cannot be used"):
            Store(tmp_path / name)


def test_others_on_the_computer_see_nothing(tmp_path: Path) -> None:
    Store(tmp_path / "new" / "studio").close()
    assert (tmp_path / "new" / "studio").stat().st_mode & 0o077 == 0


def test_others_see_nothing_in_a_folder_that_was_there_before(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips").chmod(0o755)
    (tmp_path / "notes.txt").write_text("the user's own")
    store = Store(tmp_path)
    inside = [path for path in tmp_path.iterdir() if path.name != "notes.txt"]
    assert len(inside) >= 6
    for path in inside:
        assert path.stat().st_mode & 0o077 == 0, path
    assert tmp_path.stat().st_mode & 0o777 == 0o755
    store.close()


def test_many_threads_lose_nothing(tmp_path: Path) -> None:
    store = Store(tmp_path)
    threads = [
        threading.Thread(target=lambda: [store.add_person("a", None) for _ in range(20)]) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    rows = store._run("SELECT id FROM people")
    assert len(set(rows)) == 80
    store.close()


def test_clips_of_an_earlier_version_are_kept_in_their_order(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / DATABASE) as database:
        database.execute("CREATE TABLE clips (id TEXT PRIMARY KEY, name TEXT, created TEXT, suffix TEXT)")
        database.executemany(
            "INSERT INTO clips VALUES (?, ?, '2026', '.mp4')", [("b", "first"), ("a", "last")]
        )
    database.close()
    for _ in range(2):
        store = Store(tmp_path)
        for id in ("a", "b"):
            (tmp_path / "clips" / f"{id}.mp4").touch()
        assert [clip.name for clip in store.clips()] == ["last", "first"]
        assert store.upload("a").path == tmp_path / "clips" / "a.mp4"
        store.close()


def test_a_confidential_upload_is_no_clip_and_a_name_that_is_removed_is_gone_from_the_disk(
    tmp_path: Path,
) -> None:
    store = Store(tmp_path)
    upload = store.add_upload(CONFIDENTIAL, "whistleblower", ".mp4")
    upload.path.write_bytes(b"video")
    job = store.add_job("deidentify-review", {"source": str(upload.path), "name": upload.name})
    assert store.clips() == []
    assert store.uploads(CONFIDENTIAL) == [upload]
    store.remove_job(job.id)
    store.remove_upload(upload.id)
    store.close()
    assert files(tmp_path) == set()
    assert not any(b"whistleblower" in path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
