"""The command `guise deidentify`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.batches import ConsoleObserver
from guise.app.cli.console import Board, Console
from guise.app.cli.options import Encode, Force, Part, Shown, takes
from guise.app.deidentify.options import DeidentifyOptions

if TYPE_CHECKING:
    from guise.app.deidentify.report.report import BatchEntry
    from guise.app.deidentify.run.batch import BatchRun
    from guise.app.deidentify.run.inputs import FilePair
    from guise.app.studio.site import Studio

WORK = "guise-work"
OPTIONS = (
    "donor", "gallery", "cover", "cover_strength", "region", "own_glasses", "alpha", "renderer", "seed", "keyfile",
    "audio", "keep_metadata", "label", "audit", "detector", "start", "end", "outside",
)  # fmt: skip


Inputs = Annotated[
    list[str],
    typer.Argument(metavar="INPUT...", help="Videos, images, folders, patterns in quotes, or URLs."),
]
Output = Annotated[
    str | None,
    typer.Option(
        "--output",
        "-o",
        metavar="OUT|DIR",
        help="The output of a single input, or a folder for all; default: beside each input, as "
        "NAME_deidentified.",
    ),
]
Recursive = Annotated[bool, typer.Option("--recursive", help="Include the subfolders of folders.")]
Review = Annotated[
    bool,
    typer.Option(
        "--review",
        help="Stop before rendering, and write NAME.tracks.json to edit and NAME.tracks.jpg to look at.",
    ),
]
Open = Annotated[
    bool, typer.Option("--open", help="With --review: open the studio on what was found, to decide there.")
]
Tracks = Annotated[
    Path | None, typer.Option(metavar="NAME.tracks.json", help="The edited tracks of a review.")
]
Resume = Annotated[
    bool,
    typer.Option("--resume", help="Continue where an earlier run stopped; finished files are skipped."),
]
EngineName = Annotated[
    str,
    typer.Option(metavar="local|dask:ADDRESS", help="What runs the jobs: this machine or a Dask cluster."),
]
Workers = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Processes of the local engine; default: half as many as cores."),
]
WorkFolder = Annotated[
    Path,
    typer.Option(metavar="DIR", help="Folder for temporary copies of remote files."),
]
C2pa = Annotated[
    tuple[Path, Path] | None,
    typer.Option("--c2pa", metavar="CERT KEY", help="Sign the output with a C2PA manifest; PEM files."),
]


@takes
def deidentify(
    inputs: Inputs,
    *,
    output: Output = None,
    recursive: Recursive = False,
    options: Annotated[DeidentifyOptions, Part(DeidentifyOptions, OPTIONS)],
    c2pa: C2pa = None,
    review: Review = False,
    open: Open = False,
    tracks: Tracks = None,
    resume: Resume = False,
    engine: EngineName = "local",
    workers: Workers = None,
    work: WorkFolder = Path(WORK),
    encoding: Encode,
    force: Force = False,
    console: Shown,
) -> int:
    """Swap or cover every face in videos and images, and report what was done in each frame."""
    from guise.app.deidentify.run.batch import BatchRun
    from guise.app.deidentify.run.checks import checked
    from guise.app.deidentify.run.inputs import make_plan, require_possible
    from guise.app.deidentify.run.registry import open_engine
    from guise.app.media.stream_copies import suffix_for

    certificate, key = c2pa or (None, None)
    options = replace(options, certificate=certificate, key=key, encode=encoding.options())
    plan = make_plan(
        inputs, output, work, lambda path: suffix_for(path, encoding.encoder), recursive=recursive
    )
    _check_tracks(tracks, review, plan.pairs)
    _check_open(open, review, plan.pairs)
    options = checked(options, [pair.output for pair in plan.pairs])
    for note in plan.notes:
        console.note(note)
    require_possible(plan.pairs, force=force, resume=resume)
    with open_engine(engine, workers) as opened:
        code = _run(console, plan.pairs, BatchRun(options, opened, resume, force, review, tracks))
    if open and not code:
        _open_studio(console, plan.pairs[0])
    return code


def _check_open(open: bool, review: bool, pairs: Sequence[FilePair]) -> None:
    if open and not (review and len(pairs) == 1 and not pairs[0].fetch):
        raise typer.BadParameter("--open goes with --review and a single video of this computer")


def _open_studio(console: Console, pair: FilePair) -> None:
    """Have the user decide in the browser; what they say is also in the file of tracks."""
    from guise.app.cli.studio import run_studio

    def begin(studio: Studio) -> str:
        from guise.app.studio.deidentify import begin_reviewed

        return begin_reviewed(studio, pair.input, pair.output)

    run_studio(console, 0, begin=begin)


def _check_tracks(tracks: Path | None, review: bool, pairs: Sequence[FilePair]) -> None:
    if tracks is not None and review:
        raise typer.BadParameter("--review writes the file that --tracks reads: give one of them")
    if tracks is not None and len(pairs) > 1:
        raise typer.BadParameter(
            f"--tracks is for one input, got {len(pairs)}: with --resume, edited files beside the outputs are found"
        )


def _run(console: Console, pairs: Sequence[FilePair], run: BatchRun) -> int:
    from guise.app.deidentify.run.batch import exit_code, run_batch
    from guise.common.errors import Interrupted

    start = time.perf_counter()
    with Board(console, len(pairs)) as board:
        try:
            entries = run_batch(pairs, run, ConsoleObserver(console, board, len(pairs)))
        except KeyboardInterrupt:
            raise Interrupted("interrupted; finished work is kept: continue with --resume") from None
    facts = {
        "code": exit_code(entries),
        "seconds": round(time.perf_counter() - start, 3),
        "files": [vars(entry) for entry in entries],
    }
    if len(entries) > 1 and not run.review:
        facts["report"] = _summarise(console, entries, pairs)
    console.result(facts)
    return exit_code(entries)


def _summarise(console: Console, entries: Sequence[BatchEntry], pairs: Sequence[FilePair]) -> str:
    """Report the outcomes of all files, and write the summary."""
    from guise.app.deidentify.report.report import KINDS, kind
    from guise.app.deidentify.run.batch import write_summary

    page = write_summary(pairs, entries)
    kinds = [kind(entry) for entry in entries]
    swapped, covered, unverified, failed = (kinds.count(name) for name in KINDS)
    console.say(
        f"{len(kinds)} files: {swapped} swapped, {covered} with covered faces, {unverified} not verified, "
        f"{failed} failed; see {page}"
    )
    return page
