"""Memory of a de-identification over a long video of 1920 x 1080: a real clip enlarged and repeated.

Resident memory is sampled.  It is flat when the median over the last third of the second half of the run, in which it
renders, is no more than 5 % over that of the second, and when a run three times as long has the same peak.
room_s18 shows one face, street_crowd five to eight small ones.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import Ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.guise import CLIP, done, enlarged, guise_command, long_clip

SAMPLE_SECONDS = 0.5


def third(run: Ran, number: int) -> float:
    """Median MB in a third (0-2) of the second half of a run, in which it renders."""
    low, high = (run.seconds * (0.5 + (number + k) / 6) for k in (0, 1))
    inside = [mb for at, mb in run.samples if low <= at < high]
    return float(np.median(inside)) if inside else float("nan")


def measure(options: argparse.Namespace) -> Report:
    """One long run, and one of a third of its length."""
    minutes = 0.5 if options.quick else options.minutes
    runs = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        large = enlarged(options.shared, folder, options.clip)
        for length in (minutes / 3, minutes):
            clip = long_clip(large, length)
            output = folder / f"out{length:g}.mp4"
            runs[length] = done(guise_command(clip, output, "--preset", "ultrafast"), SAMPLE_SECONDS)
            output.unlink()
            common.say(f"{length:g} minutes: {runs[length].peak_mb:.0f} MB, {runs[length].seconds:.0f} s")
    rows = [
        (f"{length:.3g} min", r.peak_mb, *(third(r, k) for k in range(3)), r.seconds)
        for length, r in runs.items()
    ]
    short, long = runs.values()
    return Report(
        "deidentify.memory", f"De-identification: memory over {minutes:g} minutes of 1080p, {options.clip}",
        [
            Criterion("peak", max(r.peak_mb for r in runs.values()), "<=", 700.0, "MB"),
            Criterion("rendering: last third over the second", third(long, 2) / third(long, 1), "<=", 1.05),
            Criterion("peak over that of a third of the length", long.peak_mb / short.peak_mb, "<=", 1.1),
        ],
        [Table("Resident memory", ("run", "peak, MB", "first third, MB", "second", "last", "seconds"), rows)],
    )  # fmt: skip


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--minutes", type=float, default=30.0, help="length of the long run")
    parser.add_argument("--clip", choices=(CLIP, "street_crowd"), default=CLIP)
    common.run(measure, parser)
