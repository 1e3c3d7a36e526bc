"""Sustained frames per second of the live pipeline: a file as fast as possible, to nowhere and to a window.

The window is on a virtual display and drawn by software GL.  Presented frames are counted.  Rounds of all ways
alternate, each with a pass that only decodes the clip.  One thread for matrix work, as in the command.
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
from guise.common.threads import one_thread

ROUNDS = 5
ROUND_FRAMES = 300
WARM_UP_FRAMES = 30  # that are not counted
FPS_TARGETS = {"640x480": 60.0, "1280x720": 40.0}
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

        def after(*_: object) -> None:
            used.append(time.process_time())
            if len(used) == WARM_UP_FRAMES + frames:
                capture.stop()

        noted = Noted(output, after)
        played(scene, capture, [noted])
    return _rate(noted.times, used)


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
    with display():
        for turn in range(1 if options.quick else ROUNDS):
            for scene in scenes:
                for way, make in WAYS.items():
                    found.setdefault((scene.label, way), []).append(sustained(scene, make(), frames))
                found.setdefault((scene.label, "decoded only"), []).append(decoded(scene, frames))
                common.say(f"round {turn + 1}: {scene.label}")
    return report(found)


def report(found: dict[tuple[str, str], list[Rate]]) -> Report:
    """From the rates of the rounds by picture size and way."""
    fps = {key: statistics.median(rate.fps for rate in rates) for key, rates in found.items()}
    used = {key: statistics.median(rate.processor for rate in rates) for key, rates in found.items()}
    rows = [
        (size, way, fps[size, way], used[size, way], fps[size, way] / fps[size, "decoded only"])
        for size, way in fps
    ]
    columns = ("picture", "to", "frames a second", "processor, ms a frame", "of decoding alone")
    rounds = len(next(iter(found.values())))
    return Report(
        "live.throughput", "Live: sustained rate",
        [
            Criterion(f"{size}, to {way}", fps[size, way], ">=", FPS_TARGETS[size], "fps")
            for size, way in fps if way in WAYS
        ],
        [Table(f"Median of {rounds} rounds", columns, rows)],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
