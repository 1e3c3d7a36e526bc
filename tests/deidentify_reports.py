"""Made-up reports of de-identified files, for the tests of the reports and their pages."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from guise.app.deidentify.covers import BYSTANDER, NO_REASON, UNSURE_FIT, CoverSpan
from guise.app.deidentify.report.report import (
    BatchEntry,
)
from guise.app.deidentify.tracks import BYSTANDERS, AuditFinding, FileReport, Track, TrackOutcome
from guise.app.swapping.policy import COVERED

HOSTILE = "\"'><script>alert(1)</script>\u202e\n</style>\udcff&amp;.mp4"
SECRET = "mean:p01+/secret/a.guise"
FOUND, STILL = AuditFinding(2, (0, 0, 9, 9), 0.9, True), AuditFinding(4, (0, 0, 9, 9), 0.9, False)


def outcome_of(track: int, done: Any, first: int = 0, frames: Any = None) -> TrackOutcome:
    """An outcome with these codes in consecutive frames, or in these."""
    done = np.asarray(done, np.uint8)
    place = np.arange(first, first + len(done)) if frames is None else np.asarray(frames)
    boxes = np.stack([place, place + 1, place + 50, place + 60], axis=1).reshape(-1, 4)
    confidence = (place % 100 / 100).astype(np.float32)
    reasons = np.where(done == COVERED, BYSTANDER if track == BYSTANDERS else UNSURE_FIT, NO_REASON)
    return TrackOutcome(
        track, place.astype(np.int32), done, confidence, reasons.astype(np.uint8), boxes.astype(np.int32)
    )


def report_of(*outcomes: TrackOutcome, frames: int = 40, **more: Any) -> FileReport:
    """A report of 25 frames a second with a track for each outcome."""
    tracks = tuple(
        Track(
            one.track, one.track, int(one.frames[0]), int(one.frames[-1]), len(one.frames), 80.0, (0.5,), "swap",
            action="swap", donor="f3", name="Ann of the user",
        )
        for one in outcomes if one.track != BYSTANDERS
    )  # fmt: skip
    return replace(
        FileReport(
            "dir/in.mp4",
            "dir/out.mp4",
            frames,
            np.arange(frames) / 25,
            640,
            360,
            tracks,
            outcomes,
            (),
        ),
        **more,
    )


def three_faces() -> FileReport:
    """Two tracks and bystanders, of which two are in one frame."""
    return report_of(
        outcome_of(1, [1, 1, 0, 0, 0, 1], first=3),
        outcome_of(2, [2] * 10, first=20),
        outcome_of(BYSTANDERS, [1] * 4, frames=[5, 5, 6, 9]),
        covers=(
            CoverSpan(1, 0, 5, 6, 5, (1, 2, 3, 4), "bystander"),
            CoverSpan(2, 1, 3, 4, 3, (1, 2, 3, 4), "unsure fit"),
        ),
        audit=(AuditFinding(31, (1, 2, 30, 40), 0.75, True),),
        settings={
            "donor": SECRET,
            "audio": "keep",
            "keyfile": "/secret/place/key.json",
            "gallery": ["/secret/b.guise"],
            "encode": {"crf": 20, "lossless": False},
            "renderer": "GL: card/SSE2",
        },
        problems=("A frame was damaged.",),
        wall_seconds=2.5,
        digest="0" * 64,
    )


def long_report() -> FileReport:
    """Half an hour at 30 frames a second with three tracks that change every fourth second."""
    frames = 54_000
    done = np.arange(frames) // 100 % 2
    return report_of(*(outcome_of(n, done) for n in (1, 2, 3)), frames=frames)


def entries_of(folder: Path) -> list[BatchEntry]:
    counts = {"swapped": 5, "covered": 0, "left": 0, "without face": 1}
    return [
        BatchEntry("a.mp4", str(folder / "javascript:a #1?%.mp4"), 0, "Good.", counts),
        BatchEntry("b.mp4", str(folder / "b.mp4"), 3, "Covered.", counts | {"covered": 2}),
        BatchEntry("c.mp4", None, 2, "It is empty.", {}),
        BatchEntry("d.mp4", None, 130, "Interrupted.", {}),
    ]
