"""Options from files: those of every run, and presets, which have a name.

A file in TOML says what else would be given on the command line, by the names of the options:

    crf = 18                    # every command that has --crf

    [deidentify]                # that command alone; [analogy.mesh] is all of a group
    region = "head"

    [presets.court]             # with --preset court
    audio = "drop"

There are three: guise.toml in the folder of the work, guise.toml in the user's folder of settings, and beside it
presets.toml, which the program writes.  The command line wins, then the preset, then a command's table over a group's
and what stands outside of tables, then the earlier of the files.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from platformdirs import user_config_path

from guise.common.errors import GuiseError
from guise.common.files import write_whole

FOLDER_VARIABLE = "GUISE_SETTINGS"
FILE = Path("guise.toml")
PRESETS = "presets"
HEADER = "# Written by Guise: presets that were saved. guise.toml beside it is yours to edit.\n"
# Until version 0.3, when --preset was the encoder's.
ENCODER_PRESETS = re.compile(r"(ultra|super|very)?fast|faster|medium|slow(er)?|veryslow|placebo|p?\d+")
_NAME = re.compile(r"[^\W_][\w .-]{0,59}")


class PresetError(GuiseError):
    """A file of options, or a preset, that cannot be used; one sentence."""


@dataclass(frozen=True)
class Entry:
    """An option in a file.

    Parameters
    ----------
    file, preset : where it stands; preset is "" outside of presets.
    path : of the command or group for which it is, () for all.   name : of the option.   value : as TOML has it.
    """

    file: Path
    preset: str
    path: tuple[str, ...]
    name: str
    value: Any

    def __str__(self) -> str:
        parts = [PRESETS, self.preset] if self.preset else []
        return f"{self.file}: {'.'.join([*parts, *self.path, self.name])}"


def folder() -> Path:
    """The user's folder of settings."""
    given = os.environ.get(FOLDER_VARIABLE)
    return Path(given) if given else user_config_path("guise", appauthor=False)


def files() -> list[Path]:
    """The files that are there, the first in rank first."""
    return [path for path in (FILE, folder() / FILE, _saved()) if path.is_file()]


def options(preset: str | None = None) -> list[Entry]:
    """What the files and a preset say, lowest in rank first: a later entry for a command replaces an earlier one.

    Raises PresetError if a file cannot be read or no preset has that name.
    """
    read = {file: _read(file) for file in files()}
    general = [
        entry
        for file in reversed(read)
        for entry in _entries(file, "", {key: value for key, value in read[file].items() if key != PRESETS})
    ]
    general.sort(key=lambda entry: len(entry.path))
    return general + ([] if preset is None else _preset(preset, read))


def names() -> list[str]:
    """Names of all presets, those of the first file first."""
    return list(dict.fromkeys(name for file in files() for name in _tables(_read(file), file)))


def saved() -> list[str]:
    """Names of the presets that the program wrote, which it can write anew and delete."""
    file = _saved()
    return list(_tables(_read(file), file)) if file.is_file() else []


def preset(name: str, command: str) -> dict[str, Any]:
    """Options of a preset for a command, such as "deidentify": by name, as TOML has them."""
    found = _preset(name, {file: _read(file) for file in files()})
    path = tuple(command.split())
    return {entry.name: entry.value for entry in found if path[: len(entry.path)] == entry.path}


def save(name: str, command: str, options: Mapping[str, Any]) -> None:
    """Write a preset for a command; one of that name for the same command is replaced, for others it stays.

    options : by name on the command line without its hyphens; strings, numbers, truth values, lists of these, and None,
    which is left out.
    """
    name = checked_name(name)
    file = _saved()
    tables = dict(_tables(_read(file), file)) if file.is_file() else {}
    told = {key: list(value) if isinstance(value, tuple) else value for key, value in options.items()}
    tables[name] = dict(tables.get(name, {})) | {command: {k: v for k, v in told.items() if v is not None}}
    _write(tables)


def delete(name: str) -> None:
    """Delete a preset that the program wrote."""
    file = _saved()
    tables = dict(_tables(_read(file), file)) if file.is_file() else {}
    if name not in tables:
        raise PresetError(f"there is no saved preset {name}: those of guise.toml are deleted there")
    del tables[name]
    _write(tables)


def checked_name(name: str) -> str:
    """A name that a preset may have, without blanks around it; PresetError if it may not."""
    name = name.strip()
    if not _NAME.fullmatch(name):
        raise PresetError(f"a preset is called by letters, digits, blanks, dots and hyphens, got {name!r}")
    if ENCODER_PRESETS.fullmatch(name):
        raise PresetError(f"{name} is a preset of video encoders: call yours otherwise")
    return name


def _saved() -> Path:
    return folder() / "presets.toml"


def _read(file: Path) -> dict[str, Any]:
    import tomllib

    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:  # no TOML, or no UTF-8
        raise PresetError(f"{file} is not TOML: {error}") from error


def _tables(table: Mapping[str, Any], file: Path) -> Mapping[str, Any]:
    """The presets of a file by name."""
    found = table.get(PRESETS, {})
    if not isinstance(found, dict) or not all(isinstance(one, dict) for one in found.values()):
        raise PresetError(f"{file}: {PRESETS} must be tables, as [{PRESETS}.NAME]")
    for name in found:
        checked_name(name)
    return found


def _preset(name: str, read: Mapping[Path, Mapping[str, Any]]) -> list[Entry]:
    for file, table in read.items():
        if (found := _tables(table, file).get(name)) is not None:
            return sorted(_entries(file, name, found), key=lambda entry: len(entry.path))
    there = ", ".join(dict.fromkeys(one for file, table in read.items() for one in _tables(table, file)))
    raise PresetError(
        f"there is no preset {name}: {f'there are {there}' if there else f'write one as [{PRESETS}.{name}] in {FILE}'}"
    )


def _entries(
    file: Path, preset: str, table: Mapping[str, Any], path: tuple[str, ...] = ()
) -> Iterator[Entry]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _entries(file, preset, value, (*path, *key.split()))
        else:
            yield Entry(file, preset, path, key, value)


def _write(tables: Mapping[str, Mapping[str, Any]]) -> None:
    file = _saved()
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, HEADER + "".join(_lines((PRESETS,), tables)))


def _lines(path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[str]:
    """A table as TOML, its own values before the tables in it."""
    plain = {key: value for key, value in table.items() if not isinstance(value, Mapping)}
    if plain:
        yield f"\n[{'.'.join(map(_toml, path))}]\n"
    for key, value in plain.items():
        yield f"{_toml(key)} = {_toml(value)}\n"
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _lines((*path, key), value)


def _toml(value: Any) -> str:
    """A value as TOML has it, which is JSON's way but for the character DEL."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
