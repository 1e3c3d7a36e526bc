"""What was measured of an output: the figures that are reported, and the curves that are plotted.

All figures are JSON-like; NaN stands for what could not be measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.app.measure.curves import (
    ANGLES,
    CURVES,
    angle_between,
    correlation,
    expression,
    jitter,
    point_errors,
    pose,
)
from guise.app.measure.pair import SoundCheck
from guise.app.measure.privacy import Scores
from guise.common.arrays import F64
from guise.common.version import VERSION


@dataclass(frozen=True)
class Reidentification:
    """How well a person is re-identified in an output when all frames are combined.

    person : from 1.   frames : in which the face was compared.   similarity : of the mean embeddings.
    rank : among `of` people; 1 means re-identified.   donor : whose face it is most like, or "".
    """

    person: int
    frames: int
    similarity: float
    rank: int
    of: int
    donor: str


@dataclass(frozen=True)
class Privacy:
    """How well people are re-identified.

    Parameters
    ----------
    to_source : scores of the output's faces with their own person; unswapped, of the original's own faces.
    to_donor : with the donor that the person's face is most like; None without donors.
    unswapped_to_donor : the same of the original.
    rank_one, unswapped_rank_one : share of faces whose best match is their own person.   chance : of a guess.
    verification, unswapped_verification : share of faces above the threshold of the false-accept rate.
    equal_error_rate, unswapped_equal_error_rate : 0.5 when the scores don't tell the person from others.
    by_state : scores with the source by what the report says was done with the face; {} without a report.
    people : each person when all frames are combined.
    """

    to_source: Scores | None
    unswapped: Scores | None
    to_donor: Scores | None
    unswapped_to_donor: Scores | None
    rank_one: float
    unswapped_rank_one: float
    chance: float
    verification: float
    unswapped_verification: float
    equal_error_rate: float
    unswapped_equal_error_rate: float
    by_state: Mapping[str, Scores]
    people: tuple[Reidentification, ...]


@dataclass(frozen=True)
class Utility:
    """How much of the expression and motion is kept.

    Parameters
    ----------
    found : share of the original's faces that are found in the output too.
    correlation : of each expression curve; NaN when it does not move.
    expression : mean over the curves that move.
    landmark_error, motion_error : mean distance of the landmarks, % of the inter-ocular distance; the second
        without the constant difference of the faces.
    pose_error, pose_motion_error : mean absolute difference of yaw, pitch and roll, degrees; likewise.
    jitter_ratio : jitter of the output's landmarks over that of the original's.
    """

    found: float
    correlation: Mapping[str, float]
    expression: float
    landmark_error: float
    motion_error: float
    pose_error: Mapping[str, float]
    pose_motion_error: Mapping[str, float]
    jitter_ratio: float

    @classmethod
    def of(cls, before: NDArray[Any], after: NDArray[Any], frames: NDArray[Any], total: int) -> Utility:
        """Of one person: landmarks (n, 81, 2) in both, in the frames (n,) in which both are found, of `total`."""
        if not len(frames):
            nothing = dict.fromkeys(ANGLES, math.nan)
            return cls(
                0.0, dict.fromkeys(CURVES, math.nan), math.nan, math.nan, math.nan, nothing, nothing, math.nan
            )
        first, second = expression(before), expression(after)
        kept = {name: correlation(first[name], second[name]) for name in CURVES}
        whole, motion = point_errors(before, after)
        turned = angle_between(pose(after), pose(before))
        original_jitter = jitter(before, frames)
        return cls(
            found=len(frames) / total,
            correlation=kept,
            expression=mean_of(kept.values()),
            landmark_error=float(whole.mean()),
            motion_error=float(motion.mean()),
            pose_error=dict(zip(ANGLES, np.abs(turned).mean(0).tolist(), strict=True)),
            pose_motion_error=dict(
                zip(ANGLES, np.abs(turned - turned.mean(0)).mean(0).tolist(), strict=True)
            ),
            jitter_ratio=jitter(after, frames) / original_jitter if original_jitter > 0 else math.nan,
        )


def mean_of(values: Any, weights: Sequence[float] | None = None) -> float:
    """Mean of the numbers that are not NaN; NaN without any."""
    numbers = np.array(list(values), np.float64)
    heavy = np.ones(len(numbers)) if weights is None else np.asarray(weights, np.float64)
    known = np.isfinite(numbers) & (heavy > 0)
    return float(numbers[known] @ heavy[known] / heavy[known].sum()) if known.any() else math.nan


def weighted_mean(parts: Sequence[Utility], frames: Sequence[int]) -> Utility:
    """Several people's figures as one, each weighted by its number of frames in the original."""

    def mean(values: Sequence[Any]) -> Any:
        if isinstance(values[0], Mapping):
            return {key: mean([value[key] for value in values]) for key in values[0]}
        return mean_of(values, frames)

    return Utility(**{one.name: mean([getattr(p, one.name) for p in parts]) for one in fields(Utility)})


