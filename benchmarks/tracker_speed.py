"""Tracker time per frame on one thread, compared with MediaPipe's Face Landmarker in the same run.

Both see the same frames of a 720p clip, decoded beforehand; passes alternate, and figures are medians over all frames
of all passes but the first.  Guise tracks its person on one thread; MediaPipe uses as many threads as it chooses.
"""

from __future__ import annotations

from benchmarks.threads import one_thread

if __name__ == "__main__":
    one_thread("benchmarks.tracker_speed")

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import PeerProcess
from benchmarks.common import F64, Criterion, Picture, Report, Table
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker

CLIP = "room_s18"
FRAMES = 90
PASSES = 6
PEER_SCRIPT = Path(__file__).with_name("peer_mediapipe.py")


class MediaPipe(PeerProcess):
    """MediaPipe, which waits for passes."""

    def once(self) -> tuple[F64, int]:
        """Milliseconds of every frame, and in how many a face was found."""
        self.send(b"go\n")
        answer = json.loads(self.line())
        return np.array(answer["ms"]), int(answer["found"])


def ours(person: Identity, lumas: list[Picture]) -> tuple[F64, int]:
    """Milliseconds of every frame after the first, which is a detection, and the frames with the face found."""
    person_tracker, times, found = PersonTracker(person.tracker, common.detector()), [], 0
    for luma in lumas:
        start = time.perf_counter()
        fit = person_tracker.update(luma)
        times.append(1e3 * (time.perf_counter() - start))
        found += common.shape_of(fit) is not None
    return np.array(times[1:]), found


def row(name: str, passes: list[tuple[F64, int]]) -> tuple[object, ...]:
    """Median, 95th percentile, frames with a face per pass."""
    times = np.concatenate([p[0] for p in passes])
    return name, float(np.median(times)), float(np.quantile(times, 0.95)), passes[-1][1]


def measure(options: argparse.Namespace) -> Report:
    """Alternating passes."""
    clip = common.real_clip(options.shared, CLIP)
    person = common.enrolled(clip)
    kept = [frame for frame, _ in zip(common.frames(clip), range(FRAMES), strict=False)]
    lumas, pictures = [frame.luma.copy() for frame in kept], np.stack([frame.rgb() for frame in kept])
    del kept
    mine, theirs = [], []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "frames.npy"
        np.save(file, pictures)
        del pictures
        if options.peers_python is None:
            mine = [ours(person, lumas) for _ in range(PASSES)]
        else:
            with MediaPipe(
                options.peers_python, PEER_SCRIPT, options.shared / "models" / "face_landmarker.task", file
            ) as peer:
                for _ in range(2 if options.quick else PASSES):
                    mine.append(ours(person, lumas))
                    theirs.append(peer.once())
    return summary(mine[1:], theirs[1:])


def summary(mine: list[tuple[F64, int]], theirs: list[tuple[F64, int]]) -> Report:
    """Criteria; the ratio only where the peer ran."""
    rows = [row("Guise, one thread", mine)] + ([row("MediaPipe Face Landmarker", theirs)] if theirs else [])
    report = Report("tracker_speed", "Tracker speed")
    report.criteria = [Criterion("time per frame, one thread, median", float(rows[0][1]), "<=", 1.5, "ms")]
    if theirs:
        report.criteria.append(
            Criterion("MediaPipe's time over ours", float(rows[1][1]) / float(rows[0][1]), ">=", 12.0)
        )
    else:
        report.notes.append("MediaPipe was not measured: give --peers-python.")
    columns = ("tracker", "median, ms", "95th percentile, ms", f"faces in {FRAMES} frames")
    report.tables = [Table(f"Per frame of {CLIP}, 1280 x 720, decoded beforehand", columns, rows)]
    return report


if __name__ == "__main__":
    common.run(measure, common.with_peers(common.arguments(__doc__)))
