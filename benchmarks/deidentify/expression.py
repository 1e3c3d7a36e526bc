"""Expression kept by de-identified videos, as a tracker sees it that has no part in the swap: MediaPipe.

Every clip of one person who looks at the camera is de-identified with default options, and MediaPipe's Face Landmarker
looks at the first frames of original and output.  A curve's correlation is over the frames in which both show the face.
Beside it stands what the same tracker keeps of a mere copy, encoded anew, which no swap can exceed by much, and how far
the built-in landmarker agrees with MediaPipe on the original itself.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import islice
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.deidentify.guise import deidentified
from benchmarks.deidentify.swapped import frontal
from benchmarks.landmarks.peers import MISSING, Peer, face81
from benchmarks.landmarks.setting import MEDIAPIPE, skipped
from guise.aam.landmarks import open_landmarker, track_video
from guise.app.measure.curves import CURVES, correlation, expression
from guise.app.measure.figures import mean_of
from guise.app.media import EncodeOptions, open_input, open_sink

NAME, TITLE = "deidentify.expression", "De-identification: expression kept"
FRAMES = 240  # the first ones of each clip
JUDGED = tuple(name for name in CURVES if name != "mouth width")
MOUTH = "mouth opening"
Kept = dict[str, float]


def watched(video: Path, options: argparse.Namespace) -> F64:
    """MediaPipe's landmarks (t, 81, 2) of the first frames, NaN where it finds nobody."""
    rows = []
    with (
        open_input(video) as source,
        Peer(options.peers_python, "video", options.shared / "models" / MEDIAPIPE) as peer,
    ):
        for frame in islice(source, FRAMES):
            meshes = peer.meshes(frame.rgb())
            rows.append(face81(meshes[0]) if len(meshes) else np.full((81, 2), np.nan))
    return np.stack(rows)


def kept(before: F64, after: F64) -> tuple[Kept, float]:
    """The curves' correlations, and the share of the first one's faces that the second one has."""
    first, second = (np.isfinite(points).all(axis=(1, 2)) for points in (before, after))
    both = first & second
    curves = expression(before[both]), expression(after[both])
    return {n: correlation(curves[0][n], curves[1][n]) for n in CURVES}, float(both.sum() / first.sum())


def copied(video: Path, output: Path) -> Path:
    """The first frames encoded anew, as an output is."""
    with open_input(video) as source, open_sink(output, source, EncodeOptions(), force=True) as sink:
        for frame in islice(source, FRAMES):
            sink.write(frame)
    return output


def of_clip(video: Path, options: argparse.Namespace) -> tuple[Kept, float, Kept, Kept]:
    """What the output keeps, the share of faces found, what a copy keeps, and how the built-in landmarker agrees."""
    before = watched(video, options)
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / f"{video.parent.name}_{video.stem}.mp4"
        deidentified(video, output)
        after, found = kept(before, watched(output, options))
        copy, _ = kept(before, watched(copied(video, Path(folder) / "copy.mp4"), options))
    with open_input(video) as source:
        own = track_video(open_landmarker("builtin"), (frame.rgb() for frame in islice(source, FRAMES)))
    return after, found, copy, kept(before, own.astype(np.float64))[0]


def row(video: Path, after: Kept, found: float, copy: Kept, other: Kept) -> tuple[object, ...]:
    """A line of the table."""
    name = video.stem if video.stem != "talk2" else f"{video.parent.name}/talk2"
    ceilings = (mean_of([part[n] for n in JUDGED]) for part in (copy, other))
    return (name, 100 * found, *(after[n] for n in CURVES), mean_of([after[n] for n in JUDGED]), *ceilings)


def measure(options: argparse.Namespace) -> Report:
    """All clips."""
    if options.peers_python is None:
        return skipped(NAME, TITLE, MISSING.format("MediaPipe"))
    rows = []
    for video in frontal(options.shared)[:: 8 if options.quick else 1]:
        rows.append(row(video, *of_clip(video, options)))
        common.say(str(rows[-1]))
    return summary(rows)


def summary(rows: list[tuple[object, ...]]) -> Report:
    """Criteria over the clips, and a row for each."""
    columns = (
        "clip", "found, %", *CURVES, "mean without mouth width", "of a copy", "built-in landmarker on the original",
    )  # fmt: skip

    def mean(column: str) -> float:
        return mean_of([line[columns.index(column)] for line in rows])

    everything = mean_of([mean(name) for name in JUDGED])
    return Report(
        NAME,
        TITLE,
        [
            Criterion("correlation of mouth opening, lids and brows", everything, ">=", 0.85),
            Criterion("correlation of mouth opening", mean(MOUTH), ">=", 0.95),
        ],
        [Table("Correlation with the original, by MediaPipe; nan: the curve hardly moves", columns, rows)],
        [
            f"Of a mere copy MediaPipe keeps {mean(columns[-2]):.3f}; the built-in landmarker agrees with it on the "
            f"originals by {mean(columns[-1]):.3f}."
        ],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
