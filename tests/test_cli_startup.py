"""What a command imports, the version least of all; and how `guise --help` groups the commands."""

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from clips import cut
from models import model_file

from guise.app.cli.commands import GROUPS
from guise.app.cli.main import main
from guise.common.version import VERSION


def modules_after(statement: str, cwd: Path) -> set[str]:
    """Top-level modules in a new interpreter after a statement."""
    code = f"import sys\n{statement}\nprint(*{{name.split('.')[0] for name in sys.modules}}, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True, check=True)
    return set(done.stderr.split())


def processor_seconds(*arguments: str) -> float:
    """The processor's time for a command, which other work on the computer hardly changes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-m", "guise", *arguments], capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.stdout.decode() == f"guise {VERSION}\n"
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def test_the_version_is_shown_at_once(tmp_path: Path) -> None:
    loaded = modules_after("from guise.app.cli.main import main; assert main(['--version']) == 0", tmp_path)
    assert loaded.isdisjoint({"typer", "rich", "numpy"})
    seconds = [processor_seconds("--version") for _ in range(10)]
    assert min(seconds) < 0.2


def test_the_version_can_be_asked_for_before_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version", "swap"]) == 0
    assert capsys.readouterr().out == f"guise {VERSION}\n"


def test_help_groups_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    groups: dict[str, list[str]] = {}
    for line in capsys.readouterr().out.splitlines():
        if title := re.match(r"╭─ (\w+) ─", line):
            names = groups.setdefault(title[1], [])
        elif command := re.match(r"│ ([a-z]+) ", line):
            names.append(command[1])
    assert list(groups) == ["Options", *GROUPS] == ["Options", "Faces", "Video", "Live", "Offline", "Tools"]
    assert groups["Faces"] == ["enroll", "info", "landmarks", "people"]
    assert groups["Video"] == ["swap", "puppet", "deidentify", "measure"]
    assert groups["Live"] == ["live", "studio", "rig"]
    assert groups["Offline"] == ["analogy"]
    assert groups["Tools"] == ["demo", "doctor", "bench"]


@pytest.mark.parametrize("command", ["swap", "deidentify", "live"])
def test_help_imports_no_heavy_library(command: str, tmp_path: Path) -> None:
    loaded = modules_after(f"from guise.app.cli.main import main; main(['{command}', '--help'])", tmp_path)
    assert loaded.isdisjoint({"numpy", "cv2", "av", "scipy", "skimage", "onnxruntime", "moderngl"})


def test_only_the_command_that_is_run_is_imported(tmp_path: Path) -> None:
    code = "import sys; from guise.app.cli.main import main; main(['swap', '--help'])"
    code += "; print(*sys.modules, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    loaded = {name for name in done.stderr.split() if name.startswith("guise.app.cli.")}
    assert "guise.app.cli.video" in loaded
    assert loaded.isdisjoint({"guise.app.cli.live", "guise.app.cli.deidentify", "guise.app.cli.analogy"})


@pytest.mark.slow
def test_swapping_imports_nothing_of_enrolment(tmp_path: Path) -> None:
    clip = cut("p01", tmp_path / "clip.mp4", 4)
    arguments = [
        "swap", str(clip), "--identity", str(model_file("p06")), "--source", str(model_file("p01")), "-o", "out.mp4",
        "-q", "--renderer", "cpu",
    ]  # fmt: skip
    loaded = modules_after(f"from guise.app.cli.main import main; assert main({arguments!r}) == 0", tmp_path)
    assert {"numpy", "cv2", "av"} <= loaded
    assert loaded.isdisjoint({"scipy", "skimage", "rich", "moderngl", "ssl", "http"})


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("guise deid", ["deidentify"]),
        ("guise analogy mesh re", ["register"]),
        ("guise swap --uns", ["--unsure"]),
        ("guise swap --unsure ", ["cover", "hold", "leave"]),
    ],
)
def test_a_shell_completes_commands_options_and_values(
    line: str, expected: list[str], tmp_path: Path
) -> None:
    """Also where a file of options is broken."""
    (tmp_path / "guise.toml").write_text("crf = ", encoding="utf-8")
    asked = {"_GUISE_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    done = subprocess.run(
        [sys.executable, "-m", "guise"],
        cwd=tmp_path,
        env={**os.environ, **asked},
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == expected
