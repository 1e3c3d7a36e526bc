"""Leaked frames: true faces of the hard synthetic clips that are not swapped or covered; `deface` beside it.

Each clip is taken as it is and in the forms that `--forms` gives: rolled, mirrored, negative, half out of the picture.
`--real` adds clips of data/real, with the faces that MediaPipe found in the clip as it is.  `--every K` takes each clip
in every K-th form only, in turn, so that all clips together are taken in all forms.

A frame is leaked when less than 90 % of the box of the points of a face that can be seen was changed, and of the face
itself: the box also spans a hand or a mug in front, which a swap leaves as it is.  It is also leaked when a face was
covered, and a point of it that can be seen lies outside the cover.  Beside it stand the box of all 68
points, some of which lie under hair, and the shares of pixels: within the outline of the points that can be seen, and
of the mesh between points that can be seen.  On real clips it isn't known which points are hidden, and a hand counts
as face.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.children import ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.changes import (
    LOSSLESS,
    LOSSY,
    MIN_CHANGED_SHARE,
    Share,
    SwappedFaces,
    Truth,
    shares,
)
from benchmarks.deidentify.forms import ALL_ROLLS, SPOILED, in_form
from benchmarks.deidentify.guise import LOSSLESS_OPTIONS, deidentified
from benchmarks.landmarks.clips import RealClip, real_clips
from guise.aam.landmarks.schemes import IBUG68

QUICK = ("leave_reenter", "occlusion_hand")
ALL_HIDDEN = 0  # outcome of a report that all faces are swapped and every frame verified
NEARLY_LOSSLESS = (
    '{"codec": "libx264", "ffmpeg_params": ["-crf", "1", "-preset", "ultrafast"], "macro_block_size": 2}'
)


@dataclass
class Found:
    """What was found so far."""

    rows: list[tuple[object, ...]] = field(default_factory=list)
    counts: list[tuple[object, ...]] = field(default_factory=list)
    leaked: int = 0
    false_claims: int = 0
    by_deface: int = 0


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
    cells: list[object] = [sum(s.is_leaked for s in found), sum(s.covered is True for s in found)]
    for kind in ("seen", "box", "face", "bare"):
        values = np.array([getattr(s, kind) for s in found])
        least = round(100 * float(values.min()), 1) if len(values) else "-"
        cells += [int((values < MIN_CHANGED_SHARE).sum()), least]
    return name, tool, len(found), *cells


def chosen(options: argparse.Namespace) -> Iterator[tuple[Path, list[Truth], str]]:
    """The clips in the forms that are measured."""
    forms = list(dict.fromkeys(options.forms))
    for k, (video, truths) in enumerate(clips(options.shared, options.real).items()):
        if options.only and video.stem not in (*options.only, *options.real):
            continue
        if not options.quick or video.stem in (*QUICK, *options.real):
            for n, form in enumerate(forms):
                if (n + k) % options.every == 0:
                    yield video, truths, form


def measured(
    found: Found, clip: tuple[Path, list[Truth], str], options: argparse.Namespace, folder: Path
) -> None:
    """De-identify a clip in a form, and add what is found."""
    source, faces, form = clip
    video, truths = in_form(source, faces, form, folder, options.frames)
    name, output = f"{source.stem} {form}", folder / "out.mkv"
    report = deidentified(video, output, *LOSSLESS_OPTIONS, "--region", options.region)
    swapped = SwappedFaces(report)
    ours = [s for truth in truths for s in shares(video, output, truth, LOSSLESS, swapped)]
    leaked = sum(s.is_leaked for s in ours)
    found.rows.append(row(name, "guise", ours))
    found.counts.append((name, *report["counts"].values(), len(report["audit"]), report["outcome"]))
    found.leaked += leaked
    found.false_claims += leaked > 0 and report["outcome"] == ALL_HIDDEN
    common.say(f"{found.rows[-1]} {report['sentence']} {[s.frame for s in ours if s.is_leaked]}")
    if options.peers_python:
        theirs = folder / "deface.mp4"
        deface(options.peers_python, video, theirs)
        peer = [s for truth in truths for s in shares(video, theirs, truth, LOSSY)]
        found.rows.append(row(name, "deface", peer))
        found.by_deface += sum(s.is_leaked for s in peer)
        common.say(f"{found.rows[-1]}")


def measure(options: argparse.Namespace) -> Report:
    """All clips in all forms."""
    found = Found()
    for clip in chosen(options):
        with tempfile.TemporaryDirectory() as folder:
            measured(found, clip, options, Path(folder))
    columns = (
        "clip and form", "tool", "faces seen", "leaked", "covered", "box", "least, %", "with hidden points", "least, %",
        "outline", "least, %", "face itself", "least, %",
    )  # fmt: skip
    worst_columns = (
        "clip and form", "without face", "swapped", "covered", "left", "found by the audit", "outcome",
    )  # fmt: skip
    unknown = sorted({str(line[0]) for line in found.rows if not line[2]})
    notes = [f"deface: {found.by_deface} leaked frames."] if options.peers_python else []
    if unknown:
        notes.append(f"Of no use, as where the face is isn't known in any frame: {', '.join(unknown)}.")
    return Report(
        "deidentify.leaks", "De-identification: leaked frames of the hard clips, in every form",
        [
            Criterion("leaked frames", float(found.leaked), "<=", 0.0),
            Criterion("reports of outcome 0 beside a leak", float(found.false_claims), "<=", 0.0),
        ],
        [
            Table("Faces of which a quarter or more can be seen", columns, found.rows),
            Table("Frames by their worst face", worst_columns, found.counts),
        ],
        notes,
    )  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument(
        "--forms", nargs="+", default=[*ALL_ROLLS, *SPOILED],
        help=f"degrees clockwise, {', '.join(SPOILED)} (default: every 15 degrees, and these)",
    )  # fmt: skip
    made.add_argument("--every", type=int, default=1, help="take each clip in every so many-th form, in turn")
    made.add_argument("--region", default="face", choices=("face", "head"), help="what a swap replaces")
    made.add_argument("--frames", type=int, help="only the first frames of each clip")
    made.add_argument("--only", nargs="*", default=[], help="names of hard clips; all by default")
    made.add_argument("--real", nargs="*", default=[], help="names of clips of data/real, to measure as well")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
