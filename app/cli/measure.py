"""The command `guise measure`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from guise.app.cli.console import Console, Stages
from guise.app.cli.options import Force, Part, Shown, takes
from guise.app.measure.options import MeasureOptions

Original = Annotated[
    Path, typer.Argument(metavar="ORIGINAL", help="The original video; with --attack a folder of people.")
]
Outputs = Annotated[
    list[Path], typer.Argument(metavar="OUTPUT...", help="The same video, de-identified by any tool.")
]
Attack = Annotated[
    bool,
    typer.Option(
        "--attack",
        help="Attack folders of people: attackers that know other pictures of them, and learn, try to find them.",
    ),
]
Figures = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="OUT.json", help="Write all figures here.")
]
Plot = Annotated[
    Path | None,
    typer.Option(metavar="OUT.png", help="Plot similarities and expressions here (extra: plots)."),
]


@takes
def measure(
    *,
    original: Original,
    outputs: Outputs,
    attack: Attack = False,
    options: Annotated[MeasureOptions, Part(MeasureOptions)],
    output: Figures = None,
    plot: Plot = None,
    force: Force = False,
    console: Shown,
) -> None:
    """Measure how private and how useful a de-identified video is, against its original."""
    from guise.common.files import require_free

    for path in filter(None, (output, plot)):
        require_free(path, force=force)
    if attack:
        _refuse_beside_attack(
            distractors=options.gallery, identity=options.identities, output_report=options.reports,
            landmarks=options.landmarks, plot=plot,
        )  # fmt: skip
        _attack(console, original, outputs, options, output)
    else:
        _measure(console, original, outputs, options, output, plot)


def _measure(
    console: Console, original: Path, outputs: list[Path], options: MeasureOptions, output: Path | None,
    plot: Path | None,
) -> None:  # fmt: skip
    from guise.app.measure.job import measure
    from guise.app.measure.table import FIRST_HEADING, rows_of

    if plot is not None:
        from guise.app.measure.plot import draw, require_plots

        require_plots(plot)
    with Stages(console) as stages:
        result = measure(original, outputs, options, progress=stages, say=console.note)
    facts = result.as_json()
    _write(output, facts)
    if plot is not None:
        draw(result, plot)
    console.grid(result.original, [FIRST_HEADING, *(one.name for one in result.outputs)], rows_of(result))
    for path in filter(None, (output, plot)):
        console.say(f"written: {path}")
    console.result(facts)


def _refuse_beside_attack(**others: object) -> None:
    """Refuse options that an attack does not know."""
    given = [name for name, value in others.items() if value]
    if given:
        raise typer.BadParameter(
            f"--attack does not take --{given[0].replace('_', '-')}: leave one of them out"
        )


def _attack(
    console: Console, original: Path, outputs: list[Path], options: MeasureOptions, output: Path | None
) -> None:
    from guise.app.measure.attack import AttackRequest, attack
    from guise.app.measure.table import (
        RANK_HEADINGS,
        SIMILARITY_HEADINGS,
        rank_rows,
        similarity_rows,
        worst_sentence,
    )

    request = AttackRequest(original, outputs, options.recognisers, options.landmarker)
    with Stages(console) as stages:
        result = attack(request, progress=stages, say=console.note)
    facts = result.as_json()
    _write(output, facts)
    for one in result.outputs:
        console.grid(one.name, list(RANK_HEADINGS), rank_rows(one))
        console.grid("", list(SIMILARITY_HEADINGS), similarity_rows(one))
        console.say(worst_sentence(result, one))
    if output is not None:
        console.say(f"written: {output}")
    console.result(facts)


def _write(output: Path | None, facts: Mapping[str, Any]) -> None:
    """Write all figures, if that was asked for."""
    from json import dumps

    from guise.common.files import write_whole

    if output is not None:
        write_whole(output, dumps(facts, indent=1, allow_nan=False) + "\n")
