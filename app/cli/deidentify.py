"""The command `guise deidentify`."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.console import Board, Console
from guise.app.cli.options import (
    Alpha,
    Crf,
    Encoder,
    Force,
    Json,
    Lossless,
    Preset,
    Quiet,
    RendererChoice,
    RendererName,
)

if TYPE_CHECKING:
    from guise.app.deidentify.report.report import BatchEntry
    from guise.app.deidentify.run.batch import Run
    from guise.app.deidentify.run.inputs import Pair
    from guise.common.progress import Progress

WORK = "guise-work"


class CoverName(StrEnum):
    """How a face that is not swapped is covered."""

    solid = "solid"
    mosaic = "mosaic"
    blur = "blur"


class AudioName(StrEnum):
    """What happens to the sound."""

    keep = "keep"
    drop = "drop"
    mask = "mask"


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
Recursive = Annotated[bool, typer.Option("--recursive", help="Folders with all that is below them.")]
Donor = Annotated[
    str,
    typer.Option(
        metavar="auto|NAME.guise|mean:K",
        help="Whose faces are shown: fictional people, each person another; one model for all; or averages of K.",
    ),
]
Gallery = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="NAME.guise", help="A donor of your own, instead of those of Guise; may be repeated."
    ),
]
Cover = Annotated[CoverName, typer.Option(help="How a face that is not swapped is covered.")]
Review = Annotated[
    bool,
    typer.Option(
        "--review",
        help="Stop before anything is changed, and write NAME.tracks.json to edit and NAME.tracks.jpg to look at.",
    ),
]
Tracks = Annotated[
    Path | None, typer.Option(metavar="NAME.tracks.json", help="The edited tracks of a review.")
]
Resume = Annotated[
    bool,
    typer.Option("--resume", help="Go on where an earlier run stopped; finished files are left as they are."),
]
EngineName = Annotated[
    str,
    typer.Option(metavar="local|dask:ADDRESS", help="What does the work: this machine or a Dask cluster."),
]
Workers = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Processes of the local engine; default: half as many as cores."),
]
Work = Annotated[
    Path,
    typer.Option(metavar="DIR", help="Where copies of what comes from or goes to a URL lie meanwhile."),
]
Seed = Annotated[int, typer.Option(help="Of the choice of donors.")]
KeyFileOption = Annotated[
    Path | None,
    typer.Option(
        "--keyfile",
        metavar="FILE",
        help="Remember people and their donors here, so that they keep them in other files.",
    ),
]
Audio = Annotated[AudioName, typer.Option(help="Keep the sound, drop it, or disguise the voices.")]
KeepMetadata = Annotated[
    bool,
    typer.Option(
        "--keep-metadata", help="Keep place, device, author, times, comments and other data streams."
    ),
]
LabelOption = Annotated[bool, typer.Option("--label", help="Draw a visible label.")]
C2pa = Annotated[
    tuple[Path, Path] | None,
    typer.Option("--c2pa", metavar="CERT KEY", help="Sign the output with a C2PA manifest; PEM files."),
]


def deidentify(
    inputs: Inputs,
    output: Output = None,
    recursive: Recursive = False,
    donor: Donor = "auto",
    gallery: Gallery = None,
    cover: Cover = CoverName.solid,
    alpha: Alpha = 1.0,
    review: Review = False,
    tracks: Tracks = None,
    resume: Resume = False,
    engine: EngineName = "local",
    workers: Workers = None,
    work: Work = Path(WORK),
    seed: Seed = 0,
    keyfile: KeyFileOption = None,
    audio: Audio = AudioName.keep,
    keep_metadata: KeepMetadata = False,
    label: LabelOption = False,
    c2pa: C2pa = None,
    encoder: Encoder = "libx264",
    crf: Crf = 20,
    preset: Preset = "veryfast",
    lossless: Lossless = False,
    renderer: RendererChoice = RendererName.auto,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Swap or cover every face in videos and images, and report what was done in each frame."""
    from guise.app.deidentify.options import Options
    from guise.app.deidentify.run.batch import Run
    from guise.app.deidentify.run.checks import checked
    from guise.app.deidentify.run.inputs import make_plan, require_possible
    from guise.app.deidentify.run.registry import open_engine
    from guise.app.media import EncodeOptions
    from guise.app.media.containers import suffix_for

    console = Console(quiet=quiet, json=json)
    certificate, key = c2pa or (None, None)
    options = Options(
        donor, tuple(gallery or ()), cover.value, alpha, seed, keyfile, audio.value, keep_metadata, label, certificate,
        key, EncodeOptions(encoder, crf, preset, lossless), renderer.value,
    )  # fmt: skip
    plan = make_plan(inputs, output, work, lambda path: suffix_for(path, encoder), recursive=recursive)
    _check_tracks(tracks, review, plan.pairs)
    options = checked(options, [pair.output for pair in plan.pairs])
    for note in plan.notes:
        console.note(note)
    require_possible(plan.pairs, force=force, resume=resume)
    with open_engine(engine, workers) as opened:
        return _run(console, plan.pairs, Run(options, opened, resume, force, review, tracks))