@dataclass(frozen=True)
class FileChecks:
    """How the file itself compares with the original.

    times_identical : whether every frame has its time stamp; time_error : largest difference, seconds, from the first
    frame on.   sound : each stream.   untouched_psnr : outside the faces, dB; infinite when nothing differs.
    """

    times_identical: bool
    time_error: float
    sound: tuple[SoundCheck, ...]
    untouched_psnr: float


@dataclass(frozen=True, eq=False)
class PlotCurves:
    """The curves that the plot shows of an output.

    seconds : (n,) of the frames in which the person seen most is found in both; before, after : their curves.
    similarity : (m,) of that person's face with the source, at the times `similarity_seconds`.
    states : (m,) what the report says was done with it, or None.
    """

    seconds: F64
    before: Mapping[str, F64]
    after: Mapping[str, F64]
    similarity_seconds: F64
    similarity: F64
    states: NDArray[np.str_] | None = None


@dataclass(frozen=True, eq=False)
class OutputFigures:
    """All that was measured of an output."""

    name: str
    privacy: Privacy | None
    utility: Utility
    people: tuple[Utility, ...]
    files: FileChecks
    plot_curves: PlotCurves


@dataclass(frozen=True, eq=False)
class MeasureResult:
    """All that was measured.

    landmarker, recogniser : names; independent : whether the landmarker is not the one that Guise swaps with.
    gallery : people, pictures, impostor_pairs, false_accept_rate, threshold, enough_pairs; {} without a recogniser.
    impostors : summary of the scores, or None.   notes : sentences for the user.
    """

    original: str
    frames: int
    seconds: float
    faces: tuple[int, ...]
    landmarker: str
    independent: bool
    recogniser: str | None
    gallery: Mapping[str, Any]
    impostors: Scores | None
    outputs: tuple[OutputFigures, ...]
    notes: tuple[str, ...] = field(default=())

    def as_json(self) -> dict[str, Any]:
        """The result as docs/measure.md explains it."""
        return {
            "format": "guise-measure",
            "version": 1,
            "guise": VERSION,
            "original": self.original,
            "frames": self.frames,
            "seconds": self.seconds,
            "people": [{"person": i + 1, "frames": n} for i, n in enumerate(self.faces)],
            "landmarker": {"name": self.landmarker, "independent": self.independent},
            "recogniser": self.recogniser,
            "gallery": plain(self.gallery),
            "impostors": plain(self.impostors and asdict(self.impostors)),
            "outputs": [_output_json(one) for one in self.outputs],
            "notes": list(self.notes),
        }


def _output_json(one: OutputFigures) -> dict[str, Any]:
    return {
        "output": one.name,
        "privacy": plain(one.privacy and asdict(one.privacy)),
        "utility": plain(asdict(one.utility) | {"people": [asdict(p) for p in one.people]}),
        "files": plain(asdict(one.files) | {"untouched_identical": math.isinf(one.files.untouched_psnr)}),
    }


def plain(value: Any) -> Any:
    """A value as JSON holds it: no NaN, no infinity."""
    if isinstance(value, Mapping):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value
