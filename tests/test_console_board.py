"""Bars of several files: what a person at a terminal sees, and nobody else."""

import io
import json
import re
import sys

import pytest

from guise.app.cli import console as module
from guise.app.cli.console import Board, Console, Stages
from guise.common.text import printable


class Terminal(io.StringIO):
    """What is written to a terminal."""

    def isatty(self) -> bool:
        return True

    def lines(self) -> list[str]:
        """The lines without colours and movements, each once."""
        plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.getvalue()).replace("\r", "\n")
        return list(dict.fromkeys(line.strip() for line in plain.split("\n") if line.strip()))


def use_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """From here on stderr is a terminal; a fixture would set it before pytest takes stderr for the test."""
    made = Terminal()
    monkeypatch.setattr(sys, "stderr", made)
    monkeypatch.setattr(module, "_REFRESH_SECONDS", 0)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    return made


def play(board: Board, names: list[str]) -> None:
    with board:
        for count, name in enumerate(names, start=1):
            board.show(name, "rendering", 0.5)
            board.finished(name, count)


def test_a_batch_has_a_bar_for_all_and_one_for_each_file(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = use_terminal(monkeypatch)
    play(Board(Console(), 2), ["in/a.mp4", "in/b[1].mp4"])
    seen = "\n".join(terminal.lines())
    for said in ("0 of 2 files", "a.mp4: rendering", "b[1].mp4: rendering", "1 of 2 files", "2 of 2 files"):
        assert said in seen
    assert "in/a.mp4" not in seen


def test_a_single_file_has_its_stage_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = use_terminal(monkeypatch)
    play(Board(Console(), 1), ["a.mp4"])
    seen = "\n".join(terminal.lines())
    assert "rendering" in seen
    assert "files" not in seen
    assert "a.mp4" not in seen


def test_notes_appear_above_the_bars(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = use_terminal(monkeypatch)
    console = Console()
    with Board(console, 1) as board:
        board.show("a.mp4", "rendering", 0.5)
        console.note("something to know")
    assert "something to know" in terminal.lines()


@pytest.mark.parametrize("console", [Console(quiet=True), Console(json=True)])
def test_bars_are_for_people(monkeypatch: pytest.MonkeyPatch, console: Console) -> None:
    terminal = use_terminal(monkeypatch)
    play(Board(console, 2), ["a.mp4", "b.mp4"])
    assert [line for line in terminal.lines() if not line.startswith('{"event": "progress"')] == []
    assert not (console.quiet and terminal.getvalue())


def test_bars_are_for_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    made = io.StringIO()
    monkeypatch.setattr(sys, "stderr", made)
    play(Board(Console(), 2), ["a.mp4", "b.mp4"])
    assert made.getvalue() == ""


def test_what_cannot_be_seen_is_written_out() -> None:
    assert printable("a b\x1b[2J\n\u202e\udcff ü漢") == "a b\\x1b[2J\\n\\u202e\\udcff ü漢"


def test_with_json_progress_is_lines_for_programs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A stage is told when it begins and ends and once a second; stdout stays the result's."""
    times = iter([10.0, 10.4, 11.5, 14.0, 14.1, 14.2])
    monkeypatch.setattr(module.time, "monotonic", lambda: next(times))
    console = Console(json=True)
    with Board(console, 2) as board:
        for share in (0.0, 0.1, 0.25, 1.0, 1.0):
            board.show("a.mp4", "drawing", share)
        board.show("b.mp4", "faces", 0.5)
    out, err = capsys.readouterr()
    assert out == ""
    told = [json.loads(line) for line in err.splitlines()]
    assert {tuple(one) for one in told} == {("event", "file", "stage", "share", "seconds_left")}
    assert [tuple(one.values()) for one in told] == [
        ("progress", "a.mp4", "drawing", 0.0, None),
        ("progress", "a.mp4", "drawing", 0.25, 4.5),
        ("progress", "a.mp4", "drawing", 1.0, 0.0),
        ("progress", "b.mp4", "faces", 0.5, None),
    ]


def test_stages_are_told_without_a_file_and_never_when_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    for quiet in (True, False):
        with Stages(Console(json=True, quiet=quiet)) as stages:
            stages("training", 0.5)
    assert json.loads(capsys.readouterr().err)["file"] is None


def test_without_json_nothing_is_told_to_programs(capsys: pytest.CaptureFixture[str]) -> None:
    with Stages(Console()) as stages:
        stages("training", 0.5)
    assert capsys.readouterr() == ("", "")
