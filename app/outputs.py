"""Outputs: refused before the work when they could not be written, and marked as synthetic."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from app.version import version

DIGITAL_SOURCE_TYPE = "http://cv.iptc.org/newscodes/digitalsourcetype/compositeWithTrainedAlgorithmicMedia"


class OutputError(ValueError):
    """An output that cannot be written; one sentence."""


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


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill NAME.part, then rename it; nothing is left behind when it fails."""
    part = path.with_name(path.name + ".part")
    try:
        write(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def synthetic_tags() -> dict[str, str]:
    """The container tags that say that a face is synthetic, and who made it."""
    return {
        "comment": f"Synthetic face: made with Guise {version()}",
        "digital_source_type": DIGITAL_SOURCE_TYPE,
    }
