"""Enrolment of 20 s clips by the command: wall time of the whole process, and its peak resident memory.

The landmarks are given.  One clip is 20 s long; the other is 720p, repeated to 20 s.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import GUISE, Ran, looped, ran
from benchmarks.common import Clip, Criterion, Report, Table

NATIVE, LOOPED = "address_o1", "room_s18"
CLIP_SECONDS = 20.0
ROUNDS = 3


def prepared(clip: Clip, folder: Path) -> tuple[Path, Path, int]:
    """A 20 s video, its landmark file and the number of its frames."""
    video = looped(clip.video, CLIP_SECONDS, folder / f"{clip.name}.mp4")
    count = sum(1 for _ in common.frames(Clip(clip.name, video, clip.points)))
    file = folder / f"{clip.name}.landmarks.npz"
    np.savez(file, face81=clip.points[np.arange(count) % len(clip.points)].astype(np.float32))
    return video, file, count


def enrolments(video: Path, landmarks: Path, rounds: int) -> list[Ran]:
    """Repeated runs of the command."""
    output = video.with_suffix(".guise")
    command = (*GUISE, "enroll", video, "--landmarks", landmarks, "-o", output, "--quiet", "--force")
    return [ran(command) for _ in range(rounds)]


def measure(options: argparse.Namespace) -> Report:
    """Both clips."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in (NATIVE, LOOPED):
            video, landmarks, count = prepared(common.real_clip(options.shared, name), Path(folder))
            runs = enrolments(video, landmarks, 1 if options.quick else ROUNDS)
            seconds = [r.seconds for r in runs]
            peak, size = max(r.peak_mb for r in runs), video.with_suffix(".guise").stat().st_size / 2**20
            rows.append((name, count, statistics.median(seconds), max(seconds), peak, size))
    return Report(
        "enrolment",
        "Enrolment of a 20 s clip",
        [
            Criterion("time, slower clip, median", max(r[2] for r in rows), "<=", 20.0, "s"),
            Criterion("peak memory, larger", max(r[4] for r in rows), "<=", 1536.0, "MB"),
        ],
        [
            Table(
                "Each clip", ("clip", "frames", "median, s", "most, s", "peak memory, MB", "model, MB"), rows
            )
        ],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
