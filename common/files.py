"""Outputs: refused before the work when they could not be written, and written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from guise.common.errors import OutputError


def require_free(path: Path, *, force: bool) -> None:
    """Raise OutputError when a file cannot be written there, before any work is done."""
    if path.is_dir():
        raise OutputError(f"{path} is a folder: give a file name in it")
    if path.exists() and not force:
        raise OutputError(f"{path} exists: use --force to replace it, or choose another name")
    folder = path.parent
    if not folder.is_dir():
        raise OutputError(
            f"{path} cannot be written, there is no folder {folder}: make it, or choose another"
        )
    if not os.access(folder, os.W_OK):
        raise OutputError(f"{path} cannot be written, the folder {folder} is not yours: choose another")


def require_outputs(
    outputs: Sequence[Path | None], inputs: Sequence[Path], *, force: bool, made: Path | None = None
) -> None:
    """Raise OutputError when a file could not be written, or would replace another or an input.

    made : a folder that is made when it is not there.
    """
    if made is not None:
        _require_folder(made)
    taken = {path.resolve(): path for path in inputs}
    for path in filter(None, outputs):
        if (other := taken.get(path.resolve())) is not None:
            why = f"{other} is an input" if other in inputs else "two outputs have that name"
            raise OutputError(f"{path} would be overwritten, {why}: choose another name or folder")
        taken[path.resolve()] = path
        if path.parent != made or made.exists():
            require_free(path, force=force)


def _require_folder(folder: Path) -> None:
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise OutputError(f"{folder} is no folder and cannot be made, {there} is a file: choose another")
    if not os.access(there, os.W_OK):
        raise OutputError(f"{folder} cannot be written to, the folder {there} is not yours: choose another")


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill NAME.part, then rename it; nothing is left behind when it fails."""
    part = path.with_name(path.name + ".part")
    try:
        write(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path, facts: Mapping[str, Any]) -> None:
    """Write a report; it appears only when it is complete."""
    text = json.dumps(facts, indent=1, allow_nan=False, default=str) + "\n"
    write_whole(path, lambda part: part.write_text(text, encoding="utf-8"))
