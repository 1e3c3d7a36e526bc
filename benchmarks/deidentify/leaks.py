"""Leaked frames: true faces of the hard synthetic clips that are not swapped or covered; `deface` beside it.

A frame is leaked when less than 90 % of the box of the points of a face that can be seen was changed.  Beside it stand
that of all 68 points, some of which lie under hair, and the share of the face's pixels instead of its box.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.changes import LOSSLESS, LOSSY, MIN_CHANGED_SHARE, Share, Truth, shares
from benchmarks.deidentify.guise import LOSSLESS_OPTIONS, deidentified

NEARLY_LOSSLESS = '{"codec": "libx264", "ffmpeg_params": ["-crf", "1", "-preset", "ultrafast"]}'


def clips(shared: Path) -> dict[Path, list[Truth]]:
    """The hard clips, and the true faces in each."""
    folder = shared / "data" / "synthetic" / "hard"
    return {
        v: [Truth.load(f) for f in sorted(folder.glob(f"{v.stem}*.npz"))]
        for v in sorted(folder.glob("*.mp4"))
    }


def deface(python: Path, video: Path, output: Path) -> None:
    """De-identify with deface and its default options, but at its encoder's best."""
    ran([python.with_name("deface"), video, "-o", output, "--ffmpeg-config", NEARLY_LOSSLESS])


def row(name: str, tool: str, found: list[Share]) -> tuple[object, ...]:
    """A line of the table: for each kind of share, how many frames are under MIN_CHANGED_SHARE, and the least."""
    cells: list[object] = []
    for kind in ("seen", "box", "face"):
        values = np.array([getattr(s, kind) for s in found])
        cells += [int((values < MIN_CHANGED_SHARE).sum()), round(100 * float(values.min()), 1)]
    return name, tool, len(found), *cells


def measure(options: argparse.Namespace) -> Report:
    """All clips."""
    rows, leaked, theirs, counts = [], 0, 0, []
    for video, truths in clips(options.shared).items():
        if options.quick and video.stem not in ("leave_reenter", "occlusion_hand"):
            continue
        with tempfile.TemporaryDirectory() as folder:
            output = Path(folder) / "out.mkv"
            counted = deidentified(video, output, *LOSSLESS_OPTIONS)["counts"]
            ours = [s for truth in truths for s in shares(video, output, truth, LOSSLESS)]
            counts.append((video.stem, *counted.values()))
            rows.append(row(video.stem, "guise", ours))
            leaked += rows[-1][3]  # type: ignore[operator]
            if options.peers_python:
                deface(options.peers_python, video, Path(folder) / "deface.mp4")
                peer = [
                    s for truth in truths for s in shares(video, Path(folder) / "deface.mp4", truth, LOSSY)
                ]
                rows.append(row(video.stem, "deface", peer))
                theirs += rows[-1][3]  # type: ignore[operator]
        common.say(f"{rows[-1]}")
    columns = (
        "clip",
        "tool",
        "faces seen",
        "leaked",
        "least, %",
        "with hidden points",
        "least, %",
        "pixels",
        "least, %",
    )
    notes = [f"deface: {theirs} leaked frames."] if options.peers_python else []
    return Report(
        "deidentify.leaks", "De-identification: leaked frames of the hard clips",
        [Criterion("leaked frames", float(leaked), "<=", 0.0)],
        [
            Table("Faces of which a quarter or more can be seen", columns, rows),
            Table("Frames by their worst face", ("clip", "without face", "swapped", "covered", "left"), counts),
        ],
        notes,
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.with_peers(common.arguments(__doc__)))
