"""Generate docs/cli.md and the manual page docs/guise.1 from the commands themselves.

python docs/make_cli.py          writes both
python docs/make_cli.py --check  fails when one is out of date
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import typer

from guise.app.cli.commands import GROUPS, command_line, commands
from guise.common.version import VERSION

PAGE = Path(__file__).with_name("cli.md")
MANUAL = Path(__file__).with_name("guise.1")
# What an option means in every command, where their helps say it in different words.
MEANINGS = {
    "--identity": "the face that is shown: `NAME.guise`, a photo, a name of `guise people list`, or a fictional one",
    "--source": "the person in the video or at the camera: their model, or a name of `guise people list`",
    "--map": "the source and the identity, for each of several people",
    "--output": "what is written, or where it goes",
    "--cover": "how a face is covered that is not swapped",
    "--unsure": "what becomes of a face that may be visible and cannot be swapped",
    "--landmarks": "landmarks of faces, or feature points of heads, from files instead of detected",
    "--outside": "what lies outside `--from` and `--to`: keep it, or cut it off",
    "--crf": "constant rate factor: lower is better and larger",
    "--frames": "how many frames are used: to train on, or to measure",
    "--input": "a video or a stream, instead of the camera",
    "--unit": "the unit of a head's lengths, which are scaled to metres in a .glb",
    "--fps": "frames per second: asked of a camera, or of a written animation",
    "--method": "how an expression is transferred; the default is the best, the others are what it is compared with",
    "--picture": "a picture that is also drawn, of what the command found or made",
    "--resume": "continue where an earlier run stopped",
}
# Values and defaults that differ: in which command, and why.
DIFFERENCES = {
    "--identity": (
        "`auto` in `deidentify`, which chooses; the fictional faces in `live`; the person's own in `bench`; none in "
        "`swap`, `puppet` and `measure`, which only you can know"
    ),
    "--alpha": "0.3 in `deidentify`, 0.6 elsewhere: more brings traces of the hidden person's moustache or glasses",
    "--cover": (
        "solid in `deidentify`, mosaic in `live`: solid leaves nothing of a face; a mosaic disturbs calls less. Emoji "
        "and images are for files"
    ),
    "--eyes": "donor in `live`, source in `swap`: files keep the person's gaze; live shows none of it unasked",
    "--crf": "20 in `live`: a camera has no file whose fineness could be kept",
    "--outside": "cut in `deidentify`, keep elsewhere: what was not worked on shows its faces",
    "--unsure": "no hold in `live`: a face that stands still there would be taken for the person",
    "--output": "each command writes its own kind of file; what has no default is required",
    "--landmarks": "two files in `analogy mesh`, one for each head",
    "--frames": "about 120 to train on, 150 to measure",
    "--fps": "30 of a camera; an animation keeps its own",
    "--method": "photos and heads are compared with different papers",
}
INTRODUCTION = """# Commands

Generated from the commands by docs/make_cli.py; `guise COMMAND --help` shows the same.

