"""The option `--preset`, and with it the options from files: see `guise.common.presets`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from inspect import Parameter
from typing import Annotated, Any

import typer

from guise.common import presets
from guise.common.presets import Entry, PresetError

_NOT_IN_FILES = ("preset", "help")
_META = "guise.entries"  # what a context holds: by parameter, the entry that its value may come from


def take_defaults(context: typer.Context, preset: str | None) -> str | None:
    """Make what the files say the defaults of a command; called before its other options are read."""
    if context.resilient_parsing:  # for a shell that completes a command
        return preset
    path = _path(context)
    known = _options(context.command)
    entries: dict[str, Entry] = {}
    for entry in presets.options(preset):
        if entry.name in known and path[: len(entry.path)] == entry.path:
            entries[str(known[entry.name].name)] = entry
        else:
            _require_known(entry)
    parameters = {param.name: param for param in known.values()}
    context.default_map = {name: _value(context, parameters[name], one) for name, one in entries.items()}
    context.meta[_META] = entries
    return preset


PRESET = Parameter(
    "named_preset",
    Parameter.KEYWORD_ONLY,
    default=None,
    annotation=Annotated[
        str | None,
        typer.Option(
            "--preset",
            metavar="NAME",
            help="Options that were saved under a name, in guise.toml or by the studio.",
            is_eager=True,
            callback=take_defaults,
        ),
    ],
)


def notes_on_files(context: typer.Context) -> Iterator[str]:
    """For each file, a note on the options that came from it."""
    said: dict[str, list[str]] = {}
    for name, entry in context.meta.get(_META, {}).items():
        source = context.get_parameter_source(name)
        if source is not None and source.name == "DEFAULT_MAP":
            place = f"preset {entry.preset} of {entry.file}" if entry.preset else str(entry.file)
            said.setdefault(place, []).append(_as_given(entry))
    for place, options in said.items():
        yield f"from {place}: {' '.join(options)}"


def _path(context: typer.Context) -> tuple[str, ...]:
    """The words of a command after `guise`."""
    words: list[str] = []
    one: Any = context
    while one.parent is not None:
        words.insert(0, str(one.info_name))
        one = one.parent
    return tuple(words)


def _options(command: Any) -> dict[str, Any]:
    """A command's parameters by the names of its options, without hyphens."""
    found = {name[2:]: param for param in command.params for name in param.opts if name.startswith("--")}
    return {name: param for name, param in found.items() if name not in _NOT_IN_FILES}


def _require_known(entry: Entry) -> None:
    """Raise PresetError if an entry is for no command at all."""
    if not any(
        entry.name in names and path[: len(entry.path)] == entry.path for path, names in _everything()
    ):
        where = " ".join(("guise", *entry.path))
        raise PresetError(f"{entry} is not an option: `{where} --help` lists what there is")


@cache
def _everything() -> list[tuple[tuple[str, ...], set[str]]]:
    """Each command's words with the names of its options; with a file of options this takes 0.1 s once."""
    from guise.app.cli.commands import command_line, commands

    whole = typer.main.get_command(command_line())
    return [(tuple(name.split()), set(_options(command))) for name, command in commands(whole)]


def _value(context: typer.Context, param: Any, entry: Entry) -> Any:
    """The value of a parameter that an entry says, as the command line would give it."""
    value = entry.value
    if param.is_flag != isinstance(value, bool):
        wanted = "true or false" if param.is_flag else "a value, as on the command line"
        raise PresetError(f"{entry} must be {wanted}, got {value!r}")
    several = param.multiple or param.nargs != 1
    if isinstance(value, list) and not several:
        raise PresetError(f"{entry} must be one value, got {len(value)}")
    words = value if param.is_flag or isinstance(value, list) else [value] if several else str(value)
    given = [str(word) for word in words] if several else words
    try:
        param.type_cast_value(context, given)
    except typer.BadParameter as error:
        raise PresetError(f"{entry}: {error.message}") from None
    return given


def _as_given(entry: Entry) -> str:
    """An entry as one would write it on the command line."""
    if isinstance(entry.value, bool):
        return f"--{entry.name}" if entry.value else f"--no-{entry.name}"
    words = entry.value if isinstance(entry.value, list) else [entry.value]
    return f"--{entry.name} {' '.join(map(str, words))}"
