"""Jobs on a Dask cluster: the command submits them to a scheduler, and workers on any machine run them.

All machines must see the input and the work folder under the same path, and have the same versions of the libraries.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import threading
import warnings
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from pathlib import Path
from platform import node, python_version
from typing import TYPE_CHECKING, Any

from guise.app.deidentify.run.engines import Done, EngineError, JobEngine, Perform, attempt, perform
from guise.common.version import VERSION

if TYPE_CHECKING:
    from guise.app.deidentify.stages.jobs import Job

CONNECT_SECONDS = 5  # to wait for the scheduler
MAX_RETRIES = 2  # of a job whose worker could not take or return it
LIBRARIES = (
    "av",
    "numpy",
    "scipy",
    "onnxruntime",
    "opencv-contrib-python-headless",
)  # what results depend on
_ONE_AT_A_TIME = threading.Lock()


class DaskEngine(JobEngine):
    """Runs the jobs on the workers of a scheduler.  A job whose worker is lost goes to another."""

    def __init__(self, address: str, work: Perform = perform) -> None:
        self._address, self._work = address, work
        self._client = _connect(address)
        self.workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        if not self.workers:
            self.close()
            raise EngineError(
                f"the Dask scheduler at {address} has no workers: start some with: dask worker {address}"
            )

    def run(self, jobs: Sequence[Job], done: Done) -> None:
        ours = versions()
        futures = {
            self._client.submit(attempt_there, job, self._work, ours, pure=False, retries=MAX_RETRIES): job
            for job in jobs
        }
        try:
            for future in self._ended(list(futures)):
                self._require_done(future)
                done(futures[future])
        except BaseException as error:
            self._cancel(list(futures), wait=isinstance(error, Exception))
            raise

    def _ended(self, futures: list[Any]) -> Iterator[Any]:
        """Futures as they end."""
        from distributed import as_completed

        return iter(as_completed(futures, loop=self._client.loop))

    def _require_done(self, future: Any) -> None:
        """Raise the error of a job, or the reason why it was not done."""
        if future.status == "finished":
            error = future.result()
        elif future.status == "error":
            error = _explain(future.exception())
        else:
            error = EngineError(
                f"the Dask scheduler at {self._address} is gone: start it and its workers again, then "
                "continue with --resume"
            )
        if error is not None:
            raise error

    def _cancel(self, futures: list[Any], *, wait: bool) -> None:
        """Take back the jobs that have not begun, and let the others end."""
        if self._client.status != "running":
            return
        begun = {key for keys in self._client.processing().values() for key in keys} if wait else set()
        self._client.cancel([future for future in futures if future.key not in begun])
        for _ in self._ended([future for future in futures if future.key in begun]):
            pass

    def close(self) -> None:
        self._client.close()


def _connect(address: str) -> Any:
    """A client of the scheduler at an address."""
    try:
        from distributed import Client
    except ImportError as error:
        raise EngineError('--engine dask needs more packages: pip install "guise-video[cluster]"') from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are reported in one sentence instead
    with contextlib.suppress(OSError, ValueError, TypeError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about versions: `attempt_there` compares those that matter
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False, name="guise")
    gc.collect()  # the client that did not connect: collected while the next one starts, the two wait for each other
    raise EngineError(
        f"there is no Dask scheduler at {address}: start one with: dask scheduler, and give the address that it prints"
    )


def _explain(error: Exception) -> EngineError:
    """Why a job did not come back, from what Dask reports."""
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return EngineError(
            "a job was abandoned because every worker that ran it was killed, most likely because memory ran out: give "
            "the workers more and continue with --resume"
        )
    return EngineError(
        f"a worker can't run jobs ({error}): install the same version of guise-video[cluster] on every machine"
    )


def attempt_there(job: Job, work: Perform, theirs: dict[str, str]) -> Exception | None:
    """Do a job on this worker for a command that has the versions `theirs`; its error is returned."""
    differing = {name for name, number in versions().items() if theirs[name] != number}
    if differing:
        differences = ", ".join(
            f"{name} {versions()[name]} and not {theirs[name]}" for name in sorted(differing)
        )
        return EngineError(
            f"the worker on {node()} has {differences}: install the same versions on every machine"
        )
    if not Path(job.work).is_dir():
        return EngineError(
            f"the worker on {node()} doesn't see the folder {job.work}: write to a file system that every machine has "
            "under the same path"
        )
    with _ONE_AT_A_TIME, _alone(job):  # also in a worker with several threads
        return attempt(job, work)


@contextlib.contextmanager
def _alone(job: Job) -> Iterator[None]:
    """Wait for another worker that runs this job: one that was believed lost, or one of a command that was stopped.

    The system releases the lock of a process that ends.  On a file system without locks nobody waits.
    """
    with (Path(job.work) / f"{job.stage}.{job.index}.lock").open("w") as file:
        with contextlib.suppress(OSError, ImportError):
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield


@cache
def versions() -> dict[str, str]:
    """The versions that decide what a job's result is."""
    return {"guise": VERSION, "python": ".".join(python_version().split(".")[:2])} | {
        name: _version(name) for name in LIBRARIES
    }


def _version(name: str) -> str:
    try:
        return installed(name)
    except PackageNotFoundError:
        return "none"
