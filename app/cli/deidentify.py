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
    FACE_HELP,
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
    from guise.app.deidentify.run.batch import BatchRun
    from guise.app.deidentify.run.inputs import FilePair
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
    disguise = "disguise"


class RegionName(StrEnum):
    """What a swap replaces."""

    face = "face"
    head = "head"


class AuditName(StrEnum):
    """Which frames the audit searches."""

    sampled = "sampled"
    full = "full"


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
Identity = Annotated[
    str,
    typer.Option(
        "--identity",
        metavar="auto|same|average:K|mean:K|FACE",
        help="The faces that are shown: a different fictional one for each; the same, or the same average of K, for "
        f"all people of all files; a different average of K for each; or one for all: {FACE_HELP}.",
    ),
]
Gallery = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FACE", help="A face to choose from, instead of all fictional ones; may be repeated."
    ),
]
Cover = Annotated[CoverName, typer.Option(help="How a face that is not swapped is covered.")]
RegionOption = Annotated[
    RegionName,
    typer.Option("--region", help="What a swap replaces: the face, or the head with hair, ears and outline."),
]
Review = Annotated[
    bool,
    typer.Option(
        "--review",
        help="Stop before rendering, and write NAME.tracks.json to edit and NAME.tracks.jpg to look at.",
    ),
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
Seed = Annotated[int, typer.Option(help="Seed for the choice of donors.")]
KeyFileOption = Annotated[
    Path | None,
    typer.Option(
        "--keyfile",
        metavar="FILE",
        help="Remember people and their donors here, so that a person gets the same donor in other files.",
    ),
]
Audio = Annotated[
    AudioName, typer.Option(help="Keep the sound, drop it, lower the voices, or disguise them as a whisper.")
]
KeepMetadata = Annotated[
    bool,
    typer.Option(
        "--keep-metadata", help="Keep location, device, author, times, comments and other data streams."
    ),
]
LabelOption = Annotated[bool, typer.Option("--label", help="Draw a visible label.")]
AuditOption = Annotated[
    AuditName,
    typer.Option("--audit", help="Search some frames of the original and the output for faces, or all."),
]
AuditDetector = Annotated[
    str | None,
    typer.Option(
        "--detector", metavar="lbp|yunet:PATH", help="Face detector of the audit; default: the built-in one."
    ),
]
C2pa = Annotated[
    tuple[Path, Path] | None,
    typer.Option("--c2pa", metavar="CERT KEY", help="Sign the output with a C2PA manifest; PEM files."),
]


def deidentify(
    inputs: Inputs,
    output: Output = None,
    recursive: Recursive = False,
    identity: Identity = "auto",
    gallery: Gallery = None,
    cover: Cover = CoverName.solid,
    region: RegionOption = RegionName.face,
    alpha: Alpha = 0.3,
    review: Review = False,
    tracks: Tracks = None,
    resume: Resume = False,
    engine: EngineName = "local",
    workers: Workers = None,
    work: WorkFolder = Path(WORK),
    seed: Seed = 0,
    keyfile: KeyFileOption = None,
    audio: Audio = AudioName.keep,
    keep_metadata: KeepMetadata = False,
    label: LabelOption = False,
    c2pa: C2pa = None,
    audit: AuditOption = AuditName.sampled,
    detector: AuditDetector = None,
    encoder: Encoder = "libx264",
    crf: Crf = None,
    preset: Preset = "veryfast",
    lossless: Lossless = False,
    renderer: RendererChoice = RendererName.auto,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> int:
    """Swap or cover every face in videos and images, and report what was done in each frame."""
    from guise.app.deidentify.options import DeidentifyOptions
    from guise.app.deidentify.run.batch import BatchRun
    from guise.app.deidentify.run.checks import checked
    from guise.app.deidentify.run.inputs import make_plan, require_possible
    from guise.app.deidentify.run.registry import open_engine
    from guise.app.media import EncodeOptions
    from guise.app.media.stream_copies import suffix_for

    console = Console(quiet=quiet, json=json)
    certificate, key = c2pa or (None, None)
    options = DeidentifyOptions(
        identity, tuple(gallery or ()), cover.value, alpha, seed, keyfile, audio.value, keep_metadata, label,
        certificate, key, EncodeOptions(encoder, crf, preset, lossless), renderer.value, audit.value, detector,
        region.value,
    )  # fmt: skip
    plan = make_plan(inputs, output, work, lambda path: suffix_for(path, encoder), recursive=recursive)
    _check_tracks(tracks, review, plan.pairs)
    options = checked(options, [pair.output for pair in plan.pairs])
    for note in plan.notes:
        console.note(note)
    require_possible(plan.pairs, force=force, resume=resume)
    with open_engine(engine, workers) as opened:
        return _run(console, plan.pairs, BatchRun(options, opened, resume, force, review, tracks))


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
            entries = run_batch(pairs, run, _ConsoleObserver(console, board, len(pairs)))
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


class _ConsoleObserver:
    """Shows the progress of a batch and the outcome of each file."""

    def __init__(self, console: Console, board: Board, total: int) -> None:
        self._console, self._board, self._total = console, board, total
        self._lock = threading.Lock()
        self._count = 0

    def file(self, name: str) -> Progress:
        """Returns what is called with the stage of a file and the share of it that is done."""
        return lambda stage, share: self._board.show(name, stage, share)

    def note(self, text: str) -> None:
        """Print a remark."""
        self._console.note(text)

    def finished(self, entry: BatchEntry) -> None:
        """Print the outcome of a file."""
        with self._lock:
            self._count += 1
            self._board.finished(entry.input, self._count)
            place = f"[{self._count}/{self._total}] " if self._total > 1 else ""
            if entry.output is None and entry.code:
                self._console.error(f"{place}{entry.sentence}")
            else:
                self._console.say(f"{place}{entry.output or entry.input}: {entry.sentence}")
