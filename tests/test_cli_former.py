"""Former names of options do what they did and say so once; what cannot be done any more is one sentence."""

from pathlib import Path
from typing import Any

import pytest
import typer

from guise.app.cli.commands import command_line
from guise.app.cli.former import FORMER, LOOKS, WITH_LOOK
from guise.app.cli.main import main

NOTE = "; the former name goes with version 0.3\n"
LOOKS_NOTE = "--light and --transfer are now --look swap|paper" + NOTE
SWAP = ["v.mp4", "-o", "o.mp4"]


def command(path: str) -> Any:
    found = typer.main.get_command(command_line(path.split()[0]))
    for name in path.split():
        found = found.commands[name]  # type: ignore[attr-defined]
    return found


def understood(path: str, arguments: list[str]) -> dict[str, Any]:
    """The values that a command gets."""
    return dict(command(path).make_context(path.split()[-1], list(arguments)).params)


@pytest.mark.parametrize(
    ("path", "former", "now", "note"),
    [
        ("live", ["--source", "rtsp://a/b"], ["--input", "rtsp://a/b"], "--source is now --input"),
        ("live", ["--source=clip.mp4"], ["--input", "clip.mp4"], "--source is now --input"),
        ("live", ["--person", "a.guise"], ["--source", "a.guise"], "--person is now --source"),
        ("live", ["--enrol"], ["--enroll"], "--enrol is now --enroll"),
        ("live", ["--headless"], [], "--headless is no longer needed"),
        ("deidentify", ["a.mp4", "--donor", "mean:2"], ["a.mp4", "--identity", "mean:2"], "--donor is now --identity"),
        ("deidentify", ["a.mp4", "--donors=same"], ["a.mp4", "--identity", "same"], "--donors is now --identity"),
        ("measure", ["a", "b", "--donor", "p03"], ["a", "b", "--identity", "p03"], "--donor is now --identity"),
        (
            "analogy animate", ["c.mp4", "t.png", "-o", "o.mp4", "--model", "a.guise"],
            ["c.mp4", "t.png", "-o", "o.mp4", "--source", "a.guise"], "--model is now --source",
        ),
        ("live", ["--uncovered"], ["--unsure", "leave"], "--uncovered is now --unsure leave"),
        (
            "deidentify", ["a.mp4", "--detector", "lbp"], ["a.mp4", "--audit-detector", "lbp"],
            "--detector is now --audit-detector",
        ),
        ("measure", ["a", "b", "--gallery", "c"], ["a", "b", "--distractors", "c"], "--gallery is now --distractors"),
        ("info", ["Mei", "--montage=m.png"], ["Mei", "--picture", "m.png"], "--montage is now --picture"),
        (
            "analogy image", ["a", "b", "c", "-o", "d", "--mouth", "none"],
            ["a", "b", "c", "-o", "d", "--open-mouth", "none"], "--mouth is now --open-mouth",
        ),
        ("swap", [*SWAP, "--preset", "slow"], [*SWAP, "--encoder-preset", "slow"], "--preset is now --encoder-preset"),
        ("live", ["--preset=p4"], ["--encoder-preset", "p4"], "--preset is now --encoder-preset"),
        ("swap", [*SWAP, "--light", "paper"], [*SWAP, "--look", "paper"], LOOKS_NOTE),
        ("swap", [*SWAP, "--light", "paper", "--transfer=paper"], [*SWAP, "--look", "paper"], LOOKS_NOTE),
        ("swap", [*SWAP, "--transfer", "full"], SWAP, LOOKS_NOTE),
        ("puppet", [*SWAP, "--identity", "Mei", "--light", "learned"], [*SWAP, "--identity", "Mei"], LOOKS_NOTE),
        ("live", ["--transfer", "paper"], ["--look", "paper"], LOOKS_NOTE),
    ],
)  # fmt: skip
def test_a_former_name_does_the_same_with_one_note_unless_quiet(
    path: str, former: list[str], now: list[str], note: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("clip.mp4").touch()
    wanted = understood(path, now)
    assert capsys.readouterr().err == ""
    assert understood(path, former) == wanted
    assert capsys.readouterr().err == note.removesuffix(NOTE) + NOTE
    assert understood(path, [*former, "--quiet"]) == wanted | {"quiet": True}
    assert capsys.readouterr() == ("", "")


def test_two_former_names_are_two_notes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("clip.mp4").touch()
    found = understood("live", ["--person", "a.guise", "--source", "clip.mp4"])
    assert (found["source"], found["input"]) == ("a.guise", "clip.mp4")
    assert capsys.readouterr().err == f"--person is now --source{NOTE}--source is now --input{NOTE}"


def test_a_person_is_a_source_and_what_follows_two_hyphens_is_no_option(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert understood("live", ["--source", "a.guise"])["source"] == "a.guise"
    assert understood("deidentify", ["a.mp4", "--", "--donor", "b.mp4"])["inputs"] == (
        "a.mp4",
        "--donor",
        "b.mp4",
    )
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("name", WITH_LOOK)
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--light", "classical"], "--light classical is gone: leave it out, or give --look paper"),
        (
            ["--light", "paper", "--transfer", "full"],
            "--light and --transfer no longer mix: give --look paper, or leave both out",
        ),
        (["--light", "bright"], "--light is now --look swap or --look paper, got --light bright"),
        (["--transfer"], "--transfer is now --look swap or --look paper, got --transfer"),
    ],
)
def test_what_is_gone_is_one_sentence(
    name: str, arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([name, *SWAP, *arguments]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"error: Invalid value: {sentence}\n")


def test_no_former_name_is_a_name_of_today() -> None:
    for path in ("live", "deidentify", "measure", "info", "analogy image", "analogy animate", *WITH_LOOK):
        today = {name for param in command(path).params for name in param.opts}
        name = path.split()[-1]
        former = {old for old, entry in FORMER.get(name, {}).items() if entry.when is None}
        assert not today & {*former, *LOOKS}
        assert {entry.now.split(" ")[0] for entry in FORMER.get(name, {}).values()} - {""} <= today
