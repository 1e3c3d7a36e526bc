"""The command `guise studio`."""

from __future__ import annotations

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from guise.app.cli.options import Shown, takes


@takes
def studio(
    *,
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="Port on this computer; 0: any free one."),
    ] = 8080,
    folder: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the studio keeps its files; default: in your data folder."),
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Don't open the browser.")] = False,
    limit: Annotated[int, typer.Option(min=1, metavar="MB", help="Largest upload.")] = 1000,
    console: Shown,
) -> None:
    """Open Guise in the browser: live, people, landmarks, de-identification and analogies."""
    from platformdirs import user_data_path

    from guise.app.studio.store import StudioError

    try:
        from guise.app.studio.server import serve
    except ModuleNotFoundError as error:
        raise StudioError(f'the studio needs {error.name}: pip install "guise-video[studio]"') from error

    def announce(address: str) -> None:
        console.say(f"The studio is at {address} until you press Ctrl-C.")
        console.result({"address": address})
        sys.stdout.flush()
        if not no_open:
            webbrowser.open(address)

    serve(folder or user_data_path("guise", appauthor=False) / "studio", port, limit * 10**6, announce)