Every command takes `--quiet`, which prints errors only, and `--json`, which prints one JSON object on stdout and
[progress in lines of JSON](conventions.md#programs-that-run-guise) on stderr. Exit codes and the rules for output files
are in [conventions.md](conventions.md).
Any option can stand in a file, `guise.toml`, also as a preset with a name: [presets.md](presets.md).

An option means the same in every command that has it:

{meanings}

So are its values and its default, but for these:

{differences}

Former names of options work until version 0.3, with a note: see the [changelog](../CHANGELOG.md).
"""
MANUAL_END = """.SH FILES
.TP
guise.toml
Options that are given every time, in the folder where the command is run or in the user's folder of settings.
.SH ENVIRONMENT
.TP
GUISE_PEOPLE
The folder in which people are saved.
.TP
GUISE_SETTINGS
The user's folder of settings.
.TP
GUISE_DEBUG
1 shows where a fault of Guise happened.
.SH EXIT STATUS
.TP
0
Done.
.TP
1
A fault in Guise; of guise deidentify, a file failed, or a face may be visible in an output.
.TP
2
A mistake in the command line or the input, said in one sentence.
.TP
3
Of guise deidentify: done, but some frames are not verified.
.TP
130
Interrupted."""
WORDS = {int: "INTEGER", float: "NUMBER", str: "TEXT", Path: "PATH"}


def page() -> str:
    """The whole page."""
    every = dict(commands(whole()))
    sections = [section(name, command) for name, command in every.items()]
    head = INTRODUCTION.format(
        meanings=two_columns("option", "meaning", MEANINGS),
        differences=two_columns("option", "what differs", DIFFERENCES),
    )
    return "\n".join([head, overview(every), *sections])


def two_columns(left: str, right: str, rows: dict[str, str]) -> str:
    """A table of options."""
    return "\n".join([f"| {left} | {right} |", "|---|---|", *(f"| `{k}` | {v} |" for k, v in rows.items())])


def disagreements() -> list[str]:
    """What differs between commands and is explained nowhere: an option's help, values, default, or two names for one.

    Options that no command shares have nothing to agree with.
    """
    helps: dict[str, set[str]] = {}
    rest: dict[str, set[tuple[str, str]]] = {}
    for command in dict(commands(whole())).values():
        hints = get_type_hints(command.callback)
        for param in command.params:
            if (name := param.opts[0]).startswith("--") and name != "--help":
                helps.setdefault(name, set()).add(param.help)
                values = "" if is_flag(param, hints) else value(param, hints)
                rest.setdefault(name, set()).add((values, default(param)))
    names: dict[str, set[str]] = {}
    for name, texts in helps.items():
        for text in texts:
            names.setdefault(text, set()).add(name)
    return [
        *(
            f"{name}: two meanings"
            for name, texts in helps.items()
            if len(texts) > 1 and name not in MEANINGS
        ),
        *(
            f"{name}: two defaults"
            for name, kinds in rest.items()
            if len(kinds) > 1 and name not in DIFFERENCES
        ),
        *(f"{' and '.join(sorted(same))}: one meaning" for same in names.values() if len(same) > 1),
        *(f"{name}: nothing to explain" for name in MEANINGS if len(helps.get(name, ())) < 2),
        *(f"{name}: no difference" for name in DIFFERENCES if len(rest.get(name, ())) < 2),
    ]


def overview(every: dict[str, Any]) -> str:
    """The commands of each group, with links to their sections."""
    rows = []
    for group in GROUPS:
        links = [f"[{n}](#{n.replace(' ', '-')})" for n in every if panel(n) == group]
        rows.append(f"| {group} | {', '.join(links)} |")
    return "\n".join(["| | |", "|---|---|", *rows, ""])


def panel(name: str) -> str:
    """The group in which `guise --help` lists a command, or the command that it is part of."""
    return str(whole().commands[name.split()[0]].rich_help_panel)


@cache
def whole() -> Any:
    """The command line with every command, which takes a while to build."""
    return typer.main.get_command(command_line())


def section(name: str, command: Any) -> str:
    """A command: heading, what it does, usage, arguments and options."""
    hints = get_type_hints(command.callback)
    params = [p for p in command.params if not getattr(p, "hidden", False) and p.name != "help"]
    arguments = [p for p in params if not p.opts[0].startswith("-")]
    options = [p for p in params if p.opts[0].startswith("-")]
    needed = [f"{p.opts[0]} {value(p, hints)}" for p in options if p.required]
    usage = ["guise", name, *(p.metavar for p in arguments), *needed, "[OPTIONS]"]
    rows = [row(p, hints) for p in [*arguments, *options]]
    table = ["| | | default |", "|---|---|---|", *rows]
    return "\n".join([f"## {name}", "", command.help, "", "```text", " ".join(usage), "```", "", *table, ""])


def row(param: Any, hints: dict[str, Any]) -> str:
    """A line of the table: spelling, meaning, default."""
    if param.opts[0].startswith("-"):
        spelling = f"`{', '.join(param.opts)}{'' if is_flag(param, hints) else ' ' + value(param, hints)}`"
    else:
        spelling = f"`{param.metavar}`"
    return f"| {spelling.replace('|', chr(92) + '|')} | {param.help} | {default(param)} |"


def plain(hint: Any) -> Any:
    """The type without `| None` and without `list`."""
    if get_origin(hint) is Literal:
        return hint
    parts = [a for a in get_args(hint) if a is not type(None)]
    return plain(parts[0]) if isinstance(hint, UnionType) or parts else hint


def is_flag(param: Any, hints: dict[str, Any]) -> bool:
    """Whether an option stands alone."""
    return plain(hints[param.name]) is bool


def value(param: Any, hints: dict[str, Any]) -> str:
    """What stands for an option's value."""
    kind = plain(hints[param.name])
    if param.metavar:
        return str(param.metavar)
    if get_origin(kind) is Literal:
        return "|".join(get_args(kind))
    return WORDS[kind]


def default(param: Any) -> str:
    """The default for a person to read."""
    if param.required:
        return "required"
    given = param.default
    if given is None or given is False or given == []:
        return ""
    return f"`{given}`"


def manual() -> str:
    """The manual page, in the macros of man(7)."""
    return "\n".join(
        [
            f'.TH GUISE 1 "" "Guise {VERSION}" "User Commands"',
            ".SH NAME",
            rf"guise \- {roff(str(whole().help).removesuffix('.'))}",
            ".SH SYNOPSIS",
            ".B guise",
            r"\fICOMMAND\fR [\fIARGUMENTS\fR]... [\fIOPTIONS\fR]",
            ".SH COMMANDS",
            *(line for name, command in commands(whole()) for line in manual_section(name, command)),
            *(roff_or_macro(line) for line in MANUAL_END.splitlines()),
            "",
        ]
    )


def manual_section(name: str, command: Any) -> Iterator[str]:
    """A command of the manual: what it does, arguments, options."""
    hints = get_type_hints(command.callback)
    yield from (f'.SS "guise {name}"', roff(command.help))
    for param in sorted(command.params, key=lambda p: p.opts[0].startswith("-")):
        if param.name == "help":
            continue
        spelling = re.findall("`([^`]*)`", row(param, hints).replace("\\|", "|"))[0]
        usual = default(param).replace("`", "")
        more = "" if not usual else " Required." if param.required else f" Default: {usual}."
        yield from (".TP", rf"\fB{roff(spelling)}\fR", roff(f"{param.help}{more}"))


def roff_or_macro(line: str) -> str:
    """A line of the manual's end: a macro as it is, other text with its characters kept."""
    return line if re.match(r"\.[A-Z]{2}\b", line) else roff(line)


def roff(text: str) -> str:
    """Text for troff, whose own characters are kept from it."""
    text = text.replace("\\", r"\e").replace("-", r"\-").replace("`", "")
    return re.sub(r"(?m)^([.'])", r"\\&\1", text)


def main() -> None:
    """Write or check both."""
    for path, text in ((PAGE, page()), (MANUAL, manual())):
        if sys.argv[1:] != ["--check"]:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            sys.exit(f"docs/{path.name} is out of date: run python docs/make_cli.py")


if __name__ == "__main__":
    main()
