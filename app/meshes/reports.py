"""Reports of the mesh commands.  Lengths are in the unit of the file that they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from guise.analogy.solver import solver_name
from guise.app.meshes.parts import NamedPart, parts_line
from guise.common.arrays import F64
from guise.common.report import Report
from guise.common.text import counted
from guise.common.version import VERSION

MAX_LISTED_EXPRESSIONS = 12  # that get a line each
UNSURE_CONFIDENCE = 0.5  # of a feature point, below which it should be checked
UNCHANGED_ERROR = 1e-3  # E below which a vertex moves as far as in the source


@dataclass(frozen=True)
class MeshReport(Report):
    """The report of a command."""

    def lines(self) -> list[str]:
        """For people."""
        raise NotImplementedError


@dataclass(frozen=True)
class MotionError:
    """The error E of Song's appendix over the moving vertices: relative difference of each motion to the source.

    median, p95 : of E.   below : share of vertices with E < 0.1 %.   vertices : number that move.
    """

    median: float
    p95: float
    below: float
    vertices: int

    @classmethod
    def of(cls, error: F64) -> MotionError | None:
        """From E per vertex (N,), NaN where nothing moves; None when nothing moves at all."""
        moved = error[np.isfinite(error)]
        if not len(moved):
            return None
        median, p95 = (round(float(np.percentile(moved, share)), 6) for share in (50, 95))
        return cls(median, p95, round(float((moved < UNCHANGED_ERROR).mean()), 4), len(moved))


@dataclass(frozen=True)
class TransferredExpression:
    """A transferred expression.

    input, output : files, or names of morph targets.   furthest : the largest displacement of a vertex.
    error : of the skin; None when it stays.   seconds : without reading and writing.
    """

    input: str
    output: str
    furthest: float
    error: MotionError | None
    seconds: float

    def summary(self) -> str:
        """For people."""
        if not self.furthest:
            return "nothing moves"
        moves = f"largest motion {self.furthest:.3g}"
        if self.error is None:
            return f"{moves}; the skin stays"
        return f"{moves}; motions differ from the source's by {self.error.median:.1%} (median)"


@dataclass(frozen=True)
class TransferReport(MeshReport):
    """The report of `transfer`, `rig` or `sequence`.

    Parameters
    ----------
    source, target, output : files or folders.   method : tents, deformable, gradients or cloning.
    correspondence : method and quality of the match.   parts : of the target.
    kind : expression, morph target or frame.   expressions : one entry each.
    skipped : frames of a sequence that existed already.
    seconds : by stage.   picture : if one was drawn.   versions : of Guise and the solver.
    """

    source: Path
    target: Path
    output: Path
    method: str
    correspondence: Mapping[str, Any]
    kind: str
    expressions: tuple[TransferredExpression, ...]
    skipped: int
    seconds: Mapping[str, float]
    picture: Path | None
    versions: Mapping[str, str]
    parts: tuple[NamedPart, ...] = ()

    def lines(self) -> list[str]:
        count, known = len(self.expressions), self.correspondence
        skipped = f", {self.skipped} existed already" if self.skipped else ""
        each = [
            f"  {Path(one.output).name}: {one.summary()}" for one in self.expressions[:MAX_LISTED_EXPRESSIONS]
        ]
        each += (
            [f"  and {count - MAX_LISTED_EXPRESSIONS} more; --report lists them all"]
            if count > MAX_LISTED_EXPRESSIONS
            else []
        )
        return [
            f"{self.output}: {counted(count, self.kind)}{skipped}, {sum(self.seconds.values()):.1f} s",
            f"  heads matched: {known['kind']}, {known['found']:.1%} of the target's skin has a counterpart",
            *([f"  parts of the target: {parts_line(self.parts)}"] if len(self.parts) > 1 else []),
            *([self._speed()] if self.kind == "frame" else each),
            *([f"  picture: {self.picture}"] if self.picture else []),
        ]

    def _speed(self) -> str:
        rate = len(self.expressions) / max(self.seconds["carrying"], 1e-9)
        alone = 1e3 * float(np.mean([one.seconds for one in self.expressions] or [0.0]))
        return f"  {rate:.1f} frames per second with reading and writing; {alone:.1f} ms per frame without"


@dataclass(frozen=True)
class Distances:
    """Distances between the vertices of two meshes."""

    mean: float
    p95: float
    largest: float

    @classmethod
    def between(cls, before: F64, after: F64) -> Distances:
        """Of vertices (N, 3) and (N, 3)."""
        way = np.linalg.norm(after - before, axis=1)
        return cls(*(float(f"{x:.6g}") for x in (way.mean(), np.percentile(way, 95), way.max())))


@dataclass(frozen=True)
class PreviewReport(MeshReport):
    """The report of `preview`.

    before, after : files; after and distances are None for a single head.   output : picture or video.
    truth : what `after` should be, from which distances are then; `error` is its E.
    """

    before: Path
    after: Path | None
    output: Path
    distances: Distances | None
    seconds: Mapping[str, float]
    truth: Path | None = None
    error: MotionError | None = None

    def lines(self) -> list[str]:
        if self.distances is None:
            return [f"written: {self.output}"]
        d = self.distances
        below = (
            ""
            if self.error is None
            else f"; {self.error.below:.1%} of those that move err by less than 0.1 %"
        )
        return [
            f"{self.output}: vertices are {d.mean:.4g} apart on average, 95 % less than {d.p95:.4g}, at most "
            f"{d.largest:.4g}{below}"
        ]


@dataclass(frozen=True)
class LandmarksReport(MeshReport):
    """The report of `landmarks`.

    points : name -> x, y, z.   confidence : name -> 0..1; 1 for given points.
    parts : of the head.   parts_file : where they were written.
    """

    mesh: Path
    output: Path
    points: Mapping[str, list[float]]
    confidence: Mapping[str, float]
    parts: tuple[NamedPart, ...]
    parts_file: Path | None
    picture: Path | None
    seconds: Mapping[str, float]

    def lines(self) -> list[str]:
        unsure = [name for name, sure in self.confidence.items() if sure < UNSURE_CONFIDENCE]
        doubt = f"; check {', '.join(unsure)}" if unsure else ""
        picture = [f"  picture: {self.picture}"] if self.picture else []
        told = f"{self.parts_file}: " if self.parts_file else "parts: "
        parts = [f"  {told}{parts_line(self.parts)}"] if self.parts_file or len(self.parts) > 1 else []
        return [f"{self.output}: {len(self.points)} feature points{doubt}", *parts, *picture]


@dataclass(frozen=True)
class RegisterReport(MeshReport):
    """The report of `register`.

    output : the deformed template.   correspondence : the .npz file.
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
        q = self.quality
        return [
            f"{self.output}, {self.correspondence}: {q['matched']:.1%} of the target has a counterpart on the "
            f"template, {sum(self.seconds.values()):.1f} s",
            f"  distance to the target: mean {q['mean']:.3g}, 95 % below {q['p95']:.3g}; {q['folded']:.2%} of the "
            "faces folded",
            *([f"  picture: {self.picture}"] if self.picture else []),
        ]


def versions() -> dict[str, str]:
    """Versions of Guise and the name of the solver."""
    return {"guise": VERSION, "solver": solver_name()}
