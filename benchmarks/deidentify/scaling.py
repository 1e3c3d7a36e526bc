"""Eight clips de-identified by one Dask worker and by two, of one core each; and what passes through the work folders.

The wall time of the command is taken, after a clip that does not count, so that the workers have imported what they
need.  One and two workers alternate.  The work folders are what machines share besides inputs and outputs: their size
is sampled five times a second, and its maximum is given as a share of the inputs.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from benchmarks import common
from benchmarks.children import GUISE, ffmpeg, ran
from benchmarks.common import Criterion, Report, Table

CLIPS = (
    "room_s18", "studio_d7", "studio_d3", "studio_d5", "studio_d6", "studio_d18", "talk_r1", "talk_r2",
)  # fmt: skip
SECONDS = 0.7  # of each clip
ROUNDS = 3
SAMPLE_SECONDS = 0.2
PORT = 18786
ADDRESS = f"tcp://127.0.0.1:{PORT}"


@contextmanager
def cluster(workers: int, *, pinned: bool) -> Iterator[None]:
    """A scheduler and workers with one thread each, and one core each if they are `pinned`."""
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", str(PORT), "--no-dashboard"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", ADDRESS, "--nthreads", "1"]
    path = os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), str(Path(__file__).parents[2]))))
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": path}
    started: list[subprocess.Popen[bytes]] = []

    def start(command: list[str]) -> None:
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(
            command, env=environment, stdout=quiet, stderr=quiet, start_new_session=True
        )
        started.append(process)

    try:
        start(dask)
        time.sleep(3)
        for number in range(workers):
            core = ["taskset", "--cpu-list", str(number)] if pinned else []
            start([*core, *worker, "--no-dashboard", "--no-nanny"])
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


def pieces(shared: Path, count: int, seconds: float, folder: Path) -> list[Path]:
    """The beginning of several clips."""
    folder.mkdir()
    made = []
    for name in CLIPS[:count]:
        made.append(folder / f"{name}.mp4")
        ran(
            ffmpeg(
                "-i", shared / "data" / "real" / f"{name}.mp4", "-t", f"{seconds:g}", "-c", "copy", made[-1]
            )
        )
    return made


def run(videos: Sequence[Path], folder: Path) -> tuple[float, int]:
    """Wall seconds on the running cluster, and the most bytes in work folders."""
    folder.mkdir()
    start, most = time.perf_counter(), 0
    options = ("--encoder-preset", "ultrafast", "--quiet", "--engine", f"dask:{ADDRESS}")
    process = subprocess.Popen([*GUISE, "deidentify", *map(str, videos), "-o", str(folder), *options])
    while process.poll() is None:
        most = max(most, sum(_size(file) for work in folder.glob("*.work") for file in work.rglob("*")))
        time.sleep(SAMPLE_SECONDS)
    return time.perf_counter() - start, most


def _size(file: Path) -> int:
    try:
        return file.stat().st_size if file.is_file() else 0
    except OSError:
        return 0


def measure(options: argparse.Namespace) -> Report:
    """One and two workers in turn."""
    seconds: dict[int, list[float]] = {1: [], 2: []}
    work = 0
    with tempfile.TemporaryDirectory() as name:
        videos = pieces(options.shared, 2 if options.quick else len(CLIPS), SECONDS, Path(name) / "in")
        size = sum(map(_size, videos))
        for number in range(1 if options.quick else options.rounds):
            for workers, found in seconds.items():
                with cluster(workers, pinned=hasattr(os, "sched_setaffinity")):
                    run(videos[:1], Path(name) / f"first{number}-{workers}")
                    taken, most = run(videos, Path(name) / f"out{number}-{workers}")
                found.append(taken)
                work = max(work, most)
                common.say(f"{workers}: {taken:.1f} s")
    growth = statistics.median(one / two for one, two in zip(seconds[1], seconds[2], strict=True))
    rows = [(n, statistics.median(s), min(s), max(s)) for n, s in seconds.items()]
    return Report(
        "deidentify.scaling",
        "De-identification: one Dask worker and two",
        [Criterion("time of one worker over that of two", growth, ">=", 1.85)],
        [
            Table(
                f"{len(videos)} clips of {SECONDS:g} s", ("workers", "median, s", "least, s", "most, s"), rows
            ),
            Table(
                "What is shared", ("what", "bytes"), [("inputs", size), ("work folders, most at once", work)]
            ),
        ],
    )


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="runs with one worker and with two")
    common.run(measure, parser)
