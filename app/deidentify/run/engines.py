"""What runs the jobs of a de-identification: this process, or processes beside it (`cluster` has a Dask cluster).

Jobs are pure: they read and write files in the work folder and return nothing, so any engine gives the same bytes.
Several threads may use an engine at once, one for each file of a batch.
"""

from __future__ import annotations

import os
import pickle
import threading
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed, wait
from multiprocessing.connection import Connection
from queue import LifoQueue
from typing import TYPE_CHECKING

from guise.app.deidentify.options import DeidentifyError
from guise.common.closing import Closing
from guise.common.processes import ChildProcess

if TYPE_CHECKING:
    from guise.app.deidentify.stages.jobs import Job

Perform = Callable[["Job"], None]
Done = Callable[["Job"], None]

MAX_STARTS_OF_KILLED_JOB = 3
_ENROLLING_THREADS = 2


class EngineError(DeidentifyError):
    """An engine that cannot be opened or has failed; one sentence."""


def perform(job: Job) -> None:
    """Do a job of a de-identification; what it needs is imported where it is done."""
    from guise.app.deidentify.stages.jobs import perform

    perform(job)


class JobEngine(Closing):
    """Runs jobs; closes by `with`.

    workers : how many it runs at a time.
    """

    workers: int

    def run(self, jobs: Sequence[Job], done: Done) -> None:
        """Run all jobs, in any order; `done` is called in this thread after each.

        The first error cancels the jobs that have not begun and is raised with its type when the others have ended.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Stop at once; jobs that still run are abandoned."""


class SerialEngine(JobEngine):
    """Runs the jobs in this process, one at a time; people are enrolled by two threads, as other jobs use two."""

    workers = 1

    def __init__(self, work: Perform = perform) -> None:
        self._work = work
        self._lock = threading.Lock()

    def run(self, jobs: Sequence[Job], done: Done) -> None:
        if len(jobs) > 1 and jobs[0].stage == "person":
            with self._lock:
                self._run_side_by_side(jobs, done)
            return
        for job in jobs:
            with self._lock:
                self._work(job)
            done(job)

    def _run_side_by_side(self, jobs: Sequence[Job], done: Done) -> None:
        from guise.common.threads import one_thread

        # A limit around all jobs: the first to end would lift its own from the others.
        with one_thread(), ThreadPoolExecutor(_ENROLLING_THREADS, "guise-enrol") as threads:
            futures = [threads.submit(self._work, job) for job in jobs]
            try:
                for job, future in zip(jobs, futures, strict=True):
                    future.result()
                    done(job)
            finally:
                for future in futures:
                    future.cancel()


class LocalEngine(JobEngine):
    """Runs the jobs in processes of this machine.

    A process that the system kills is replaced, and its job is started again.
    """

    def __init__(self, workers: int, work: Perform = perform) -> None:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # inherited; read when NumPy is imported
        self.workers = workers
        self._workers = [_WorkerProcess(work) for _ in range(workers)]
        # The one that was busy last goes first: it may have kept the frames of the file.
        self._free: LifoQueue[_WorkerProcess] = LifoQueue()
        for worker in self._workers:
            self._free.put(worker)
        self._threads = ThreadPoolExecutor(workers, "guise-job")

    def run(self, jobs: Sequence[Job], done: Done) -> None:
        futures = {self._threads.submit(self._run_one, job): job for job in jobs}
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

    def _run_one(self, job: Job) -> None:
        worker = self._free.get()
        try:
            for _ in range(MAX_STARTS_OF_KILLED_JOB):
                if worker.run(job):
                    return
            raise EngineError(
                f"the process that ran {job.stage} {job.index} was killed {MAX_STARTS_OF_KILLED_JOB} times "
                f"(exit code {worker.exit_code}), most likely because memory ran out: use fewer --workers and "
                "continue with --resume"
            )
        finally:
            self._free.put(worker)

    def close(self) -> None:
        for worker in self._workers:
            worker.close()
        self._threads.shutdown(cancel_futures=True)


class _WorkerProcess:
    """A process that runs one job at a time; started when it is first needed.

    exit_code : of the last process that was killed.
    """

    def __init__(self, work: Perform) -> None:
        self._work = work
        self._lock = threading.Lock()
        self._closed = False
        self._process: ChildProcess | None = None
        self.exit_code: int | None = None

    def run(self, job: Job) -> bool:
        """Run a job and raise its error; False when the process was killed."""
        process = self._started()
        try:
            process.send(job)
            error = process.receive()
        except (EOFError, OSError):
            self._discard(process)
            return False
        if error is not None:
            raise error
        return True

    def _started(self) -> ChildProcess:
        with self._lock:
            if self._closed:
                raise EngineError("the run was stopped; use --resume to continue")
            if self._process is None:
                self._process = ChildProcess(_serve, self._work)
            return self._process

    def _discard(self, process: ChildProcess) -> None:
        """Clear up after a process that was killed."""
        with self._lock:
            process.kill()
            process.close()
            self.exit_code = process.exit_code
            self._process = None

    def close(self) -> None:
        """Kill the process; a thread that waits for a job of it gets an error."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()


def _serve(pipe: Connection, work: Perform) -> None:
    """The loop of a worker process: jobs in, their errors or None out, until the other side is gone."""
    while True:
        try:
            job = pipe.recv()
        except (EOFError, OSError):
            return
        pipe.send(attempt(job, work))


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
