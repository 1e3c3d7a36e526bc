"""A long run at the pace of a camera: a looping clip is swapped and recorded, and nothing may grow.

Memory, threads and the offset between the frames' times and the clock at presentation are sampled once a second.
Memory is flat when the median over the last fifth of the run is at most 5 % above that of the second fifth.  Drift is
the change of the median offset between the same fifths.  The recording's length, by its own times, is compared with
the clock.  Encoder and allocator fill their pools for some minutes, so that memory still grows in short runs.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import PAGE_MB
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.live.runs import Noted, played, small
from guise.app.live.capture import FileCapture
from guise.app.live.output import OutputFrame
from guise.app.live.recorder import VideoRecorder
from guise.app.live.stats import PipelineStats
from guise.app.media import EncodeOptions
from guise.common.threads import one_thread

SAMPLE_SECONDS = 1.0  # between two samples
MAX_MEMORY_GROWTH = 1.05
MAX_DRIFT_MS = 10.0
MAX_LENGTH_ERROR_MS = (
    100.0  # of the recording; its first and last frame may differ by one from what was presented
)


@dataclass(frozen=True)
class Sample:
    """At a time, seconds from the start: memory (MB), threads, and lateness of the frames (milliseconds)."""

    at: float
    memory: float
    threads: int
    late: float


class Soak:
    """Takes samples while pictures are shown, and ends the capture.

    Parameters
    ----------
    capture : FileCapture, paced.   seconds : how long.
    """

    def __init__(self, capture: FileCapture, seconds: float) -> None:
        self.samples: list[Sample] = []
        self.arrived: list[float] = []  # of the first and the last picture, seconds
        self._capture, self._seconds = capture, seconds
        self._lates: list[float] = []

    def after(self, shown: OutputFrame, now: float) -> None:
        """A picture was shown."""
        self.arrived = [*self.arrived[:1], shown.arrived]
        begun = self._capture.begun
        assert begun is not None
        at = now - begun
        self._lates.append(1e3 * (at - float(shown.frame.pts * shown.frame.time_base)))
        if at >= SAMPLE_SECONDS * (len(self.samples) + 1):
            memory = int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MB
            self.samples.append(Sample(at, memory, threading.active_count(), float(np.median(self._lates))))
            self._lates.clear()
        if at >= self._seconds:
            self._capture.stop()


def length(video: Path) -> float:
    """Seconds that a video lasts by its own times."""
    entries = ("-select_streams", "v", "-show_entries", "stream=duration", "-of", "csv=p=0")
    probe = subprocess.run(["ffprobe", "-v", "error", *entries, video], capture_output=True, check=True)
    return float(probe.stdout)


def fifth(values: F64, number: int) -> float:
    """Median over a fifth (0-4) of the run."""
    return float(np.median(np.array_split(values, 5)[number]))


def measure(options: argparse.Namespace) -> Report:
    """One run."""
    scene, seconds = small(), 15.0 if options.quick else 60 * options.minutes
    before = threading.active_count()
    with tempfile.TemporaryDirectory() as name:
        recorder = VideoRecorder(
            Path(name) / "out.mp4", encode=EncodeOptions(preset="ultrafast"), say=common.say
        )
        with one_thread(), FileCapture(scene.clip.video, loop=True) as capture:
            soak = Soak(capture, seconds)
            stats = played(scene, capture, [Noted(after=soak.after), recorder])
        short = soak.arrived[1] - soak.arrived[0] - length(recorder.path)
    return report(soak.samples, threading.active_count() - before, short, stats)


def report(samples: Sequence[Sample], left: int, short: float, stats: PipelineStats) -> Report:
    """From the samples, the threads that were left, and the seconds by which the recording is too short."""
    columns = {
        "memory, MB": np.array([s.memory for s in samples]),
        "threads": np.array([float(s.threads) for s in samples]),
        "later than its time, ms": np.array([s.late for s in samples]),
    }
    memory, threads, late = columns.values()
    minutes, growth = samples[-1].at / 60, fifth(memory, 4) / fifth(memory, 1)
    return Report(
        "live.soak", f"Live: {minutes:.3g} minutes from a looping clip, recorded",
        [
            Criterion("memory, last fifth over the second", growth, "<=", MAX_MEMORY_GROWTH),
            Criterion("drift of the pictures' times", abs(fifth(late, 4) - fifth(late, 1)), "<=", MAX_DRIFT_MS, "ms"),
            Criterion("the recording's length beside the clock", 1e3 * abs(short), "<=", MAX_LENGTH_ERROR_MS, "ms"),
            Criterion("threads, last fifth over the second", fifth(threads, 4) - fifth(threads, 1), "<=", 0.0),
            Criterion("threads left", float(left), "<=", 0.0),
        ],
        [
            Table(
                "Medians over fifths of the run", ("what", *(f"fifth {k + 1}" for k in range(5))),
                [(name, *(fifth(values, k) for k in range(5))) for name, values in columns.items()],
            )
        ],
        [
            f"{stats.frames} frames, {stats.dropped} dropped, {stats.skipped} not recorded; "
            + ", ".join(f"{count} {name}" for name, count in sorted(stats.outcomes.items())) + "."
        ],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__, minutes=60.0))
