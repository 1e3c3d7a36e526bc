"""Several files in one command: what is shown of them, and the swaps of `guise swap`."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from guise.app.cli.console import Board, Console

if TYPE_CHECKING:
    from guise.app.deidentify.report.report import BatchEntry
    from guise.app.deidentify.run.inputs import FilePair
    from guise.app.swapping.report import SwapReport, SwapSettings
    from guise.common.progress import Progress

Swap = Callable[[Path, Path, "SwapSettings"], "SwapReport"]  # of an input to an output


def swap_each(
    console: Console, inputs: Sequence[str], output: str, swap: Swap, settings: SwapSettings, *, each: bool
) -> int:
    """Swap several inputs, each to an output of its own, in the way of `guise deidentify`; the exit code.

    output : the output of a single input, such as a URL, or a folder.   each : every image is an input of its own.
    """
    from guise.app.deidentify.report.report import BatchEntry
    from guise.app.deidentify.run.batch import clean_up, prepare, run_all, with_names
    from guise.app.deidentify.run.inputs import SWAP, make_plan, require_possible
    from guise.app.media.stream_copies import suffix_for
    from guise.common.errors import Interrupted
    from guise.common.failures import FAULT, USER_MISTAKE, explain

    def one(pair: FilePair) -> BatchEntry:
        progress = observer.file(pair.name)
        prepare(pair, progress)
        told = replace(settings, progress=progress, say=lambda text: observer.note(with_names(text, pair)))
        report = swap(pair.input, pair.output, told)
        clean_up(pair, progress)
        counts = {name: getattr(report, name) for name in ("swapped", "held", "covered", "lost")}
        return BatchEntry(pair.name, pair.shown_output, 0, summary(report, "swapped"), counts)

    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="guise-") as copies:
        encoder = settings.encode.encoder
        plan = make_plan(
            inputs, output, Path(copies), lambda path: suffix_for(path, encoder), recursive=False, each=each,
            purpose=SWAP,
        )  # fmt: skip
        for note in plan.notes:
            console.note(note)
        require_possible(plan.pairs, force=settings.force, purpose=SWAP)
        with Board(console, len(plan.pairs)) as board:
            observer = ConsoleObserver(console, board, len(plan.pairs))
            try:
                entries = run_all(plan.pairs, one, observer, code_of=lambda error, pair: explain(error)[1])
            except KeyboardInterrupt:
                raise Interrupted("interrupted; finished files are kept") from None
    code = next((code for code in (FAULT, USER_MISTAKE) if any(e.code == code for e in entries)), 0)
    if len(entries) > 1:
        failed = sum(entry.code != 0 for entry in entries)
        console.say(f"{len(entries)} files: {len(entries) - failed} swapped, {failed} failed")
    seconds = round(time.perf_counter() - start, 3)
    console.result(
        {
            "code": code,
            "seconds": seconds,
            "files": [{k: v for k, v in vars(entry).items() if k != "report"} for entry in entries],
        }
    )
    return code


def summary(report: SwapReport, word: str) -> str:
    """What was done to a file, in a line.   word : what was done to most frames."""
    people = getattr(report, "people", ())
    if people and report.frames == 1:
        faces = f"{len(people)} face" + "s" * (len(people) > 1)
        return f"{sum(one.swapped for one in people)} of {faces} {word}; {report.seconds:.1f} s"
    covered = f"{report.covered} covered, " if report.covered else ""
    untouched = f", {report.untouched} untouched" if report.untouched else ""
    return (
        f"{report.swapped} of {report.frames} frames {word}, {report.held} held, {covered}"
        f"{report.lost} lost{untouched}; {report.seconds:.1f} s, {report.frames_per_second:.1f} frames per second"
    )


class ConsoleObserver:
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
                report = f" Report: {entry.report}" if entry.report else ""
                self._console.say(f"{place}{entry.output or entry.input}: {entry.sentence}{report}")
