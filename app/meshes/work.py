"""What all mesh commands are told beside their files, and how long their stages take."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

Progress = Callable[[str, float], None]
Say = Callable[[str], None]


@dataclass(frozen=True)
class Work:
    """The surroundings of a command.

    Parameters
    ----------
    force : replace existing outputs.
    progress : called with the stage and the share of it that is done.   say : called with notes for the user.
    picture, report : files that are also written, if given.
    seconds : by stage, filled by `stage`.
    """

    force: bool
    progress: Progress
    say: Say
    picture: Path | None = None
    report: Path | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Show that a stage begins, and time it; what has one name adds up."""
        self.progress(name, 0.0)
        start = time.perf_counter()
        yield
        self.seconds[name] = round(self.seconds.get(name, 0.0) + time.perf_counter() - start, 4)
