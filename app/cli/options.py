"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from guise.app.enrolment.landmark_source import LandmarkSource


class RendererName(StrEnum):
    """Which renderer draws."""

    auto = "auto"
    gl = "gl"
    cpu = "cpu"


class HwaccelName(StrEnum):
    """Which device decodes."""

    none = "none"
    auto = "auto"
    cuda = "cuda"
    vaapi = "vaapi"
    videotoolbox = "videotoolbox"
    d3d11va = "d3d11va"


class UnsureName(StrEnum):
    """What is done to a face that is lost but may be visible."""

    cover = "cover"
    hold = "hold"
    leave = "leave"


class OthersName(StrEnum):
    """What happens to people who are not named."""

    leave = "leave"
    cover = "cover"
    fictional = "fictional"


class LookName(StrEnum):
    """How the face is drawn."""

    swap = "swap"
    paper = "paper"


class OwnerName(StrEnum):
    """Whose eyes or mouth are shown."""

    donor = "donor"
    source = "source"


class LandmarkFormat(StrEnum):
    """Output formats of landmarks."""

    json = "json"
    npz = "npz"
    pts = "pts"


Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, notes on stderr.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing output.")]

Video = Annotated[Path, typer.Argument(metavar="VIDEO", help="A video, an image or a folder of images.")]
FACE_HELP = (
    "NAME.guise, a name of `guise people list`, or a fictional face: Luca, Amara, Mei, Walter, Kofi, Elena, Kenji, "
    "Asha, Omar"
)
_IDENTITY = typer.Option(
    "--identity",
    metavar="FACE",
    help=f"The face that is shown: {FACE_HELP}.",
)
FaceSpec = Annotated[str, _IDENTITY]
Output = Annotated[Path, typer.Option("--output", "-o", metavar="OUT.mp4", help="The file to write.")]
OneFace = Annotated[str | None, _IDENTITY]
FaceMap = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="SOURCE=FACE",
        help="Instead of --identity, for each of several people: left, right, largest, a number of "
        "`guise people find`, or their model, and the face that they get.",
    ),
]
OthersChoice = Annotated[
    OthersName,
    typer.Option("--others", help="With --map, everybody else: leave, cover, or give a face of the gallery."),
]
SourceSpec = Annotated[
    str | None,
    typer.Option(
        "--source",
        metavar="SRC",
        help="Model of the person in VIDEO, a file or a name of `guise people list`; default: they are enrolled first.",
    ),
]
NoKeep = Annotated[
    bool,
    typer.Option(
        "--no-keep",
        help="Enroll the person in VIDEO even if their model was kept by an earlier run, and do not keep it.",
    ),
]
LandmarkFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--landmarks",
        metavar="FILE",
        help="Landmarks (.npz, .json, .pts), once for each clip; default: the file beside the clip, or detected.",
    ),
]
LandmarkFile = Annotated[
    Path | None,
    typer.Option(
        "--landmarks",
        metavar="FILE",
        help="Landmarks of VIDEO for enrollment; default: the file beside it, or detected.",
    ),
]
LandmarkerSpec = Annotated[
    str | None,
    typer.Option(
        "--landmarker",
        metavar="SPEC",
        help="Landmarker: builtin (default) or CARD.toml[@DETECTOR].",
    ),
]
Alpha = Annotated[
    float,
    typer.Option(
        min=0.0, max=1.0, help="How much expression beyond the identity's own range is passed on, 0 to 1."
    ),
]
RendererChoice = Annotated[RendererName, typer.Option("--renderer", help="Which renderer draws the face.")]
LookChoice = Annotated[
    LookName,
    typer.Option(
        "--look",
        help="How the face is drawn: swap, as well as Guise can; or paper, by the papers' plain formulas, for "
        "comparison, and over hands, too.",
    ),
]
Rest = Annotated[
    float | None,
    typer.Option(
        "--rest",
        min=0.0,
        metavar="SECONDS",
        help="A time in the first clip at which the face is at rest: mouth shut, brows down; default: a guess.",
    ),
]
Outline = Annotated[
    float,
    typer.Option(
        min=0.0,
        max=1.0,
        help="How far the head's jaw line goes to the identity's, with what is near it, 0 to 1; 0 keeps the head's.",
    ),
]
EyesChoice = Annotated[
    OwnerName,
    typer.Option(
        "--eyes",
        help="Eyeballs between the lids: the identity's (donor) or the person's own with the identity's iris "
        "colour (source).",
    ),
]
MouthChoice = Annotated[
    OwnerName,
    typer.Option(
        "--mouth", help="Teeth and tongue between the lips: the identity's (donor) or the person's own."
    ),
]
Detector = Annotated[str, typer.Option(metavar="builtin|lbp|yunet:PATH", help="Face detector.")]
UnsureOption = Annotated[
    UnsureName,
    typer.Option(
        "--unsure",
        help="A face that is lost but may be visible: cover it, hold the last face there, or leave the frame as it is.",
    ),
]
Encoder = Annotated[str, typer.Option(metavar="NAME", help="Video encoder, such as libx264, libx265, ffv1.")]
HardwareDecoding = Annotated[
    HwaccelName,
    typer.Option(
        "--hwaccel", help="The device that decodes the video; what does not work is left to the processor."
    ),
]
RecordingCrf = Annotated[
    int, typer.Option(min=0, max=63, help="Constant rate factor; lower is better and larger.")
]
Crf = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=63,
        help="Constant rate factor; lower is better and larger. Default: as fine as the input, from 15 to 20.",
    ),
]
Preset = Annotated[str, typer.Option(metavar="NAME", help="Encoder preset, from ultrafast to veryslow.")]
Lossless = Annotated[bool, typer.Option("--lossless", help="Encode losslessly.")]

