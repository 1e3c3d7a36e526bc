"""The studio's storage: clips, pictures, meshes and jobs, in one folder; people are where the commands keep them.

FOLDER/studio.sqlite holds the rows; files are at FOLDER/clips/ID.mp4, FOLDER/uploads/ID.png and FOLDER/jobs/ID/, models
in the folder of `guise.app.people.kept`, where a file's stem is the person's id.  Ids are generated here; names are the
user's own text and never part of a path.  Times are UTC in ISO 8601.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import sqlite3
import threading
import uuid
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from guise.aam.model import read_header, rename_model
from guise.app.deidentify.run.inputs import VIDEO_SUFFIXES
from guise.app.media.animation_writer import FORMS
from guise.app.people import kept
from guise.common.errors import GuiseError

State = Literal["waiting", "running", "done", "failed", "cancelled"]

FOLDERS = ("clips", "uploads", "jobs")
DATABASE = "studio.sqlite"
CLIP = "clip"  # the kind of uploads that are videos, and of those that are to be de-identified, which are nowhere else
CONFIDENTIAL = "confidential"
CLIP_SUFFIXES = VIDEO_SUFFIXES | FORMS.keys()  # animated pictures too
_PRIVATE = 0o700  # as all of it is biometric data
MAX_NAME_CHARACTERS = 80
# Of clips in a table of their own, as once, uploads are made.
_TABLES = """
CREATE TABLE IF NOT EXISTS people (id TEXT PRIMARY KEY, name TEXT, created TEXT, clip TEXT);
CREATE TABLE IF NOT EXISTS uploads (id TEXT PRIMARY KEY, name TEXT, created TEXT, kind TEXT, suffix TEXT);
CREATE TABLE IF NOT EXISTS jobs (id TEXT PRIMARY KEY, kind TEXT, about TEXT, state TEXT, stage TEXT, share REAL,
    sentence TEXT, result TEXT, created TEXT);
