"""What all mesh commands share beside their files: options, notes, progress and the seconds of each stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from guise.analogy.formats.files import MeshFile, Rig, read_mesh, read_rig
from guise.common.progress import Progress, Say


@dataclass(frozen=True)
class RunContext:
    """The context in which a command runs.

    Parameters
    ----------
    force : replace existing outputs.
    progress : called with the stage and the completed share of it.   say : called with notes for the user.
    picture, report : further outputs, if given.
    seconds : by stage, recorded by `stage`.
    """

    force: bool
    progress: Progress
    say: Say
    picture: Path | None = None
    report: Path | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    def read(self, path: Path) -> MeshFile:
        """A head, with what the user should know of its file; raises MeshError."""
        return self._told(read_mesh(path))

    def read_rig(self, path: Path) -> Rig:
        """A head with morph targets, likewise."""
        rig = read_rig(path)
        self._told(rig.file)
        return rig

    def _told(self, file: MeshFile) -> MeshFile:
        for note in file.notes:
            self.say(note)
        return file

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Report that a stage begins, and time it; stages of one name add up."""
        self.progress(name, 0.0)
        start = time.perf_counter()
        yield
        self.seconds[name] = round(self.seconds.get(name, 0.0) + time.perf_counter() - start, 4)
