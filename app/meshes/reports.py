"""What the mesh commands say and write about what they did.  Lengths in the unit of the file that they are of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from guise.analogy.solver import solver
from guise.common.arrays import F64
from guise.common.version import version

MOST_TOLD = 12  # expressions of which a line is said
UNSURE = 0.5  # confidence of a feature point below which one should look at it
KEPT = 1e-3  # error E below which a vertex moved as far as in the source


class Report(Protocol):
    """What a command did."""

    def lines(self) -> list[str]:
        """For people."""

    def as_json(self) -> dict[str, Any]:
        """For programs."""


@dataclass(frozen=True)
class AmountError:
    """The error E of Song's appendix over the vertices that move: how far each moves, against the source.

    median, p95 : of E.   below : share of vertices with E < 0.1 %.   vertices : that move.
    """

    median: float
    p95: float
    below: float
    vertices: int

    @classmethod
    def of(cls, error: F64) -> AmountError | None:
        """Of E per vertex (N,), NaN where nothing moves; None when nothing does."""
        moved = error[np.isfinite(error)]
        if not len(moved):
            return None
        median, p95 = (round(float(np.percentile(moved, share)), 6) for share in (50, 95))
        return cls(median, p95, round(float((moved < KEPT).mean()), 4), len(moved))


@dataclass(frozen=True)
class Carried:
    """An expression that was carried over.

    input, output : files, or names of morph targets.   furthest : the longest way of a vertex.
    error : None when nothing moves.   seconds : without reading and writing.
    """

    input: str
    output: str
    furthest: float
    error: AmountError | None
    seconds: float

    def words(self) -> str:
        """For people."""
        if self.error is None:
            return "nothing moves"
        return f"longest way {self.furthest:.3g}; ways differ from the source's by {self.error.median:.1%} (median)"


@dataclass(frozen=True)
class TransferReport:
    """What `transfer`, `rig` or `sequence` did.

    Parameters
    ----------
    source, target, output : files or folders.   method : tents, gradients or cloning.
    correspondence : how the heads were matched, and how well.
    kind : expression, morph target or frame.   expressions : each.
    skipped : of a sequence, how many were there already.
    seconds : by stage.   picture : that was drawn.   versions : of what did it.
    """

    source: Path
    target: Path
    output: Path
    method: str
    correspondence: Mapping[str, Any]
    kind: str
    expressions: tuple[Carried, ...]
    skipped: int
    seconds: Mapping[str, float]
    picture: Path | None
    versions: Mapping[str, str]

    def lines(self) -> list[str]:
        """For people."""
        count, known = len(self.expressions), self.correspondence
        skipped = f", {self.skipped} were there" if self.skipped else ""
        each = [f"  {Path(one.output).name}: {one.words()}" for one in self.expressions[:MOST_TOLD]]
        each += [f"  and {count - MOST_TOLD} more; --report tells of all"] if count > MOST_TOLD else []
        return [
            f"{self.output}: {_many(count, self.kind)}{skipped}, {sum(self.seconds.values()):.1f} s",
            f"  heads matched: {known['kind']}, {known['found']:.1%} of the target is found on the source",
            *([self._speed()] if self.kind == "frame" else each),
            *([f"  picture: {self.picture}"] if self.picture else []),
        ]

    def _speed(self) -> str:
        rate = len(self.expressions) / max(self.seconds["carrying"], 1e-9)
        alone = 1e3 * float(np.mean([one.seconds for one in self.expressions] or [0.0]))
        return f"  {rate:.1f} frames a second, reading and writing included; {alone:.1f} ms a frame without"

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return asdict(self)


@dataclass(frozen=True)
class Distances:
    """How far the vertices of two meshes are apart."""

    mean: float
    p95: float
    largest: float

    @classmethod
    def between(cls, before: F64, after: F64) -> Distances:
        """Of vertices (N, 3) and (N, 3)."""
        way = np.linalg.norm(after - before, axis=1)
        return cls(*(float(f"{x:.6g}") for x in (way.mean(), np.percentile(way, 95), way.max())))


@dataclass(frozen=True)
class PreviewReport:
    """What `preview` drew.

    before, after : files; after and distances are None for a single head.   output : picture or video.
    """

    before: Path
    after: Path | None
    output: Path
    distances: Distances | None
    seconds: Mapping[str, float]

    def lines(self) -> list[str]:
        """For people."""
        if self.distances is None:
            return [f"written: {self.output}"]
        d = self.distances
        return [
            f"{self.output}: vertices are {d.mean:.4g} apart in the mean, 95 % less than {d.p95:.4g}, at most "
            f"{d.largest:.4g}"
        ]

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return asdict(self)


@dataclass(frozen=True)
class LandmarksReport:
    """What `landmarks` found.

    points : name -> x, y, z.   confidence : name -> 0..1; 1 for those that were given.
    """

    mesh: Path
    output: Path
    points: Mapping[str, list[float]]
    confidence: Mapping[str, float]
    picture: Path | None
    seconds: Mapping[str, float]

    def lines(self) -> list[str]:
        """For people."""
        unsure = [name for name, sure in self.confidence.items() if sure < UNSURE]
        doubt = f"; look at {', '.join(unsure)}" if unsure else ""
        picture = [f"  picture: {self.picture}"] if self.picture else []
        return [f"{self.output}: {len(self.points)} feature points{doubt}", *picture]

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return asdict(self)


@dataclass(frozen=True)
class RegisterReport:
    """What `register` did.

    output : the template on the target.   correspondence : the .npz file.
    quality : of the registration, lengths in the target's unit.
    """

    template: Path
    target: Path
    output: Path
    correspondence: Path
    quality: Mapping[str, float]
    seconds: Mapping[str, float]
    picture: Path | None
    versions: Mapping[str, str]

    def lines(self) -> list[str]:
        """For people."""
        q = self.quality
        return [
            f"{self.output}, {self.correspondence}: {q['matched']:.1%} of the target found on the template, "
            f"{sum(self.seconds.values()):.1f} s",
            f"  distance to the target: mean {q['mean']:.3g}, 95 % below {q['p95']:.3g}; {q['folded']:.2%} of the "
            "faces folded",
            *([f"  picture: {self.picture}"] if self.picture else []),
        ]

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return asdict(self)


def versions() -> dict[str, str]:
    """Of Guise, and who solved."""
    return {"guise": version(), "solver": solver()}


def _many(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"