def _check_tracks(tracks: Path | None, review: bool, pairs: Sequence[Pair]) -> None:
    if tracks is not None and review:
        raise typer.BadParameter("--review writes the file that --tracks reads: give one of them")
    if tracks is not None and len(pairs) > 1:
        raise typer.BadParameter(
            f"--tracks is for one input, got {len(pairs)}: edited files beside the outputs are found with --resume"
        )


def _run(console: Console, pairs: Sequence[Pair], run: Run) -> int:
    from guise.app.deidentify.run.batch import exit_code, run_batch
    from guise.common.errors import Interrupted

    start = time.perf_counter()
    with Board(console, len(pairs)) as board:
        try:
            entries = run_batch(pairs, run, _Watch(console, board, len(pairs)))
        except KeyboardInterrupt:
            raise Interrupted("interrupted; what is done is kept: go on with --resume") from None
    facts = {
        "code": exit_code(entries),
        "seconds": round(time.perf_counter() - start, 3),
        "files": [vars(entry) for entry in entries],
    }
    if len(entries) > 1 and not run.review:
        facts["report"] = _summarise(console, entries, pairs)
    console.result(facts)
    return exit_code(entries)


def _summarise(console: Console, entries: Sequence[BatchEntry], pairs: Sequence[Pair]) -> str:
    """Say and write what became of all files."""
    from guise.app.deidentify.report.report import ALL_SWAPPED, SOME_COVERED
    from guise.app.deidentify.run.batch import write_summary

    page = write_summary(pairs, entries)
    codes = [entry.code for entry in entries]
    swapped, covered = codes.count(ALL_SWAPPED), codes.count(SOME_COVERED)
    failed = len(codes) - swapped - covered
    console.say(
        f"{len(codes)} files: {swapped} swapped, {covered} with covered faces, {failed} failed; see {page}"
    )
    return page


class _Watch:
    """Shows how far a batch is, and says what becomes of each file."""

    def __init__(self, console: Console, board: Board, total: int) -> None:
        self._console, self._board, self._total = console, board, total
        self._lock = threading.Lock()
        self._count = 0

    def file(self, name: str) -> Progress:
        """What is called with the stage of a file and the share of it that is done."""
        return lambda stage, share: self._board.show(name, stage, share)

    def note(self, text: str) -> None:
        """Say something to know."""
        self._console.note(text)

    def finished(self, entry: BatchEntry) -> None:
        """Say what became of a file."""
        with self._lock:
            self._count += 1
            self._board.finished(entry.input, self._count)
            place = f"[{self._count}/{self._total}] " if self._total > 1 else ""
            if entry.output is None and entry.code:
                self._console.error(f"{place}{entry.sentence}")
            else:
                self._console.say(f"{place}{entry.output or entry.input}: {entry.sentence}")
