"""The command `guise live`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Literal

import typer

from guise.app.cli.console import Stages
from guise.app.cli.options import (
    EncodeChoices,
    Force,
    Part,
    Shown,
    faces_by_person,
    look_of,
    takes,
)
from guise.app.cli.studio import studio
from guise.app.drawing.look import FACE_HELP, LIVE_CHOICES, DrawingChoices
from guise.common.option import option


@dataclass(frozen=True)
class Recording(EncodeChoices):
    """How a recording is encoded: a camera has no file whose fineness could be kept."""

    crf: int = option(20, "Constant rate factor; lower is better and larger.", least=0, most=63)


Input = Annotated[
    str | None,
    typer.Option(
        metavar="FILE|URL",
        help="A video, played at its own pace, or a stream (rtsp, http ...); default: the camera.",
    ),
]
Camera = Annotated[int, typer.Option(min=0, metavar="N", help="Number of the camera.")]
Identities = Annotated[
    list[str] | None,
    typer.Option(
        "--identity",
        metavar="FACE",
        help=f"The face that is shown: {FACE_HELP}; repeat to choose among several with the number keys; default: "
        "the fictional faces.",
    ),
]
Source = Annotated[
    str | None,
    typer.Option(
        metavar="SRC",
        help="Model of the person in the picture; default: the one kept for this camera or file, or a new one.",
    ),
]
Cast = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="SOURCE=FACE",
        help="For up to four people at once: a person's model and the face that they get; others are covered.",
    ),
]
Outputs = Annotated[
    list[str] | None,
    typer.Option(
        "--output",
        "-o",
        metavar="window|studio|virtualcam|OUT.mp4",
        help="Where the result goes; may be repeated; default: window.",
    ),
]
Size = Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Requested of the camera.")]
Fps = Annotated[float, typer.Option(min=1, max=240, help="Requested of the camera.")]
Headless = Annotated[
    bool,
    typer.Option("--headless", help="No window: write every frame of a file to files, as fast as possible."),
]
Loop = Annotated[bool, typer.Option("--loop", help="Repeat the file.")]
Enroll = Annotated[bool, typer.Option("--enroll", help="Make a new model of the person in the picture.")]
Mode = Annotated[
    Literal["swap", "puppet", "off"], typer.Option(help="Swap, animate a still of the face, or cover.")
]
Cover = Annotated[Literal["solid", "mosaic", "blur"], typer.Option(help="How a face is covered.")]
Uncovered = Annotated[
    bool, typer.Option("--uncovered", help="Show the real face where it cannot be swapped.")
]
Mirror = Annotated[
    bool | None, typer.Option("--mirror/--no-mirror", help="Mirror the window; default: with a camera.")
]
SideBySide = Annotated[
    bool, typer.Option("--side-by-side", help="Show the real face beside the result, in the window only.")
]
Readout = Annotated[
    bool, typer.Option("--readout", help="Show frame rate, latency and dropped frames in the window.")
]


@takes
def live(
    *,
    input: Input = None,
    camera: Camera = 0,
    identity: Identities = None,
    source: Source = None,
    map: Cast = None,
    output: Outputs = None,
    headless: Headless = False,
    size: Size = "1280x720",
    fps: Fps = 30.0,
    loop: Loop = False,
    enroll: Enroll = False,
    mode: Mode = "swap",
    cover: Cover = "mosaic",
    uncovered: Uncovered = False,
    mirror: Mirror = None,
    side_by_side: SideBySide = False,
    readout: Readout = False,
    drawing: Annotated[DrawingChoices, Part(LIVE_CHOICES, ("look", "alpha", "eyes", "mouth", "renderer"))],
    encoding: Annotated[Recording, Part(Recording, ("encoder", "crf", "preset"))],
    force: Force = False,
    console: Shown,
) -> None:
    """Show another face live: from a camera, a file or a stream, in a window, a call or a file."""
    from guise.app.drawing.look import LIVE
    from guise.app.live.controls import LiveSettings
    from guise.app.live.run import LiveOptions, run_live

    if _is_for_studio(output, alone=not (input or identity or source)):
        studio(quiet=console.quiet, json=console.json)
        return
    cast = _cast(map, alone=not (identity or source or enroll or mode == "puppet"))
    settings = LiveSettings(
        alpha=drawing.alpha, mode=mode, mirror=input is None if mirror is None else mirror,
        side_by_side=side_by_side, readout=readout, style=cover, uncovered=uncovered,
    )  # fmt: skip
    options = LiveOptions(
        input, camera, tuple(identity or ()), source, tuple(output or (() if headless else ("window",))), headless,
        _size(size), fps, loop, enroll, settings,
        look_of(drawing, LIVE),
        encoding.options(), force, cast=cast,
    )  # fmt: skip
    with Stages(console) as stages:
        report = run_live(options, progress=stages, say=console.note)
    console.say(str(report))
    console.result(report.as_json())


def _is_for_studio(output: list[str] | None, *, alone: bool) -> bool:
    """Whether the browser is to be opened, with nothing else given."""
    if not output or "studio" not in output:
        return False
    if output != ["studio"] or not alone:
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


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{2,5})x(\d{2,5})", text)
    if found is None:
        raise typer.BadParameter(f"--size must be like 1280x720, got {text!r}")
    return int(found[1]), int(found[2])
