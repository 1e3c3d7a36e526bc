"""Swapped rather than covered: frames of frontal clips of one person in which the person's face is swapped.

A frame counts as swapped when its track is; whether something else in it is covered besides (a thing that the detector
takes for a face) is told apart.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.guise import deidentified
from benchmarks.landmarks.clips import HARD, real_clips

MAX_CLIP_FRAMES = 2000  # longer clips are left out, to save time


def frontal(shared: Path) -> list[Path]:
    """The clips of data/real that show one person from the front, and the synthetic people's second clips."""
    real = [c.video for c in real_clips(shared) if c.name not in HARD and len(c.points) <= MAX_CLIP_FRAMES]
    rendered = sorted((shared / "data" / "synthetic" / "people").glob("*/talk2.mp4"))
    return [*real, *rendered]


def counted(report: dict[str, Any]) -> tuple[int, int, int]:
    """Frames, frames with a swapped track, and frames with anything covered."""
    swapped = {f for track in report["tracks"] for f in frames_of(track, "swapped")}
    return report["frames"], len(swapped), report["counts"]["covered"]


def frames_of(track: dict[str, Any], done: str) -> set[int]:
    """The frames of a track in which something was done with it."""
    return {
        f for span in track["spans"] if span["done"] == done for f in range(span["first"], span["last"] + 1)
    }


def measure(options: argparse.Namespace) -> Report:
    """All clips."""
    rows, frames, swapped = [], 0, 0
    for video in frontal(options.shared)[:: 8 if options.quick else 1]:
        with tempfile.TemporaryDirectory() as folder:
            found = counted(deidentified(video, Path(folder) / "out.mp4", "--encoder-preset", "ultrafast"))
        name = video.stem if video.stem != "talk2" else f"{video.parent.name}/talk2"
        rows.append((name, found[0], 100 * found[1] / found[0], 100 * found[2] / found[0]))
        frames, swapped = frames + found[0], swapped + found[1]
        common.say(f"{rows[-1]}")
    columns = ("clip", "frames", "swapped, %", "frames with anything covered, %")
    return Report(
        "deidentify.swapped", "De-identification: swapped rather than covered",
        [Criterion("frames in which the person is swapped", 100 * swapped / frames, ">=", 98.0, "%")],
        [Table("Frontal clips of one person", columns, rows)],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
