"""Time from the start of the process `guise live` to its first swapped frame, with a cached model of the person.

The command runs as a user starts it, on a clip whose person is cached from an earlier run, and is timed from outside:
it prints a line when an output has shown the first swapped frame, and is ended.  The first round is discarded.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.live.runs import SAMPLES, display

CLIP = SAMPLES / "p01" / "talk.mp4"
ROUNDS = 5
TARGET_SECONDS = 3.0
CHILD = """
from guise.app.cli.main import main
from guise.app.live.pipeline import Pipeline

original = Pipeline.presented

def presented(self, shown, channel):
    original(self, shown, channel)
    if shown.result.outcome == "swapped":
        print("swapped", flush=True)
        self.stop()

Pipeline.presented = presented
raise SystemExit(main())
"""


def first_swap(arguments: Sequence[str | Path], cache: Path) -> float:
    """Seconds from the start of the command to its first swapped frame; NaN when there was none."""
    command = [sys.executable, "-c", CHILD, "live", *(str(part) for part in arguments)]
    environment = {**os.environ, "GUISE_PEOPLE": str(cache)}
    start, first = time.perf_counter(), float("nan")
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("swapped") and first != first:
                first = time.perf_counter() - start
    return first


def measure(options: argparse.Namespace) -> Report:
    """Alternating rounds of a window and a file."""
    taken: dict[str, list[float]] = {"window": [], "file, headless": []}
    with tempfile.TemporaryDirectory() as name, display():
        folder = Path(name)
        ways: dict[str, list[str | Path]] = {
            "window": ["--output", "window"],
            "file, headless": ["--headless", "--output", folder / "out.mp4", "--force"],
        }
        for turn in range(2 if options.quick else ROUNDS + 1):
            for way, more in ways.items():
                seconds = first_swap(["--quiet", "--input", CLIP, *more], folder / "cache")
                common.say(f"round {turn}, {way}: {seconds:.2f} s")
                if turn > 0:
                    taken[way].append(seconds)
    return report(taken)


def report(taken: dict[str, list[float]]) -> Report:
    """From the seconds of the rounds by way."""
    rows = [(way, statistics.median(s), min(s), max(s)) for way, s in taken.items()]
    rounds = len(next(iter(taken.values())))
    return Report(
        "live.start", "Live: from the start of the command to the first swapped frame",
        [Criterion(f"to {way}", statistics.median(s), "<=", TARGET_SECONDS, "s") for way, s in taken.items()],
        [Table(f"{rounds} rounds", ("to", "median, s", "least, s", "most, s"), rows)],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
