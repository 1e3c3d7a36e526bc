"""What swapping and puppeteering a file share: their settings, their report, and whose face is in the video."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from guise.aam.follow import Finder
from guise.aam.landmarks import open_detector, open_landmarker
from guise.aam.model import Identity
from guise.app.media import EncodeOptions, ProcessStats, Source
from guise.app.swapping.options import Options
from guise.common.errors import GuiseError
from guise.common.progress import Progress, Say, mute, silent


class SwapError(GuiseError):
    """A video that cannot be swapped; one sentence."""


@dataclass(frozen=True)
class Settings:
    """How a file is made.

    Parameters
    ----------
    options : how the engine draws.
    encode : encoder, crf, preset, lossless.
    detector : "builtin", the landmarker, or "lbp" or "yunet:MODEL.onnx", which find boxes: what finds the face at the
        start and after a loss.
    force : replace an existing output.
    progress : called with the stage and the share of it that is done.
    say : called with notes for the user.
    """

    options: Options = Options()
    encode: EncodeOptions = field(default_factory=EncodeOptions)
    detector: str = "builtin"
    force: bool = False
    progress: Progress = silent
    say: Say = mute

    def boxes(self) -> Finder:
        """What finds the face."""
        return open_landmarker("builtin") if self.detector == "builtin" else open_detector(self.detector)


DEFAULTS = Settings()


@dataclass(frozen=True)
class Report:
    """What a run did.

    Parameters
    ----------
    output : the file that was written.
    frames : number written; of these `swapped` show the new face where the face is, `held` where it was last seen,
        and in `lost` the face was not found.
    seconds : wall time without enrolment.
    work_seconds : of these, in tracking and drawing.
    renderer : who drew.
    faces : most faces seen at once.
    problems : sentences about what was survived in the input.
    """

    output: str
    frames: int
    swapped: int
    held: int
    lost: int
    seconds: float
    work_seconds: float
    renderer: str
    faces: int
    problems: tuple[str, ...]

    @property
    def frames_per_second(self) -> float:
        """Frames per second from file to file."""
        return self.frames / max(self.seconds, 1e-9)

    def as_json(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        return {**asdict(self), "frames_per_second": round(self.frames_per_second, 2)}


class Tally:
    """Counts outcomes while a file is made, and makes the report of it.

    faces, renderer : for the report, known when the work is done.
    """

    def __init__(self, settings: Settings, source: Source, stage: str) -> None:
        self._settings, self._source, self._stage = settings, source, stage
        self._total = source.frame_count or 0
        self._start = time.perf_counter()
        self.counts = {"swapped": 0, "held": 0, "lost": 0}
        self.faces = 0
        self.renderer = ""

    def add(self, outcome: str) -> None:
        """One more frame with this outcome."""
        self.counts[outcome] += 1

    def progress(self, done: int) -> None:
        """`done` frames are finished."""
        self._settings.progress(self._stage, done / self._total if self._total else 0.0)

    def require_some(self, person: str) -> None:
        """Raise SwapError when the person was seen in no frame."""
        if not self.counts["swapped"]:
            seen = sum(self.counts.values())
            raise SwapError(
                f"no face of the source person ({person}) found in the {seen} frames of {self._source.name}: give the "
                "model of the person in the video with --source, or enrol them from it"
            )

    def report(self, output: Path, stats: ProcessStats) -> Report:
        """The report, made when the output is complete, after the notes on what was survived."""
        seconds = time.perf_counter() - self._start
        for problem in stats.problems:
            self._settings.say(f"{self._source.name}: {problem}")
        if self.faces > 1:
            self._settings.say(
                f"{self._source.name}: up to {self.faces} faces were seen in a frame; the largest one that the source "
                "model knows was taken"
            )
        return Report(
            str(output), stats.frames, **self.counts, seconds=round(seconds, 3),
            work_seconds=round(stats.work_seconds, 3), renderer=self.renderer, faces=self.faces,
            problems=stats.problems,
        )  # fmt: skip


def person_in(source: Source, given: Any, like: Identity, settings: Settings) -> Identity:
    """The model of the person in a video: the given one, or enrolled from the video, to be mixed with `like`.

    given : Identity, or LandmarkSource for the enrolment.
    """
    if isinstance(given, Identity):
        return given
    if source.kind == "image":
        raise SwapError(
            f"{source.name} is a single image, which is too little to learn a face from: "
            "give the model of the person in it with --source"
        )
    from guise.aam.training import TrainingOptions
    from guise.app.enrolment.enrol import enrol

    settings.say(f"enrolling the person in {source.name}")
    training = TrainingOptions(resolution=like.frame.resolution)
    name = source.path.stem
    return enrol(
        [source.path], given, name=name, options=training, progress=settings.progress, say=settings.say
    )
