"""The command `guise live`."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Annotated

import typer

from guise.app.cli.console import Stages
from guise.app.cli.options import (
    EncodeChoices,
    Part,
    Shown,
    faces_by_person,
    takes,
)
from guise.app.cli.studio import studio
from guise.app.drawing.look import LIVE, LIVE_CHOICES, DrawingChoices
from guise.app.live.options import LiveOptions, LiveSettings
from guise.common.option import option


@dataclass(frozen=True)
class Recording(EncodeChoices):
    """How a recording is encoded: a camera has no file whose fineness could be kept."""

    crf: int = option(20, "Constant rate factor; lower is better and larger.", least=0, most=63)


Cast = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="SOURCE=FACE",
        help="For up to four people: a person's model and the face that they get; others are covered.",
    ),
]
Size = Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Size of picture to ask the camera for.")]
Mirror = Annotated[
    bool | None, typer.Option("--mirror/--no-mirror", help="Mirror the window; default: with a camera.")
]


@takes
def live(
    *,
    options: Annotated[LiveOptions, Part(LiveOptions)],
    map: Cast = None,
    size: Size = "1280x720",
    settings: Annotated[LiveSettings, Part(LiveSettings)],
    mirror: Mirror = None,
    drawing: Annotated[
        DrawingChoices, Part(LIVE_CHOICES, ("look", "alpha", "eyes", "mouth", "glasses", "renderer"))
    ],
    encoding: Annotated[Recording, Part(Recording, ("encoder", "crf", "preset"))],
    console: Shown,
) -> None:
    """Show another face live: from a camera, a file or a stream, in a window, a call or a file."""
    from guise.app.live.run import run_live

    named = options.identities or options.source
    if _is_for_studio(options.outputs, alone=not (options.input or named)):
        studio(quiet=console.quiet, json=console.json)
        return
    cast = _cast(map, alone=not (named or options.enrol or settings.mode == "puppet"))
    mirrored = options.input is None if mirror is None else mirror
    options = replace(
        options, outputs=options.outputs or ("window",), size=camera_size(size), cast=cast,
        settings=replace(settings, alpha=drawing.alpha, mirror=mirrored), look=drawing.of(LIVE),
        encode=encoding.options(),
    )  # fmt: skip
    with Stages(console) as stages:
        report = run_live(options, progress=stages, say=console.note)
    console.say(str(report))
    console.result(report.as_json())


def _is_for_studio(outputs: tuple[str, ...], *, alone: bool) -> bool:
    """Whether the browser is to be opened, with nothing else given."""
    if "studio" not in outputs:
        return False
    if outputs != ("studio",) or not alone:
        raise typer.BadParameter(
            "--output studio opens the browser, where everything else is chosen: give it alone"
        )
    return True


def _cast(map: list[str] | None, *, alone: bool) -> dict[str, str]:
    """Faces by person, if nothing else says who gets which face."""
    cast = faces_by_person(map)
    if cast and not alone:
        raise typer.BadParameter(
            "--map says who gets which face: leave out --identity, --source, --enroll and puppet"
        )
    return cast


def camera_size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{2,5})x(\d{2,5})", text)
    if found is None:
        raise typer.BadParameter(f"--size must be like 1280x720, got {text!r}")
    return int(found[1]), int(found[2])
