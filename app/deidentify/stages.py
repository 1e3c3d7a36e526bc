"""The jobs of a de-identification: each reads the manifest and earlier results, and writes its own, whole."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Job:
    """A piece of work that any process may do: the `index`-th of a stage, for a work folder."""

    stage: str
    work: str
    index: int


def perform(job: Job) -> None:
    """Do a job; nothing is done when its result is there already."""
    raise NotImplementedError(job.stage)
