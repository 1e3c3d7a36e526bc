"""`guise analogy mesh sequence`: an animation of one head carried over to another, one frame after the other."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analogy.mesh_io import MeshFile, read_frames, read_mesh
from app.failures import Interrupted
from app.meshes.outputs import require_outputs
from app.meshes.pair import Carrier, How, open_carrier
from app.meshes.reports import Carried, TransferReport
from app.meshes.transferring import CARRYING, READING, draw, report_of, told
from app.meshes.work import Work
from app.outputs import OutputError

F64 = NDArray[np.float64]

SAID = 1.0  # seconds between two sayings of the speed


@dataclass(frozen=True)
class Frames:
    """Where frames come from and go to.

    source : a folder of .obj or .ply, or an animated .glb or .gltf.   folder : for one file a frame.
    rate : frames per second of an animation, None for its keys.   resume : files that are there are left.
    """

    source: Path
    folder: Path
    rate: float | None = None
    resume: bool = False

    @property
    def count(self) -> int | None:
        """How many there are, if that is known without reading them."""
        if not self.source.is_dir():
            return None
        return sum(file.suffix.lower() in (".obj", ".ply") for file in self.source.iterdir())


def sequence_files(source: Path, frames: Frames, target: Path, how: How, work: Work) -> TransferReport:
    """Carry every frame over, each to a file named after it in the target's format.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError, OutputError
        At once, or at the first frame that cannot be used; those before it are kept.
    Interrupted
        Those so far are kept.
    """
    _check(source, frames, target, work)
    with work.stage(READING):
        neutral, head = read_mesh(source), read_mesh(target)
        first = next(
            read_frames(frames.source, neutral, frames.rate)
        )  # its mistakes are said before the work
    del first
    carrier = open_carrier(neutral, head, how, work)
    carried: list[Carried] = []
    try:
        with work.stage(CARRYING):
            skipped, most = _carry(carrier, frames, carried, work)
    except KeyboardInterrupt:
        kept = f"{len(carried)} frames are kept in {frames.folder}: go on with --resume"
        raise Interrupted(f"interrupted; {kept}") from None
    if most is not None:
        name = max(carried, key=lambda one: one.furthest).input
        draw(carrier, [most[0]], [most[1]], [name], work)
    return report_of(carrier, how, frames.folder, "frame", carried, work, skipped)


def _check(source: Path, frames: Frames, target: Path, work: Work) -> None:
    inputs = [source, target]
    require_outputs([work.picture, work.report], inputs, force=work.force, made=frames.folder)
    if frames.source.is_dir() and frames.folder.resolve() == frames.source.resolve():
        raise OutputError(f"{frames.folder} holds the frames that are read: choose another folder with -o")
    there = list(frames.folder.glob(f"*{target.suffix}"))
    if any(file.samefile(path) for file in there for path in inputs if path.exists()):
        raise OutputError(f"{frames.folder} holds an input: choose another folder with -o")
    if there and not (work.force or frames.resume):
        raise OutputError(
            f"{frames.folder} holds {len(there)} {target.suffix} files: use --resume to do only the rest, --force to "
            "replace them, or another folder with -o"
        )


def _carry(
    carrier: Carrier, frames: Frames, carried: list[Carried], work: Work
) -> tuple[int, tuple[F64, F64] | None]:
    """Carry what is not there yet, adding to `carried`; how many were there, and source and result of the frame
    that moves most."""
    skipped, most, speed = 0, None, _Speed(work, frames.count)
    target: MeshFile = carrier.pair.target
    for name, expressive in _frames(carrier, frames):
        output = frames.folder / f"{name}{target.path.suffix}"
        if frames.resume and output.exists():
            skipped += 1
            continue
        start = time.perf_counter()
        made = carrier.transfer(expressive)
        seconds = round(time.perf_counter() - start, 4)
        target.write(output, made)
        one = told(carrier, expressive, made, name, str(output), seconds)
        if one.furthest >= max((other.furthest for other in carried), default=0.0):
            most = expressive, made
        carried.append(one)
        speed.show(len(carried), skipped)
    return skipped, most


def _frames(carrier: Carrier, frames: Frames) -> Iterator[tuple[str, F64]]:
    return read_frames(frames.source, carrier.pair.source, frames.rate)


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
