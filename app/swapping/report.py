"""How a file is swapped or puppeteered, what was done to it, counted frame by frame, and the report of that."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from guise.aam.landmarks import open_detector, open_landmarker
from guise.aam.person_tracker import FaceFinder
from guise.app.drawing.look import SWAP, Look
from guise.app.drawing.passes.place import OUTLINE_WARP
from guise.app.media import EncodeOptions, MediaInput, ProcessStats
from guise.app.media.hardware import HardwareDecoder
from guise.app.media.time_range import TimeRange
from guise.app.swapping.policy import LIMITS, Unsure
from guise.common.errors import GuiseError
from guise.common.progress import Progress, Say, mute, silent

if TYPE_CHECKING:
    from guise.aam.model import Identity
    from guise.app.swapping.grade import Grade


@dataclass(frozen=True)
class SwapSettings:
    """How a file is made.

    Parameters
    ----------
    look : how faces are drawn.
    encode : encoder, crf, preset, lossless.
    hwaccel : the device that decodes the video, "auto" for one that works, or "none" for the processor.
    detector : "builtin", the landmarker, or "lbp", "yunet:MODEL.onnx" or "centerface:MODEL.onnx", which find boxes:
        what finds the face at the start and after a loss.
    unsure : what is done to frames in which the person's face is lost but may be visible: "cover" it, "hold" the last
        face for a second, or "leave" the frame as it is.
    keep_people : use the model of the video's person that an earlier run has kept, and keep a new one.
    part : what of the video is swapped, None for all; the rest is kept as it is or cut off.
    rest_seconds : after the first frame, at which the person in the video is at rest; None finds out.
    graded : say in the report how good the swap looks, which takes as long as some ten frames.
    force : replace an existing output.
    progress : called with the stage and the share of it that is done.
    say : called with notes for the user.
    """

    look: Look = SWAP
    encode: EncodeOptions = field(default_factory=EncodeOptions)
    hwaccel: HardwareDecoder = "none"
    detector: str = "builtin"
    unsure: Unsure = "cover"
    keep_people: bool = False
    part: TimeRange | None = None
    rest_seconds: float | None = None
    graded: bool = True
    force: bool = False
    progress: Progress = silent
    say: Say = mute

    @property
    def read(self) -> TimeRange | None:
        """The part of the video that is read, as the rest is cut off; None for all."""
        return self.part if self.part is not None and self.part.cuts else None

    @property
    def drawn(self) -> TimeRange | None:
        """The part of what is read that is drawn on; None for all."""
        return None if self.part is not None and self.part.cuts else self.part

    def drawn_look(self) -> Look:
        """How faces are drawn, with the time for which a lost one is held."""
        seconds = LIMITS.hold_seconds if self.unsure == "hold" else LIMITS.bridge_seconds
        return replace(self.look, hold_seconds=seconds)

    def face_finder(self) -> FaceFinder:
        """What finds the face."""
        return open_landmarker("builtin") if self.detector == "builtin" else open_detector(self.detector)


DEFAULTS = SwapSettings()


def say_of_faces(faces: Iterable[Identity], say: Say) -> None:
    """Say what weakens the faces that are shown, and of whom nothing but a photo lends one."""
    for face in faces:
        is_of_photo = face.facts.get("made_from") == "one photo"
        for sentence in face.facts.get("weaknesses", ()):
            say(
                f"{face.name} could be enrolled from a better {'photo' if is_of_photo else 'clip'}: {sentence}"
            )
        if is_of_photo:
            say(f"{face.name} was enrolled from one photo: use it only with the person's consent")


class SwapError(GuiseError):
    """A video that cannot be swapped; one sentence."""


@dataclass(frozen=True)
class FileTimes:
    """How long a file took.

    seconds : wall time without enrolment.
    work_seconds : of these, spent in tracking and drawing, which overlap.
    first_packet_seconds : until the first encoded picture was written; None where nothing is encoded.
    encoder_idle_share : share in [0, 1] of the time that the encoder waited for frames.
    """

    seconds: float
    work_seconds: float
    first_packet_seconds: float | None
    encoder_idle_share: float


@dataclass(frozen=True, kw_only=True)
class UntouchedFrames:
    """How many frames lie outside the part that was asked for, and are as in the input."""

    untouched: int = 0


@dataclass(frozen=True)
class SwapReport(UntouchedFrames):
    """What was done to a file.

    Parameters
    ----------
    output : the file that was written.
    swapped, held, covered, lost : frames that show the new face where the face is, or where it was last seen, in which
        a face that could not be swapped was covered, and in which no face was found.
    times : how long it took.
    renderer : what drew the face.
    faces : largest number of faces seen in one frame.
    beyond_face_widths : distance from the jaw line up to which pixels beside the face may have changed, face widths.
    problems : sentences about faults in the input that were worked around.
    grade : how good the swap looks, 0 to 100, see `guise.app.swapping.grade`, or None.   advice : what would help most.
    """

    output: str
    swapped: int
    held: int
    covered: int
    lost: int
    times: FileTimes
    renderer: str
    faces: int
    beyond_face_widths: float
    problems: tuple[str, ...]
    grade: int | None = None
    advice: str = ""

    @property
    def frames(self) -> int:
        """Number of frames written."""
        return self.swapped + self.held + self.covered + self.lost + self.untouched

    @property
    def seconds(self) -> float:
        """Wall time without enrolment."""
        return self.times.seconds

    @property
    def frames_per_second(self) -> float:
        """Frames per second from file to file."""
        return self.frames / max(self.seconds, 1e-9)

    def as_json(self) -> dict[str, Any]:
        """The report as JSON holds it, flat."""
        told = asdict(self)
        times = told.pop("times")
        rate = round(self.frames_per_second, 2)
        return {
            "output": told.pop("output"),
            "frames": self.frames,
            **told,
            **times,
            "frames_per_second": rate,
        }


@dataclass(frozen=True)
class PersonOutcome:
    """What was done with a person: number, face ("" if none), and frames in which they were swapped, covered, left.

    grade, advice : of their swap, as for `SwapReport`.
    """

    number: int
    face: str
    swapped: int
    covered: int
    left: int
    grade: int | None = None
    advice: str = ""


@dataclass(frozen=True)
class SeveralReport(SwapReport):
    """What was done to a file and to each person in it.

    A frame counts as covered if somebody whom the user named is, else as swapped if anybody is.
    """

    people: tuple[PersonOutcome, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        return super().as_json() | {"people": [vars(person) for person in self.people]}


class Tally:
    """Counts outcomes while a file is written, and makes the report of it.

    faces, renderer, grade : for the report, known when the work is done.
    """

    def __init__(self, settings: SwapSettings, media: MediaInput, stage: str) -> None:
        self._settings, self._media, self._stage = settings, media, stage
        self._total = media.frame_count or 0
        self._beyond = OUTLINE_WARP.outer_reach if settings.look.outline > 0 else 0.0
        self._start = time.perf_counter()
        self.counts = {"swapped": 0, "held": 0, "covered": 0, "lost": 0, "untouched": 0}
        self.faces = 0
        self.renderer = ""
        self.grade: Grade | None = None

    def add(self, outcome: str) -> None:
        """Count one more frame with this outcome."""
        self.counts[outcome] += 1

    def progress(self, done: int) -> None:
        """Report that `done` frames are finished."""
        self._settings.progress(self._stage, done / self._total if self._total else 0.0)

    def require_some(self, person: str) -> None:
        """Raise SwapError when the person was seen in no frame."""
        if not self.counts["swapped"]:
            seen, part = sum(self.counts.values()), self._settings.drawn
            if part is not None and seen == self.counts["untouched"]:
                raise SwapError(f"{self._media.name} shows no frame {part.told()}")
            raise SwapError(
                f"no face of the source person ({person}) found in the {seen} frames of {self._media.name}: give the "
                "model of the person in the video with --source, or enroll them from it"
            )

    def report(self, output: Path, stats: ProcessStats, first_packet: float | None) -> SwapReport:
        """The report, made when the output is complete, after the notes on what was survived.

        first_packet : time at which a `Sink` wrote its first.
        """
        seconds = time.perf_counter() - self._start
        began = None if first_packet is None else round(first_packet - self._start, 3)
        for problem in stats.problems:
            self._settings.say(f"{self._media.name}: {problem}")
        if self.faces > 1:
            self._settings.say(
                f"{self._media.name}: up to {self.faces} faces were seen in a frame; the largest one that the source "
                "model knows was taken"
            )
        work, idle = round(stats.work_seconds + stats.ahead_seconds, 3), round(stats.encoder_idle_share, 4)
        return SwapReport(
            str(output), **self.counts, times=FileTimes(round(seconds, 3), work, began, idle),
            renderer=self.renderer, faces=self.faces, beyond_face_widths=self._beyond, problems=stats.problems,
            grade=self.grade.score if self.grade else None, advice=self.grade.advice if self.grade else "",
        )  # fmt: skip
