"""People kept on this computer: those enrolled by name, at a camera, or from a video that was swapped.

All are in one folder, which nobody else may read, a file NAME.guise each: GUISE_PEOPLE if that is set, otherwise
`guise/people` in the user's data folder.  A key says for what a model is kept: a camera's name, or what a video holds.
The models are biometric data of the people; removing one costs an enrolment.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from platformdirs import user_data_path

from guise.aam.model import Identity, ModelError, read_header, rename_model
from guise.common.files import natural_key
from guise.common.progress import mute

FOLDER_VARIABLE = "GUISE_PEOPLE"
READABLE_CHARACTERS = 40  # of a key, in a file's name
_BLOCK_BYTES = 1 << 20  # read at once of a file that is hashed


class PeopleError(ModelError):
    """A person who is not kept, or cannot be kept under a name; one sentence."""


@dataclass(frozen=True)
class KeptPerson:
    """A person who is kept.

    Parameters
    ----------
    name : by which they are called; no two have the same.
    origin : what they were enrolled from or are kept for, "" where that is not known.
    path : of the model.   size : of it, bytes.   kept : since when, in local time.
    """

    name: str
    origin: str
    path: Path
    size: int
    kept: datetime

    def as_json(self) -> dict[str, Any]:
        """The person as JSON holds them."""
        return {**vars(self), "path": str(self.path), "kept": self.kept.isoformat(timespec="seconds")}


def folder() -> Path:
    """Where models are kept."""
    given = os.environ.get(FOLDER_VARIABLE)
    return Path(given) if given else user_data_path("guise", appauthor=False) / "people"


def cached(key: str, say: Callable[[str], None] = mute) -> Identity | None:
    """The model kept under a key, or None; one that can't be used is reported to `say` and counts as none."""
    path = _path(key)
    if not path.is_file():
        return None
    try:
        return Identity.load(path)
    except ModelError as error:
        say(f"A saved model is ignored: {error}")
        return None


def keep(key: str, identity: Identity, origin: str = "") -> Path:
    """Keep a model under a key, in place of an older one, whose name it takes; returns its file.

    origin : for the list of people; by default the key.
    """
    path = _path(key)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    names = {person.path: person.name for person in everybody()}
    name = names.pop(path, None) or _free(identity.name, set(names.values()))
    replace(identity, name=name, facts=identity.facts | {"kept_for": origin or key}).save(path)
    return path


def place_for(name: str) -> Path:
    """The file of a person who is enrolled under a name; its folder is made.  PeopleError when the name is taken."""
    path = _path(f"enrolled {name}")
    if any(person.name == name and person.path != path for person in everybody()):
        raise PeopleError(f"there is already somebody named {name}: choose another name")
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    return path


def free_name(name: str, path: Path) -> str:
    """A name for the model at a path that nobody else has: the name itself, or with a number."""
    return _free(name, {person.name for person in everybody() if person.path != path})


def everybody() -> list[KeptPerson]:
    """All who are kept, by name; files that are no models are passed over."""
    found = (_person(path) for path in folder().glob("*.guise"))
    return sorted((person for person in found if person is not None), key=lambda p: natural_key(p.name))


def named(name: str) -> KeptPerson:
    """The person of a name.  PeopleError when there is none."""
    everyone = everybody()
    for person in everyone:
        if person.name == name:
            return person
    names = ", ".join(person.name for person in everyone)
    raise PeopleError(
        f"nobody is kept under the name {name}: "
        + (f"there are {names}" if names else "nobody is kept yet, guise enroll VIDEO keeps somebody")
    )


def rename(name: str, new: str) -> KeptPerson:
    """Give a person another name.  PeopleError when it is taken or empty, or there is no such person."""
    person = named(name)
    new = " ".join(new.split())
    if not new or not new.isprintable():
        raise PeopleError("a person's name must have at least one character that can be printed")
    if new != name and any(other.name == new for other in everybody()):
        raise PeopleError(f"there is already somebody named {new}: choose another name")
    rename_model(person.path, new)
    return replace(person, name=new)


def delete(names: Iterable[str]) -> list[KeptPerson]:
    """Delete the models of people.  PeopleError, before anything is deleted, when one of them is not kept."""
    people = [named(name) for name in dict.fromkeys(names)]
    for person in people:
        person.path.unlink(missing_ok=True)
    return people


def video_key(path: Path, *more: object) -> str:
    """The key of a video's person: what the file, or all files of a folder, hold, whatever they are called.

    more : what else the model depends on.
    """
    files = sorted(entry for entry in path.rglob("*") if entry.is_file()) if path.is_dir() else [path]
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            while block := stream.read(_BLOCK_BYTES):
                digest.update(block)
    return " ".join(map(str, ["video", digest.hexdigest(), *more]))


def _person(path: Path) -> KeptPerson | None:
    try:
        header, facts = read_header(path), path.stat()
    except (ModelError, OSError):
        return None
    since = datetime.fromtimestamp(facts.st_mtime).astimezone()
    clips = ", ".join(map(str, header.facts.get("clips", ())))
    return KeptPerson(header.name, str(header.facts.get("kept_for", clips)), path, facts.st_size, since)


def _free(name: str, taken: set[str]) -> str:
    """A name that nobody has: the name itself, or with the first number that makes it so.

    >>> _free("talk", set()), _free("talk", {"talk", "talk 2"})
    ('talk', 'talk 3')
    """
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name} {number}"
    return free


def _path(key: str) -> Path:
    """A file name that is valid on any system: the readable part of the key, and a digest that tells keys apart."""
    readable = re.sub(r"[^a-z0-9]+", "-", key.lower())[:READABLE_CHARACTERS].strip("-") or "camera"
    digest = hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return folder() / f"{readable}-{digest}.guise"
