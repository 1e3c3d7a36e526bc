"""Leaked frames: true faces of the hard synthetic clips that are not swapped or covered; `deface` beside it.

Each clip is taken as it is and rolled by the angles that `--rolls` gives.  `--real` adds clips of data/real, with the
faces that MediaPipe found in the upright clip.

A frame is leaked when less than 90 % of the box of the points of a face that can be seen was changed, and of the face
itself: the box also spans a hand or a mug in front, which a swap leaves as it is.  Beside it stand the box of all 68
points, some of which lie under hair, and the shares of pixels: within the outline of the points that can be seen, and
of the mesh between points that can be seen.  On real clips it isn't known which points are hidden, and a hand counts
as face.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from itertools import product, repeat
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.changes import LOSSLESS, LOSSY, MIN_CHANGED_SHARE, Share, Truth, shares
from benchmarks.deidentify.guise import LOSSLESS_OPTIONS, deidentified
from benchmarks.landmarks.clips import RealClip, real_clips
from benchmarks.rolled import moved, write_rolled
from guise.aam.landmarks.schemes import IBUG68

QUICK = ("leave_reenter", "occlusion_hand")
ALL_HIDDEN = 0  # outcome of a report that all faces are swapped and every frame verified
NEARLY_LOSSLESS = '{"codec": "libx264", "ffmpeg_params": ["-crf", "1", "-preset", "ultrafast"]}'


def clips(shared: Path, real: Sequence[str]) -> dict[Path, list[Truth]]:
    """The hard clips and some real ones, and the true faces in each."""
    folder = shared / "data" / "synthetic" / "hard"
    hard = {
        v: [Truth.load(f) for f in sorted(folder.glob(f"{v.stem}*.npz"))]
        for v in sorted(folder.glob("*.mp4"))
    }
    found = [clip for name in real for clip in real_clips(shared, name)]
    return hard | {clip.video: [seen_by_mediapipe(clip)] for clip in found}


def seen_by_mediapipe(clip: RealClip) -> Truth:
    """The largest face of a real clip; it cannot be seen where MediaPipe found none."""
    points = clip.points[:, IBUG68]
    return Truth(points, np.isfinite(points).all(2))


def deface(python: Path, video: Path, output: Path) -> None:
    """De-identify with deface and its default options, but at its encoder's best."""
    ran([python.with_name("deface"), video, "-o", output, "--ffmpeg-config", NEARLY_LOSSLESS])


def row(name: str, tool: str, found: list[Share]) -> tuple[object, ...]:
    """A line of the table: for each kind of share, how many frames are under MIN_CHANGED_SHARE, and the least."""
    cells: list[object] = [sum(s.is_leaked for s in found)]
    for kind in ("seen", "box", "face", "bare"):
        values = np.array([getattr(s, kind) for s in found])
        cells += [int((values < MIN_CHANGED_SHARE).sum()), round(100 * float(values.min()), 1)]
    return name, tool, len(found), *cells


def rolled_clip(video: Path, truths: list[Truth], degrees: float, folder: Path) -> tuple[Path, list[Truth]]:
    """A clip rolled clockwise, written losslessly into a folder, and the true faces in it."""
    if not degrees:
        return video, truths
    output = folder / f"{video.stem}_{degrees:g}.mkv"
    forward = write_rolled(video, output, repeat(degrees))[0]
    return output, [Truth(moved(truth.points, forward), truth.visible) for truth in truths]


def measure(options: argparse.Namespace) -> Report:
    """All clips at all rolls."""
    rows, leaked, theirs, counts, false_claims = [], 0, 0, [], 0
    for (source, faces), degrees in product(clips(options.shared, options.real).items(), options.rolls):
        if options.quick and source.stem not in (*QUICK, *options.real):
            continue
        with tempfile.TemporaryDirectory() as folder:
            output = Path(folder) / "out.mkv"
            video, truths = rolled_clip(source, faces, degrees, Path(folder))
            report = deidentified(video, output, *LOSSLESS_OPTIONS)
            ours = [s for truth in truths for s in shares(video, output, truth, LOSSLESS)]
            tracked = sum(track["counts"]["covered"] for track in report["tracks"])
            counts.append((video.stem, *report["counts"].values(), tracked))
            rows.append(row(video.stem, "guise", ours))
            here = sum(s.is_leaked for s in ours)
            leaked, false_claims = (
                leaked + here,
                false_claims + (here > 0 and report["outcome"] == ALL_HIDDEN),
            )
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
        "box",
        "least, %",
        "with hidden points",
        "least, %",
        "outline",
        "least, %",
        "face itself",
        "least, %",
    )
    worst_columns = ("clip", "without face", "swapped", "covered", "left", "tracked faces covered")
    notes = [f"deface: {theirs} leaked frames."] if options.peers_python else []
    return Report(
        "deidentify.leaks", "De-identification: leaked frames of the hard clips, upright and rolled",
        [
            Criterion("leaked frames", float(leaked), "<=", 0.0),
            Criterion("reports of outcome 0 beside a leak", float(false_claims), "<=", 0.0),
        ],
        [
            Table("Faces of which a quarter or more can be seen", columns, rows),
            Table("Frames by their worst face", worst_columns, counts),
        ],
        notes,
    )  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.with_peers(common.arguments(__doc__))
    made.add_argument(
        "--rolls",
        type=float,
        nargs="+",
        default=[0, 90, 180, 270],
        help="degrees clockwise (default: quarters)",
    )
    made.add_argument("--real", nargs="*", default=[], help="names of clips of data/real, to measure as well")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