LandmarkOutput = Annotated[
    Path,
    typer.Option(
        "--output", "-o", metavar="OUT.json", help="A .json, .npz or .pts file, or a folder of .pts files."
    ),
]
FormatChoice = Annotated[
    LandmarkFormat | None,
    typer.Option("--format", help="Output format; default: by the suffix of the output."),
]
Overlay = Annotated[
    Path | None, typer.Option(metavar="OUT.mp4|OUT.png", help="Also draw the landmarks on a copy of VIDEO.")
]
MinConfidence = Annotated[float, typer.Option(min=0.0, max=1.0, help="Leave out faces with less confidence.")]
NoSmooth = Annotated[
    bool,
    typer.Option("--no-smooth", help="Write the points of a video as detected, without the temporal filter."),
]
BoxDetectorSpec = Annotated[
    str | None,
    typer.Option(
        "--detector", metavar="lbp|yunet:PATH", help="Face detector; default: the landmarker's own."
    ),
]


def drawn_as(look: LookName) -> dict[str, Any]:
    """The values of `EngineOptions` by which a look is drawn."""
    return {"light": "paper", "transfer": "paper"} if look is LookName.paper else {}


def faces_by_person(pairs: list[str] | None) -> dict[str, str]:
    """What --map says: by person, the face that they get."""
    faces: dict[str, str] = {}
    for pair in pairs or ():
        who, _, face = pair.partition("=")
        if not who or not face or who in faces:
            raise typer.BadParameter(f"--map takes SOURCE=FACE, each SOURCE once, got {pair!r}")
        faces[who] = face
    return faces


def landmark_source(files: list[Path], landmarker: str | None, clips: int) -> LandmarkSource:
    """Where the landmarks of some clips come from, by the options --landmarks and --landmarker."""
    from guise.app.enrolment.landmark_source import LandmarkSource

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
    """Show a group's help when it is called without a command, which is not an error."""
    if context.invoked_subcommand is None:
        print(context.get_help())
