"""Fields of a dataclass that a user sets: default, help and limits in one place, for every front end.

@dataclass(frozen=True)
class Options:
    seed: int = option(0, "Seed for the choice of donors.")
"""

from __future__ import annotations

import sys
from dataclasses import Field, dataclass, field, fields
from types import SimpleNamespace
from typing import Any, get_type_hints

_KEY = "option"


@dataclass(frozen=True)
class Option:
    """What a user is told about a field.

    Parameters
    ----------
    help : one sentence.   name : on the command line, and a short one after a space; by default that of the field.
    metavar : what stands for its value.   least, most : its limits.
    """

    help: str
    name: str | None = None
    metavar: str | None = None
    least: float | None = None
    most: float | None = None


def option(default: Any, help: str, **more: Any) -> Any:
    """A field with this default that a user may set; `more` as for `Option`."""
    return field(default=default, metadata={_KEY: Option(help, **more)})


def options_of(kind: type) -> dict[str, tuple[Option, Field[Any], Any]]:
    """By name of the field, in order: its option, the field and its type.

    Types of other fields are not evaluated, so that their modules need not be loaded.
    """
    found = {one.name: one for one in fields(kind) if _KEY in one.metadata}
    texts = SimpleNamespace(__annotations__={name: one.type for name, one in found.items()})
    types = get_type_hints(texts, vars(sys.modules[kind.__module__]))
    return {name: (one.metadata[_KEY], one, types[name]) for name, one in found.items()}
