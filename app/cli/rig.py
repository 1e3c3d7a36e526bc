"""The commands `guise rig`: ARKit's coefficients of a clip, and live."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from guise.app.cli.console import Stages
from guise.app.cli.live import Mirror, Size, camera_size
from guise.app.cli.options import From, NoSmooth, Part, Shown, To, help_without_command, takes
from guise.app.rig.options import RIG_SUFFIXES, RigClipOptions, RigLiveOptions

rig = typer.Typer(
    name="rig",
    help="Drive a face rig: ARKit's 52 coefficients, head and eyes of a person in a clip or at the camera.",
)
rig.callback(invoke_without_command=True)(help_without_command)


@rig.command("from-video")
@takes
def from_video(
    *,
    clip: Annotated[Path, typer.Argument(metavar="CLIP", help="A video of one person, or a folder of images.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar=RIG_SUFFIXES,
            help="Live Link Face CSV, JSON lines, or a head with the animation.",
        ),
    ],
    options: Annotated[RigClipOptions, Part(RigClipOptions)],
    no_smooth: NoSmooth = False,
    from_: From = None,
    to: To = None,
    console: Shown,
) -> None:  # fmt: skip
    """Write the coefficients of the person in a clip."""
    from guise.app.media.time_range import TimeRange
    from guise.app.rig.clip import rig_clip

    with Stages(console) as stages:
        report = rig_clip(
            clip, output, replace(options, smooth=not no_smooth), TimeRange.between(from_, to, "cut"),
            progress=stages, say=console.note,
        )  # fmt: skip
    console.say(str(report))
    console.result(report.as_json())


@rig.command("live")
@takes
def rig_live(
    *,
    options: Annotated[RigLiveOptions, Part(RigLiveOptions)],
    size: Size = "1280x720",
    window: Annotated[
        bool, typer.Option("--window/--no-window", help="Show the picture and the coefficients.")
    ] = True,
    mirror: Mirror = None,
    console: Shown,
) -> None:
    """Send the coefficients of the person at the camera to an avatar, by the VMC protocol."""
    from guise.app.rig.live import run_rig_live

    mirrored = options.input is None if mirror is None else mirror
    options = replace(options, window=window, mirror=mirrored, size=camera_size(size))
    with Stages(console) as stages:
        report = run_rig_live(options, progress=stages, say=console.note)
    for line in str(report).splitlines():
        console.say(line)
    console.result(report.as_json())
