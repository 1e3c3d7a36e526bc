"""`guise analogy mesh sequence`: an animation of one head transferred to another, frame by frame."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from guise.analogy.formats.files import read_frames
from guise.app.meshes.animated_glb import write_animated_glb
from guise.app.meshes.context import RunContext
from guise.app.meshes.options import TransferOptions, Unit
from guise.app.meshes.pair import TransferPair, prepare_pair
from guise.app.meshes.reports import TransferredExpression, TransferReport
from guise.app.meshes.transferring import (
    READING,
    TRANSFERRING,
    WRITING,
    draw_report_picture,
    make_report,
    metres_per_unit,
    summarise,
)
from guise.common.arrays import F32, F64
from guise.common.errors import Interrupted, OutputError
from guise.common.files import require_outputs

MESH_SUFFIXES = (".vrm", ".gltf", ".obj", ".ply", ".fbx")
DEFAULT_FPS = 30.0  # of an animated GLB, unless given
SPEED_INTERVAL_S = 1.0  # between two updates of the speed


@dataclass(frozen=True)
class SequenceFiles:
    """Input and output of a sequence.

    source : a folder of .obj or .ply, or an animated .glb or .gltf.
    output : a folder for one file per frame, or a .glb for an animation.
    rate : frames per second of a GLB; None uses the keys when reading and `DEFAULT_FPS` when writing.
    resume : existing files are kept.   unit : of the target's lengths, for a GLB; None counts them as metres.
    """

    source: Path
    output: Path
    rate: float | None = None
    resume: bool = False
    unit: Unit | None = None

    @property
    def is_animation(self) -> bool:
        """Whether the output is one animated GLB."""
        return self.output.suffix.lower() == ".glb"

    @property
    def count(self) -> int | None:
        """Number of frames, if known without reading them."""
        if not self.source.is_dir():
            return None
        return sum(file.suffix.lower() in (".obj", ".ply") for file in self.source.iterdir())

    @property
    def sampling_fps(self) -> float | None:
        """Frames per second at which an animation is read."""
        return self.rate or (DEFAULT_FPS if self.is_animation else None)


def transfer_sequence(
    source: Path, frames: SequenceFiles, target: Path, options: TransferOptions, context: RunContext
) -> TransferReport:
    """Transfer every frame, each to a file named after it in the target's format, or all to an animated GLB.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError, OutputError
        At once, or at the first frame that cannot be used; files written before are kept.
    Interrupted
        Files written so far are kept.
    """
    _require_outputs(source, frames, target, context)
    with context.stage(READING):
        neutral, head = context.read(source), context.read(target)
        next(
            read_frames(frames.source, neutral, frames.sampling_fps)
        )  # so that errors are reported before the work
    pair = prepare_pair(neutral, head, options, context)
    run = _SequenceRun(pair, frames, context)
    try:
        with context.stage(TRANSFERRING):
            run.transfer()
    except KeyboardInterrupt:
        kept = f"{len(run.transferred)} frames are kept in {frames.output}: continue with --resume"
        raise Interrupted(f"interrupted; {'nothing was written' if frames.is_animation else kept}") from None
    if frames.is_animation:
        with context.stage(WRITING):
            scale = metres_per_unit(head, frames.unit, context)
            write_animated_glb(frames.output, head, run.vertices, frames.rate or DEFAULT_FPS, scale)
    if run.largest is not None:
        name = max(run.transferred, key=lambda one: one.furthest).input
        draw_report_picture(pair.heads, [run.largest[0]], [run.largest[1]], [name], context)
    return make_report(pair.heads, options, frames.output, "frame", run.transferred, context, run.skipped)


def _require_outputs(source: Path, frames: SequenceFiles, target: Path, context: RunContext) -> None:
    inputs, extra = [source, target, frames.source], [context.picture, context.report]
    if frames.is_animation:
        if frames.resume:
            raise OutputError(f"--resume needs a folder as output, but {frames.output} is written as a whole")
        require_outputs([frames.output, *extra], inputs, force=context.force)
        return
    if frames.output.suffix.lower() in MESH_SUFFIXES and not frames.output.is_dir():
        raise OutputError(
            f"{frames.output} must be a folder, or end in .glb: a sequence is not written as one such file"
        )
    require_outputs(extra, inputs, force=context.force, made=frames.output)
    if frames.source.is_dir() and frames.output.resolve() == frames.source.resolve():
        raise OutputError(f"{frames.output} contains the input frames: choose another folder with -o")
    there = list(frames.output.glob(f"*{target.suffix}"))
    if any(file.samefile(path) for file in there for path in inputs if path.exists()):
        raise OutputError(f"{frames.output} contains an input: choose another folder with -o")
    if there and not (context.force or frames.resume):
        raise OutputError(
            f"{frames.output} holds {len(there)} {target.suffix} files: use --resume to do only the rest, --force to "
            "replace them, or another folder with -o"
        )


class _SequenceRun:
    """Transfers the frames that do not exist yet.

    carried : what is told of each.   skipped : how many were there.   made : the frames of a film.
    most : source and result of the frame that moves most, if any.
    """

    def __init__(self, pair: TransferPair, frames: SequenceFiles, context: RunContext) -> None:
        self._pair, self._frames = pair, frames
        self._speed = _SpeedDisplay(context, frames.count)
        self.transferred: list[TransferredExpression] = []
        self.skipped = 0
        self.vertices: list[F32] = []
        self.largest: tuple[F64, F64] | None = None

    def transfer(self) -> None:
        """Transfer all frames."""
        frames, pair = self._frames, self._pair.heads
        for name, expressive in read_frames(frames.source, pair.source, frames.sampling_fps):
            output = frames.output / f"{name}{pair.target.path.suffix}"
            if frames.resume and output.exists():
                self.skipped += 1
                continue
            self._transfer_frame(name, expressive, None if frames.is_animation else output)
            self._speed.show(len(self.transferred), self.skipped)

    def _transfer_frame(self, name: str, expressive: F64, output: Path | None) -> None:
        start = time.perf_counter()
        made = self._pair.transfer(expressive)
        seconds = round(time.perf_counter() - start, 4)
        if output is None:
            self.vertices.append(made.astype(np.float32))
        else:
            self._pair.heads.target.write(output, made)
        one = summarise(self._pair, expressive, made, name, str(output or self._frames.output), seconds)
        if one.furthest >= max((other.furthest for other in self.transferred), default=0.0):
            self.largest = expressive, made
        self.transferred.append(one)


class _SpeedDisplay:
    """Shows the frames per second."""

    def __init__(self, context: RunContext, total: int | None) -> None:
        self._work, self._total = context, total
        self._start = self._said = time.monotonic()
        self._stage = TRANSFERRING

    def show(self, done: int, skipped: int) -> None:
        """Show the progress: frames done, and frames skipped."""
        now = time.monotonic()
        if now - self._said > SPEED_INTERVAL_S:
            self._said = now
            self._stage = f"{done} frames, {done / (now - self._start):.0f} per second"
        self._work.progress(self._stage, (done + skipped) / self._total if self._total else 0.0)
