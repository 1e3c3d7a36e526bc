"""Speed of a de-identification: both passes and the audit beside a transcode, `deface` beside it.

room_s18 is 1280 x 720 with sound, 282 frames.  The commands run in turns, several times; medians are compared, as the
machine may be noisy; deface runs once, and so does everything with two minutes of 1920 x 1080.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path

from benchmarks import common
from benchmarks.children import CommandError, Ran, ffmpeg, ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.guise import CLIP, done, enlarged, guise_command, long_clip

ROUNDS = 3
LONG, LONG_MINUTES = "2 minutes of 1080p", 2.0
ENCODE = ("-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-c:a", "copy")


def deface(python: Path, video: Path, output: Path, *more: str) -> Ran:
    """De-identify with deface, keeping the sound."""
    return ran([python.with_name("deface"), video, "-o", output, "--keep-audio", *more])


def measure(options: argparse.Namespace) -> Report:
    """Time all of them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        short = options.shared / "data" / "real" / f"{CLIP}.mp4"
        runs = {CLIP: _turns(short, folder, 1 if options.quick else ROUNDS)}
        peers = {}
        if options.peers_python:
            for label, more in {"deface": (), "deface -s 640x360": ("-s", "640x360")}.items():
                try:
                    peers[label] = deface(options.peers_python, short, folder / "peer.mp4", *more).seconds
                except CommandError as error:
                    common.say(str(error))
        if not options.quick:
            runs[LONG] = _turns(long_clip(enlarged(options.shared, folder), LONG_MINUTES), folder, 1)
    return _report(runs, peers)


def _turns(video: Path, folder: Path, rounds: int) -> tuple[list[Ran], list[Ran]]:
    """Transcodes of a video, and de-identifications."""
    transcodes, ours = [], []
    for turn in range(rounds):
        transcodes.append(ran(ffmpeg("-i", video, *ENCODE, folder / f"{video.stem}.copy{turn}.mp4")))
        ours.append(done(guise_command(video, folder / f"{video.stem}.ours{turn}.mp4", "--crf", "20")))
        common.say(f"transcode {transcodes[-1].seconds:.1f} s, guise {ours[-1].seconds:.1f} s")
    return transcodes, ours


def _report(runs: dict[str, tuple[list[Ran], list[Ran]]], peers: dict[str, float]) -> Report:
    wall, work = (
        {c: [statistics.median(getattr(r, kind) for r in some) for some in both] for c, both in runs.items()}
        for kind in ("seconds", "processor")
    )
    rows: list[tuple[object, ...]] = []
    for clip, both in runs.items():
        names = "ffmpeg, libx264 veryfast, crf 20", "guise deidentify"
        for what, some, seconds, processor in zip(names, both, wall[clip], work[clip], strict=True):
            peak = max(r.peak_mb for r in some)
            rows.append((clip, what, seconds, processor, peak, seconds / wall[clip][0]))
    base, own = wall[CLIP]
    rows += [(CLIP, label, seconds, "", "", seconds / base) for label, seconds in peers.items()]
    criteria = [
        Criterion(f"{clip}: {what} over a transcode", ours / copy, "<=", most)
        for what, by_clip, most in (("time", wall, 3.0), ("processor time", work, 2.2))
        for clip, (copy, ours) in by_clip.items()
    ]
    for label, least in (("deface", 6.0), ("deface -s 640x360", 2.0)):
        if label in peers:
            criteria.append(Criterion(f"{label}'s time over it", peers[label] / own, ">=", least))
    columns = ("clip", "command", "seconds", "processor seconds", "peak, MB", "over a transcode")
    table = Table("Wall seconds, medians", columns, rows)
    return Report("deidentify.speed", "De-identification: speed", criteria, [table])


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
