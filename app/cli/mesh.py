"""The commands `guise analogy mesh`: expressions from one 3-D head to another."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.console import Console, Stages
from guise.app.cli.options import Force, Json, Quiet, help_without_command

if TYPE_CHECKING:
    from guise.app.meshes.pair import How
    from guise.app.meshes.reports import Report
    from guise.app.meshes.work import Work

mesh = typer.Typer(help="Expressions from one 3-D head to another (.obj, .ply, .gltf, .glb).")
mesh.callback(invoke_without_command=True)(help_without_command)


class MethodName(StrEnum):
    """How an expression is carried over."""

    tents = "tents"
    gradients = "gradients"
    cloning = "cloning"


class CorrespondenceName(StrEnum):
    """How the heads are matched."""

    dense = "dense"
    cylinder = "cylinder"


SourceNeutral = Annotated[
    Path, typer.Argument(metavar="SOURCE_NEUTRAL", help="The head that has the expressions, at rest.")
]
Target = Annotated[
    Path,
    typer.Option(metavar="TARGET", help="The head that gets them, at rest; any topology, size and pose."),
]
Method = Annotated[
    MethodName,
    typer.Option(help="Vertex tents, or what they were compared with: deformation gradients, cloning."),
]
Matching = Annotated[
    CorrespondenceName,
    typer.Option(help="Match the heads by deforming one onto the other, or by cylindrical pictures of them."),
]
Landmarks = Annotated[
    tuple[str, str] | None,
    typer.Option(
        metavar="SOURCE.json TARGET.json",
        help="Feature points of both heads, as `landmarks` writes them; `auto` for a head on which they are found.",
    ),
]
KeepRigid = Annotated[
    bool,
    typer.Option("--keep-rigid", help="Leave eyes, teeth and other parts of the target where they are."),
]
PictureOut = Annotated[
    Path | None, typer.Option(metavar="OUT.png", help="Also draw both heads, at rest and with expressions.")
]
ReportOut = Annotated[
    Path | None,
    typer.Option(metavar="OUT.json", help="Also write what was done, how well and how fast."),
]


@mesh.command()
def transfer(
    source: SourceNeutral,
    expressions: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE_EXPR...", help="The same head with expressions: same vertices, moved."),
    ],
    target: Target,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="DIR",
            help="The folder for one file per expression, in TARGET's format; default: TARGET_expressions "
            "beside it.",
        ),
    ] = None,
    method: Method = MethodName.tents,
    correspondence: Matching = CorrespondenceName.dense,
    landmarks: Landmarks = None,
    keep_rigid: KeepRigid = False,
    picture: PictureOut = None,
    report: ReportOut = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Carry expressions of one head over to another."""
    from guise.app.meshes.transferring import transfer_files

    how = _how(method, correspondence, landmarks, keep_rigid)
    _run(
        lambda work: transfer_files(source, expressions, target, output, how, work),
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
    method: Method = MethodName.tents,
    correspondence: Matching = CorrespondenceName.dense,
    landmarks: Landmarks = None,
    keep_rigid: KeepRigid = False,
    picture: PictureOut = None,
    report: ReportOut = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Give a head all morph targets of another, with their names."""
    from guise.app.meshes.rigging import rig_file

    how = _how(method, correspondence, landmarks, keep_rigid)
    _run(lambda work: rig_file(source, target, output, how, work), force, quiet, json, picture, report)


@mesh.command()
def sequence(
    source: SourceNeutral,
    frames: Annotated[
        Path,
        typer.Argument(
            metavar="FRAMES", help="A folder of .obj or .ply, one a frame, or a .glb whose morph targets move."
        ),
    ],
    target: Target,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="DIR|OUT.glb",
            help="A folder for one file per frame, in TARGET's format, or one animated file.",
        ),
    ],
    method: Method = MethodName.tents,
    correspondence: Matching = CorrespondenceName.dense,
    landmarks: Landmarks = None,
    keep_rigid: KeepRigid = False,
    fps: Annotated[
        float | None,
        typer.Option(
            min=1, max=1000, help="Frames a second of a .glb; default: one for each key of FRAMES, 30 in OUT.glb."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where an earlier run stopped; its frames are left as they are.")
    ] = False,
    picture: PictureOut = None,
    report: ReportOut = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Carry an animation of one head over to another, frame by frame."""
    from guise.app.meshes.sequences import Frames, sequence_files

    wanted = Frames(frames, output, fps, resume)
    how = _how(method, correspondence, landmarks, keep_rigid)
    _run(lambda work: sequence_files(source, wanted, target, how, work), force, quiet, json, picture, report)


@mesh.command()
def register(
    template: Annotated[
        Path, typer.Argument(metavar="TEMPLATE", help="The head that is deformed, at rest.")
    ],
    target: Annotated[Path, typer.Argument(metavar="TARGET", help="The head whose shape it takes.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FITTED",
            help="The deformed template, in TEMPLATE's format, and beside it FITTED.npz, the correspondence; "
            "default: TEMPLATE_fitted beside TEMPLATE.",
        ),
    ] = None,
    landmarks: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="TEMPLATE.json TARGET.json",
            help="Feature points of both heads, as `landmarks` writes them; `auto` for a head on which they are found.",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="OUT.png", help="Also draw both with a chessboard carried from one to the other."),
    ] = None,
    report: ReportOut = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Deform a head onto another, and write which point of it each vertex of the other corresponds to."""
    from guise.app.meshes.registering import register_files

    _run(
        lambda work: register_files(template, target, output, landmarks, work),
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
            help="Points that are known better: a JSON object, name to vertex (from 0) or to x, y, z.",
        ),
    ] = None,
    template: Annotated[
        Path | None,
        typer.Option(
            metavar="HEAD",
            help="Search for points that look like those of this head, from the found or given ones on (Xiang et al.).",
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
    from guise.app.meshes.points import landmarks_file

    like = None if template is None else (template, template_landmarks)
    _run(lambda work: landmarks_file(head, output, edit, like, work), force, quiet, json, picture)


@mesh.command()
def preview(
    head: Annotated[Path, typer.Argument(metavar="MESH", help="A head, or the one before.")],
    after: Annotated[
        Path | None,
        typer.Argument(metavar="[AFTER]", help="The same head with an expression, or the truth to compare with."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="OUT.png|OUT.mp4",
            help="Views from several sides, or a turning head; default: MESH_preview.png beside it.",
        ),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:  # fmt: skip
    """Draw a head, or two of the same vertices and in colours how far each vertex is from the other's."""
    from guise.app.meshes.previewing import preview_files

    _run(lambda work: preview_files(head, after, output, work), force, quiet, json)


def _how(
    method: MethodName, matching: CorrespondenceName, landmarks: tuple[str, str] | None, keep_rigid: bool
) -> How:
    from guise.app.meshes.pair import How

    return How(method.value, matching.value, landmarks, keep_rigid)


def _run(
    do: Callable[[Work], Report], force: bool, quiet: bool, json: bool, picture: Path | None = None,
    report: Path | None = None,
) -> None:  # fmt: skip
    """Do it, say and write what was done."""
    from guise.app.meshes.work import Work
    from guise.common.files import write_json

    console = Console(quiet=quiet, json=json)
    with Stages(console) as stages:
        done = do(Work(force, stages, console.note, picture, report))
    if report is not None:
        write_json(report, done.as_json())
    for line in done.lines():
        console.say(line)
    console.result(done.as_json())
