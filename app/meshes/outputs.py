"""What the mesh commands write: checked before the work, so that nothing is done in vain and nothing is replaced."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from app.outputs import OutputError, require_free, write_whole


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


def write_json(path: Path, facts: Mapping[str, Any]) -> None:
    """Write a report; it appears only when it is complete."""
    text = json.dumps(facts, indent=1, allow_nan=False, default=str) + "\n"
    write_whole(path, lambda part: part.write_text(text, encoding="utf-8"))
