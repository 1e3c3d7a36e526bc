"""Who does the jobs of a de-identification: this process, processes beside it, or a Dask cluster.

Jobs are pure: they read and write files in the work folder and return nothing, so any of them gives the same bytes.
An engine may be used by several threads at once, one for each file of a batch.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed, wait
from multiprocessing.connection import Connection
from queue import SimpleQueue
from types import TracebackType
from typing import TYPE_CHECKING, Self

from guise.app.deidentify.options import DeidentifyError

if TYPE_CHECKING:
    from guise.app.deidentify.stages.jobs import Job

Perform = Callable[["Job"], None]
Done = Callable[["Job"], None]

TRIES = 3  # times that a job is begun whose worker was killed


class EngineError(DeidentifyError):
    """An engine that cannot be had or has failed; one sentence."""


def perform(job: Job) -> None:
    """Do a job of a de-identification; what it needs is imported where it is done."""
    from guise.app.deidentify.stages.jobs import perform

    perform(job)


class Engine:
    """Does jobs; closes by `with`.

    workers : how many it does at a time.
    """

    workers: int

    def run(self, jobs: Sequence[Job], done: Done) -> None:
        """Do all jobs, in any order; `done` is called in this thread after each.

        The first error cancels the jobs that have not begun and is raised with its type when the others have ended.
        """
        raise NotImplementedError

    def close(self) -> None:
        """End at once; jobs that still run are given up."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class SerialEngine(Engine):
    """Does the jobs in this process, one at a time."""

    workers = 1

    def __init__(self, work: Perform = perform) -> None:
        self._work = work
        self._lock = threading.Lock()

    def run(self, jobs: Sequence[Job], done: Done) -> None:
        for job in jobs:
            with self._lock:
                self._work(job)
            done(job)


class LocalEngine(Engine):
    """Does the jobs in processes of this machine.

    A process that the system kills is replaced, and its job is begun again.
    """

    def __init__(self, workers: int, work: Perform = perform) -> None:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # inherited; read when NumPy is imported
        self.workers = workers
        self._hands = [_Hand(work) for _ in range(workers)]
        self._free: SimpleQueue[_Hand] = SimpleQueue()
        for hand in self._hands:
            self._free.put(hand)
        self._threads = ThreadPoolExecutor(workers, "guise-job")

    def run(self, jobs: Sequence[Job], done: Done) -> None:
        futures = {self._threads.submit(self._do, job): job for job in jobs}
        try:
            for future in as_completed(futures):
                future.result()
                done(futures[future])
        except BaseException as error:
            running = [future for future in futures if not future.cancel()]
            if not isinstance(error, Exception):
                self.close()
            wait(running)
            raise

    def _do(self, job: Job) -> None:
        hand = self._free.get()
        try:
            for _ in range(TRIES):
                if hand.do(job):
                    return
            raise EngineError(
                f"the process that did {job.stage} {job.index} was killed {TRIES} times (exit code {hand.exitcode}), "
                "mostly for want of memory: use fewer --workers, and --resume to go on"
            )
        finally:
            self._free.put(hand)

    def close(self) -> None:
        for hand in self._hands:
            hand.close()
        self._threads.shutdown(cancel_futures=True)


class _Hand:
    """A process that does one job at a time; begun when it is needed."""

    def __init__(self, work: Perform) -> None:
        self._work = work
        self._lock = threading.Lock()
        self._closed = False
        self._process: multiprocessing.process.BaseProcess | None = None
        self._link: Connection | None = None
        self.exitcode: int | None = None

    def do(self, job: Job) -> bool:
        """Do a job and raise its error; False when the process was killed."""
        link = self._begin()
        try:
            link.send(job)
            error = link.recv()
        except (EOFError, OSError):
            self._end()
            return False
        if error is not None:
            raise error
        return True

    def _begin(self) -> Connection:
        with self._lock:
            if self._closed:
                raise EngineError("the run was stopped; use --resume to go on")
            if self._link is None:
                context = multiprocessing.get_context("spawn")
                self._link, theirs = context.Pipe()
                self._process = context.Process(target=_serve, args=(theirs, self._work), daemon=True)
                self._process.start()
                theirs.close()  # so that reading ends when the process does
            return self._link

    def _end(self) -> None:
        with self._lock:
            assert self._process is not None
            assert self._link is not None
            self._process.kill()
            self._process.join()
            self.exitcode = self._process.exitcode
            self._link.close()
            self._process = self._link = None

    def close(self) -> None:
        """Kill the process; whoever waits for a job of it is told."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()
                self._process.join()


def _serve(link: Connection, work: Perform) -> None:
    """A worker's life: jobs in, their errors or None out, until the other side is gone."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # the terminal's Ctrl-C is for the command, which ends this process
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    while True:
        try:
            job = link.recv()
        except (EOFError, OSError):
            return
        link.send(attempt(job, work))


def _leave_with_parent() -> None:
    """End this process at once when its parent has, however that came."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def attempt(job: Job, work: Perform) -> Exception | None:
    """Do a job; its error is returned, in a form that can be sent to another process."""
    try:
        work(job)
    except Exception as error:
        error.add_note("".join(traceback.format_exception(error)))
        return _sendable(error)
    return None


def _sendable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def open_engine(spec: str, workers: int | None = None) -> Engine:
    """The engine of that name.

    Parameters
    ----------
    spec : "local" or "dask:ADDRESS".
    workers : processes of a local engine; one for each two cores when None, as each uses two threads.

    Raises
    ------
    EngineError
        When there is no such engine, or no cluster at the address.
    """
    kind, _, address = spec.partition(":")
    if spec == "local":
        number = workers or max(1, _cores() // 2)
        return SerialEngine() if number == 1 else LocalEngine(number)
    if kind != "dask" or not address:
        raise EngineError(
            f"engine must be local or dask:ADDRESS, such as dask:tcp://10.0.0.5:8786; got {spec!r}"
        )
    if workers is not None:
        raise EngineError(
            "--workers is for the local engine: a cluster has the workers that were started for it"
        )
    from guise.app.deidentify.run.cluster import DaskEngine

    return DaskEngine(address)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
