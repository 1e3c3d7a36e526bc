"""All commands, in the groups in which `guise --help` lists them.

A command is thin: it opens what it needs, calls the library and prints the result.  Heavy libraries are imported inside
the commands, so that `guise --help` is fast, and of the commands only the one that is run.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Annotated, Any

import typer
from typer import Abort
from typer.core import TyperGroup

from guise.app.cli.former import Command
from guise.common.version import VERSION

__all__ = ["GROUPS", "Abort", "command_line", "commands"]

# Group -> command -> module in guise.app.cli.
GROUPS: dict[str, dict[str, str]] = {
    "Faces": {"enroll": "faces", "info": "faces", "landmarks": "faces", "people": "people"},
    "Video": {"swap": "video", "puppet": "video", "deidentify": "deidentify", "measure": "measure"},
    "Live": {"live": "live", "studio": "studio", "rig": "rig"},
    "Offline": {"analogy": "analogy"},
    "Tools": {"demo": "tools", "doctor": "tools", "bench": "tools"},
}


class _InGroups(TyperGroup):
    """Lists the commands in the order of GROUPS; typer alone would put those with commands of their own last."""

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        panels = list(GROUPS)
        return sorted(self.commands, key=lambda name: panels.index(str(self.commands[name].rich_help_panel)))  # type: ignore[attr-defined]


def command_line(name: str | None = None) -> typer.Typer:
    """The command line with the command of that name alone, which is sooner made; with all if there is none."""
    made = typer.Typer(
        cls=_InGroups,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        help="Swap faces in video in real time, and de-identify video, on an ordinary CPU.",
    )
    made.callback()(_root)
    known = any(name in commands for commands in GROUPS.values())
    for panel, commands in GROUPS.items():
        for command, module in commands.items():
            if known and command != name:
                continue
            found = getattr(import_module(f"guise.app.cli.{module}"), command)
            if isinstance(found, typer.Typer):
                made.add_typer(found, rich_help_panel=panel)
            else:
                made.command(cls=Command, rich_help_panel=panel)(found)
    return made


def commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Every command of a group with its full name, such as "analogy mesh rig"."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"guise {VERSION}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Take the options before the command."""
