"""`guise analogy mesh sequence`: an animation of one head carried over to another, one frame after the other."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from guise.analogy.formats.files import read_frames, read_mesh
from guise.app.meshes.film import write_film
from guise.app.meshes.pair import Carrier, How, open_carrier
from guise.app.meshes.reports import Carried, TransferReport
from guise.app.meshes.transferring import CARRYING, READING, WRITING, draw, report_of, told
from guise.app.meshes.work import Work
from guise.common.arrays import F32, F64
from guise.common.errors import Interrupted, OutputError
from guise.common.files import require_outputs

RATE = 30.0  # frames per second of a film, where none is given
SAID = 1.0  # seconds between two sayings of the speed


@dataclass(frozen=True)
class Frames:
    """Where frames come from and go to.

    source : a folder of .obj or .ply, or an animated .glb or .gltf.
    output : a folder for one file a frame, or a .glb for an animation.
    rate : frames per second of a GLB; None: an animation's keys when it is read, RATE when it is written.
    resume : files that are there are left.
    """

    source: Path
    output: Path
    rate: float | None = None
    resume: bool = False

    @property
    def film(self) -> bool:
        """Whether they go into one GLB."""
        return self.output.suffix.lower() == ".glb"

    @property
    def count(self) -> int | None:
        """How many there are, if that is known without reading them."""
        if not self.source.is_dir():
            return None
        return sum(file.suffix.lower() in (".obj", ".ply") for file in self.source.iterdir())

    @property
    def sampled(self) -> float | None:
        """Frames per second at which an animation is read."""
        return self.rate or (RATE if self.film else None)


def sequence_files(source: Path, frames: Frames, target: Path, how: How, work: Work) -> TransferReport:
    """Carry every frame over, each to a file named after it in the target's format, or all to an animated GLB.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError, OutputError
        At once, or at the first frame that cannot be used; files of those before it are kept.
    Interrupted
        Files so far are kept.
    """
    _check(source, frames, target, work)
    with work.stage(READING):
        neutral, head = read_mesh(source), read_mesh(target)
        next(read_frames(frames.source, neutral, frames.sampled))  # its mistakes are said before the work
    carrier = open_carrier(neutral, head, how, work)
    run = _Run(carrier, frames, work)
    try:
        with work.stage(CARRYING):
            run.carry()
    except KeyboardInterrupt:
        kept = f"{len(run.carried)} frames are kept in {frames.output}: go on with --resume"
        raise Interrupted(f"interrupted; {'nothing was written' if frames.film else kept}") from None
    if frames.film:
        with work.stage(WRITING):
            write_film(frames.output, head, run.made, frames.rate or RATE)
    if run.most is not None:
        name = max(run.carried, key=lambda one: one.furthest).input
        draw(carrier, [run.most[0]], [run.most[1]], [name], work)
    return report_of(carrier, how, frames.output, "frame", run.carried, work, run.skipped)


def _check(source: Path, frames: Frames, target: Path, work: Work) -> None:
    inputs, extra = [source, target, frames.source], [work.picture, work.report]
    if frames.film:
        if frames.resume:
            raise OutputError(f"--resume is for a folder of files, {frames.output} is written as a whole")
        require_outputs([frames.output, *extra], inputs, force=work.force)
        return
    require_outputs(extra, inputs, force=work.force, made=frames.output)
    if frames.source.is_dir() and frames.output.resolve() == frames.source.resolve():
        raise OutputError(f"{frames.output} holds the frames that are read: choose another folder with -o")
    there = list(frames.output.glob(f"*{target.suffix}"))
    if any(file.samefile(path) for file in there for path in inputs if path.exists()):
        raise OutputError(f"{frames.output} holds an input: choose another folder with -o")
    if there and not (work.force or frames.resume):
        raise OutputError(
            f"{frames.output} holds {len(there)} {target.suffix} files: use --resume to do only the rest, --force to "
            "replace them, or another folder with -o"
        )


class _Run:
    """Carries the frames that are not there yet.

    carried : what is told of each.   skipped : how many were there.   made : the frames of a film.
    most : source and result of the frame that moves most, if any.
    """

    def __init__(self, carrier: Carrier, frames: Frames, work: Work) -> None:
        self._carrier, self._frames = carrier, frames
        self._speed = _Speed(work, frames.count)
        self.carried: list[Carried] = []
        self.skipped = 0
        self.made: list[F32] = []
        self.most: tuple[F64, F64] | None = None

    def carry(self) -> None:
        """Carry all frames over."""
        frames, pair = self._frames, self._carrier.pair
        for name, expressive in read_frames(frames.source, pair.source, frames.sampled):
            output = frames.output / f"{name}{pair.target.path.suffix}"
            if frames.resume and output.exists():
                self.skipped += 1
                continue
            self._one(name, expressive, None if frames.film else output)
            self._speed.show(len(self.carried), self.skipped)

    def _one(self, name: str, expressive: F64, output: Path | None) -> None:
        start = time.perf_counter()
        made = self._carrier.transfer(expressive)
        seconds = round(time.perf_counter() - start, 4)
        if output is None:
            self.made.append(made.astype(np.float32))
        else:
            self._carrier.pair.target.write(output, made)
        one = told(self._carrier, expressive, made, name, str(output or self._frames.output), seconds)
        if one.furthest >= max((other.furthest for other in self.carried), default=0.0):
            self.most = expressive, made
        self.carried.append(one)


class _Speed:
    """Shows how many frames a second are done."""

    def __init__(self, work: Work, total: int | None) -> None:
        self._work, self._total = work, total
        self._start = self._said = time.monotonic()
        self._stage = CARRYING

    def show(self, done: int, skipped: int) -> None:
        """So many are done, and so many were there."""
        now = time.monotonic()
        if now - self._said > SAID:
            self._said = now
            self._stage = f"{done} frames, {done / (now - self._start):.0f} a second"
        self._work.progress(self._stage, (done + skipped) / self._total if self._total else 0.0)
