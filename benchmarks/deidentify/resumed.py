"""Killed at random moments and resumed: the result must be the same bytes as that of an uninterrupted run.

The clip is several segments long.  Moments are drawn evenly over the time that the uninterrupted
run took; the command and its children get SIGKILL, and then the same command goes on with `--resume`.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import ffmpeg, ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.guise import done, guise_command

CLIP = Path("data") / "synthetic" / "hard" / "yaw40.mp4"
REPEATS = 4  # of the clip: two segments and more
KILLS = 50


def killed(command: list[str | Path], after: float) -> bool:
    """Start a command in a process group of its own and kill all of it; False when it was through before."""
    process = subprocess.Popen(
        [str(part) for part in command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        process.wait(after)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True
    return False


def measure(options: argparse.Namespace) -> Report:
    """One run to compare with, and the killed ones."""
    rng, kills = np.random.default_rng(0), 2 if options.quick else options.kills
    rows, same = [], 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip = folder / "clip.mp4"
        ran(ffmpeg("-stream_loop", str(REPEATS - 1), "-i", options.shared / CLIP, "-vf", "scale=320:240",
                   "-c:v", "libx264", "-preset", "ultrafast", "-g", "60", "-c:a", "copy", clip))  # fmt: skip
        start = time.perf_counter()
        done(guise_command(clip, folder / "whole.mp4", "--preset", "ultrafast"))
        usual = time.perf_counter() - start
        whole = (folder / "whole.mp4").read_bytes()
        for turn, moment in enumerate(rng.uniform(0, usual, kills)):
            output = folder / f"killed{turn}.mp4"
            command = guise_command(clip, output, "--preset", "ultrafast", "--resume")
            was = killed(command, float(moment))
            if was or not output.exists():
                done(command)
            equal = output.read_bytes() == whole
            same += equal
            left = sorted(p.name for p in folder.glob(f"killed{turn}*"))
            rows.append(
                (
                    turn + 1,
                    float(moment),
                    "killed" if was else "through",
                    "same" if equal else "OTHER",
                    len(left),
                )
            )
            common.say(f"{rows[-1]}")
            for file in folder.glob(f"killed{turn}*"):
                file.unlink()
    return Report(
        "deidentify.resumed", f"De-identification: killed {kills} times and resumed",
        [Criterion("results that are the same bytes", float(same), ">=", float(kills))],
        [Table(f"A run takes {usual:.1f} s", ("run", "killed after, s", "", "result", "files left"), rows)],
    )  # fmt: skip


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--kills", type=int, default=KILLS, help="how many")
    common.run(measure, parser)
