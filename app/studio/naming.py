"""Errors of a job in the user's own words for the files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from guise.app.studio.store import StudioError
from guise.common.errors import GuiseError


@contextmanager
def called(names: Mapping[Path, str]) -> Iterator[None]:
    """A user's mistake is raised as StudioError that tells of the files by these names."""
    try:
        yield
    except GuiseError as error:
        told = str(error)
        for path, name in names.items():
            told = told.replace(str(path), name).replace(path.name, name)
        raise StudioError(told) from error
