"""Frames in which a face is seen that a swap leaves as it was or covers.

Everyone of the real clips and of `hard/` is enrolled from the clip itself by the built-in landmarker and swapped, frame
by frame.  A face is seen where MediaPipe's landmarks beside a real clip say so (everywhere in a clip in which it never
found one: those show a signer all the time), and in a rendered clip where at least half of the true inner points are
visible.  Held is a frame that keeps the last face for a moment after a loss;
lost is one in which nothing is drawn or covered.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks.clips import real_clips
from benchmarks.landmarks.metrics import Bools
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import INNER51
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import SWAP
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.media import open_input
from guise.app.swapping.session import SwapSession
from guise.common.errors import GuiseError

CROWD = "street_crowd"  # shows nobody in particular
MIN_VISIBLE_SHARE = 0.5  # of the inner points
MAX_UNSWAPPED = 0.2  # %
NOT_SWAPPED = ("lost", "covered", "held")


def seen_in_real(points: F64) -> Bools:
    """(t,) bool: where landmarks (t, 81, 2) beside a clip tell of a face; all of it where there are none at all."""
    seen = np.isfinite(points).all((1, 2))
    return np.asarray(seen if seen.any() else ~seen)


def seen_in_rendered(truth: Path) -> Bools:
    """(t,) bool: where half of the face is visible."""
    with np.load(truth) as stored:
        return np.asarray(stored["visibility"][:, INNER51].mean(1) >= MIN_VISIBLE_SHARE)


def clips(shared: Path) -> Iterator[tuple[str, str, Path, Bools]]:
    """Kind, name and video of every clip, and where a face is seen in it."""
    for clip in real_clips(shared):
        if clip.name != CROWD:
            yield "real", clip.name, clip.video, seen_in_real(clip.points)
    for video in sorted((shared / "data" / "synthetic" / "hard").glob("*.mp4")):
        if video.with_suffix(".npz").exists():  # else two people are seen
            yield "hard", video.stem, video, seen_in_rendered(video.with_suffix(".npz"))


def outcomes(video: Path, seen: Bools) -> Counter[str]:
    """How many of the frames in which a face is seen had which outcome."""
    source = LandmarkSource(landmarker=open_landmarker("builtin"))
    person = enrol([video], source, name=video.stem)
    finder, found = open_landmarker("builtin"), Counter[str]()
    look = replace(SWAP, renderer="cpu")
    with (
        open_input(video) as media,
        SwapSession(lambda _: Engine(person, Donor.of(person), finder, look), "mosaic") as session,
    ):
        for frame in media:
            outcome = session.follow(frame, 1, session.engine(1).track(frame)).outcome
            found[outcome] += bool(frame.index < len(seen) and seen[frame.index])
    return found


def measure(options: argparse.Namespace) -> Report:
    """All clips."""
    rows, total = [], {"real": Counter[str](), "hard": Counter[str]()}
    chosen = list(clips(options.shared))
    for kind, name, video, seen in chosen[:: 6 if options.quick else 1]:
        try:
            found = outcomes(video, seen)
        except GuiseError as error:
            rows.append((name, kind, int(seen.sum()), str(error).split(":")[0], "", ""))
            total[kind]["lost"] += int(seen.sum())
            continue
        total[kind] += found
        counts = [found[outcome] for outcome in NOT_SWAPPED]
        rows.append((name, kind, int(seen.sum()), *counts))
        common.say(f"{name}: {dict(zip(NOT_SWAPPED, counts, strict=True))} of {int(seen.sum())}")
    criteria = []
    for kind, counts in total.items():
        if frames := sum(counts.values()):
            left = 100 * (frames - counts["swapped"]) / frames
            what = f"of {frames} frames with a face, not swapped, {kind} clips"
            criteria.append(Criterion(what, left, "<=", MAX_UNSWAPPED, "%"))
    columns = ("clip", "kind", "frames with a face", *NOT_SWAPPED)
    return Report(
        "unswapped", "Faces that are seen and not swapped", criteria, [Table("Clips", columns, rows)]
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
