"""Speed at 720p on one thread: refine per face, detect per frame, compared with MediaPipe in the same run.

All see the same frames, decoded beforehand, in alternating blocks; the first block of each is thrown away.  MediaPipe
follows its face in video mode, on as many threads as it likes, in a process of its own; its time is that of the search
alone.

Targets are for one core, and judged by processor time, all threads of a process together, which other load on the
machine hardly changes; the time on the clock stands beside it, and is the same on an idle machine for one thread.
"""

from __future__ import annotations

from benchmarks.threads import one_thread

if __name__ == "__main__":
    one_thread("benchmarks.landmarks.speed")

import argparse
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Picture, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.peers import MISSING, Peer
from guise.aam.landmarks import Face

NAME, TITLE = "landmarks.speed", "Landmarker speed"
CLIP = "room_s18"
BLOCK_FRAMES = 30  # frames
BLOCKS = 9  # 270 frames of the clip's 282
DETECT_EVERY = 3
Times = tuple[float, float]  # milliseconds on the clock, of the processor
REFINE, DETECT, BOXES, MEDIAPIPE = (
    "refine, a face",
    "detect, a frame",
    "its detector alone",
    "MediaPipe, a frame",
)


def clocked(action: Callable[[], Any]) -> tuple[Any, Times]:
    """What an action gives, and its milliseconds on the clock and of the processor."""
    start, begun = time.perf_counter(), time.process_time()
    answer = action()
    return answer, (1e3 * (time.perf_counter() - start), 1e3 * (time.process_time() - begun))


def refined(landmarker: Any, frames: list[Picture], face: Face) -> tuple[list[Times], Face]:
    """Milliseconds of following a face through frames, and the face in the last; found anew, unclocked, when lost."""
    times = []
    for rgb in frames:
        found, spent = clocked(partial(landmarker.refine, rgb, face))
        if found is not None:
            times.append(spent)
        face = found or next(iter(landmarker.detect(rgb)), face)
    return times, face


def row(name: str, times: list[Times]) -> tuple[object, ...]:
    """Median and 95th percentile of processor and clock."""
    clock, processor = np.array(times).T
    values = (float(f) for v in (processor, clock) for f in (np.median(v), np.quantile(v, 0.95)))
    return name, *values, len(times)


def measure(options: argparse.Namespace) -> Report:
    """Alternating blocks."""
    if not (options.shared / "data" / "real" / f"{CLIP}.mp4").is_file():
        return setting.skipped(NAME, TITLE, f"{CLIP} is not in {options.shared / 'data' / 'real'}")
    landmarker: Any = setting.landmarker(options)
    frames = common.frames(common.real_clip(options.shared, CLIP))
    detector = getattr(landmarker, "detector", None)
    times: dict[str, list[Times]] = {name: [] for name in (REFINE, DETECT, BOXES, MEDIAPIPE)}
    with ExitStack() as stack:
        peer = None
        if options.peers_python:
            model = options.shared / "models" / setting.MEDIAPIPE
            peer = stack.enter_context(Peer(options.peers_python, "video", model))
        face = None
        for block in range(3 if options.quick else BLOCKS):
            pictures = [frame.rgb() for frame in islice(frames, BLOCK_FRAMES)]
            face = face or next(iter(landmarker.detect(pictures[0])), None)
            if face is None:
                return setting.skipped(NAME, TITLE, f"{landmarker.name} finds no face in {CLIP}")
            spent: dict[str, list[Times]] = {REFINE: [], DETECT: [], BOXES: [], MEDIAPIPE: []}
            spent[REFINE], face = refined(landmarker, pictures, face)
            for rgb in pictures[::DETECT_EVERY]:
                spent[DETECT].append(clocked(partial(landmarker.detect, rgb))[1])
                if detector is not None:
                    spent[BOXES].append(clocked(partial(detector.detect, rgb))[1])
            spent[MEDIAPIPE] = [peer.ask(rgb)[1] for rgb in pictures] if peer else []
            for name in times if block else ():
                times[name] += spent[name]
    return summary(times)


def summary(times: dict[str, list[Times]]) -> Report:
    """Criteria; the ratio only where the peer ran."""
    report = Report(NAME, TITLE)
    rows = [row(name, values) for name, values in times.items() if values]
    median = {str(name): (float(processor), float(clock)) for name, processor, _, clock, *_ in rows}  # type: ignore[arg-type]
    missing = (float("nan"), float("nan"))
    report.criteria = [
        Criterion("refine, a face, one core, median", median.get(REFINE, missing)[0], "<=", 4.0, "ms"),
        Criterion("detect at 720p, one core, median", median.get(DETECT, missing)[0], "<=", 15.0, "ms"),
    ]
    if MEDIAPIPE in median:
        ours, theirs = median.get(REFINE, missing), median[MEDIAPIPE]
        report.criteria += [
            Criterion("MediaPipe's processor time over that of refine", theirs[0] / ours[0], ">=", 3.0),
            Criterion("MediaPipe's time on the clock over that of refine", theirs[1] / ours[1], ">=", 3.0),
        ]
    else:
        report.notes.append(MISSING.format("MediaPipe"))
    columns = (
        "what", "processor, median, ms", "processor, 95th percentile, ms", "clock, median, ms",
        "clock, 95th percentile, ms", "times taken",
    )  # fmt: skip
    report.tables = [Table(f"{CLIP}, 1280 x 720, decoded beforehand", columns, rows)]
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
