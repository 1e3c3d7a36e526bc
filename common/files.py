"""Files: outputs that are refused before the work or written whole, and names in natural order."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from guise.common.errors import OutputError

MAX_NAME_BYTES = 255  # of a file name, in most file systems


def require_free(path: Path, *, force: bool) -> None:
    """Raise OutputError, before any work is done, if a file cannot be written there."""
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
    """Raise OutputError if a file could not be written, or would replace another output or an input.

    made : a folder that is created if it does not exist.
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
        raise OutputError(
            f"{folder} is not a folder and cannot be created, as {there} is a file: choose another"
        )
    if not os.access(there, os.W_OK):
        raise OutputError(f"{folder} cannot be written to, the folder {there} is not yours: choose another")


def fitting_name(stem: str, ending: str) -> str:
    """A file name of a stem and an ending; what is too long becomes a digest, the ending stays.

    >>> fitting_name("talk", ".part")
    'talk.part'
    >>> fitting_name("t" * 300, ".part")[-20:]
    'tttttt~0afa5eb0.part'
    """
    if len(os.fsencode(stem + ending)) <= MAX_NAME_BYTES:
        return stem + ending
    whole = os.fsencode(stem)
    ending = f"~{hashlib.sha256(whole).hexdigest()[:8]}{ending}"
    return whole[: MAX_NAME_BYTES - len(os.fsencode(ending))].decode(errors="ignore") + ending


def part_of(path: Path) -> Path:
    """NAME.part, the name under which an output is written until it is complete."""
    return path.with_name(fitting_name(path.name, ".part"))


def write_whole(path: Path, content: bytes | str | Callable[[Path], object]) -> None:
    """Write NAME.part, then rename it; nothing is left behind when that fails.

    content : of the file, text as UTF-8; or a function that fills the file whose path it is given.
    """
    part = part_of(path)
    try:
        if isinstance(content, bytes):
            part.write_bytes(content)
        elif isinstance(content, str):
            part.write_text(content, encoding="utf-8")
        else:
            content(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path, facts: Mapping[str, Any]) -> None:
    """Write a report; it appears only when it is complete."""
    write_whole(path, json.dumps(facts, indent=1, allow_nan=False, default=str) + "\n")


def write_arrays(path: Path, arrays: Mapping[str, Any], *, compressed: bool = True) -> None:
    """Write an .npz file of arrays by name; it appears only when it is complete."""
    import numpy as np

    save = np.savez_compressed if compressed else np.savez

    def write(part: Path) -> None:
        with part.open("wb") as file:
            save(file, allow_pickle=False, **arrays)

    write_whole(path, write)


class WholeOutput:
    """An output that grows as NAME.part, which others must not write, and has its name only when it is complete.

    By `with` it is completed, or on an exception removed.

    Parameters
    ----------
    path : the name that it gets.   part : NAME.part.
    force : replace an existing one, and take over what another run left under the name NAME.part.
    folder : whether it is a folder of files.
    """

    def __init__(self, path: Path, *, force: bool = False, folder: bool = False) -> None:
        self.path, self.part = path, part_of(path)
        self._force, self._folder = force, folder
        self._closed = False

    def claim(self) -> None:
        """Create an empty NAME.part; OutputError when there is one, which another run may be writing."""
        try:
            self._create()
        except FileExistsError as error:
            raise OutputError(
                f"{self.part} exists, from another run or one that was killed: delete it or use --force"
            ) from error

    def _create(self) -> None:
        if not self._folder:
            with self.part.open("wb" if self._force else "xb"):
                return
        if self._force and self.part.is_dir():
            shutil.rmtree(self.part)
        self.part.mkdir()

    def publish(self) -> None:
        """Give NAME.part its final name, in place of what had that name."""
        self.part.replace(self.path)

    def discard(self) -> None:
        """Remove NAME.part, if it is still there."""
        if self._folder:
            shutil.rmtree(self.part, ignore_errors=True)
        else:
            self.part.unlink(missing_ok=True)

    def complete(self) -> None:
        """Finish NAME.part and rename it."""
        self.publish()

    def abort(self) -> None:
        """Remove what was written, unless the output is complete."""
        if not self._closed:
            self._closed = True
            self.discard()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and not self._closed:
                self.complete()
                self._closed = True
        finally:
            self.abort()


def natural_key(name: str) -> tuple[list[tuple[int, str]], str]:
    """The sort key by which frame2 comes before frame10, whatever the case of letters.

    >>> sorted(["f10.png", "f2.png", "F1.png"], key=natural_key)
    ['F1.png', 'f2.png', 'f10.png']
    """
    parts = re.split(r"(\d+)", name.casefold())  # text and numbers by turns, so that like meets like
    return [(int(part), "") if part.isdecimal() else (0, part) for part in parts], name
