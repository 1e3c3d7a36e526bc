"""Two Dask workers, one of which is killed in the middle: all outputs complete, the same bytes as without a cluster."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks import common
from benchmarks.children import GUISE
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.guise import SOME_COVERED

CLIPS = ("leave_reenter", "light_change", "two_people", "yaw40")
PORT = 18786
ADDRESS = f"tcp://127.0.0.1:{PORT}"
KILL_AFTER_SHARE = 0.4  # of the duration of the run without a cluster


@contextmanager
def cluster(workers: int = 2, *, pinned: bool = False) -> Iterator[list[subprocess.Popen[bytes]]]:
    """A scheduler and workers with one thread each, and one core each if they are `pinned`; gives the workers."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", str(PORT), "--no-dashboard"]
    worker = [
        sys.executable,
        "-m",
        "distributed.cli.dask_worker",
        ADDRESS,
        "--nthreads",
        "1",
        "--no-dashboard",
        "--no-nanny",
    ]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": _path()}
    started = [subprocess.Popen(dask, env=environment, **quiet)]  # type: ignore[call-overload]
    time.sleep(3)
    try:
        for number in range(workers):
            core = ["taskset", "--cpu-list", str(number)] if pinned else []
            started.append(subprocess.Popen(core + worker, env=environment, **quiet))  # type: ignore[call-overload]
        yield started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


def _path() -> str:
    """Where the workers find these scripts' package, as this process does."""
    return os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), str(Path(__file__).parents[2]))))


def command(videos: list[Path], folder: Path, *more: str) -> list[str]:
    """De-identify all of them into a folder."""
    return [
        *GUISE,
        "deidentify",
        *map(str, videos),
        "-o",
        str(folder),
        "--preset",
        "ultrafast",
        "--quiet",
        *more,
    ]


def outputs(folder: Path) -> dict[str, bytes]:
    """The videos of a folder."""
    return {file.name: file.read_bytes() for file in sorted(folder.glob("*.mp4"))}


def measure(options: argparse.Namespace) -> Report:
    """Without a cluster, then with one."""
    videos = [
        options.shared / "data" / "synthetic" / "hard" / f"{c}.mp4"
        for c in CLIPS[: 2 if options.quick else None]
    ]
    with tempfile.TemporaryDirectory() as name:
        alone, together = Path(name) / "alone", Path(name) / "together"
        alone.mkdir()
        together.mkdir()
        start = time.perf_counter()
        subprocess.run(command(videos, alone), check=False)
        usual = time.perf_counter() - start
        with cluster() as workers:
            process = subprocess.Popen(command(videos, together, "--engine", f"dask:{ADDRESS}"))
            time.sleep(KILL_AFTER_SHARE * usual)
            running = process.poll() is None
            os.kill(workers[0].pid, signal.SIGKILL)
            code = process.wait()
        before, after = outputs(alone), outputs(together)
    rows = [
        (n, "same" if after.get(n) == data else "OTHER" if n in after else "missing")
        for n, data in before.items()
    ]
    same = sum(result == "same" for _, result in rows)
    return Report(
        "deidentify.cluster", "De-identification: two Dask workers, one killed",
        [
            Criterion("outputs complete and the same", float(same), ">=", float(len(videos))),
            Criterion("exit code (3: some faces covered)", float(code), "<=", float(SOME_COVERED)),
            Criterion("the worker was killed while the run went on", float(running), ">=", 1.0),
        ],
        [Table("Outputs beside those without a cluster", ("file", "bytes"), rows)],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
