"""The command `guise studio`."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.console import Console
from guise.app.cli.options import Shown, takes

if TYPE_CHECKING:
    from guise.app.studio.site import Studio

PORT, LIMIT_MB = 8080, 1000


@takes
def studio(
    *,
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="Port on this computer; 0: any free one."),
    ] = PORT,
    folder: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the studio keeps its files; default: in your data folder."),
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Don't open the browser.")] = False,
    limit: Annotated[int, typer.Option(min=1, metavar="MB", help="Largest upload.")] = LIMIT_MB,
    console: Shown,
) -> None:
    """Open Guise in the browser: live, people, landmarks, de-identification and analogies."""
    run_studio(console, port, folder, no_open=no_open, limit=limit)


def run_studio(
    console: Console, port: int = PORT, folder: Path | None = None, *, no_open: bool = False, limit: int = LIMIT_MB,
    begin: Callable[[Studio], str] = lambda studio: "/",
) -> None:  # fmt: skip
    """Run the studio until it is interrupted, with the browser at the page that `begin` gives."""
    from platformdirs import user_data_path

    from guise.app.studio.server import serve

    def announce(address: str) -> None:
        console.say(f"The studio is at {address} until you press Ctrl-C.")
        console.result({"address": address})
        sys.stdout.flush()
        if not no_open:
            webbrowser.open(address)

    serve(folder or user_data_path("guise", appauthor=False) / "studio", port, limit * 10**6, announce, begin)
