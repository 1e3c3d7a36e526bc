"""Long-running work of the studio: jobs run one after the other, each in a process of its own.

A job outlives the page that started it.  A job that is interrupted by the end of the studio runs again from its
beginning when the studio is started the next time.
"""

from __future__ import annotations

import contextlib
import shutil
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from guise.app.studio.store import JobRow, Store, StudioError
from guise.common.failures import explain, trace
from guise.common.processes import ChildProcess
from guise.common.progress import Progress

JobFunction = Callable[[dict[str, Any], Path, Progress], dict[str, Any]]
Finish = Callable[[dict[str, Any], Path], None]

REPORT_SECONDS = 0.1  # between two reports of progress within a stage
TERMINATE_SECONDS = 2.0  # that a process gets to end before it is killed


class JobQueue:
    """Runs jobs in the order in which they were started, from `open` to `close`.

    Kinds are registered first.  A job's function is at the top level of a module; it is called in a new process as
    function(about, folder, progress) and returns the result; `about` and the result are JSON objects.  An exception
    becomes a sentence, in which files are called as in about["files"], by their paths.  What a job leaves outside its
    folder is put there by `finish`, which a cancelled job never comes to, however late it was cancelled.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self._functions: dict[str, JobFunction] = {}
        self._finish: dict[str, Finish] = {}
        self._change = threading.Condition()
        self._closed = False
        self._current: tuple[str, ChildProcess] | None = None
        self._thread = threading.Thread(target=self._work, name="studio jobs", daemon=True)

    def register(self, kind: str, function: JobFunction, finish: Finish | None = None) -> None:
        """Set the function that runs a kind of jobs, and what is called here as finish(about, folder) afterwards."""
        self._functions[kind] = function
        if finish is not None:
            self._finish[kind] = finish

    def open(self) -> None:
        """Start working, beginning with what was left undone."""
        for job in self.store.jobs():
            if job.state == "running":
                self.store.change_job(job.id, state="waiting")
        self._thread.start()

    def start(self, kind: str, about: dict[str, Any]) -> str:
        """Queue a job and return its id."""
        if kind not in self._functions:
            raise StudioError(f"there are no jobs of kind {kind}, only of {', '.join(self._functions)}")
        job = self.store.add_job(kind, about)
        with self._change:
            self._change.notify_all()
        return job.id

    def cancel(self, id: str) -> None:
        """Stop a job, or take it out of the queue; its files are deleted."""
        with self._change:
            if self.store.job(id).ended:
                return
            self.store.change_job(id, state="cancelled")
            if self._current is not None and self._current[0] == id:
                self._current[1].terminate(TERMINATE_SECONDS)
            shutil.rmtree(self.store.folder_of(id), ignore_errors=True)

    def close(self) -> None:
        """Stop; the running job starts over the next time."""
        with self._change:
            self._closed = True
            if self._current is not None:
                self._current[1].terminate(TERMINATE_SECONDS)
            self._change.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        while (job := self._next()) is not None:
            with contextlib.suppress(StudioError):  # it was removed
                self._run(job)

    def _next(self) -> JobRow | None:
        """Wait for the oldest waiting job; None when the queue is closed."""
        with self._change:
            while not self._closed:
                waiting = [job for job in self.store.jobs() if job.state == "waiting"]
                if waiting:
                    return waiting[-1]
                self._change.wait()
        return None

    def _run(self, job: JobRow) -> None:
        """Run a job to its end."""
        folder = self.store.folder_of(job.id)
        shutil.rmtree(folder, ignore_errors=True)
        with self._change:
            if self._closed or self.store.job(job.id).state != "waiting":
                return
            folder.mkdir(parents=True)
            self.store.change_job(job.id, state="running")
            function = self._functions.get(job.kind)
            # not a daemon: de-identification starts processes of its own
            process = ChildProcess(
                _run_job, function, job.about, folder, name=f"studio {job.kind}", daemon=False
            )
            self._current = job.id, process
        try:
            self._listen(job, folder, process)
        finally:
            process.close()  # the process of a removed job ends at its next report
            with self._change:
                self._current = None
        with self._change:
            self._conclude(job.id, folder, process.exit_code)

    def _listen(self, job: JobRow, folder: Path, process: ChildProcess) -> None:
        """Store what the process reports until it ends."""
        while True:
            try:
                change = process.receive()
            except (EOFError, OSError):
                return
            with self._change:
                if self.store.job(job.id).state == "running":
                    self.store.change_job(job.id, **self._finished(job, folder, change))

    def _finished(self, job: JobRow, folder: Path, change: dict[str, Any]) -> dict[str, Any]:
        """What a process reports, after its files are put where they belong if it is done."""
        if change["state"] == "done" and job.kind in self._finish:
            try:
                self._finish[job.kind](job.about, folder)
            except OSError as error:
                return {"state": "failed", "sentence": explain(error)[0]}
        return change

    def _conclude(self, id: str, folder: Path, code: int | None) -> None:
        """Mark a job as failed whose process ended without a result, unless the studio ended it."""
        state = self.store.job(id).state
        if state == "running" and not self._closed:
            sentence = f"the job ended unexpectedly (exit code {code}): start it again"
            self.store.change_job(id, state="failed", sentence=sentence)
        if state != "done":
            shutil.rmtree(folder, ignore_errors=True)


def _run_job(pipe: Connection, function: JobFunction | None, about: dict[str, Any], folder: Path) -> None:
    """What the process of a job does: it reports progress and, at the end, the result or the error."""
    try:
        if function is None:
            raise StudioError("this version has no jobs of this kind: remove it")
        result = function(about, folder, _Reporter(pipe))
        pipe.send({"state": "done", "share": 1.0, "result": result})
    except Exception as error:
        trace(error)
        pipe.send({"state": "failed", "sentence": with_user_names(explain(error)[0], about)})


def with_user_names(text: str, about: dict[str, Any]) -> str:
    """A text with the user's own names for a job's files in place of their paths."""
    for path, name in about.get("files", {}).items():
        text = text.replace(path, name).replace(Path(path).name, name)
    return text


class _Reporter:
    """Reports progress through a pipe, no more often than REPORT_SECONDS within a stage."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._stage, self._reported = pipe, "", 0.0

    def __call__(self, stage: str, share: float) -> None:
        now = time.monotonic()
        if stage == self._stage and now - self._reported < REPORT_SECONDS:
            return
        self._stage, self._reported = stage, now
        self._pipe.send({"state": "running", "stage": stage, "share": min(1.0, max(0.0, share))})
