"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import Field, dataclass, replace
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from types import GenericAlias
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin, get_type_hints

import typer

from guise.app.cli.console import Console
from guise.app.cli.presets import PRESET, notes_on_files
from guise.app.swapping import FACE_HELP, LANDMARKER_HELP
from guise.common.option import Option, option, options_of

if TYPE_CHECKING:
    from guise.app.enrolment.landmark_source import LandmarkSource
    from guise.app.media import EncodeOptions


Force = Annotated[bool, typer.Option("--force", help="Replace an existing output.")]

Video = Annotated[Path, typer.Argument(metavar="VIDEO", help="A video, an image or a folder of images.")]
Videos = Annotated[
    list[str],
    typer.Argument(
        metavar="VIDEO", help="One or more videos, images, folders of images, patterns in quotes, or URLs."
    ),
]
Each = Annotated[
    bool,
    typer.Option(
        "--each", help="Swap the files of a folder one by one; otherwise its images are one sequence."
    ),
]
OutputOrFolder = Annotated[
    str,
    typer.Option(
        "--output", "-o", metavar="OUT.mp4|DIR",
        help="The file to write, or for several inputs a folder, in which they are called NAME_swapped.",
    ),
]  # fmt: skip
From = Annotated[
    str | None,
    typer.Option(
        "--from", metavar="TIME", help="Where the part to work on begins: seconds, 1:30 or 1:02:30."
    ),
]
To = Annotated[
    str | None, typer.Option("--to", metavar="TIME", help="Where it ends; default: with the video.")
]
OutsideChoice = Annotated[
    Literal["keep", "cut"],
    typer.Option("--outside", help="What lies outside --from and --to: keep it as it is, or cut it off."),
]
PipeFormat = Annotated[
    Literal["y4m", "rawvideo", "nut"],
    typer.Option("--pipe", help="The format that `-o -` writes to a pipe."),
]
RawVideo = Annotated[
    str | None,
    typer.Option(
        "--raw",
        metavar="WxH@FPS[:PIXELS]",
        help="The format of raw video read from a pipe (`-`): 640x480@30:yuv420p.",
    ),
]
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
        help="For several people, instead of --identity: a person (left, right, largest, a number of "
        "`guise people find`, or their model) and the face that they get; may be repeated.",
    ),
]
Others = Literal["leave", "cover", "fictional"]
OthersChoice = Annotated[
    Others,
    typer.Option(
        "--others", help="With --map, everybody else: leave them, cover them, or give them a fictional face."
    ),
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
        help="Enroll the person in VIDEO anew, and do not save the model.",
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
LandmarkerSpec = Annotated[str | None, typer.Option("--landmarker", metavar="SPEC", help=LANDMARKER_HELP)]
Rest = Annotated[
    float | None,
    typer.Option(
        "--rest",
        min=0.0,
        metavar="SECONDS",
        help="When the face is at rest in the first clip: mouth closed, brows down; default: a guess.",
    ),
]
UnsureOption = Annotated[
    Literal["cover", "hold", "leave"],
    typer.Option(
        "--unsure",
        help="A face that is lost but may be visible: cover it, hold the last face there, or leave the frame as it is.",
    ),
]
Device = Literal["none", "auto", "cuda", "vaapi", "videotoolbox", "d3d11va"]
HardwareDecoding = Annotated[
    Device,
    typer.Option("--hwaccel", help="The device that decodes the video; the processor does what it cannot."),
]
LandmarkOutput = Annotated[
    Path,
    typer.Option(
        "--output", "-o", metavar="OUT.json", help="A .json, .npz or .pts file, or a folder of .pts files."
    ),
]
FormatChoice = Annotated[
    Literal["json", "npz", "pts"] | None,
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
DetectorSpec = Annotated[
    str | None,
    typer.Option(
        "--detector",
        metavar="lbp|yunet:PATH|centerface:PATH",
        help="Face detector; default: the landmarker's own.",
    ),
]


@dataclass(frozen=True)
class Part:
    """In the annotation of a command's parameter: the fields of a dataclass that the command takes as options.

    usual : the dataclass, or one of its instances, whose values then are the defaults.
    names : of the fields, in order; by default all that are options.
    """

    usual: Any
    names: tuple[str, ...] = ()

    def parameters(self) -> Iterator[Parameter]:
        """Parameters of a command as typer reads them."""
        for name, (told, field, kind) in self._options().items():
            default: Any = field.default if isinstance(self.usual, type) else getattr(self.usual, name)
            if _is_several(kind):
                kind, default = GenericAlias(list, get_args(kind)[0]) | None, list(default) or None
            said = typer.Option(
                *(told.name or "--" + name.replace("_", "-")).split(), metavar=told.metavar, help=told.help,
                min=told.least, max=told.most,
            )  # fmt: skip
            yield Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, said])

    def taken(self, given: dict[str, Any]) -> Any:
        """The dataclass with the values of its options, which are taken from those that were given."""
        values = {}
        for name, (_, _, kind) in self._options().items():
            value = given.pop(name)
            values[name] = tuple(value or ()) if _is_several(kind) else value
        return self.usual(**values) if isinstance(self.usual, type) else replace(self.usual, **values)

    def _options(self) -> dict[str, tuple[Option, Field[Any], Any]]:
        every = options_of(self.usual if isinstance(self.usual, type) else type(self.usual))
        return {name: every[name] for name in self.names or every}


