"""Errors of a job in the user's own words for the files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from app.failures import user_mistakes
from app.studio.store import StudioError


@contextmanager
def called(names: Mapping[Path, str]) -> Iterator[None]:
    """A user's mistake is raised as StudioError that tells of the files by these names."""
    try:
        yield
    except user_mistakes() as error:
        told = str(error)
        for path, name in names.items():
            told = told.replace(str(path), name).replace(path.name, name)
        raise StudioError(told) from error
