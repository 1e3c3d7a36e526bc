"""Frames per second, processor time and latency of the live pipeline, to nowhere and to a window.

The rate is that of a file as fast as possible; presented frames are counted.  Processor time is all that the process
uses, in parts by its threads: the faces that are followed and drawn, the search for others, the decoding of the clip,
which a camera that sends JPEG asks for as well, and outputs.  A file's frame is the same face swapped as `guise swap`
does, decoding apart.  Latency is from the capture of a frame of 640 x 480 to the end of its presentation, as
`guise live` reads it out, while the file plays at its own pace of 30 frames a second.  The window is on a virtual
display and drawn by software GL.  Rounds of all ways alternate, each with a pass that only decodes the clip.  One
thread for matrix work, as in the command.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.live.runs import PARTS, Noted, Scene, display, large, larger, played, small, used, window
from guise.aam.landmarks import open_landmarker
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.live.capture import FileCapture
from guise.app.live.output import Output
from guise.app.live.stats import PipelineStats
from guise.common.threads import one_thread

ROUNDS = 5
ROUND_FRAMES = 300
WARM_UP_FRAMES = 30  # that are not counted
FPS_TARGETS = {"640x480": 60.0, "1280x720": 40.0, "1920x1080": 45.0}
PROCESSOR_TARGETS_MS = {"640x480": 6.0, "1280x720": 9.0}
SPLIT = (*dict.fromkeys(PARTS.values()), "output")
LATENCIES, LATENCY_TARGETS_MS = ("median", "95th percentile"), (20.0, 33.0)
OWN_TARGETS = (1.5, 2.5)  # latencies over a file's frame
FILE, DECODED = "a file's frame", "decoded only"
WAYS: dict[str, Callable[[], Output | None]] = {"nowhere": lambda: None, "window": window}


@dataclass(frozen=True)
class Rate:
    """Frames a second that were presented, and milliseconds of the processor that one took, all and in parts.

    covered : frames in which something was covered, though there is nobody but who is swapped.
    """

    fps: float
    processor: float
    parts: tuple[float, ...] = (0.0,) * len(SPLIT)
    covered: int = 0


def sustained(scene: Scene, output: Output | None, frames: int) -> Rate:
    """A round."""
    spent: list[Counter[str]] = []
    with one_thread(), FileCapture(scene.clip.video, loop=True, paced=False) as capture:

        def after() -> None:
            if len(noted.times) in (WARM_UP_FRAMES + 1, WARM_UP_FRAMES + frames):
                spent.append(used())
            if len(spent) == 2:
                capture.stop()

        noted = Noted(output, after)
        played(scene, capture, [noted])
    rate = _rate(noted.times[: WARM_UP_FRAMES + frames], spent[0], spent[1])
    return replace(rate, covered=noted.covered)


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
    times, spent = [], []
    with FileCapture(scene.clip.video, loop=True, paced=False) as capture:
        for _ in islice(capture, WARM_UP_FRAMES + frames):
            times.append(time.perf_counter())
            if len(times) in (WARM_UP_FRAMES + 1, WARM_UP_FRAMES + frames):
                spent.append(used())
    return _rate(times, spent[0], spent[1])


def in_a_file(scene: Scene, frames: int) -> Rate:
    """The same frames swapped as those of a file are; 1000 over the rate is the median time of one."""
    donor, finder = Donor.of(scene.donor), open_landmarker("builtin")
    walls, spent = [], []
    with (
        one_thread(),
        FileCapture(scene.clip.video, loop=True, paced=False) as capture,
        Engine(scene.person, donor, finder) as engine,
    ):
        for frame in islice(capture, WARM_UP_FRAMES + frames):
            wall, processor = time.perf_counter(), time.thread_time()
            engine.swap(frame)
            walls.append(time.perf_counter() - wall)
            spent.append(time.thread_time() - processor)
    own = 1e3 * statistics.mean(spent[WARM_UP_FRAMES:])
    return Rate(1 / statistics.median(walls[WARM_UP_FRAMES:]), own, (own, *(0.0 for _ in SPLIT[1:])))


def _rate(times: list[float], first: Counter[str], last: Counter[str]) -> Rate:
    count = len(times) - 1 - WARM_UP_FRAMES
    processor, *parts = ((last[part] - first[part]) / count for part in ("all", *SPLIT))
    return Rate(count / (times[-1] - times[WARM_UP_FRAMES]), processor, tuple(parts))


def measure(options: argparse.Namespace) -> Report:
    """All ways, in turns."""
    frames = 60 if options.quick else ROUND_FRAMES
    found: dict[tuple[str, str], list[Rate]] = {}
    late: dict[str, list[PipelineStats]] = {way: [] for way in WAYS}
    with display(), tempfile.TemporaryDirectory() as folder:
        scenes = [small(), big := large(options.shared), larger(big, Path(folder))]
        for turn in range(1 if options.quick else ROUNDS):
            for scene in scenes:
                for way, make in WAYS.items():
                    found.setdefault((scene.label, way), []).append(sustained(scene, make(), frames))
                found.setdefault((scene.label, FILE), []).append(in_a_file(scene, frames))
                found.setdefault((scene.label, DECODED), []).append(decoded(scene, frames))
                common.say(f"round {turn + 1}: {scene.label}")
            for way, make in WAYS.items():
                late[way].append(at_own_pace(scenes[0], make(), frames))
    return report(found, late)


def report(found: dict[tuple[str, str], list[Rate]], late: dict[str, list[PipelineStats]]) -> Report:
    """From the rates of the rounds by picture size and way, and the rounds at the file's pace by way."""
    fps = {key: statistics.median(rate.fps for rate in rates) for key, rates in found.items()}
    spent = {key: statistics.median(rate.processor for rate in rates) for key, rates in found.items()}
    rows = [
        (
            size, way, fps[size, way], spent[size, way],
            *(statistics.median(parts) for parts in zip(*(rate.parts for rate in found[size, way]), strict=True)),
            fps[size, way] / fps[size, DECODED],
        )
        for size, way in fps
    ]  # fmt: skip
    columns = ("picture", "to", "frames a second", "processor, ms a frame", *SPLIT, "of decoding alone")
    rounds = len(next(iter(found.values())))
    delays = [
        (
            way, statistics.median(one.latency for one in some), statistics.median(one.latency_95 for one in some),
            sum(one.dropped + one.skipped for one in some),
        )
        for way, some in late.items()
    ]  # fmt: skip
    own = {way: 1e3 / fps[size, FILE] for size, way in fps if size == "640x480" and (size, FILE) in fps}
    return Report(
        "live.throughput", "Live: rate, processor time and latency",
        [
            Criterion(f"{size}, to {way}", fps[size, way], ">=", FPS_TARGETS[size], "fps")
            for size, way in fps if way in WAYS
        ] + [
            Criterion(f"latency to {way}, {what}", measured, "<=", target, "ms")
            for way, *measures, _ in delays
            for what, measured, target in zip(LATENCIES, measures, LATENCY_TARGETS_MS, strict=True)
        ] + [
            Criterion(f"{size}, to nowhere, processor a frame", spent[size, "nowhere"], "<=", target, "ms")
            for size, target in PROCESSOR_TARGETS_MS.items() if (size, "nowhere") in spent
        ] + [
            Criterion(
                "frames with a cover, though nobody else is there",
                float(sum(rate.covered for rates in found.values() for rate in rates)), "<=", 0.0,
            )
        ] + [
            Criterion(f"latency to nowhere over {FILE}, {what}", measured / own[way], "<=", target)
            for way, *measures, _ in delays if way == "nowhere" and way in own
            for what, measured, target in zip(LATENCIES, measures, OWN_TARGETS, strict=True)
        ],
        [
            Table(f"Median of {rounds} rounds", columns, rows),
            Table("Latency at the file's pace", ("to", *(f"{what}, ms" for what in LATENCIES), "dropped"), delays),
        ],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
