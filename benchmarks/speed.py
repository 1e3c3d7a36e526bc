"""`guise swap` as fast as the codec allows: its time over ffmpeg's transcode of the same file with the same settings.

Guise and ffmpeg alternate, and ratios are medians over the rounds, so that other load on the machine weighs on both.
Clips: room_s18 (720p), the same ten times over, and two made from it by ffmpeg in which the face is 420 pixels wide
(1080p) and 800 pixels wide (4K).  The first packet is timed from the start of the process to the moment at which the
first encoded picture is handed to the container.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import Ran, ffmpeg, looped, ran
from benchmarks.common import Clip, Criterion, Report, Table

CLIP, DONOR = "room_s18", "studio_d7"
ROUNDS = 5
SECONDS = 9.4  # of CLIP
ENCODE = ("-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-c:a", "copy")
# As GUISE, writing the time of the first packet to a file.
TIMED = """
import os, sys, time
from guise.app.cli.main import main
import guise.app.media.sink as sink

plain, file = sink.VideoOutput._mux, os.environ["FIRST_PACKET"]

def timed(self, packets):
    packets = list(packets)
    plain(self, packets)
    if packets and not os.path.exists(file):
        open(file, "w").write(str(time.monotonic()))

sink.VideoOutput._mux = timed
raise SystemExit(main())
"""
# In a process of its own: Linux counts what the parent held when it started a child to the child's peak.
ENROL = """
import sys
from pathlib import Path
from benchmarks import common

common.enrolled(common.clip_at(Path(sys.argv[1]))).save(Path(sys.argv[2]))
"""


@dataclass(frozen=True)
class Round:
    """One transcode and one swap; seconds until the swap's first packet, and its encoder's idle share."""

    transcode: Ran
    swap: Ran
    first_packet: float
    idle: float


def enlarged(clip: Clip, size: tuple[int, int], face: float, seconds: float, output: Path) -> Path:
    """A part of a clip enlarged to a size, in which the face is so many pixels wide."""
    low, high = np.nanmin(clip.points, (0, 1)), np.nanmax(clip.points, (0, 1))
    scale = face / float(np.nanmean(np.ptp(clip.points[:, :, 0], axis=1)))
    width, height = (2 * round(side / scale / 2) for side in size)
    x, y = (max(0, round(c - side / 2)) for c, side in zip((low + high) / 2, (width, height), strict=True))
    part = f"crop=min({width}\\,iw):min({height}\\,ih):{x}:{y},scale={size[0]}:{size[1]}:flags=bicubic"
    fast = ("-c:v", "libx264", "-preset", "veryfast", "-crf", "18", "-c:a", "copy", "-t", f"{seconds:g}")
    ran(ffmpeg("-i", clip.video, "-vf", part, *fast, output))
    return output


def one_round(video: Path, models: tuple[Path, Path], folder: Path) -> Round:
    """Both, one after the other."""
    transcode = ran(ffmpeg("-i", video, *ENCODE, folder / "ffmpeg.mp4"))
    first, printed = folder / "first", folder / "report.json"
    first.unlink(missing_ok=True)
    given = ("--source", models[0], "--identity", models[1], "--crf", "20", "--json", "--force")
    start = time.monotonic()
    swap = ran(
        (sys.executable, "-c", TIMED, "swap", video, *given, "-o", folder / "guise.mp4"),
        output=printed, environment={"FIRST_PACKET": str(first)},
    )  # fmt: skip
    idle = json.loads(printed.read_text())["encoder_idle_share"]
    return Round(transcode, swap, float(first.read_text()) - start, idle)


def makers(clip: Clip) -> dict[str, Callable[[Path], Path]]:
    """What is swapped, by name: how it is made in a folder."""
    return {
        "720p": lambda folder: clip.video,
        "720p, ten times": lambda folder: looped(clip.video, 10 * SECONDS, folder / "long.mp4"),
        "1080p, face 420": lambda folder: enlarged(clip, (1920, 1080), 420, SECONDS, folder / "hd.mp4"),
        "4K, face 800": lambda folder: enlarged(clip, (3840, 2160), 800, 4, folder / "uhd.mp4"),
    }


def figures(rounds: list[Round]) -> dict[str, float]:
    """Medians over the rounds."""
    return {
        "wall over transcode": statistics.median(r.swap.seconds / r.transcode.seconds for r in rounds),
        "processor over transcode": statistics.median(
            r.swap.processor / r.transcode.processor for r in rounds
        ),
        "first packet, s": statistics.median(r.first_packet for r in rounds),
        "encoder idle share": statistics.median(r.idle for r in rounds),
        "peak, MB": max(r.swap.peak_mb for r in rounds),
        "processor of the transcode, s": statistics.median(r.transcode.processor for r in rounds),
    }


def measure(options: argparse.Namespace) -> Report:
    """Every clip in turn, after a round of the first that does not count."""
    clip, donor_clip = (common.real_clip(options.shared, name) for name in (CLIP, DONOR))
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        models = folder / "source.guise", folder / "donor.guise"
        for one, model in zip((clip, donor_clip), models, strict=True):
            ran((sys.executable, "-c", ENROL, one.video, model))
        one_round(clip.video, models, folder)
        for key, make in makers(clip).items():
            if key not in (("720p",) if options.quick else options.clips or makers(clip)):
                continue
            video, count = make(folder), 1 if options.quick else options.rounds
            found[key] = figures([one_round(video, models, folder) for _ in range(count)])
            common.say(f"{key}: {found[key]}")
    return summary(found)


TARGETS = (
    ("720p", "wall over transcode", 1.25),
    ("720p", "processor over transcode", 1.30),
    ("720p", "first packet, s", 0.35),
    ("720p", "encoder idle share", 0.05),
    ("720p", "peak, MB", 350.0),
    ("720p, ten times", "wall over transcode", 1.15),
    ("1080p, face 420", "wall over transcode", 1.3),
    ("4K, face 800", "wall over transcode", 1.3),
    ("4K, face 800", "peak, MB", 900.0),
)


def summary(found: dict[str, dict[str, float]]) -> Report:
    """Targets, and every figure."""
    rows = [(clip, what, value) for clip, values in found.items() for what, value in values.items()]
    return Report(
        "speed",
        "As fast as the codec allows",
        [Criterion(f"{c}: {w}", found[c][w], "<=", t) for c, w, t in TARGETS if c in found],
        [Table("Medians", ("clip", "what", "measured"), rows)],
    )


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="swaps and transcodes of each clip")
    parser.add_argument("--clips", nargs="+", metavar="NAME", help='some of them, such as "4K, face 800"')
    common.run(measure, parser)
