"""Many files: each on its own, several at a time where the engine can; a bad one does not stop the others."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from guise.app.deidentify.options import Options
from guise.app.deidentify.report.page import write_batch_page
from guise.app.deidentify.report.report import (
    ALL_SWAPPED,
    FAILED,
    SOME_COVERED,
    BatchEntry,
    outcome,
    verdict,
    write_batch,
)
from guise.app.deidentify.run import remote
from guise.app.deidentify.run.engines import JobEngine
from guise.app.deidentify.run.inputs import Pair, is_there, short
from guise.app.deidentify.run.job import beside, deidentify_file
from guise.common.failures import explain, trace
from guise.common.progress import Progress

COPYING = "copying"
SUMMARY = "deidentify-%Y%m%d-%H%M%S"


class Watch(Protocol):
    """Whoever is told how far a batch is; from several threads at once."""

    def file(self, name: str) -> Progress:
        """A file has begun: what is to be called with its stage and the share of it that is done."""

    def note(self, text: str) -> None:
        """Something to know."""

    def finished(self, entry: BatchEntry) -> None:
        """A file is done, or has failed."""


@dataclass(frozen=True)
class Run:
    """How all files are done.

    Parameters
    ----------
    options : what is asked for.   engine : who does it.
    resume, force, review, tracks : as in `deidentify_file`; with `resume`, files with an output are left as they are.
    """

    options: Options
    engine: JobEngine
    resume: bool = False
    force: bool = False
    review: bool = False
    tracks: Path | None = None

    def at_once(self, files: int) -> int:
        """How many files are done at the same time: one, where each may change the key file for the next."""
        return 1 if self.options.keyfile else max(1, min(files, self.engine.workers))


def run_batch(pairs: Sequence[Pair], run: Run, watch: Watch) -> list[BatchEntry]:
    """De-identify all files; what became of each, in their order.

    An interruption ends the jobs at once and comes through; finished files stay.
    """

    stopped = threading.Event()

    def one(pair: Pair) -> BatchEntry:
        entry = _attempt(pair, run, watch)
        if not stopped.is_set():
            watch.finished(entry)
        return entry

    count = run.at_once(len(pairs))
    if count == 1:
        return [one(pair) for pair in pairs]
    with ThreadPoolExecutor(count, "guise-file") as files:
        try:
            return list(files.map(one, pairs))
        except BaseException:
            stopped.set()
            files.shutdown(wait=False, cancel_futures=True)
            run.engine.close()
            raise


def exit_code(entries: Sequence[BatchEntry]) -> int:
    """1 when a file has failed, else 3 when a face was covered, else 0."""
    codes = {entry.code for entry in entries}
    if codes <= {ALL_SWAPPED, SOME_COVERED}:
        return max(codes, default=ALL_SWAPPED)
    return FAILED


def write_summary(pairs: Sequence[Pair], entries: Sequence[BatchEntry]) -> str:
    """Write what became of all files, as JSON and as a page, into the folder that holds all outputs; names the page."""
    name = time.strftime(SUMMARY)
    local = [str(pair.output.parent) for pair in pairs if not pair.put]
    if local:
        return short(_write_summary(Path(os.path.commonpath(local)), name, entries))
    folder = remote.common_folder([pair.put for pair in pairs])
    with tempfile.TemporaryDirectory() as here:
        page = _write_summary(Path(here), name, entries)
        for path in (page, page.with_suffix(".json")):
            remote.put(path, remote.join(folder, path.name))
    return remote.join(folder, page.name)


def _write_summary(folder: Path, name: str, entries: Sequence[BatchEntry]) -> Path:
    write_batch(folder / f"{name}.report.json", entries)
    page = folder / f"{name}.report.html"
    write_batch_page(page, entries)
    return page


def _attempt(pair: Pair, run: Run, watch: Watch) -> BatchEntry:
    try:
        return _done_before(pair) if run.resume and _is_done(pair) else _one(pair, run, watch)
    except Exception as error:
        trace(error)
        return BatchEntry(pair.name, None, FAILED, _why_failed(error, pair), {})


def _why_failed(error: Exception, pair: Pair) -> str:
    """A sentence with the input's name in it, which also says when the work can be resumed."""
    sentence = _with_names(explain(error)[0], pair)
    if Path(pair.name).name not in sentence:
        sentence = f"{pair.name}: {sentence}"
    if _work_of(pair).exists() and "--resume" not in sentence and "--force" not in sentence:
        sentence = f"{sentence.rstrip('.')}; what is done is kept for --resume"
    return sentence


