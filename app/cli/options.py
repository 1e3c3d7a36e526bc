"""The options that commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from guise.app.enrolment.enrol import LandmarkSource


class RendererName(StrEnum):
    """Who draws."""

    auto = "auto"
    gl = "gl"
    cpu = "cpu"


class LandmarkFormat(StrEnum):
    """What landmarks are written as."""

    json = "json"
    npz = "npz"
    pts = "pts"


Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say errors only.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, notes on stderr.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing output.")]

Video = Annotated[Path, typer.Argument(metavar="VIDEO", help="A video, an image or a folder of images.")]
ModelPath = Annotated[Path, typer.Option("--identity", metavar="NAME.guise", help="Whose face is shown.")]
Output = Annotated[Path, typer.Option("--output", "-o", metavar="OUT.mp4", help="What is written.")]
SourcePath = Annotated[
    Path | None,
    typer.Option(
        "--source",
        metavar="SRC.guise",
        help="Model of the person in VIDEO; without it they are enrolled first.",
    ),
]
LandmarkFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--landmarks",
        metavar="FILE",
        help="Landmarks (.npz, .json, .pts) of each clip; default: beside the clip.",
    ),
]
LandmarkFile = Annotated[
    Path | None,
    typer.Option("--landmarks", metavar="FILE", help="Landmarks of VIDEO for enrolling; default: beside it."),
]
LandmarkerSpec = Annotated[
    str | None,
    typer.Option(
        "--landmarker",
        metavar="SPEC",
        help="What finds the landmarks: builtin (default) or CARD.toml[@DETECTOR].",
    ),
]
Alpha = Annotated[
    float,
    typer.Option(
        min=0.0, max=1.0, help="Share of expression beyond the identity's own that is let through, 0 to 1."
    ),
]
RendererChoice = Annotated[RendererName, typer.Option("--renderer", help="Who draws the face.")]
Detector = Annotated[str, typer.Option(metavar="builtin|lbp|yunet:PATH", help="What finds the face.")]
Encoder = Annotated[str, typer.Option(metavar="NAME", help="Video encoder, such as libx264, libx265, ffv1.")]
Crf = Annotated[int, typer.Option(min=0, max=63, help="Constant rate factor; lower is better and larger.")]
Preset = Annotated[str, typer.Option(metavar="NAME", help="Encoder preset, from ultrafast to veryslow.")]
Lossless = Annotated[bool, typer.Option("--lossless", help="Lose nothing in encoding.")]

LandmarkOutput = Annotated[
    Path,
    typer.Option(
        "--output", "-o", metavar="OUT.json", help="A .json, .npz or .pts file, or a folder of .pts files."
    ),
]
FormatChoice = Annotated[
    LandmarkFormat | None,
    typer.Option("--format", help="What is written; default: what the output's name says."),
]
Overlay = Annotated[
    Path | None, typer.Option(metavar="OUT.mp4|OUT.png", help="Also draw the landmarks onto a copy of VIDEO.")
]
MinConfidence = Annotated[float, typer.Option(min=0.0, max=1.0, help="Faces below are left out.")]
NoSmooth = Annotated[
    bool, typer.Option("--no-smooth", help="Write the points of a video as they were found, not steadied.")
]
BoxDetectorSpec = Annotated[
    str | None,
    typer.Option(
        "--detector", metavar="lbp|yunet:PATH", help="What finds faces; default: the landmarker's own."
    ),
]


def landmark_source(files: list[Path], landmarker: str | None, clips: int) -> LandmarkSource:
    from guise.app.enrolment.enrol import LandmarkSource

    if files and landmarker:
        raise typer.BadParameter("give either --landmarks or --landmarker")
    if files and len(files) != clips:
        raise typer.BadParameter(
            f"--landmarks must be given once for each of the {clips} clips, got {len(files)}"
        )
    if landmarker is None:
        return LandmarkSource(files)
    from guise.aam.landmarks import open_landmarker

    return LandmarkSource(landmarker=open_landmarker(landmarker))


def help_without_command(context: typer.Context) -> None:
    """Show a group's help when it is called without a command, which is no mistake."""
    if context.invoked_subcommand is None:
        print(context.get_help())
