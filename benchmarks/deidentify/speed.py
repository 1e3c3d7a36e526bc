"""Speed of a de-identification: both passes and the audit beside a transcode, `deface` beside it.

room_s18 is 1280 x 720 with sound, 282 frames.  The commands run in turns, several times; medians are compared, as the
machine may be noisy; deface runs once.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path

from benchmarks import common
from benchmarks.children import CommandError, Ran, ffmpeg, ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.guise import done, guise_command

ROUNDS = 3


def deface(python: Path, video: Path, output: Path, *more: str) -> Ran:
    """De-identify with deface, keeping the sound."""
    return ran([python.with_name("deface"), video, "-o", output, "--keep-audio", *more])


def measure(options: argparse.Namespace) -> Report:
    """Time all of them."""
    video = options.shared / "data" / "real" / "room_s18.mp4"
    transcodes, ours = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for turn in range(1 if options.quick else ROUNDS):
            copy = folder / f"copy{turn}.mp4"
            transcodes.append(
                ran(
                    ffmpeg(
                        "-i",
                        video,
                        "-c:v",
                        "libx264",
                        "-preset",
                        "veryfast",
                        "-crf",
                        "20",
                        "-c:a",
                        "copy",
                        copy,
                    )
                )
            )
            ours.append(done(guise_command(video, folder / f"ours{turn}.mp4", "--crf", "20")))
            common.say(f"transcode {transcodes[-1].seconds:.1f} s, guise {ours[-1].seconds:.1f} s")
        peers = {}
        if options.peers_python:
            for label, more in {"deface": (), "deface -s 640x360": ("-s", "640x360")}.items():
                try:
                    peers[label] = deface(options.peers_python, video, folder / "peer.mp4", *more).seconds
                except CommandError as error:
                    common.say(str(error))
    return _report(transcodes, ours, peers)


def _report(transcodes: list[Ran], ours: list[Ran], peers: dict[str, float]) -> Report:
    base, own = (statistics.median(r.seconds for r in runs) for runs in (transcodes, ours))
    rows: list[tuple[object, ...]] = [
        ("ffmpeg, libx264 veryfast, crf 20", base, statistics.median(r.processor for r in transcodes), 1.0),
        ("guise deidentify", own, statistics.median(r.processor for r in ours), own / base),
        *((label, seconds, "", seconds / base) for label, seconds in peers.items()),
    ]
    criteria = [Criterion("time over a transcode", own / base, "<=", 3.0)]
    if "deface" in peers:
        criteria.append(Criterion("deface's time over it", peers["deface"] / own, ">=", 6.0))
    if "deface -s 640x360" in peers:
        criteria.append(
            Criterion("deface -s 640x360's time over it", peers["deface -s 640x360"] / own, ">=", 2.0)
        )
    columns = ("command", "seconds", "processor seconds", "over a transcode")
    table = Table(f"room_s18, wall seconds, median of {len(ours)}", columns, rows)
    return Report("deidentify.speed", "De-identification: speed", criteria, [table])


if __name__ == "__main__":
    common.run(measure, common.with_peers(common.arguments(__doc__)))
