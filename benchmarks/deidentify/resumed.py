"""Killed at random moments, or out of disk space, and resumed: the same bytes as those of an uninterrupted run.

The clip is several segments long.  Moments are drawn evenly over the time that the uninterrupted run took; the command
and its children get SIGKILL, and then the same command goes on with `--resume`.  Disks are file systems in memory whose
sizes are drawn evenly up to what the uninterrupted run needed; mounting them takes root.  A full disk must
end the command in a sentence, without an output, and the run goes on when there is room.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import ffmpeg, ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.guise import SOME_COVERED, done, guise_command

CLIP = Path("data") / "synthetic" / "hard" / "yaw40.mp4"
REPEATS = 4  # of the clip: two segments and more
KILLS, DISKS = 100, 20
MIN_DISK_BYTES, MAX_DISK_BYTES = 64 << 10, 1 << 30
POLL_SECONDS = 0.05
# By the file that is written last before it: the stages of a run.
STAGES = {
    "published.json": "published", "render.": "rendering", "plan.npz": "rendering", "tracks.json": "planning",
    "fit.": "tracking", "people.json": "tracking", "person.": "enrolling", "link.json": "enrolling",
    "detect.": "finding faces", "scan.json": "finding faces", "manifest.json": "scanning",
}  # fmt: skip


def killed(command: list[str | Path], after: float) -> bool:
    """Start a command in a process group of its own and kill all of it; False when it was through before."""
    process = _started(command)
    try:
        process.wait(after)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True
    return False


def stage(work: Path) -> str:
    """How far a run came, by its work folder."""
    files = [file.name for file in work.glob("*")] if work.is_dir() else []
    return next(
        (label for start, label in STAGES.items() if any(f.startswith(start) for f in files)), "start"
    )


def measure(options: argparse.Namespace) -> Report:
    """One run to compare with, the killed ones, and those on small disks."""
    kills, disks = (2, 1) if options.quick else (options.kills, options.disks)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip = folder / "clip.mp4"
        cut = ("-frames:v", str(options.frames)) if options.frames else ()
        ran(ffmpeg("-stream_loop", str(options.repeats - 1), "-i", options.shared / CLIP, "-vf", "scale=192:144",
                   *cut, "-c:v", "libx264", "-preset", "ultrafast", "-g", "60", "-c:a", "copy", clip))  # fmt: skip
        start = time.perf_counter()
        process = _started(guise_command(clip, folder / "whole.mp4", "--preset", "ultrafast"))
        needed = _most_bytes(process, folder) - clip.stat().st_size
        usual = time.perf_counter() - start
        whole = (folder / "whole.mp4").read_bytes()
        rng = np.random.default_rng(options.seed)
        moments = rng.uniform(0, usual, kills)
        by_kill = [
            _after_kill(clip, folder / f"killed{n}.mp4", float(m), whole) for n, m in enumerate(moments)
        ]
        sizes = rng.uniform(MIN_DISK_BYTES, needed, disks)
        by_disk = [_on_disk(clip, folder / f"disk{n}", int(size), whole) for n, size in enumerate(sizes)]
    stages = Counter(str(row[2]) for row in by_kill)
    return Report(
        "deidentify.resumed", f"De-identification: killed {kills} times, out of disk space {disks} times, and resumed",
        [
            Criterion("results after a kill that are the same bytes", _count(by_kill, 3), ">=", float(kills)),
            Criterion("full disks that end in a sentence, or are large enough", _count(by_disk, 1), ">=", float(disks)),
            Criterion("results after them that are the same bytes", _count(by_disk, 3), ">=", float(disks)),
        ],
        [
            Table(f"A run takes {usual:.1f} s", ("killed after, s", "", "stage", "same bytes", "files left"), by_kill),
            Table(
                f"A run takes {needed / 1e3:.0f} kB", ("disk, kB", "ended well", "stage", "same bytes", "said"), by_disk
            ),
        ],
        [f"Killed while: {', '.join(f'{name} {count}' for name, count in stages.most_common())}."],
    )  # fmt: skip


def _after_kill(clip: Path, output: Path, moment: float, whole: bytes) -> tuple[object, ...]:
    """Kill a run at a moment, in seconds, and resume it."""
    command = guise_command(clip, output, "--preset", "ultrafast", "--resume")
    was = killed(command, moment)
    reached = stage(output.with_name(f"{output.name}.work"))
    if was or not output.exists():
        done(command)
    same = output.read_bytes() == whole
    left = sorted(output.parent.glob(f"{output.stem}*"))
    row = (moment, "killed" if was else "through", reached, "same" if same else "OTHER", len(left))
    common.say(f"{row}")
    for file in left:
        file.unlink()
    return row


def _on_disk(clip: Path, folder: Path, size: int, whole: bytes) -> tuple[object, ...]:
    """A run on a disk of so many bytes, and its end when there is room."""
    with _disk(folder, size):
        output = folder / "out.mp4"
        command = guise_command(clip, output, "--preset", "ultrafast", "--resume")
        first = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
        said = first.stderr.strip()
        reached = stage(output.with_name(f"{output.name}.work"))
        through = first.returncode in (0, SOME_COVERED) and output.exists()
        refused = (
            first.returncode in (1, 2) and not output.exists() and said.count("\n") == 0 and "error: " in said
        )
        well = through or (refused and "Guise failed" not in said)
        subprocess.run(["mount", "-o", f"remount,size={MAX_DISK_BYTES}", folder], check=True)
        if not through:
            done(command)
        same = output.read_bytes() == whole
    row = (size / 1e3, "same" if well else "OTHER", reached, "same" if same else "OTHER", said[-120:])
    common.say(f"{row}")
    return row


@contextmanager
def _disk(folder: Path, size: int) -> Iterator[None]:
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def _started(command: list[str | Path]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [str(part) for part in command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _most_bytes(process: subprocess.Popen[bytes], folder: Path) -> int:
    """The largest size of a folder until a process ends."""
    most = 0
    while process.poll() is None:
        most = max(most, _bytes(folder))
        time.sleep(POLL_SECONDS)
    return most


def _bytes(folder: Path) -> int:
    size = 0
    for file in folder.rglob("*"):
        with suppress(FileNotFoundError):
            size += file.stat().st_size
    return size


def _count(rows: list[tuple[object, ...]], column: int) -> float:
    return float(sum(row[column] == "same" for row in rows))


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--kills", type=int, default=KILLS, help="how many")
    parser.add_argument("--disks", type=int, default=DISKS, help="how many; 0 where nothing can be mounted")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="of the clip")
    parser.add_argument("--frames", type=int, help="only so many of the repeated clip")
    parser.add_argument("--seed", type=int, default=0, help="of moments and sizes")
    common.run(measure, parser)
