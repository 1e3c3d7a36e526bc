"""The command `guise measure`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from guise.app.cli.console import Console, Stages
from guise.app.cli.options import Force, Json, LandmarkerSpec, Quiet


def measure(
    original: Annotated[Path, typer.Argument(metavar="ORIGINAL", help="The original video.")],
    outputs: Annotated[
        list[Path], typer.Argument(metavar="OUTPUT...", help="The same video, de-identified by any tool.")
    ],
    recogniser: Annotated[
        Path | None,
        typer.Option(metavar="CARD.toml", help="A face recogniser; without it only utility is measured."),
    ] = None,
    gallery: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Other people: a picture, a video or a folder of them for each."),
    ] = None,
    donor: Annotated[
        list[str] | None, typer.Option(metavar="NAME.guise", help="A donor whose face the outputs show.")
    ] = None,
    report: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="NAME.report.json",
            help="The report of an output by `guise deidentify`: what was done with each face.",
        ),
    ] = None,
    landmarks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Landmarks of ORIGINAL (.npz, .json, .pts); default: found by the landmarker.",
        ),
    ] = None,
    landmarker: LandmarkerSpec = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="OUT.json", help="Write all figures here.")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="OUT.png", help="Plot similarities and expressions here (extra: plots)."),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Measure how private and how useful a de-identified video is, against its original."""
    from json import dumps

    from guise.app.measure import MeasureRequest
    from guise.app.measure import measure as run
    from guise.app.measure.table import FIRST_HEADING, rows_of
    from guise.common.files import require_free, write_whole

    console = Console(quiet=quiet, json=json)
    for path in filter(None, (output, plot)):
        require_free(path, force=force)
    if plot is not None:
        from guise.app.measure.plot import draw, require_plots

        require_plots(plot)
    request = MeasureRequest(
        original, outputs, landmarker or "builtin", landmarks, recogniser, gallery, donor or (), report or ()
    )
    with Stages(console) as stages:
        result = run(request, progress=stages, say=console.note)
    facts = result.as_json()
    if output is not None:
        text = dumps(facts, indent=1, allow_nan=False) + "\n"
        write_whole(output, text)
    if plot is not None:
        draw(result, plot)
    console.grid(result.original, [FIRST_HEADING, *(one.name for one in result.outputs)], rows_of(result))
    for path in filter(None, (output, plot)):
        console.say(f"written: {path}")
    console.result(facts)
