"""The engines by the names that `--engine` takes."""

from __future__ import annotations

import os

from guise.app.deidentify.run.engines import EngineError, JobEngine, LocalEngine, SerialEngine


def open_engine(spec: str, workers: int | None = None) -> JobEngine:
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
            "--workers is for the local engine only: a cluster uses the workers that were started for it"
        )
    from guise.app.deidentify.run.cluster import DaskEngine

    return DaskEngine(address)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
