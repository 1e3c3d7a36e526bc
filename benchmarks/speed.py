"""`guise swap` as fast as the codec allows: its time over ffmpeg's transcode of the same file with the same settings.

Guise and ffmpeg alternate, and ratios are medians over the rounds, so that other load on the machine weighs on both.
Clips: room_s18 (720p), the same ten times over, and two made from it by ffmpeg in which the face is 420 pixels wide
(1080p) and 800 pixels wide (4K).  The first packet is timed from the start of the process to the moment at which the
first encoded picture is handed to the container; beyond the lookahead, to that at which the encoder gets its first
frame.  Besides, the work of a frame of room_s18 in memory beside another
revision, and its instructions: see `benchmarks.frame_work`.
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

from benchmarks import common, frame_work
from benchmarks.children import Ran, ffmpeg, looped, ran
from benchmarks.common import Clip, Criterion, Report, Table

CLIP, DONOR = "room_s18", "studio_d7"
MEMORY = "720p in memory"
BESIDE = "323e094"  # the last revision before the picture was bought with time
ROUNDS = 5
SECONDS = 9.4  # of CLIP
ENCODE = ("-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-c:a", "copy")
# As GUISE, writing the times of the first frame that is encoded and of the first packet to a file.
TIMED = """
import os, sys, time
from guise.app.cli.main import main
from guise.app.media.sink import VideoOutput, VideoSink

mux, write, times = VideoOutput._mux, VideoSink.write, []

def note(is_next):
    if is_next:
        times.append(time.monotonic())
        open(os.environ["FIRST_TIMES"], "w").write(" ".join(map(str, times)))

def timed_mux(self, packets):
    packets = list(packets)
    mux(self, packets)
    note(packets and len(times) == 1)

def timed_write(self, frame):
    note(not times)
    write(self, frame)

VideoOutput._mux, VideoSink.write = timed_mux, timed_write
raise SystemExit(main())
"""


@dataclass(frozen=True)
class Round:
    """One transcode and one swap; seconds until the swap's encoder has its first frame, and gives its first packet."""

    transcode: Ran
    swap: Ran
    first_frame: float
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
    given = ("--source", models[0], "--identity", models[1], "--crf", "20", "--json", "--force")
    start = time.monotonic()
    swap = ran(
        (sys.executable, "-c", TIMED, "swap", video, *given, "-o", folder / "guise.mp4"),
        output=printed, environment={"FIRST_TIMES": str(first)},
    )  # fmt: skip
    idle = json.loads(printed.read_text())["encoder_idle_share"]
    return Round(transcode, swap, *(float(at) - start for at in first.read_text().split()), idle)


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
        "first packet beyond x264's lookahead, s": statistics.median(r.first_frame for r in rounds),
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
        frame_work.enrol((clip.video, donor_clip.video), models)
        one_round(clip.video, models, folder)
        for key, make in makers(clip).items():
            if key not in (("720p",) if options.quick else options.clips or makers(clip)):
                continue
            video, count = make(folder), 1 if options.quick else options.rounds
            found[key] = figures([one_round(video, models, folder) for _ in range(count)])
            common.say(f"{key}: {found[key]}")
        if not options.quick and MEMORY in (options.clips or [MEMORY]):
            found[MEMORY] = frame_work.figures(
                (clip.video, donor_clip.video), options.beside or BESIDE, folder
            )
    return summary(found)


TARGETS = (
    ("720p", "wall over transcode", 1.7),
    ("720p", "processor over transcode", 1.6),
    ("720p", "first packet beyond x264's lookahead, s", 0.35),
    ("720p", "encoder idle share", 0.05),
    ("720p", "peak, MB", 320.0),
    ("720p, ten times", "processor over transcode", 1.5),
    ("1080p, face 420", "wall over transcode", 1.3),
    ("4K, face 800", "wall over transcode", 1.2),
    ("4K, face 800", "peak, MB", 900.0),
    (MEMORY, "processor of a frame over " + BESIDE, 0.34),
    (MEMORY, "instructions of a frame over " + BESIDE, 0.34),
    (MEMORY, "instructions a frame, millions", 53.0),
)


def summary(found: dict[str, dict[str, float]]) -> Report:
    """Targets, and every figure."""
    rows = [(clip, what, value) for clip, values in found.items() for what, value in values.items()]
    return Report(
        "speed",
        "As fast as the codec allows",
        [Criterion(f"{c}: {w}", found[c][w], "<=", t) for c, w, t in TARGETS if w in found.get(c, {})],
        [Table("Medians", ("clip", "what", "measured"), rows)],
    )


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="swaps and transcodes of each clip")
    parser.add_argument("--clips", nargs="+", metavar="NAME", help=f'some of them, such as "{MEMORY}"')
    parser.add_argument("--beside", metavar="REVISION", type=frame_work.known, help=f"(default: {BESIDE})")
    common.run(measure, parser)
