"""All commands, in the groups in which `guise --help` lists them.

A command is thin: it opens what it needs, calls the library and prints the result.  Heavy libraries are imported inside
the commands, so that `guise --help` is fast.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer import Abort
from typer.core import TyperGroup

from guise.app.cli.analogy import analogy
from guise.app.cli.deidentify import deidentify
from guise.app.cli.faces import enroll, info, landmarks
from guise.app.cli.live import live
from guise.app.cli.measure import measure
from guise.app.cli.people import people
from guise.app.cli.studio import studio
from guise.app.cli.tools import bench, demo, doctor
from guise.app.cli.video import puppet, swap
from guise.common.version import version

__all__ = ["GROUPS", "Abort", "app"]

GROUPS: dict[str, tuple[Callable[..., Any] | typer.Typer, ...]] = {
    "Faces": (enroll, info, landmarks, people),
    "Video": (swap, puppet, deidentify, measure),
    "Live": (live, studio),
    "Offline": (analogy,),
    "Tools": (demo, doctor, bench),
}


class _InGroups(TyperGroup):
    """Lists the commands in the order of GROUPS; typer alone would put those with commands of their own last."""

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        panels = list(GROUPS)
        return sorted(self.commands, key=lambda name: panels.index(str(self.commands[name].rich_help_panel)))  # type: ignore[attr-defined]


app = typer.Typer(
    cls=_InGroups,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Swap faces in video in real time, and de-identify video, on an ordinary CPU.",
)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"guise {version()}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Take the options before the command."""


for _panel, _commands in GROUPS.items():
    for _command in _commands:
        if isinstance(_command, typer.Typer):
            app.add_typer(_command, rich_help_panel=_panel)
        else:
            app.command(rich_help_panel=_panel)(_command)
