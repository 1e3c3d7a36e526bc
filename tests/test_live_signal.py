"""`guise live` ended by a signal: the file is complete, and the command says so."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import pytest
from made_up import SAMPLES
from models import model_file

PATIENCE_SECONDS = 120.0


def live(folder: Path, *more: str) -> "subprocess.Popen[str]":
    """The command, writing what it shows of a clip that never ends."""
    command = [sys.executable, "-m", "guise", "live", "--input", str(SAMPLES / "p01" / "talk.mp4"), "--loop"]
    people = ["--source", str(model_file("p01")), "--identity", str(model_file("p06"))]
    environment = os.environ | {"GUISE_PEOPLE": str(folder / "people")}
    return subprocess.Popen(
        [*command, *people, "-o", "out.mp4", *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        cwd=folder, env=environment,
    )  # fmt: skip


def wait_for_pictures(part: Path) -> None:
    end = time.monotonic() + PATIENCE_SECONDS
    while not (part.exists() and part.stat().st_size > 10_000):
        assert time.monotonic() < end, "nothing was written"
        time.sleep(0.1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.slow
def test_a_run_ended_by_a_signal_says_what_it_has_written(number: signal.Signals, tmp_path: Path) -> None:
    with live(tmp_path) as process:
        wait_for_pictures(tmp_path / "out.mp4.part")
        process.send_signal(number)
        said, errors = process.communicate(timeout=PATIENCE_SECONDS)
    assert process.returncode == 0
    assert said.startswith("out.mp4: ")
    assert "nothing" not in said + errors
    with av.open(str(tmp_path / "out.mp4")) as container:
        frames = sum(1 for _ in container.decode(video=0))
    assert frames > 0
    assert not (tmp_path / "out.mp4.part").exists()


def test_a_run_ended_before_its_first_picture_says_that_nothing_was_written(tmp_path: Path) -> None:
    with live(tmp_path, "--json") as process:
        process.send_signal(signal.SIGTERM)
        said, _ = process.communicate(timeout=PATIENCE_SECONDS)
    assert not (tmp_path / "out.mp4").exists()
    assert not said or json.loads(said)["files"] == []
