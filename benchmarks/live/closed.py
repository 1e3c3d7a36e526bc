"""Leaked frames of `guise live`: true faces in the hard synthetic clips that are neither swapped nor covered.

The person is enrolled from the clip itself, as the command does with --input.  Every frame is processed, and then
only every third, as on a slow computer.  Leaked is a cover that doesn't hold all that can be seen, as
`benchmarks.deidentify.changes` says, and a swap of which too little was changed; it fades out within the face's rim.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.changes import MIN_VISIBLE_SHARE, Share, Truth, share
from benchmarks.deidentify.leaks import clips
from benchmarks.live.runs import DONOR
from guise.aam.model import Identity
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.enrolment.source_person import source_person
from guise.app.live.capture import FileCapture
from guise.app.live.controls import Controls
from guise.app.live.session import LiveProcessor, SessionConfig
from guise.app.live.stats import PipelineStats
from guise.app.swapping.donors import open_donor
from guise.app.swapping.report import SwapSettings
from guise.common.threads import one_thread

FRAME_INTERVALS = (1, 3)  # every frame, every third
MIN_SWAPPED_SHARE = 0.8  # of a face that was swapped
OUTCOMES = ("swapped", "covered", "lost")


def shares(
    video: Path, truths: list[Truth], config: SessionConfig, interval: int, outcomes: Counter[str]
) -> Iterator[Share]:
    """For each processed frame and each true face in it, how much of it was changed; outcomes are counted."""
    session = LiveProcessor(config, Controls())
    try:
        with FileCapture(video, paced=False) as capture:
            for frame in capture:
                if frame.index % interval:
                    continue
                before = frame.rgb().astype(np.int16)
                outcome = session.process(frame, 0.0, PipelineStats()).result.outcome
                outcomes[outcome] += 1
                changed = np.abs(frame.rgb() - before).max(2) > 0
                for truth in truths:
                    points, visible = truth.points[frame.index], truth.visible[frame.index]
                    if visible.mean() >= MIN_VISIBLE_SHARE:
                        yield share(frame.index, changed, points, visible, covered=outcome != "swapped")
    finally:
        session.close()


def changed_share(face: Share) -> float:
    """Of what can be seen of a face."""
    return max(face.seen, face.bare)


def is_leaked(face: Share) -> bool:
    """Whether too much of a face was left as it is."""
    return face.is_leaked if face.covered else changed_share(face) < MIN_SWAPPED_SHARE


def enrolled_from(video: Path, like: Identity) -> Identity:
    """The person in a video, as the command makes their model."""
    with FileCapture(video) as capture:
        return source_person(capture.media, LandmarkSource(), like, SwapSettings())


def measure(options: argparse.Namespace) -> Report:
    """All clips."""
    donor, rows, leaks = open_donor(DONOR), [], 0
    for video, truths in clips(options.shared, ()).items():
        if options.quick and video.stem not in ("leave_reenter", "two_people"):
            continue
        with one_thread():
            config = SessionConfig([donor], enrolled_from(video, donor))
            for interval in FRAME_INTERVALS:
                outcomes: Counter[str] = Counter()
                found = list(shares(video, truths, config, interval, outcomes))
                leaked = sum(map(is_leaked, found))
                least = round(100 * min(map(changed_share, found)), 1)
                counts = [outcomes[name] for name in OUTCOMES]
                rows.append((video.stem, interval, *counts, len(found), leaked, least))
                leaks += leaked
                common.say(f"{rows[-1]}")
    columns = ("clip", "every", *OUTCOMES, "faces seen", "leaked", "least, %")
    return Report(
        "live.closed", "Live: leaked frames of the hard clips",
        [Criterion("leaked frames", float(leaks), "<=", 0.0)],
        [Table("Frames by what was done, and true faces of which a quarter or more can be seen", columns, rows)],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
