"""The commands `guise analogy mesh`: expression transfer between 3-D heads."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.console import Console, Stages
from guise.app.cli.options import Force, Json, Quiet, help_without_command

if TYPE_CHECKING:
    from guise.app.meshes.context import RunContext
    from guise.app.meshes.pair import TransferOptions
    from guise.app.meshes.reports import MeshReport

mesh = typer.Typer(help="Transfer expressions between 3-D heads (.obj, .ply, .gltf, .glb).")
mesh.callback(invoke_without_command=True)(help_without_command)


class MeshMethodName(StrEnum):
    """How an expression is transferred."""

    tents = "tents"
    gradients = "gradients"
    cloning = "cloning"


class CorrespondenceName(StrEnum):
    """How the heads are matched."""

    dense = "dense"
    cylinder = "cylinder"


SourceNeutral = Annotated[
    Path, typer.Argument(metavar="SOURCE_NEUTRAL", help="The head with the expressions, at rest.")
]
Target = Annotated[
    Path,
    typer.Option(metavar="TARGET", help="The head that receives them, at rest; any topology, size and pose."),
]
Method = Annotated[
    MeshMethodName,
    typer.Option(help="Vertex tents, or the methods they are compared with: deformation gradients, cloning."),
]
Matching = Annotated[
    CorrespondenceName,
    typer.Option(help="Match the heads by deforming one onto the other, or by cylindrical projection."),
]
Landmarks = Annotated[
    tuple[str, str] | None,
    typer.Option(
        metavar="SOURCE.json TARGET.json",
        help="Feature points of both heads, as written by `landmarks`; `auto` detects them.",
    ),
]
KeepRigid = Annotated[
    bool,
    typer.Option("--keep-rigid", help="Keep eyes, teeth and other parts of the target in place."),
]
PictureOut = Annotated[
    Path | None, typer.Option(metavar="OUT.png", help="Also draw both heads, at rest and with expressions.")
]
ReportOut = Annotated[
    Path | None,
    typer.Option(metavar="OUT.json", help="Also write a report: settings, accuracy and times."),
]


@mesh.command()
def transfer(
    source: SourceNeutral,
    expressions: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE_EXPR...", help="The same head with expressions: the same vertices, moved."),
    ],
    target: Target,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="DIR",
            help="Folder for one file per expression, in the format of TARGET; default: TARGET_expressions "
            "beside it.",
        ),
    ] = None,
    method: Method = MeshMethodName.tents,
    correspondence: Matching = CorrespondenceName.dense,
    landmarks: Landmarks = None,
    keep_rigid: KeepRigid = False,
    picture: PictureOut = None,
    report: ReportOut = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Transfer expressions from one head to another."""
    from guise.app.meshes.transferring import transfer_files

    options = _options(method, correspondence, landmarks, keep_rigid)
    _run(
        lambda context: transfer_files(source, expressions, target, output, options, context),
        force,
        quiet,
        json,
        picture,
        report,
    )


@mesh.command()
def rig(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE_RIG", help="A head with morph targets (.glb, .gltf).")
    ],
    target: Target,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="RIG.glb", help="The target with those morph targets.")
    ],
    method: Method = MeshMethodName.tents,
    correspondence: Matching = CorrespondenceName.dense,
    landmarks: Landmarks = None,
    keep_rigid: KeepRigid = False,
    picture: PictureOut = None,
    report: ReportOut = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Transfer all morph targets of a head to another, with their names."""
    from guise.app.meshes.transferring import transfer_rig

    options = _options(method, correspondence, landmarks, keep_rigid)
    _run(
        lambda context: transfer_rig(source, target, output, options, context),
        force,
        quiet,
        json,
        picture,
        report,
    )


@mesh.command()
def sequence(
    source: SourceNeutral,
    frames: Annotated[
        Path,
        typer.Argument(
            metavar="FRAMES",
            help="A folder of .obj or .ply files, one per frame, or a .glb with animated morph targets.",
        ),
    ],
    target: Target,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="DIR|OUT.glb",
            help="A folder for one file per frame, in the format of TARGET, or one animated .glb.",
        ),
    ],
    method: Method = MeshMethodName.tents,
    correspondence: Matching = CorrespondenceName.dense,
    landmarks: Landmarks = None,
    keep_rigid: KeepRigid = False,
    fps: Annotated[
        float | None,
        typer.Option(
            min=1, max=1000, help="Frames per second of a .glb; default: the keys of FRAMES, 30 in OUT.glb."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue where an earlier run stopped; its frames are kept.")
    ] = False,
    picture: PictureOut = None,
    report: ReportOut = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Transfer an animation from one head to another, frame by frame."""
    from guise.app.meshes.sequences import SequenceFiles, transfer_sequence

    wanted = SequenceFiles(frames, output, fps, resume)
    options = _options(method, correspondence, landmarks, keep_rigid)
    _run(
        lambda context: transfer_sequence(source, wanted, target, options, context),
        force,
        quiet,
        json,
        picture,
        report,
    )


