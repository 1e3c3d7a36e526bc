"""Fields of a dataclass that a user sets: default, help and limits in one place, for every front end.

@dataclass(frozen=True)
class Options:
    seed: int = option(0, "Seed for the choice of donors.")
"""

from __future__ import annotations

import math
import sys
from dataclasses import Field, dataclass, field, fields
from types import SimpleNamespace
from typing import Any, TypeVar, get_type_hints

from guise.common.errors import GuiseError

T = TypeVar("T")
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

    def allows(self, value: float) -> bool:
        """Whether a number is within the limits; a number that is not one never is."""
        lowest, highest = self._limits
        return lowest <= value <= highest

    @property
    def limits(self) -> str:
        """In words.

        >>> Option("", least=0, most=1).limits, Option("", least=12).limits
        ('from 0 to 1', 'at least 12')
        """
        lowest, highest = self._limits
        return f"at least {lowest:g}" if highest == math.inf else f"from {lowest:g} to {highest:g}"

    @property
    def _limits(self) -> tuple[float, float]:
        lowest, highest = self.least, self.most
        return -math.inf if lowest is None else lowest, math.inf if highest is None else highest


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


def made(kind: type[T], **values: Any) -> T:
    """Options with these values; GuiseError for a number beyond its limits.

    >>> @dataclass(frozen=True)
    ... class Options:
    ...     share: float = option(0.5, "A share.", least=0.0, most=1.0)
    >>> made(Options, share=2)
    Traceback (most recent call last):
    guise.common.errors.GuiseError: share must be from 0 to 1, got 2
    """
    for name, (told, _, _) in options_of(kind).items():
        if isinstance(value := values.get(name), int | float):
            require(name, value, told)
    return kind(**values)


def require(name: str, value: float, told: Option) -> None:
    """Raise GuiseError for a number beyond an option's limits."""
    if not told.allows(value):
        raise GuiseError(f"{name} must be {told.limits}, got {value:g}")
