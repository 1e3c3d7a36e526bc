"""Former names of options: for one more version they do what they did, print a note, and stand in no help.

Arguments are rewritten before they are parsed, so that the commands know today's names only.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand

from guise.common.presets import ENCODER_PRESETS

MODEL_SUFFIX = ".guise"
UNTIL = "the former name goes with version 0.3"
LOOKS_NOTE = f"--light and --transfer are now --look swap|paper; {UNTIL}"


@dataclass(frozen=True)
class FormerName:
    """A former name and what it is now.

    Parameters
    ----------
    now : today's name; "" for an option that is no longer needed.
    flag : whether it takes no value.
    when : of a name that also is one of today's: for which values the former meaning is meant.
    """

    now: str
    flag: bool = False
    when: Callable[[str], bool] | None = None


def _is_media(value: str) -> bool:
    """Whether a value of `guise live --source` is a file or an address, which --input takes, instead of a person."""
    return "://" in value or (Path(value).exists() and Path(value).suffix != MODEL_SUFFIX)


_ENCODER_PRESET = {
    "--preset": FormerName("--encoder-preset", when=lambda value: bool(ENCODER_PRESETS.fullmatch(value)))
}
# By command, what was called otherwise.
FORMER: Mapping[str, Mapping[str, FormerName]] = {
    "swap": _ENCODER_PRESET,
    "puppet": _ENCODER_PRESET,
    "live": {
        **_ENCODER_PRESET,
        "--source": FormerName("--input", when=_is_media),
        "--person": FormerName("--source"),
        "--enrol": FormerName("--enroll", flag=True),
        "--headless": FormerName("", flag=True),
        "--uncovered": FormerName("--unsure leave", flag=True),
    },
    "deidentify": {
        **_ENCODER_PRESET,
        "--donor": FormerName("--identity"),
        "--donors": FormerName("--identity"),
        "--detector": FormerName("--audit-detector"),
    },
    "measure": {
        "--donor": FormerName("--identity"),
        "--gallery": FormerName("--distractors"),
        "--report": FormerName("--output-report"),
    },
    "info": {"--montage": FormerName("--picture")},
    "image": {"--montage": FormerName("--picture"), "--mouth": FormerName("--open-mouth")},
    "animate": {**_ENCODER_PRESET, "--model": FormerName("--source"), "--mouth": FormerName("--open-mouth")},
}
# By command, the ways to draw that were two options, each with the values that it took.
WITH_LOOK = ("swap", "puppet", "live")
LOOKS = {"--light": ("learned", "classical", "paper"), "--transfer": ("full", "paper")}


class Command(TyperCommand):
    """A command that knows the former names of its options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse today's names, and say which former ones were given unless that is to be quiet."""
        renewed, notes = _renewed(str(self.name), args)
        rest = super().parse_args(ctx, renewed)
        if not ctx.params.get("quiet"):
            for note in notes:
                print(note, file=sys.stderr)
        return rest


def _renewed(command: str, args: list[str]) -> tuple[list[str], list[str]]:
    """Arguments with today's names, and a note on each former one."""
    former = FORMER.get(command, {})
    renewed: list[str] = []
    notes: dict[str, None] = {}  # in order, each once
    looks: dict[str, str] = {}
    for name, value, words in _options(args, former):
        entry = former.get(name)
        if name in LOOKS and command in WITH_LOOK:
            looks[name] = value
        elif entry is not None and (entry.when is None or entry.when(value)):
            renewed += entry.now.split() if entry.flag else [entry.now, value]
            now = f"is now {entry.now}" if entry.now else "is no longer needed"
            notes[f"{name} {now}; {UNTIL}"] = None
        else:
            renewed += words
    if looks:
        notes[LOOKS_NOTE] = None
    return [*_look(looks), *renewed], list(notes)


def _options(args: list[str], former: Mapping[str, FormerName]) -> Iterator[tuple[str, str, list[str]]]:
    """Each former option with its value and the arguments that both are; any other argument by itself, up to --."""
    words = iter(args)
    for word in words:
        if word == "--":
            yield "", "", [word, *words]
            return
        name, equals, value = word.partition("=")
        known = name in LOOKS or (name in former and not former[name].flag)
        if known and not equals and (following := next(words, None)) is not None:
            yield name, following, [word, following]
        else:
            yield name, value, [word]


def _look(given: Mapping[str, str]) -> list[str]:
    """The option that the former --light and --transfer stand for, if they were given."""
    for name, value in given.items():
        if value not in LOOKS[name]:
            raise typer.BadParameter(f"{name} is now --look swap or --look paper, got {name} {value}")
    if given.get("--light") == "classical":
        raise typer.BadParameter("--light classical is gone: leave it out, or give --look paper")
    paper = [value == "paper" for value in given.values()]
    if any(paper) and not all(paper):
        raise typer.BadParameter("--light and --transfer no longer mix: give --look paper, or leave both out")
    return ["--look", "paper"] if any(paper) else []
