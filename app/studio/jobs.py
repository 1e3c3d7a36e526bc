"""Long work of the studio: in a process of its own, one piece after the other.

A job outlives the page that started it.  One that was interrupted by the end of the studio runs again, from its
beginning, when the studio is started the next time.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from guise.app.studio.store import JobRow, Store, StudioError

Progress = Callable[[str, float], None]
Function = Callable[[dict[str, Any], Path, Progress], dict[str, Any]]

_SPAWN = multiprocessing.get_context("spawn")
_EVERY = 0.1  # seconds, between two reports of progress within a stage
_PATIENCE = 2.0  # seconds, until a process that was told to end is killed


class Jobs:
    """Runs jobs in the order in which they were started, from `open` to `close`.

    The kinds are registered first.  A job's function is at the top of a module; it is called in a new process as
    run(about, folder, progress) and returns the result, both as JSON holds them.  What it raises becomes a sentence.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self._functions: dict[str, Function] = {}
        self._change = threading.Condition()
        self._closed = False
        self._current: tuple[str, Any] | None = None
        self._thread = threading.Thread(target=self._work, name="studio jobs", daemon=True)

    def register(self, kind: str, function: Function) -> None:
        """Say what runs a kind of jobs."""
        self._functions[kind] = function

    def open(self) -> None:
        """Begin, with what was left undone."""
        for job in self.store.jobs():
            if job.state == "running":
                self.store.change_job(job.id, state="waiting")
        self._thread.start()

    def start(self, kind: str, about: dict[str, Any]) -> str:
        """Queue a job and return its id."""
        if kind not in self._functions:
            raise StudioError(f"there is no work called {kind}; there are {', '.join(self._functions)}")
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
                _end(self._current[1])
            shutil.rmtree(self.store.folder_of(id), ignore_errors=True)

    def close(self) -> None:
        """Stop; what runs is begun again the next time."""
        with self._change:
            self._closed = True
            if self._current is not None:
                _end(self._current[1])
            self._change.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        while (job := self._next()) is not None:
            with contextlib.suppress(StudioError):  # it was removed
                self._run(job)

    def _next(self) -> JobRow | None:
        """The oldest job that waits; None at the end."""
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
        ours, theirs = _SPAWN.Pipe(duplex=False)
        arguments = (theirs, self._functions.get(job.kind), job.about, folder)
        process = _SPAWN.Process(target=_child, args=arguments, name=f"studio {job.kind}")
        with self._change:
            if self._closed or self.store.job(job.id).state != "waiting":
                return
            folder.mkdir(parents=True)
            self.store.change_job(job.id, state="running")
            process.start()
            self._current = job.id, process
        theirs.close()
        try:
            self._listen(job.id, ours)
        finally:
            ours.close()  # so that one that was removed ends at its next word
            process.join()
            with self._change:
                self._current = None
        with self._change:
            self._conclude(job.id, folder, process.exitcode)

    def _listen(self, id: str, ours: Connection) -> None:
        """Write down what the process says, until it ends."""
        while True:
            try:
                change = ours.recv()
            except EOFError:
                return
            with self._change:
                if self.store.job(id).state == "running":
                    self.store.change_job(id, **change)

    def _conclude(self, id: str, folder: Path, code: int | None) -> None:
        """A process that ended without a word has failed; one that was ended with the studio has not."""
        state = self.store.job(id).state
        if state == "running" and not self._closed:
            sentence = f"the work ended unexpectedly (exit code {code}): start it again"
            self.store.change_job(id, state="failed", sentence=sentence)
        if state != "done":
            shutil.rmtree(folder, ignore_errors=True)


def _end(process: Any) -> None:
    process.terminate()
    process.join(_PATIENCE)
    if process.is_alive():
        process.kill()


def _child(pipe: Connection, function: Function | None, about: dict[str, Any], folder: Path) -> None:
    """The process of a job; it says how far it is, and at last what came of it."""
    from guise.common.failures import explain, trace

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the studio decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        if function is None:
            raise StudioError("this version has no such work: remove it")
        result = function(about, folder, _Reporter(pipe))
        pipe.send({"state": "done", "share": 1.0, "result": result})
    except Exception as error:
        trace(error)
        pipe.send({"state": "failed", "sentence": explain(error)[0]})


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class _Reporter:
    """Progress through a pipe, not more often than somebody could see."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._stage, self._said = pipe, "", 0.0

    def __call__(self, stage: str, share: float) -> None:
        now = time.monotonic()
        if stage == self._stage and now - self._said < _EVERY:
            return
        self._stage, self._said = stage, now
        self._pipe.send({"state": "running", "stage": stage, "share": min(1.0, max(0.0, share))})
