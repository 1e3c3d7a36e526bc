"""Frames per second and latency of the live pipeline, to nowhere and to a window.

The rate is that of a file as fast as possible; presented frames are counted.  Latency is from the capture of a frame of
640 x 480 to the end of its presentation, as `guise live` reads it out, while the file plays at its own pace of 30
frames a second.  The window is on a virtual display and drawn by software GL.  Rounds of all ways alternate, each with
a pass that only decodes the clip.  One thread for matrix work, as in the command.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.live.runs import Noted, Scene, display, large, played, small, window
from guise.app.live.capture import FileCapture
from guise.app.live.output import Output
from guise.app.live.stats import PipelineStats
from guise.common.threads import one_thread

ROUNDS = 5
ROUND_FRAMES = 300
WARM_UP_FRAMES = 30  # that are not counted
FPS_TARGETS = {"640x480": 60.0, "1280x720": 40.0}
LATENCIES, LATENCY_TARGETS_MS = ("median", "95th percentile"), (20.0, 33.0)
WAYS: dict[str, Callable[[], Output | None]] = {"nowhere": lambda: None, "window": window}


@dataclass(frozen=True)
class Rate:
    """Frames a second that were presented, and milliseconds of processor time, all threads, that one took."""

    fps: float
    processor: float


def sustained(scene: Scene, output: Output | None, frames: int) -> Rate:
    """A round."""
    used: list[float] = []
    with one_thread(), FileCapture(scene.clip.video, loop=True, paced=False) as capture:

        def after() -> None:
            used.append(time.process_time())
            if len(used) == WARM_UP_FRAMES + frames:
                capture.stop()

        noted = Noted(output, after)
        played(scene, capture, [noted])
    return _rate(noted.times, used)


def at_own_pace(scene: Scene, output: Output | None, frames: int) -> PipelineStats:
    """A round whose latencies count."""
    with one_thread(), FileCapture(scene.clip.video, loop=True) as capture:

        def after() -> None:
            if len(noted.times) == frames:
                capture.stop()

        noted = Noted(output, after)
        return played(scene, capture, [noted])


def decoded(scene: Scene, frames: int) -> Rate:
    """The same frames, only decoded."""
    times, used = [], []
    with FileCapture(scene.clip.video, loop=True, paced=False) as capture:
        for _ in islice(capture, WARM_UP_FRAMES + frames):
            times.append(time.perf_counter())
            used.append(time.process_time())
    return _rate(times, used)


def _rate(times: list[float], used: list[float]) -> Rate:
    count = len(times) - 1 - WARM_UP_FRAMES
    return Rate(count / (times[-1] - times[WARM_UP_FRAMES]), 1e3 * (used[-1] - used[WARM_UP_FRAMES]) / count)


def measure(options: argparse.Namespace) -> Report:
    """All ways, in turns."""
    scenes = [small(), large(options.shared)]
    frames = 60 if options.quick else ROUND_FRAMES
    found: dict[tuple[str, str], list[Rate]] = {}
    late: dict[str, list[PipelineStats]] = {way: [] for way in WAYS}
    with display():
        for turn in range(1 if options.quick else ROUNDS):
            for scene in scenes:
                for way, make in WAYS.items():
                    found.setdefault((scene.label, way), []).append(sustained(scene, make(), frames))
                found.setdefault((scene.label, "decoded only"), []).append(decoded(scene, frames))
                common.say(f"round {turn + 1}: {scene.label}")
            for way, make in WAYS.items():
                late[way].append(at_own_pace(scenes[0], make(), frames))
    return report(found, late)


def report(found: dict[tuple[str, str], list[Rate]], late: dict[str, list[PipelineStats]]) -> Report:
    """From the rates of the rounds by picture size and way, and the rounds at the file's pace by way."""
    fps = {key: statistics.median(rate.fps for rate in rates) for key, rates in found.items()}
    used = {key: statistics.median(rate.processor for rate in rates) for key, rates in found.items()}
    rows = [
        (size, way, fps[size, way], used[size, way], fps[size, way] / fps[size, "decoded only"])
        for size, way in fps
    ]
    columns = ("picture", "to", "frames a second", "processor, ms a frame", "of decoding alone")
    rounds = len(next(iter(found.values())))
    delays = [
        (
            way, statistics.median(one.latency for one in some), statistics.median(one.latency_95 for one in some),
            sum(one.dropped + one.skipped for one in some),
        )
        for way, some in late.items()
    ]  # fmt: skip
    return Report(
        "live.throughput", "Live: rate and latency",
        [
            Criterion(f"{size}, to {way}", fps[size, way], ">=", FPS_TARGETS[size], "fps")
            for size, way in fps if way in WAYS
        ] + [
            Criterion(f"latency to {way}, {what}", measured, "<=", target, "ms")
            for way, *measures, _ in delays
            for what, measured, target in zip(LATENCIES, measures, LATENCY_TARGETS_MS, strict=True)
        ],
        [
            Table(f"Median of {rounds} rounds", columns, rows),
            Table("Latency at the file's pace", ("to", *(f"{what}, ms" for what in LATENCIES), "dropped"), delays),
        ],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
