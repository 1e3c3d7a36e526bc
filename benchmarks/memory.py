"""Memory of three commands over a long video, models given: resident memory of the process, sampled twice a second.

`guise swap` gets a 720p clip repeated to ten minutes (`--minutes`); the preset is ultrafast, which changes the
encoder's memory, so a minute is also run with the default one for its peak.  `guise live` gets the same, without a
window.  `guise deidentify` gets the clip enlarged to 1920 x 1080 and as long, and a third as long, which has the same
peak.  Memory is flat when the median of the last part of the run exceeds that of the second by no more than 5 %: fifths
of a swap and of a live run, sixths of the second half of a de-identification, in which it renders.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import GUISE, Ran, looped, ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.guise import CLIP, done, enlarged, guise_command, long_clip
from benchmarks.frame_work import enrol

DONOR = "studio_d7"
SAMPLE_SECONDS = 0.5
DEFAULT_PRESET_MINUTES = 1.0
MAX_GROWTH = 1.05


def swapped(command: Sequence[str | Path], output: Path, models: tuple[Path, Path], preset: str) -> Ran:
    """One run of `guise swap` or `guise live`, with samples."""
    given = ("--source", models[0], "--identity", models[1], "--encoder-preset", preset, "--quiet", "--force")
    return ran((*GUISE, *command, *given, "-o", output), SAMPLE_SECONDS)


def part(run: Ran, first: float, last: float) -> float:
    """Median MB from one share of a run's time to another."""
    inside = [mb for at, mb in run.samples if first <= at / run.seconds < last]
    return float(np.median(inside)) if inside else float("nan")


def swaps(options: argparse.Namespace, minutes: float, folder: Path) -> dict[str, Ran]:
    """The long swap, the short one with the default preset, and the long live run."""
    clip, donor = (common.real_clip(options.shared, name) for name in (CLIP, DONOR))
    models = folder / "source.guise", folder / "donor.guise"
    enrol((clip.video, donor.video), models)
    few = min(minutes, DEFAULT_PRESET_MINUTES)
    runs = {}
    for length, preset, command in (
        (minutes, "ultrafast", ("swap",)),
        (few, "veryfast", ("swap",)),
        (minutes, "ultrafast", ("live", "--input")),
    ):
        video = looped(clip.video, 60 * length, folder / "in.mp4")
        name = f"{command[0]}, {length:.3g} min, {preset}"
        runs[name] = swapped((*command, video), folder / "out.mp4", models, preset)
    return runs


def deidentifications(options: argparse.Namespace, minutes: float, folder: Path) -> dict[str, Ran]:
    """The long one, and one of a third of its length."""
    large, runs = enlarged(options.shared, folder, options.clip), {}
    for length in (minutes, minutes / 3):
        output = folder / f"out{length:g}.mp4"
        command = guise_command(long_clip(large, length), output, "--encoder-preset", "ultrafast")
        runs[f"deidentify {options.clip}, {length:.3g} min"] = done(command, SAMPLE_SECONDS)
        output.unlink()
    return runs


def measure(options: argparse.Namespace) -> Report:
    """All three commands."""
    minutes = 0.5 if options.quick else options.minutes
    with tempfile.TemporaryDirectory() as name:
        swap = swaps(options, minutes, Path(name))
        other = deidentifications(options, minutes, Path(name))
    (long, short, live), (longer, third) = swap.values(), other.values()
    rows = [
        (name, r.peak_mb, *(part(r, k / 6, (k + 1) / 6) for k in range(6)), r.seconds)
        for name, r in (swap | other).items()
    ]
    growth = [part(run, 0.8, 1) / part(run, 0.2, 0.4) for run in (long, live)]
    growth.append(part(longer, 5 / 6, 1) / part(longer, 4 / 6, 5 / 6))
    return Report(
        "memory", "Memory over long videos",
        [
            Criterion("swap: peak", max(long.peak_mb, short.peak_mb), "<=", 500.0, "MB"),
            Criterion("swap: last fifth over the second", growth[0], "<=", MAX_GROWTH),
            Criterion("live: last fifth over the second", growth[1], "<=", MAX_GROWTH),
            Criterion("deidentify: peak", max(longer.peak_mb, third.peak_mb), "<=", 700.0, "MB"),
            Criterion("deidentify: rendering, last third over the second", growth[2], "<=", MAX_GROWTH),
            Criterion("deidentify: peak over that of a third as long", longer.peak_mb / third.peak_mb, "<=", 1.1),
        ],
        [Table("Resident memory, MB", ("run", "peak", *(f"sixth {k + 1}" for k in range(6)), "seconds"), rows)],
    )  # fmt: skip


if __name__ == "__main__":
    parser = common.arguments(__doc__, minutes=10.0)
    parser.add_argument("--clip", choices=(CLIP, "street_crowd"), default=CLIP, help="that is de-identified")
    common.run(measure, parser)