def _is_several(kind: Any) -> bool:
    """Whether a type is a tuple of any length: an option that may be repeated."""
    return get_origin(kind) is tuple and get_args(kind)[1:] == (...,)


def takes(command: Callable[..., Any]) -> Callable[..., Any]:
    """A command each of whose parameters with a `Part` in its annotation is filled from the options of that.

    It also takes --preset, and what files say as defaults, which it tells.
    """
    hints = get_type_hints(command, include_extras=True)
    parts = {
        name: part for name, hint in hints.items() for part in get_args(hint)[1:] if isinstance(part, Part)
    }
    found: list[Parameter] = []
    for name, one in signature(command).parameters.items():
        if name in parts:
            found += parts[name].parameters()
        else:
            found.append(one.replace(kind=Parameter.KEYWORD_ONLY, annotation=hints[name]))
    found += [PRESET, Parameter("context", Parameter.KEYWORD_ONLY, annotation=typer.Context)]

    @wraps(command)
    def run(*, context: typer.Context | None = None, named_preset: str | None = None, **given: Any) -> Any:
        filled = {name: part.taken(given) for name, part in parts.items()}
        if context is not None and isinstance(console := filled.get("console"), Console):
            for note in notes_on_files(context):
                console.note(note)
        return command(**given, **filled)

    run.__signature__ = Signature(found)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in found}
    return run


@dataclass(frozen=True)
class EncodeChoices:
    """How a video is encoded, as a user says it; see `guise.app.media.EncodeOptions`, which takes long to import."""

    encoder: str = option(
        "auto",
        "Video encoder, such as libx264, libx265, ffv1. auto: libx264, or libx265 for more than 8 bits; in .webm VP9 "
        "or AV1; ProRes for transparency in .mov.",
        metavar="NAME",
    )
    crf: int | None = option(
        None,
        "Constant rate factor; lower is better and larger. Default: as fine as the input, from 15 to 20.",
        least=0,
        most=63,
    )
    preset: str = option(
        "veryfast", "Encoder preset, from ultrafast to veryslow.", name="--encoder-preset", metavar="NAME"
    )
    lossless: bool = option(False, "Encode losslessly.")

    def options(self) -> EncodeOptions:
        """For the encoder."""
        from guise.app.media import EncodeOptions

        return EncodeOptions(self.encoder, self.crf, self.preset, self.lossless)


Shown = Annotated[Console, Part(Console)]
Encode = Annotated[EncodeChoices, Part(EncodeChoices)]


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
