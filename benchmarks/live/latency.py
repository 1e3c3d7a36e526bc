"""Latency from capture to presentation: a clock burnt into the frames of a file is read when they are shown.

640 x 480, 30 frames a second.  The time is written into a frame when it is captured.  Without a window it is read from
the frame that the output is given; with one, by another process from the pixels of the virtual display, which is what
an eye would see.  Rounds alternate; the first seconds of each are ignored.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.live import clock
from benchmarks.live.runs import Noted, Scene, display, played, small, window
from guise.app.live.capture import FileCapture
from guise.app.live.output import OutputFrame
from guise.app.media import Frame
from guise.common.threads import one_thread

ROUNDS = 3
ROUND_SECONDS = 20.0
WARM_UP_SECONDS = 2.0  # that are not counted
TARGETS_MS = (("median", 0.5, 20.0), ("95th percentile", 0.95, 33.0))  # name, quantile, milliseconds


class Clocked(FileCapture):
    """A file in whose frames the time is burnt at which they are given; it ends after some seconds of playing."""

    def __init__(self, path: Path, seconds: float) -> None:
        super().__init__(path, loop=True)
        self._seconds = seconds

    def __iter__(self) -> Iterator[Frame]:
        for frame in super().__iter__():
            if frame.pts * frame.time_base > self._seconds:
                return
            clock.burn(frame, clock.now())
            yield frame


def to_nowhere(scene: Scene, seconds: float) -> tuple[F64, int]:
    """Times in seconds and delays in milliseconds (n, 2) of what an output got, and how many frames it did not get."""
    seen: list[tuple[float, float]] = []

    def after(shown: OutputFrame, at: float) -> None:
        code = clock.read(shown.frame.luma)
        if code is not None:
            seen.append((at, clock.passed(code, clock.now())))

    with one_thread(), Clocked(scene.clip.video, seconds) as capture:
        stats = played(scene, capture, [Noted(after=after)])
    return np.reshape(seen, (-1, 2)), stats.dropped + stats.skipped


def to_window(scene: Scene, seconds: float, screen: Path) -> tuple[F64, int]:
    """The same for what is on the display."""
    with one_thread(), Clocked(scene.clip.video, seconds) as capture:
        command = [sys.executable, "-m", "benchmarks.live.clock", screen, capture.width, capture.height]
        with subprocess.Popen([str(part) for part in command], stdout=subprocess.PIPE, text=True) as watcher:
            stats = played(scene, capture, [window()])
            seen, _ = watcher.communicate()
    return np.reshape([float(word) for word in seen.split()], (-1, 2)), stats.dropped + stats.skipped


def after_warm_up(seen: F64) -> list[float]:
    """The delays that were not seen in the first seconds."""
    return [] if len(seen) == 0 else seen[seen[:, 0] > seen[0, 0] + WARM_UP_SECONDS, 1].tolist()


def measure(options: argparse.Namespace) -> Report:
    """Both ways, in turns."""
    scene, seconds = small(), 5.0 if options.quick else ROUND_SECONDS
    found: dict[str, list[float]] = {"nowhere": [], "window": []}
    lost = dict.fromkeys(found, 0)
    with display() as screen:
        for _ in range(1 if options.quick else ROUNDS):
            for way, (seen, missed) in {
                "nowhere": to_nowhere(scene, seconds), "window": to_window(scene, seconds, screen),
            }.items():  # fmt: skip
                found[way] += after_warm_up(seen)
                lost[way] += missed
                common.say(f"{way}: {share_of(found[way], 0.5):.1f} ms, {missed} dropped")
    return report(found, lost)


def share_of(delays: list[float], share: float) -> float:
    """A quantile; NaN of nothing."""
    return float(np.quantile(delays, share)) if delays else float("nan")


def report(found: dict[str, list[float]], lost: dict[str, int]) -> Report:
    """From the delays, milliseconds, and the frames that were dropped, by way."""
    rows = [
        (way, len(ms), *(share_of(ms, share) for share in (0.5, 0.95, 0.99, 1.0)), lost[way])
        for way, ms in found.items()
    ]
    columns = ("to", "frames", "median, ms", "95 %, ms", "99 %, ms", "most, ms", "dropped")
    return Report(
        "live.latency", "Live: from capture to presentation, 640x480",
        [
            Criterion(f"to {way}, {what}", share_of(ms, share), "<=", target, "ms")
            for way, ms in found.items()
            for what, share, target in TARGETS_MS
        ],
        [Table("By a clock in the pictures", columns, rows)],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
