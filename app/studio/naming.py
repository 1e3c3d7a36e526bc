"""Error messages of jobs with the user's own names for files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from guise.app.studio.store import StudioError
from guise.common.errors import GuiseError


@contextmanager
def user_names(names: Mapping[Path, str]) -> Iterator[None]:
    """Raise a user's mistake again as StudioError that calls the files by these names."""
    try:
        yield
    except GuiseError as error:
        raise StudioError(with_user_names(str(error), names)) from error


def with_user_names(text: str, names: Mapping[Path, str]) -> str:
    """The text with the user's names in place of paths."""
    for path, name in names.items():
        text = text.replace(str(path), name).replace(path.name, name)
    return text
