"""File to file: a 720p clip with sound swapped by the command, compared with ffmpeg's transcoding and with deface.

All write H.264; Guise and ffmpeg use libx264, preset veryfast, crf 20, and copy the sound; both models are given.
Times are wall times of whole processes, start-up included.  Guise and ffmpeg alternate, and their ratio is the median
over the rounds, so that other load on the machine weighs on both.  deface, which takes minutes, runs between them, and
its ratio is to the median of Guise's times of the same run.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks import common
from benchmarks.children import GUISE, Ran, ffmpeg, ran
from benchmarks.common import Criterion, Report, Table

CLIP, DONOR = "room_s18", "studio_d7"
ROUNDS = 9
SMALL = "640x360"
Command = Sequence[str | Path]


def commands(video: Path, models: tuple[Path, Path], folder: Path) -> dict[str, Command]:
    """What alternates."""
    source, donor = models
    given = ("--source", source, "--identity", donor, "--crf", "20", "--quiet", "--force")
    encode = ("-c:v", "libx264", "-preset", "veryfast", "-crf", "20")
    return {
        "ffmpeg": ffmpeg("-i", video, *encode, "-c:a", "copy", folder / "ffmpeg.mp4"),
        "guise swap": (*GUISE, "swap", video, *given, "-o", folder / "guise.mp4"),
    }


def deface_commands(python: Path, video: Path, folder: Path) -> dict[str, Command]:
    """What runs once."""
    program = python.with_name("deface")
    return {
        f"deface -s {SMALL}": (program, video, "--scale", SMALL, "-o", folder / "small.mp4"),
        "deface": (program, video, "-o", folder / "deface.mp4"),
    }


def measure(options: argparse.Namespace) -> Report:
    """Alternating runs, with the peers between them."""
    clip, donor_clip = (common.real_clip(options.shared, name) for name in (CLIP, DONOR))
    runs: dict[str, list[Ran]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        models = folder / "source.guise", folder / "donor.guise"
        common.enrolled(clip).save(models[0])
        common.enrolled(donor_clip).save(models[1])
        peers = deface_commands(options.peers_python, clip.video, folder) if options.peers_python else {}
        waiting = list(peers.items())[: 1 if options.quick else None]
        alternating = commands(clip.video, models, folder)
        for key in alternating:  # files are read and programs loaded once before anything counts
            ran(alternating[key])
        for _ in range(1 if options.quick else ROUNDS):
            for key, command in alternating.items():
                runs.setdefault(key, []).append(ran(command))
                common.say(f"{key}: {runs[key][-1].seconds:.2f} s")
            if waiting:
                key, command = waiting.pop(0)
                runs[key] = [ran(command)]
                common.say(f"{key}: {runs[key][-1].seconds:.2f} s")
    return summary(runs, len(clip.points))


def summary(runs: dict[str, list[Ran]], frames: int) -> Report:
    """Ratios, and a row for each command."""
    seconds = {key: [r.seconds for r in some] for key, some in runs.items()}
    middle = {key: statistics.median(values) for key, values in seconds.items()}
    pairs = zip(seconds["guise swap"], seconds["ffmpeg"], strict=True)
    criteria = [Criterion("our time over ffmpeg's", statistics.median(a / b for a, b in pairs), "<=", 1.5)]
    for key, target in (("deface", 15.0), (f"deface -s {SMALL}", 5.0)):
        if key in middle:
            criteria.append(
                Criterion(f"time of {key} over ours", middle[key] / middle["guise swap"], ">=", target)
            )
    rows = [
        (
            key, middle[key], min(seconds[key]), max(seconds[key]), frames / middle[key],
            statistics.median(r.processor for r in some), len(some),
        )
        for key, some in runs.items()
    ]  # fmt: skip
    columns = ("command", "median, s", "least, s", "most, s", "frames a second", "processor, s", "runs")
    notes = (
        []
        if "deface" in middle
        else ["deface was not measured in full: give --peers-python, without --quick."]
    )
    table = Table(f"{CLIP}, 1280 x 720, {frames} frames, with sound", columns, rows)
    return Report("file_to_file", "File to file", criteria, [table], notes)


if __name__ == "__main__":
    common.run(measure, common.with_peers(common.arguments(__doc__)))
