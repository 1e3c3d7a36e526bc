"""Enrolment from files to a file, and the report of it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from guise.aam.model import Identity
from guise.aam.training import TrainingOptions
from guise.aam.views import Views
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.common.files import require_free
from guise.common.progress import Progress, Say, mute, silent
from guise.common.report import Report
from guise.common.version import VERSION


@dataclass(frozen=True)
class EnrolReport(Report):
    """What an enrolment gave.

    Parameters
    ----------
    modes : of appearance.   retained : share of the variance in them.
    views : how far the head was turned, degrees.
    held_out_error : mean landmark error on frames not trained with, per cent of the inter-ocular distance.
    size : of the file, bytes.   seconds : wall time.
    weaknesses : what about the clips will weaken a swap, one sentence each, with what to do about it.
    """

    output: str
    name: str
    clips: tuple[str, ...]
    frames: int
    modes: int
    retained: float
    held_out_error: float
    views: Views
    resolution: int
    size: int
    seconds: float
    weaknesses: tuple[str, ...] = ()

    def as_rows(self) -> dict[str, str]:
        """The report for a person to read."""
        return {
            "clips": ", ".join(self.clips),
            "frames": str(self.frames),
            "modes": f"{self.modes}, {100 * self.retained:.1f} % of the variance",
            "held-out error": f"{self.held_out_error:.2f} % of the inter-ocular distance",
            "views": str(self.views),
            "resolution": f"{self.resolution} pixels across the face",
            "size": f"{self.size / 1e6:.1f} MB",
            "time": f"{self.seconds:.1f} s",
        }


def enrol_file(
    clips: Sequence[Path], output: Path, landmarks: LandmarkSource, *, name: str,
    person: int | None = None, options: TrainingOptions = TrainingOptions(), force: bool = False,
    facts: Mapping[str, Any] | None = None, progress: Progress = silent, say: Say = mute,
) -> EnrolReport:  # fmt: skip
    """Train a person's model and write it; parameters as for `guise.app.enrolment.enrol.enrol`.

    facts : to be stored in the model as well.

    Raises OutputError before the work when the output cannot be written; a failed run leaves nothing behind.
    """
    require_free(output, force=force)
    start = time.perf_counter()
    identity = enrol(clips, landmarks, name=name, person=person, options=options, progress=progress, say=say)
    identity.facts.update(facts or {})
    return saved(identity, output, start)


def saved(identity: Identity, output: Path, start: float) -> EnrolReport:
    """Write a person's model, and tell what it holds.   start : when the work began, of `time.perf_counter`."""
    identity.facts["guise"] = VERSION
    size = identity.save(output)
    components, known = identity.appearance.components, identity.facts
    return EnrolReport(
        str(output), identity.name, tuple(known["clips"]), int(known["frames"]), components.modes,
        round(components.retained, 4), round(100 * float(known["held_out_error"]), 3), Views(**known["views"]),
        identity.reference.resolution, size, round(time.perf_counter() - start, 2), tuple(known.get("weaknesses", ())),
    )  # fmt: skip
