"""The demonstration, the checks of this computer, its speed, and the studio."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from guise.api.options import AnyPath, WatchOptions
from guise.api.pictures import path_of
from guise.api.vocabulary import call, watch_of
from guise.common.option import Option, require

if TYPE_CHECKING:
    from guise.app.tools.bench import Timing, WholeFile
    from guise.app.tools.demo import DemoReport
    from guise.app.tools.doctor import Finding


@dataclass(frozen=True)
class Speed:
    """How long each stage of a frame takes, and a whole file beside its transcode."""

    stages: list[Timing]
    file: WholeFile


@call
def demo(
    output: AnyPath = "guise-demo",
    *,
    samples: AnyPath | None = None,
    overwrite: bool = False,
    **options: Unpack[WatchOptions],
) -> DemoReport:
    """Enroll two sample people and swap one's face onto the other, into a folder."""
    from guise.app.swapping.report import SwapSettings
    from guise.app.tools.demo import run_demo

    progress, say = watch_of({**options})
    return run_demo(path_of(samples), Path(output), SwapSettings(force=overwrite, progress=progress, say=say))


def doctor() -> list[Finding]:
    """What works on this computer: topic, name, whether it is there (None where it is optional), and more about it."""
    from guise.app.tools.doctor import examine

    return examine()


@call
def bench(
    clip: AnyPath | None = None,
    *,
    source: AnyPath | None = None,
    identity: AnyPath | None = None,
    samples: AnyPath | None = None,
    frames: int = 150,
    **options: Unpack[WatchOptions],
) -> Speed:
    """How fast this computer swaps a clip, by default a sample."""
    from guise.app.tools.bench import measure, measure_file, prepare

    require("frames", frames, Option("", least=20))
    progress, say = watch_of({**options})
    names = [None if name is None else os.fspath(name) for name in (source, identity)]
    path, person, shown = prepare(
        path_of(clip), names[0], names[1], path_of(samples), progress=progress, say=say
    )
    return Speed(measure(path, person, shown, frames=frames, say=say), measure_file(path, person, shown))


@call
def studio(
    *,
    port: int = 8080,
    folder: AnyPath | None = None,
    open: bool = True,
    limit: int = 1000,
    **options: Unpack[WatchOptions],
) -> None:
    """Open Guise in the browser, until it is interrupted.   limit : MB of an upload; others as for the command."""
    from guise.app.cli.console import Console
    from guise.app.cli.studio import run_studio

    require("port", port, Option("", least=0, most=65_535))
    require("limit", limit, Option("", least=1))
    _, say = watch_of({**options})

    class Told(Console):
        def say(self, text: str) -> None:
            say(text)

    run_studio(Told(), port, path_of(folder), no_open=not open, limit=limit)
