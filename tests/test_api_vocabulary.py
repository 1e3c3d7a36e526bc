"""What all calls of the API have in common: every command has its call, and errors of the engine speak Python."""

import ast
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

import guise
from guise.api.vocabulary import COMMANDS, RENAMED, call_of, in_python, parameters_of
from guise.app.cli.commands import command_line

ROOT = Path(__file__).parents[1]
# Of the command line alone: what is printed; pipes, which in Python are arrays; presets, which `guise.preset` reads;
# --each, which is a loop, and --open, which is a page.
NOT_IN_PYTHON = {"quiet", "json", "pipe", "raw", "named_preset", "verbose"}
BESIDES = {"swap": {"each"}, "deidentify": {"open"}}
SPOKEN_ONLY_THERE = {"app/media/pipes.py", "app/studio", "app/cli", "app/tools/doctor.py", "common/tuned.py"}


def commands(group: object = None, before: str = "") -> dict[str, typer.core.TyperCommand]:
    found = {}
    for name, one in (group or typer.main.get_command(command_line())).commands.items():  # type: ignore[attr-defined]
        inner = commands(one, f"{before}{name} ") if hasattr(one, "commands") else {f"{before}{name}": one}
        found |= inner
    return found


EVERY = commands()


def test_every_command_has_a_call_that_the_page_names() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `guise ([a-z -]+)` \| (.*) \|$", page, re.M))
    assert set(rows) == set(COMMANDS) == set(EVERY)
    for command, row in rows.items():
        name = COMMANDS[command].split(".")[1]
        assert f"guise.{name}(" in row, command
        assert hasattr(guise, name)
        assert name in guise.__all__


@pytest.mark.parametrize("command", EVERY)
def test_every_option_of_a_command_is_a_parameter_of_its_call(command: str) -> None:
    parameters = parameters_of(call_of(command))
    missing = set()
    for one in EVERY[command].params:
        if one.opts[0].startswith("-") and one.name not in {
            *NOT_IN_PYTHON,
            "help",
            *BESIDES.get(command, ()),
        }:
            name = one.opts[0].lstrip("-").replace("-", "_")
            missing |= {RENAMED.get(name, name.removeprefix("no_"))} - set(parameters)
    assert missing == set()


def test_an_option_that_a_call_does_not_know_is_refused() -> None:
    with pytest.raises(TypeError, match=r"swap_file\(\) got an unexpected keyword argument 'crff'"):
        guise.swap_file("a.mp4", "Mei", "b.mp4", crff=18)  # type: ignore[call-overload]


@pytest.mark.parametrize(
    ("engine", "python"),
    [
        ("use --force to replace it, or -o x", "use overwrite=True to replace it, or output=... x"),
        ("--cover fog: it must be one of solid and blur", 'cover="fog": it must be one of solid and blur'),
        ("choose --renderer cpu", 'choose renderer="cpu"'),
        ("--to 2 must be later than --from 3 (seconds).", "end=2 must be later than start=3 (seconds)."),
        ("continue with --resume; or not", "continue with resume=True; or not"),
        ("give --source, or cut it", "give source=..., or cut it"),
        ("make one with: guise enroll VIDEO -o a.guise", 'make one with: guise.enroll(VIDEO, output="a.guise")'),
        ("see `guise people list`, or guise people find.", "see guise.people(), or guise.find_people()."),
        ("guise enroll --person NUMBER learns another", "guise.enroll(person=NUMBER) learns another"),
        ("pip install --upgrade av, the well-known one -- and Guise itself", None),
    ],
)  # fmt: skip
def test_a_sentence_of_the_engine_speaks_python(engine: str, python: str | None) -> None:
    assert in_python(engine) == (python or engine)


def sentences(path: Path) -> list[str]:
    """The texts of a module that are no docstrings, pieces of a formatted one joined."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documents = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    options = {
        keyword.value for node in ast.walk(tree) if isinstance(node, ast.Call) for keyword in node.keywords
        if keyword.arg == "name"
    }  # fmt: skip
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "X1" for part in node.values]
            found.append("".join(map(str, parts)))
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in documents | options
        ):
            found.append(node.value)
    return found


def test_every_option_that_the_engine_speaks_of_has_its_argument() -> None:
    left = {}
    for package in ("aam", "analogy", "app", "common", "render"):
        for path in (ROOT / package).rglob("*.py"):
            place = path.relative_to(ROOT).as_posix()
            if any(place.startswith(one) for one in SPOKEN_ONLY_THERE):
                continue
            spoken = [in_python(text) for text in sentences(path)]
            wrong = [
                text for text in spoken if re.search(r"(?<![\w-])--[a-z]|\bguise (enroll|people|swap)", text)
            ]
            if wrong:
                left[place] = wrong
    assert left == {}


@pytest.mark.parametrize(
    ("call", "options", "sentence"),
    [
        (guise.Swapper, {"unsure": "show"}, 'unsure must be "cover", "hold" or "leave", got \'show\''),
        (guise.deidentify, {"region": "nose"}, 'region must be "face" or "head", got \'nose\''),
        (guise.deidentify, {"cover_strength": 9}, "cover_strength must be from 1 to 5, got 9"),
        (guise.enroll, {"frames": 2}, "frames must be at least 12, got 2"),
        (
            lambda _, **options: guise.studio(**options),
            {"port": 99_999},
            "port must be from 0 to 65535, got 99999",
        ),
        (guise.bench, {"frames": 0}, "frames must be at least 20, got 0"),
    ],
)
def test_a_value_that_an_option_does_not_take_is_refused(
    call: Any, options: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(guise.GuiseError, match=re.escape(sentence)):
        call(np.zeros((48, 64, 3), np.uint8), **options)
