"""Memory over a long video: a 720p clip repeated to ten minutes and swapped by the command, models given.

Resident memory of the process is sampled twice a second.  It is flat when the median of the last fifth of the run
exceeds that of the second fifth by no more than 5 %.  The preset is ultrafast, which changes the encoder's memory, so
a minute is also run with the default preset for its peak.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import GUISE, Ran, looped, ran
from benchmarks.common import Criterion, Report, Table

CLIP, DONOR = "room_s18", "studio_d7"
SAMPLE_SECONDS = 0.5  # seconds
DEFAULT_PRESET_MINUTES = 1.0


def swapped(video: Path, models: tuple[Path, Path], preset: str) -> Ran:
    """One run of the command, with samples."""
    given = ("--source", models[0], "--identity", models[1], "--preset", preset, "--quiet", "--force")
    return ran((*GUISE, "swap", video, *given, "-o", video.with_name("out.mp4")), SAMPLE_SECONDS)


def fifth(run: Ran, number: int) -> float:
    """Median MB in a fifth (0-4) of the run's time."""
    low, high = (run.seconds * (number + k) / 5 for k in (0, 1))
    inside = [mb for at, mb in run.samples if low <= at < high]
    return float(np.median(inside)) if inside else float("nan")


def measure(options: argparse.Namespace) -> Report:
    """The long run, and the short one with the default preset."""
    clip, donor_clip = (common.real_clip(options.shared, name) for name in (CLIP, DONOR))
    minutes = 0.5 if options.quick else options.minutes
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        models = folder / "source.guise", folder / "donor.guise"
        common.enrolled(clip).save(models[0])
        common.enrolled(donor_clip).save(models[1])
        long = swapped(looped(clip.video, 60 * minutes, folder / "long.mp4"), models, "ultrafast")
        part = min(minutes, DEFAULT_PRESET_MINUTES)
        short = swapped(looped(clip.video, 60 * part, folder / "short.mp4"), models, "veryfast")
    rows = [
        (f"{length:g} min, {preset}", r.peak_mb, *(fifth(r, k) for k in range(5)), r.seconds)
        for length, preset, r in ((minutes, "ultrafast", long), (part, "veryfast", short))
    ]
    columns = ("run", "peak, MB", *(f"fifth {k + 1}, MB" for k in range(5)), "seconds")
    return Report(
        "memory",
        f"Memory over {minutes:g} minutes of 720p",
        [
            Criterion("peak, either run", max(long.peak_mb, short.peak_mb), "<=", 500.0, "MB"),
            Criterion("last fifth over the second", fifth(long, 4) / fifth(long, 1), "<=", 1.05),
        ],
        [Table("Resident memory", columns, rows)],
    )


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="length of the long run")
    common.run(measure, parser)
