"""Options of commands are fields of dataclasses: one default, one help, one set of values."""

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
import typer

from guise.analogy.photo import Method as PhotoMethod
from guise.analogy.photo import Mouth
from guise.analogy.transfer import Method as MeshMethod
from guise.app.cli.commands import command_line
from guise.app.cli.options import Part, takes
from guise.app.deidentify.options import DeidentifyOptions
from guise.app.drawing.look import LIVE, LIVE_CHOICES, PAPER, SWAP, DrawingChoices
from guise.app.landmarks.file import LandmarkOptions
from guise.app.live.options import LiveOptions, LiveSettings
from guise.app.live.session import SessionConfig
from guise.app.media import EncodeOptions
from guise.app.meshes.options import TransferOptions
from guise.app.photos.options import AnalogyOptions
from guise.app.swapping.cover import STRENGTHS, CoverStyle
from guise.app.swapping.report import SwapSettings
from guise.common.option import option, options_of
from guise.render.compositor import Renderer


@dataclass(frozen=True)
class Settings:
    size: int = option(3, "How large.", least=1, most=9)
    kind: Literal["a", "b"] = option("b", "Which.")
    files: tuple[Path, ...] = option((), "What.", name="--file", metavar="FILE")
    loud: bool = option(False, "Whether.")
    not_told: "NotLoaded" = field(default=None)  # type: ignore[name-defined]  # noqa: F821


def made(part: Part) -> Any:
    """A command that returns the settings that it takes."""
    line = typer.Typer()

    def command(settings: Annotated[Settings, part]) -> Settings:
        return settings

    line.command()(takes(command))
    return typer.main.get_command(line)


def taken(part: Part, *arguments: str) -> Any:
    return made(part)(list(arguments), standalone_mode=False)


def test_only_declared_fields_are_options_and_others_are_not_evaluated() -> None:
    found = options_of(Settings)
    assert list(found) == ["size", "kind", "files", "loud"]
    assert found["files"][2] == tuple[Path, ...]


def test_defaults_are_those_of_the_dataclass_or_of_an_instance() -> None:
    assert taken(Part(Settings)) == taken(Part(Settings())) == Settings()
    assert taken(Part(replace(Settings(), kind="a", size=5))) == Settings(5, "a")


def test_values_arrive_in_their_types() -> None:
    given = ["--size", "9", "--kind", "a", "--file", "x", "--file", "y", "--loud"]
    assert taken(Part(Settings()), *given) == Settings(9, "a", (Path("x"), Path("y")), True)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (("--size", "10"), "10 is not in the range 1<=x<=9"),
        (("--kind", "c"), "'c' is not one of 'a', 'b'"),
        (("--no-loud",), "--no-loud"),
        (("--not-told", "1"), "--not-told"),
    ],
)
def test_a_value_or_a_name_that_is_not_declared_is_refused(given: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(Exception, match=sentence):
        taken(Part(Settings()), *given)


def test_a_command_may_take_some_of_the_fields() -> None:
    names = [name for param in made(Part(Settings(), ("loud", "size"))).params for name in param.opts]
    assert [name for name in names if name in ("--size", "--kind", "--file", "--loud")] == [
        "--loud",
        "--size",
    ]


def test_choices_are_what_the_engine_does_by_default() -> None:
    assert DrawingChoices().of(SWAP) == SWAP
    assert LIVE_CHOICES.of(LIVE) == LIVE == LiveOptions().look == SessionConfig([], None).look
    assert DrawingChoices(look="paper").of(SWAP) == PAPER
    assert DrawingChoices(look="exact").of(LIVE) == replace(PAPER, exact=True)


def test_values_are_those_that_the_rooms_know() -> None:
    assert options_of(DrawingChoices)["renderer"][2] == Renderer
    assert options_of(DeidentifyOptions)["renderer"][2] == Renderer
    assert options_of(LiveSettings)["style"][2] == CoverStyle
    strength = options_of(DeidentifyOptions)["cover_strength"][0]
    assert range(int(strength.least or 0), int(strength.most or 0) + 1) == STRENGTHS
    assert options_of(TransferOptions)["method"][2] == MeshMethod
    assert options_of(AnalogyOptions)["method"][2] == PhotoMethod
    assert options_of(AnalogyOptions)["mouth"][2] == Mouth


def defaults(path: str) -> dict[str, Any]:
    """The default of each option of a command, as the dataclasses have it."""
    found: Any = typer.main.get_command(command_line(path.split()[0]))
    for name in path.split():
        found = found.commands[name]
    return {param.name: getattr(param.default, "value", param.default) for param in found.params}


@pytest.mark.parametrize(
    ("command", "filled", "renamed"),
    [
        ("swap", SwapSettings(), {}),
        ("swap", EncodeOptions(), {}),
        ("puppet", EncodeOptions(), {}),
        ("deidentify", EncodeOptions(), {}),
        ("live", LiveOptions().encode, {}),
        ("live", LiveSettings(), {}),
        ("landmarks", LandmarkOptions(), {}),
        ("analogy image", AnalogyOptions(), {}),
        ("analogy animate", AnalogyOptions(), {}),
        ("analogy mesh transfer", TransferOptions(), {}),
        ("analogy mesh rig", TransferOptions(), {}),
    ],
)  # fmt: skip
def test_defaults_written_in_a_command_are_those_of_the_dataclass(
    command: str, filled: Any, renamed: dict[str, str]
) -> None:
    there = defaults(command)
    shared = {one.name: renamed.get(one.name, one.name) for one in fields(filled)}
    compared = {
        field: option
        for field, option in shared.items()
        if option in there and there[option] is not None and option not in ("identity", "mask", "look")
    }
    assert len(compared) >= 2
    assert {option: there[option] for option in compared.values()} == {
        option: getattr(filled, field) for field, option in compared.items()
    }