CREATE TABLE IF NOT EXISTS clips (id TEXT PRIMARY KEY, name TEXT, created TEXT, suffix TEXT);
INSERT INTO uploads SELECT id, name, created, 'clip', suffix FROM clips ORDER BY rowid;
DELETE FROM clips;
CREATE TABLE IF NOT EXISTS settings (name TEXT PRIMARY KEY, value TEXT);
"""


class StudioError(GuiseError):
    """Something the studio cannot do; one sentence."""


class MissingError(StudioError):
    """Something that is asked for and is not there, or no longer."""


@dataclass(frozen=True)
class Person:
    """A person; their model is at `path`, `clip` is the id of the clip it was trained on here, if it was."""

    id: str
    name: str
    created: str
    clip: str | None
    path: Path


@dataclass(frozen=True)
class Upload:
    """A clip, a picture or a mesh, as `kind` says; complete when the file at `path` exists."""

    id: str
    name: str
    created: str
    kind: str
    path: Path

    @property
    def preview(self) -> Path:
        """A small picture of it."""
        return preview_of(self.path)


def preview_of(upload: Path) -> Path:
    """The small picture of an upload."""
    return upload.with_name(f"{upload.stem}.preview.png")


@dataclass(frozen=True)
class JobRow:
    """A job.

    Parameters
    ----------
    about : what it was started with.   result : what it returned; both are JSON objects.
    share : completed share of the stage, in [0, 1].
    sentence : why it failed, "" otherwise.
    """

    id: str
    kind: str
    about: dict[str, Any]
    state: State
    stage: str
    share: float
    sentence: str
    result: dict[str, Any]
    created: str

    @property
    def ended(self) -> bool:
        """Whether it is done, failed or cancelled."""
        return self.state in ("done", "failed", "cancelled")


class Store:
    """The studio's folder, created if there is none.  Safe to use from any thread.

    Raises StudioError when another studio uses the folder, or when it cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._database = _open(folder)
        _move_people(folder / "people")
        shutil.rmtree(self.incoming, ignore_errors=True)
        self.incoming.mkdir(mode=_PRIVATE)

    @property
    def incoming(self) -> Path:
        """Where uploads are written until they are complete; emptied at the start."""
        return self.folder / "incoming"

    def add_person(self, name: str, clip: str | None) -> Person:
        """Add a person whose model the caller writes."""
        return self._person(self._add("people", _clean(name), _now(), clip))

    def people(self) -> list[Person]:
        """Everybody who is kept on this computer, newest first."""
        rows = {id: (created, clip) for id, _, created, clip in self._all("people")}
        found = []
        for one in kept.everybody():
            since = one.kept.astimezone(UTC).isoformat(timespec="seconds")
            created, clip = rows.get(one.path.stem, (since, None))
            found.append(Person(one.path.stem, one.name, created, clip, one.path))
        return sorted(found, key=lambda person: person.created, reverse=True)

    def person(self, id: str) -> Person:
        """The person of an id, also before there is a model.  StudioError when there is none."""
        known = {person.id: person for person in self.people()}
        return known.get(id) or self._person(self._one("people", id, "person"))

    def rename_person(self, id: str, name: str) -> Person:
        """Give a person another name.  GuiseError when somebody else has it."""
        kept.rename(self.person(id).name, _clean(name))
        return self.person(id)

    def remove_person(self, id: str) -> None:
        """Delete a person and their model."""
        self.person(id).path.unlink(missing_ok=True)
        self._run("DELETE FROM people WHERE id = ?", (id,))

    def add_upload(self, kind: str, name: str, suffix: str) -> Upload:
        """Add a file that the caller writes.  StudioError when the suffix of a clip is not a video's."""
        if kind in (CLIP, CONFIDENTIAL) and suffix.lower() not in CLIP_SUFFIXES:
            raise StudioError(
                f"{_clean(name)} isn't a video file that Guise reads: use .mp4, .webm, .mov or .mkv"
            )
        return self._upload(self._add("uploads", _clean(name), _now(), kind, suffix.lower()))

    def uploads(self, kind: str) -> list[Upload]:
        """The complete uploads of a kind, newest first."""
        found = map(self._upload, self._all("uploads"))
        return [upload for upload in found if upload.kind == kind and upload.path.exists()]

    def clips(self) -> list[Upload]:
        """The complete clips, newest first."""
        return self.uploads(CLIP)

    def upload(self, id: str) -> Upload:
        """The upload of an id.  StudioError when there is none."""
        return self._upload(self._one("uploads", id, "file"))

    def remove_upload(self, id: str) -> None:
        """Delete an upload, its file and the files beside it, such as its preview or landmarks."""
        upload = self.upload(id)
        for file in upload.path.parent.glob(f"{upload.id}.*"):
            file.unlink()
        self._run("DELETE FROM uploads WHERE id = ?", (id,))

    def add_job(self, kind: str, about: dict[str, Any]) -> JobRow:
        """Add a waiting job."""
        return _job(self._add("jobs", kind, json.dumps(about), "waiting", "", 0.0, "", "{}", _now()))

    def jobs(self) -> list[JobRow]:
        """All jobs, newest first."""
        return list(map(_job, self._all("jobs")))

    def job(self, id: str) -> JobRow:
        """The job of an id.  StudioError when there is none."""
        return _job(self._one("jobs", id, "job"))

    def change_job(
        self, id: str, *, state: State, stage: str = "", share: float = 0.0, sentence: str = "",
        result: dict[str, Any] | None = None,
    ) -> None:  # fmt: skip
        """Update the state of a job."""
        self._run(
            "UPDATE jobs SET state = ?, stage = ?, share = ?, sentence = ?, result = ? WHERE id = ?",
            (state, stage, share, sentence, json.dumps(result or {}), id),
        )

    def remove_job(self, id: str) -> None:
        """Delete a job and its folder.  StudioError when the folder cannot be deleted."""
        folder = self.folder_of(id)
        shutil.rmtree(folder, ignore_errors=True)
        if folder.exists():
            raise StudioError(f"{folder} cannot be deleted: close what uses it, and delete again")
        self._run("DELETE FROM jobs WHERE id = ?", (id,))

    def folder_of(self, id: str) -> Path:
        """The folder for a job's files.  StudioError when there is no such job."""
        return self.folder / "jobs" / self.job(id).id

    def setting(self, name: str) -> Any:
        """A remembered setting, or None."""
        rows = self._run("SELECT value FROM settings WHERE name = ?", (name,))
        return json.loads(rows[0][0]) if rows else None

    def remember(self, name: str, value: Any) -> None:
        """Remember a setting, a JSON value."""
        self._run("INSERT OR REPLACE INTO settings VALUES (?, ?)", (name, json.dumps(value)))

    def close(self) -> None:
        """Release the folder."""
        with self._lock:
            self._database.close()

    def _run(self, statement: str, values: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        with self._lock, self._database:
            return self._database.execute(statement, values).fetchall()

    def _add(self, table: str, *values: Any) -> tuple[Any, ...]:
        """Insert a row with a new id."""
        row = (uuid.uuid4().hex, *values)
        self._run(f"INSERT INTO {table} VALUES ({', '.join('?' * len(row))})", row)
        return row

    def _all(self, table: str) -> list[tuple[Any, ...]]:
        """Newest first."""
        return self._run(f"SELECT * FROM {table} ORDER BY rowid DESC")

    def _one(self, table: str, id: str, word: str) -> tuple[Any, ...]:
        rows = self._run(f"SELECT * FROM {table} WHERE id = ?", (id,))
        if not rows:
            raise MissingError(f"this {word} no longer exists: reload the page")
        return rows[0]

    def _upload(self, row: tuple[Any, ...]) -> Upload:
        id, name, created, kind, suffix = row
        folder = self.folder / ("clips" if kind == CLIP else "uploads")
        return Upload(id, name, created, kind, folder / f"{id}{suffix}")

    def _person(self, row: tuple[Any, ...]) -> Person:
        id, name, created, clip = row
        return Person(id, name, created, clip, kept.folder() / f"{id}.guise")


def _open(folder: Path) -> sqlite3.Connection:
    """The database, which no other process can open until it is closed."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=_PRIVATE)
        for name in FOLDERS:  # also those of a folder that was there before, which may hold other things
            (folder / name).mkdir(exist_ok=True, mode=_PRIVATE)
            (folder / name).chmod(_PRIVATE)
        (folder / DATABASE).touch()
        (folder / DATABASE).chmod(_PRIVATE & 0o600)
        database = sqlite3.connect(folder / DATABASE, timeout=0.5, check_same_thread=False)
        database.executescript(
            f"PRAGMA locking_mode=EXCLUSIVE; PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL; "
            f"PRAGMA secure_delete=ON; {_TABLES}"
        )
        return database
    except sqlite3.OperationalError as error:
        raise StudioError(
            f"{folder} is used by another studio: close it, or choose another --folder"
        ) from error
    except (OSError, sqlite3.DatabaseError) as error:
        raise StudioError(f"{folder} cannot be used ({error}): choose another --folder") from error


def _move_people(before: Path) -> None:
    """Move people to where all are kept from the folder in which the studio once kept its own."""
    kept.folder().mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
    if before.resolve() == kept.folder().resolve():
        return
    for model in before.glob("*.guise"):
        moved = Path(shutil.move(model, kept.folder() / model.name))
        with contextlib.suppress(GuiseError):  # no model that can be read
            rename_model(moved, kept.free_name(read_header(moved).name, moved))
    shutil.rmtree(before, ignore_errors=True)


def _job(row: tuple[Any, ...]) -> JobRow:
    id, kind, about, state, stage, share, sentence, result, created = row
    return JobRow(id, kind, json.loads(about), state, stage, share, sentence, json.loads(result), created)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _clean(name: str) -> str:
    """A name on one line, without unprintable characters, not too long.

    >>> _clean("a\\nb"), _clean("  ")
    ('a b', 'unnamed')
    """
    printable = "".join(c if c.isprintable() else " " for c in name)
    return " ".join(printable.split())[:MAX_NAME_CHARACTERS] or "unnamed"
