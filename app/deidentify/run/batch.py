"""Many files: each on its own, several at a time where the engine allows; a bad one does not stop the others."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.report.page import write_batch_page
from guise.app.deidentify.report.report import (
    FAILED,
    NOT_VERIFIED,
    VERIFIED,
    BatchEntry,
    outcome,
    verdict,
    write_batch,
)
from guise.app.deidentify.run import remote
from guise.app.deidentify.run.engines import JobEngine
from guise.app.deidentify.run.inputs import FilePair, is_there, short
from guise.app.deidentify.run.job import deidentify_file, work_folder
from guise.app.deidentify.run.results import beside
from guise.app.media.errors import UnreadableError
from guise.common.failures import USER_MISTAKE, explain, trace
from guise.common.progress import Progress

COPYING = "copying"
UNREAD = USER_MISTAKE  # code of a file that could not be read at all
SUMMARY_NAME = "deidentify-%Y%m%d-%H%M%S"


class BatchObserver(Protocol):
    """Is notified of the progress of a batch, from several threads at once."""

    def file(self, name: str) -> Progress:
        """A file has begun; returns what is called with its stage and the share of it that is done."""

    def note(self, text: str) -> None:
        """A remark for the user."""

    def finished(self, entry: BatchEntry) -> None:
        """A file is done, or has failed."""


@dataclass(frozen=True)
class BatchRun:
    """How all files are processed.

    Parameters
    ----------
    options : what is requested.   engine : what runs the jobs.
    resume, force, review, tracks : as in `deidentify_file`; with `resume`, files that have an output are skipped.
    """

    options: DeidentifyOptions
    engine: JobEngine
    resume: bool = False
    force: bool = False
    review: bool = False
    tracks: Path | None = None

    def at_once(self, files: int) -> int:
        """How many files are processed at the same time: one, where each may change the key file for the next."""
        return 1 if self.options.keyfile else max(1, min(files, self.engine.workers))


def run_batch(pairs: Sequence[FilePair], run: BatchRun, observer: BatchObserver) -> list[BatchEntry]:
    """De-identify all files; the outcome of each, in their order.

    An interruption stops the jobs at once and is raised; finished files stay.
    """

    def one(pair: FilePair) -> BatchEntry:
        return _earlier_result(pair) if run.resume and _is_done(pair) else _one(pair, run, observer)

    return run_all(
        pairs, one, observer, code_of=_failure, count=run.at_once(len(pairs)), stop=run.engine.close
    )


def run_all(
    pairs: Sequence[FilePair], work: Callable[[FilePair], BatchEntry], observer: BatchObserver,
    *, code_of: Callable[[Exception, FilePair], int], count: int = 1, stop: Callable[[], None] | None = None,
) -> list[BatchEntry]:  # fmt: skip
    """Work on all files, `count` at a time; the outcome of each, in their order.  A bad one does not stop the others.

    code_of : the code of a file that failed.   stop : called at an interruption, which is raised.
    """
    stopped = threading.Event()

    def process(pair: FilePair) -> BatchEntry:
        entry = _attempt(pair, work, code_of)
        if not stopped.is_set():
            observer.finished(entry)
        return entry

    if count == 1:
        return [process(pair) for pair in pairs]
    with ThreadPoolExecutor(count, "guise-file") as files:
        try:
            return list(files.map(process, pairs))
        except BaseException:
            stopped.set()
            files.shutdown(wait=False, cancel_futures=True)
            if stop is not None:
                stop()
            raise


def exit_code(entries: Sequence[BatchEntry]) -> int:
    """1 when a file has failed, else 3 when one is not verified, else 0; 2 when the only file could not be read."""
    codes = {entry.code for entry in entries}
    if codes <= {VERIFIED, NOT_VERIFIED}:
        return max(codes, default=VERIFIED)
    return UNREAD if codes == {UNREAD} else FAILED


def write_summary(pairs: Sequence[FilePair], entries: Sequence[BatchEntry]) -> str:
    """Write the outcomes of all files, as JSON and as a page, where all outputs are; returns the name of the page."""
    name = time.strftime(SUMMARY_NAME)
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


def _attempt(
    pair: FilePair,
    work: Callable[[FilePair], BatchEntry],
    code_of: Callable[[Exception, FilePair], int],
) -> BatchEntry:
    try:
        return work(pair)
    except Exception as error:
        trace(error)
        return BatchEntry(pair.name, None, code_of(error, pair), _why_failed(error, pair), {})


def _failure(error: Exception, pair: FilePair) -> int:
    """Whether a file could not be read at all, or failed later."""
    missing = isinstance(error, remote.RemoteError) and not pair.input.exists()
    unread = isinstance(error, UnreadableError) and not _work_of(pair).exists()
    return UNREAD if missing or unread else FAILED


def _why_failed(error: Exception, pair: FilePair) -> str:
    """A sentence that names the input and says when the work can be resumed."""
    sentence = with_names(explain(error)[0], pair)
    if Path(pair.name).name not in sentence:
        sentence = f"{pair.name}: {sentence}"
    if _work_of(pair).exists() and "--resume" not in sentence and "--force" not in sentence:
        sentence = f"{sentence.rstrip('.')}; finished work is kept for --resume"
    return sentence


def with_names(text: str, pair: FilePair) -> str:
    """A text with the paths as the user gave them."""
    for path, name in ((pair.output, pair.shown_output), (pair.input, pair.name)):
        text = text.replace(str(path), name)
    return text.replace(f"{Path.cwd()}{os.sep}", "")


def _one(pair: FilePair, run: BatchRun, observer: BatchObserver) -> BatchEntry:
    """Download the input if needed, de-identify it, upload the output if needed, and clean up."""
    progress = observer.file(pair.name)
    entry = _earlier_output(pair) if run.resume and pair.put else None
    if entry is None:
        prepare(pair, progress, resume=run.resume)
        report = deidentify_file(
            pair.input, pair.output, run.options, run.engine, resume=run.resume, force=run.force, review=run.review,
            tracks=run.tracks, progress=progress, say=lambda text: observer.note(with_names(text, pair)),
        )  # fmt: skip
        if report is None:  # stopped for a review
            return BatchEntry(pair.name, None, VERIFIED, "The tracks are ready to be reviewed.", {})
        entry = BatchEntry(
            pair.name, pair.shown_output, outcome(report), verdict(report), report.counts, _page_of(pair)
        )
    clean_up(pair, progress)
    return entry


def prepare(pair: FilePair, progress: Progress, *, resume: bool = False) -> None:
    """Make the folders, and download the input if needed.   resume : use what an earlier run has downloaded."""
    if pair.put:
        _make_private(pair.output.parent)
    pair.output.parent.mkdir(parents=True, exist_ok=True)
    if pair.fetch and not (resume and pair.input.exists()):
        progress(COPYING, 0.0)
        _make_private(pair.input.parent)
        remote.fetch(pair.fetch, pair.input)


def clean_up(pair: FilePair, progress: Progress) -> None:
    """Upload the output if needed, and delete copies of remote files."""
    if pair.put:
        progress(COPYING, 0.0)
        _send(pair)
    if pair.fetch:
        _remove_copy(pair.input.parent)


def _is_done(pair: FilePair) -> bool:
    """Whether the output is there, and its reports are, too."""
    return is_there(pair) and not _work_of(pair).exists()


def _work_of(pair: FilePair) -> Path:
    return work_folder(pair.output)


def _earlier_result(pair: FilePair) -> BatchEntry:
    """The entry of a file that an earlier run finished, from its report."""
    path = beside(pair.output, ".report.json")
    if not pair.put:
        return _entry_from(pair, path.read_bytes() if path.exists() else None)
    url = remote.join(remote.folder_of(pair.put), path.name)
    return _entry_from(pair, remote.read(url) if remote.exists(url) else None)


def _earlier_output(pair: FilePair) -> BatchEntry | None:
    """The entry of an output that an earlier run made and that only has to be uploaded, if there is one."""
    path = beside(pair.output, ".report.json")
    made = pair.output.exists() and path.exists() and not _work_of(pair).exists()
    return _entry_from(pair, path.read_bytes()) if made else None


def _entry_from(pair: FilePair, report: bytes | None) -> BatchEntry:
    if report is None:
        sentence = "It existed already, without a report."
        return BatchEntry(pair.name, pair.shown_output, VERIFIED, sentence, {})
    known = json.loads(report)
    return BatchEntry(
        pair.name, pair.shown_output, known["outcome"], known["sentence"], known["counts"], _page_of(pair)
    )


def _page_of(pair: FilePair) -> str:
    """The name of the page of a file's report, as the user gave that of the output."""
    return pair.shown_output.removesuffix(pair.output.name) + beside(pair.output, ".report.html").name


def _send(pair: FilePair) -> None:
    """Upload the output and its reports, the output last: where it is, the others are too."""
    made = sorted(pair.output.parent.iterdir(), key=lambda path: path == pair.output)
    for path in made:
        remote.put(path, remote.join(remote.folder_of(pair.put), path.name))
    _remove_copy(pair.output.parent)


def _make_private(folder: Path) -> None:
    """Make a folder that only its owner can read."""
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)


def _remove_copy(folder: Path) -> None:
    """Delete a copy, and the folder of copies when it was the last."""
    shutil.rmtree(folder, ignore_errors=True)
    with contextlib.suppress(OSError):
        folder.parent.rmdir()