def _with_names(text: str, pair: Pair) -> str:
    """A text with the names that the user knows."""
    for path, name in ((pair.output, pair.shown_output), (pair.source, pair.name)):
        text = text.replace(str(path), name)
    return text.replace(f"{Path.cwd()}{os.sep}", "")


def _one(pair: Pair, run: Run, watch: Watch) -> BatchEntry:
    """Copy the input here when it is elsewhere, de-identify it, copy the output there, and clear up."""
    progress = watch.file(pair.name)
    entry = _made_before(pair) if run.resume and pair.put else None
    if entry is None:
        _prepare(pair, run, progress)
        report = deidentify_file(
            pair.source, pair.output, run.options, run.engine, resume=run.resume, force=run.force, review=run.review,
            tracks=run.tracks, progress=progress, say=lambda text: watch.note(_with_names(text, pair)),
        )  # fmt: skip
        if report is None:  # stopped for a review
            return BatchEntry(pair.name, None, ALL_SWAPPED, "The tracks are ready to be reviewed.", {})
        entry = BatchEntry(pair.name, pair.shown_output, outcome(report), verdict(report), report.counts)
    if pair.put:
        progress(COPYING, 0.0)
        _send(pair)
    if pair.fetch:
        _clear(pair.source.parent)
    return entry


def _prepare(pair: Pair, run: Run, progress: Progress) -> None:
    """Make the folders, and copy the input here when it is elsewhere."""
    if pair.put:
        _make_private(pair.output.parent)
    pair.output.parent.mkdir(parents=True, exist_ok=True)
    if pair.fetch and not (run.resume and pair.source.exists()):
        progress(COPYING, 0.0)
        _make_private(pair.source.parent)
        remote.fetch(pair.fetch, pair.source)


def _is_done(pair: Pair) -> bool:
    """Whether the output is there, and its reports are, too."""
    return is_there(pair) and not _work_of(pair).exists()


def _work_of(pair: Pair) -> Path:
    return pair.output.with_name(pair.output.name + ".work")


def _done_before(pair: Pair) -> BatchEntry:
    """What an earlier run has told of a file in its report."""
    path = beside(pair.output, ".report.json")
    if not pair.put:
        return _retold(pair, path.read_bytes() if path.exists() else None)
    url = remote.join(remote.folder_of(pair.put), path.name)
    return _retold(pair, remote.read(url) if remote.exists(url) else None)


def _made_before(pair: Pair) -> BatchEntry | None:
    """What an earlier run has told of an output that has only to be copied to its URL, if there is one."""
    path = beside(pair.output, ".report.json")
    made = pair.output.exists() and path.exists() and not _work_of(pair).exists()
    return _retold(pair, path.read_bytes()) if made else None


def _retold(pair: Pair, report: bytes | None) -> BatchEntry:
    if report is None:
        said = "It was there already, without a report."
        return BatchEntry(pair.name, pair.shown_output, ALL_SWAPPED, said, {})
    told = json.loads(report)
    return BatchEntry(pair.name, pair.shown_output, told["outcome"], told["sentence"], told["counts"])


def _send(pair: Pair) -> None:
    """Copy the output and its reports to where they belong, the output last: where it is, all is."""
    made = sorted(pair.output.parent.iterdir(), key=lambda path: path == pair.output)
    for path in made:
        remote.put(path, remote.join(remote.folder_of(pair.put), path.name))
    _clear(pair.output.parent)


def _make_private(folder: Path) -> None:
    """Make a folder that only its owner can read."""
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)


def _clear(folder: Path) -> None:
    """Delete a copy, and the folder of copies when it was the last."""
    shutil.rmtree(folder, ignore_errors=True)
    with contextlib.suppress(OSError):
        folder.parent.rmdir()