@mesh.command()
def register(
    template: Annotated[
        Path, typer.Argument(metavar="TEMPLATE", help="The head to deform, at rest.")
    ],
    target: Annotated[Path, typer.Argument(metavar="TARGET", help="The head whose shape it takes on.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FITTED",
            help="The deformed template, in the format of TEMPLATE, and beside it FITTED.npz, the correspondence; "
            "default: TEMPLATE_fitted beside TEMPLATE.",
        ),
    ] = None,
    landmarks: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="TEMPLATE.json TARGET.json",
            help="Feature points of both heads, as written by `landmarks`; `auto` detects them.",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="OUT.png", help="Also draw both with a chessboard mapped from one to the other."),
    ] = None,
    report: ReportOut = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Deform a head onto another, and write the correspondence of their vertices."""
    from guise.app.meshes.registering import register_files

    _run(
        lambda context: register_files(template, target, output, landmarks, context),
        force,
        quiet,
        json,
        picture,
        report,
    )


@mesh.command()
def landmarks(
    head: Annotated[Path, typer.Argument(metavar="MESH", help="A head at rest.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="OUT.json", help="The feature points; default: MESH.landmarks.json."
        ),
    ] = None,
    edit: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help="Corrected points: a JSON object from names to vertices (from 0) or to x, y, z.",
        ),
    ] = None,
    template: Annotated[
        Path | None,
        typer.Option(
            metavar="HEAD",
            help="Refine the points by matching those of this head (Xiang et al.).",
        ),
    ] = None,
    template_landmarks: Annotated[
        str, typer.Option(metavar="FILE|auto", help="The points of --template.")
    ] = "auto",
    picture: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Also draw the points on the head.")
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Find the 20 feature points (MPEG-4) of a head: mouth, nose, eyes, brows, chin."""
    from guise.app.meshes.points import write_feature_points

    like = None if template is None else (template, template_landmarks)
    _run(lambda context: write_feature_points(head, output, edit, like, context), force, quiet, json, picture)


@mesh.command()
def preview(
    head: Annotated[Path, typer.Argument(metavar="MESH", help="A head, or the first of two.")],
    after: Annotated[
        Path | None,
        typer.Argument(metavar="[AFTER]", help="The same head with an expression, or the truth to compare with."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="OUT.png|OUT.mp4",
            help="Views from several sides, or a turntable video; default: MESH_preview.png beside it.",
        ),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Draw a head, or two with the same vertices and the distances between these in colours."""
    from guise.app.meshes.previewing import preview_files

    _run(lambda context: preview_files(head, after, output, context), force, quiet, json)


def _options(
    method: MeshMethodName, matching: CorrespondenceName, landmarks: tuple[str, str] | None, keep_rigid: bool
) -> TransferOptions:
    from guise.app.meshes.pair import TransferOptions

    return TransferOptions(method.value, matching.value, landmarks, keep_rigid)


def _run(
    do: Callable[[RunContext], MeshReport], force: bool, quiet: bool, json: bool, picture: Path | None = None,
    report: Path | None = None,
) -> None:  # fmt: skip
    """Run a command, and print and write its report."""
    from guise.app.meshes.context import RunContext
    from guise.common.files import write_json
    from guise.common.threads import one_thread

    console = Console(quiet=quiet, json=json)
    with Stages(console) as stages, one_thread():
        done = do(RunContext(force, stages, console.note, picture, report))
    if report is not None:
        write_json(report, done.as_json())
    for line in done.lines():
        console.say(line)
    console.result(done.as_json())
