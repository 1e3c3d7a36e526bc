"""Models of the people in front of the cameras, cached from run to run.

A key is a camera's name, or the `file_key` of a file.  Models are kept in the user's own cache folder, which nobody
else may read; removing one costs an enrolment.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable
from pathlib import Path

from platformdirs import user_cache_path

from guise.aam.model import Identity, ModelError
from guise.common.progress import mute

READABLE_CHARACTERS = 40  # of a key, in a file's name


def cached(key: str, say: Callable[[str], None] = mute) -> Identity | None:
    """The model kept under a key, or None; one that can't be used is reported to `say` and counts as none."""
    path = _path(key)
    if not path.is_file():
        return None
    try:
        return Identity.load(path)
    except ModelError as error:
        say(f"the model kept for {key} is not used: {error}")
        return None


def keep(key: str, identity: Identity) -> Path:
    """Keep a model under a key, in place of an older one; returns its file."""
    path = _path(key)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    identity.save(path)
    return path


def forget(key: str) -> bool:
    """Remove the model kept under a key; returns whether there was one."""
    path = _path(key)
    known = path.is_file()
    path.unlink(missing_ok=True)
    return known


def file_key(path: Path) -> str:
    """The key of a file as it is now: a changed file under the same name has another key."""
    facts = os.stat(path)
    return f"{path.name} {facts.st_size} {facts.st_mtime_ns} {path.resolve()}"


def folder() -> Path:
    """Where models are kept."""
    return user_cache_path("guise", appauthor=False) / "people"


def _path(key: str) -> Path:
    """A file name that is valid on any system: the readable part of the key, and a digest that tells keys apart."""
    readable = re.sub(r"[^a-z0-9]+", "-", key.lower())[:READABLE_CHARACTERS].strip("-") or "camera"
    digest = hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return folder() / f"{readable}-{digest}.guise"
