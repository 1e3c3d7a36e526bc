"""Models of the people in front of the cameras, kept from one run to the next.

A key is a camera's name, or what `file_key` makes of a file.  Models are kept in the user's own cache folder, which
nobody else may read; forgetting one costs an enrolment.
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

LONGEST = 40  # characters of a file's name that are there to be read


def cached(key: str, say: Callable[[str], None] = mute) -> Identity | None:
    """The model kept under a key, or None; one that cannot be used is told to `say` and counts as none."""
    path = _path(key)
    if not path.is_file():
        return None
    try:
        return Identity.load(path)
    except ModelError as error:
        say(f"the model kept for {key} is left aside: {error}")
        return None


def keep(key: str, identity: Identity) -> Path:
    """Keep a model under a key, in place of an older one; returns its file."""
    path = _path(key)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    identity.save(path)
    return path


def forget(key: str) -> bool:
    """Remove the model kept under a key; whether there was one."""
    path = _path(key)
    known = path.is_file()
    path.unlink(missing_ok=True)
    return known


def file_key(path: Path) -> str:
    """The key of a file as it is now: another file under its name has another key."""
    facts = os.stat(path)
    return f"{path.name} {facts.st_size} {facts.st_mtime_ns} {path.resolve()}"


def folder() -> Path:
    """Where models are kept."""
    return user_cache_path("guise", appauthor=False) / "people"


def _path(key: str) -> Path:
    """A file name that any system takes: what of the key can be read, and a digest that tells keys apart."""
    readable = re.sub(r"[^a-z0-9]+", "-", key.lower())[:LONGEST].strip("-") or "camera"
    digest = hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return folder() / f"{readable}-{digest}.guise"
