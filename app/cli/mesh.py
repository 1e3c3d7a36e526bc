"""The commands `guise analogy mesh`: expression transfer between 3-D heads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.console import Console, Stages
from guise.app.cli.options import Force, Part, Shown, help_without_command, takes
from guise.app.meshes.options import TransferOptions, Unit
from guise.common.option import option

if TYPE_CHECKING:
    from guise.app.meshes.context import RunContext
    from guise.app.meshes.reports import MeshReport

mesh = typer.Typer(help="Transfer expressions between 3-D heads (.obj, .ply, .gltf, .glb, .vrm).")
mesh.callback(invoke_without_command=True)(help_without_command)


@dataclass(frozen=True)
class Extra:
    """What is written besides, and whether existing outputs are replaced."""

    picture: Path | None = option(
        None, "Also draw both heads, at rest and with expressions.", metavar="OUT.png"
    )
    report: Path | None = option(
        None, "Also write a report: settings, accuracy and times.", metavar="OUT.json"
    )
    force: bool = option(False, "Replace an existing output.")


SourceNeutral = Annotated[
    Path, typer.Argument(metavar="SOURCE_NEUTRAL", help="The head with the expressions, at rest.")
]
Target = Annotated[
    Path,
    typer.Option(metavar="TARGET", help="The head that receives them, at rest; any topology, size and pose."),
]
TargetUnit = Annotated[
    Unit | None,
    typer.Option(help="Unit of TARGET's lengths, scaled to metres in a .glb; default: as they are."),
]
Transferring = Annotated[TransferOptions, Part(TransferOptions)]
Extras = Annotated[Extra, Part(Extra)]


@mesh.command()
@takes
def transfer(
    *,
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
    options: Transferring,
    extra: Extras,
    console: Shown,
) -> None:  # fmt: skip
    """Transfer expressions from one head to another."""
    from guise.app.meshes.transferring import transfer_files

    _run(
        lambda context: transfer_files(source, expressions, target, output, options, context), console, extra
    )


@mesh.command()
@takes
def rig(
    *,
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE_RIG", help="A head with morph targets (.glb, .gltf, .vrm).")
    ],
    target: Target,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="RIG.glb|RIG.vrm",
            help="The target with those morph targets; a .vrm also gets its expressions.",
        ),
    ],
    author: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Who made TARGET, for a .vrm made of another format; may be repeated."),
    ] = None,
    unit: TargetUnit = None,
    options: Transferring,
    extra: Extras,
    console: Shown,
) -> None:  # fmt: skip
    """Transfer all morph targets of a head to another, with their names."""
    from guise.app.meshes.transferring import transfer_rig

    _run(
        lambda context: transfer_rig(source, target, output, options, context, unit, author or ()),
        console,
        extra,
    )


@mesh.command()
@takes
def sequence(
    *,
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
    options: Transferring,
    fps: Annotated[
        float | None,
        typer.Option(
            min=1, max=1000, help="Frames per second of a .glb; default: the keys of FRAMES, 30 in OUT.glb."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue where an earlier run stopped; its frames are kept.")
    ] = False,
    unit: TargetUnit = None,
    extra: Extras,
    console: Shown,
) -> None:  # fmt: skip
    """Transfer an animation from one head to another, frame by frame."""
    from guise.app.meshes.sequences import SequenceFiles, transfer_sequence

    wanted = SequenceFiles(frames, output, fps, resume, unit)
    _run(lambda context: transfer_sequence(source, wanted, target, options, context), console, extra)


@mesh.command()
@takes
def register(
    *,
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
    extra: Annotated[Extra, Part(Extra, ("report", "force"))],
    console: Shown,
) -> None:  # fmt: skip
    """Deform a head onto another, and write the correspondence of their vertices."""
    from guise.app.meshes.registering import register_files

    extra = replace(extra, picture=picture)
    _run(lambda context: register_files(template, target, output, landmarks, context), console, extra)


@mesh.command()
@takes
def landmarks(
    *,
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
    parts_out: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.toml",
            help="Also write what the parts of the head are, for `--parts` of the other commands.",
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Also draw the points on the head.")
    ] = None,
    force: Force = False,
    console: Shown,
) -> None:  # fmt: skip
    """Find the 20 feature points (MPEG-4) of a head: mouth, nose, eyes, brows, chin."""
    from guise.app.meshes.points import write_feature_points

    like = None if template is None else (template, template_landmarks)
    _run(
        lambda context: write_feature_points(head, output, edit, like, parts_out, context),
        console,
        Extra(picture, force=force),
    )


@mesh.command()
@takes
def preview(
    *,
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
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="TRUTH", help="What AFTER should be: draw its error E (Song et al.) in bands of 0.1, 0.5 and 2 %."
        ),
    ] = None,
    force: Force = False,
    console: Shown,
) -> None:  # fmt: skip
    """Draw a head, or two with the same vertices and the distances between these in colours."""
    from guise.app.meshes.previewing import preview_files

    _run(lambda context: preview_files(head, after, output, context, truth), console, Extra(force=force))


def _run(do: Callable[[RunContext], MeshReport], console: Console, extra: Extra) -> None:
    """Run a command, and print and write its report."""
    from guise.app.meshes.context import RunContext
    from guise.common.files import write_json
    from guise.common.threads import one_thread

    with Stages(console) as stages, one_thread():
        done = do(RunContext(extra.force, stages, console.note, extra.picture, extra.report))
    if extra.report is not None:
        write_json(extra.report, done.as_json())
    for line in done.lines():
        console.say(line)
    console.result(done.as_json())
