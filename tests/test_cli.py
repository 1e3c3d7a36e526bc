"""The command line: what it says, what it returns and what it leaves behind, verbatim."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from clips import cut, empty_scene
from made_up import SAMPLES
from models import model_file

from guise.aam.model import Identity
from guise.app.cli.main import main
from guise.common.version import VERSION

TALK2 = str(SAMPLES / "p01" / "talk2.mp4")


@pytest.fixture
def people(here: Path) -> Path:
    """The folder with p01.guise and p06.guise in it."""
    for person in ("p01", "p06"):
        (here / f"{person}.guise").symlink_to(model_file(person))
    return here


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    code = main(arguments)
    said = capsys.readouterr()
    return code, said.out, said.err


SWAP = ("--identity", "p06.guise", "--source", "p01.guise", "-o", "out.mp4")


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "--help")
    assert (code, err) == (0, "")
    for command in ("enroll", "swap", "puppet", "landmarks", "info", "demo", "doctor", "bench"):
        assert command in out


@pytest.mark.parametrize(
    "command", ["enroll", "swap", "puppet", "landmarks", "info", "demo", "doctor", "bench"]
)
def test_every_command_has_help_quiet_and_json(capsys: pytest.CaptureFixture[str], command: str) -> None:
    code, out, _ = run(capsys, command, "--help")
    assert code == 0
    assert "--quiet" in out
    assert "--json" in out


def test_no_arguments_is_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys) == run(capsys, "--help")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "--version") == (0, f"guise {VERSION}\n", "")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["frobnicate"], "No such command 'frobnicate'."),
        (["swap"], "Missing argument 'VIDEO'."),
        (
            ["swap", "a.mp4", "-o", "b.mp4"],
            "Invalid value: give --identity FACE, or --map SOURCE=FACE for each of several people",
        ),
        (["info", "--nonsense"], "No such option: --nonsense"),
        (
            ["info", "no.guise"],
            "there is no model file no.guise; make one with: guise enroll VIDEO -o no.guise",
        ),
        (
            ["enroll", "no.mp4", "-o", "a.guise", "--landmarks", "a.npz", "--landmarker", "b.toml"],
            "Invalid value: give either --landmarks or --landmarker",
        ),
        (
            ["enroll", "a.mp4", "b.mp4", "-o", "a.guise", "--landmarks", "a.npz"],
            "Invalid value: --landmarks must be given once for each of the 2 clips, got 1",
        ),
        (
            ["enroll", "a.mp4", "-o", "a.guise", "--landmarker", "magic"],
            "landmarker must be one of builtin[@DETECTOR], CARD.toml[@DETECTOR]; got 'magic'",
        ),
        (
            ["enroll", "a.mp4", "-o", "nowhere/a.guise"],
            "nowhere/a.guise cannot be written, there is no folder nowhere: make it, or choose another",
        ),
        (
            ["demo", "--samples", "nowhere"],
            "the sample clips are not in nowhere (p01/talk.mp4 is missing): give the folder sample_videos of a "
            "Guise checkout with --samples",
        ),
    ],
)
def test_misuse_is_one_sentence(
    capsys: pytest.CaptureFixture[str], here: Path, arguments: list[str], sentence: str
) -> None:
    assert run(capsys, *arguments) == (2, "", f"error: {sentence}\n")
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("arguments", [["--alpha", "1.5"], ["--crf", "99"], ["--renderer", "paint"]])
def test_values_out_of_range_are_refused(
    capsys: pytest.CaptureFixture[str], people: Path, arguments: list[str]
) -> None:
    code, out, err = run(capsys, "swap", TALK2, *SWAP, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"error: Invalid value for '{arguments[0]}'")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["no.mp4"], "no.mp4 does not exist: give a video file, an image or a folder of images."),
        (
            ["p01.guise"],
            "p01.guise is not a video that can be read (Invalid data found when processing input): give a video "
            "file, an image or a folder of images.",
        ),
        (
            ["void.png"],
            "void.png is not an image that can be read: give a PNG, JPEG, HEIC, AVIF, TIFF or WebP file.",
        ),
        (
            [TALK2, "--encoder", "foo"],
            "Encoder 'foo' is not available: use one of libx264, libx265, libsvtav1, libvpx-vp9, ffv1.",
        ),
        ([TALK2, "--encoder-preset", "hasty"], None),
        (
            [TALK2, "-o", "nowhere/out.mp4"],
            "nowhere/out.mp4 cannot be written (No such file or directory): choose a folder that exists and is "
            "writable.",
        ),
        ([TALK2, "-o", "out.txt"], "out.txt does not name a video container: use .mp4, .mov or .mkv."),
        ([TALK2, "-o", "old.mp4"], "old.mp4 exists: use --force to replace it, or choose another name."),
        (
            [TALK2, "--detector", "owl"],
            "face detector must be one of builtin, lbp, yunet:MODEL.onnx, centerface:MODEL.onnx; got 'owl'",
        ),
        (
            [TALK2, "--identity", "cut.guise"],
            "cut.guise is not a Guise model or is truncated; enroll the person again",
        ),
        (
            [TALK2, "--identity", "later.guise"],
            "later.guise has model format 9, this Guise reads formats 1 and 2; enroll the person again",
        ),
        (
            [TALK2, "--landmarks", "a.npz"],
            "Invalid value: --landmarks and --landmarker are for enrollment, which --source replaces: leave them out",
        ),
        (
            ["nobody.mp4"],
            "no face of the source person (p01) found in the 8 frames of nobody.mp4: give the model of the person "
            "in the video with --source, or enroll them from it",
        ),
    ],
)
@pytest.mark.parametrize("command", ["swap", "puppet"])
@pytest.mark.slow
def test_bad_input_is_one_sentence_and_leaves_nothing(
    capsys: pytest.CaptureFixture[str], people: Path, command: str, arguments: list[str], sentence: str | None
) -> None:
    (people / "void.png").write_bytes(b"")
    (people / "old.mp4").write_bytes(b"precious")
    model = model_file("p06").read_bytes()
    (people / "cut.guise").write_bytes(model[: len(model) // 2])
    (people / "later.guise").write_bytes(re.sub(rb'"version":"\d"', b'"version":"9"', model, count=1))
    if "nobody.mp4" in arguments:
        empty_scene(people / "nobody.mp4")
    before = sorted(people.iterdir())
    code, out, err = run(capsys, command, arguments[0], *SWAP, *arguments[1:])
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    if sentence is not None:
        assert err == f"error: {sentence}\n"
    assert sorted(people.iterdir()) == before
    assert (people / "old.mp4").read_bytes() == b"precious"


@pytest.mark.slow
def test_models_of_different_resolution_are_mixed(capsys: pytest.CaptureFixture[str], people: Path) -> None:
    small = ("--resolution", "40", "--frames", "24")
    assert main(["enroll", str(cut("p02", people / "p02.mp4", 60)), "-o", "other.guise", *small, "-q"]) == 0
    clip = str(cut("p01", people / "clip.mp4", 12))
    code, out, err = run(capsys, "swap", clip, *SWAP, "--identity", "other.guise", "--json")
    assert code == 0, err
    report = json.loads(out)
    assert report["swapped"] == report["frames"]
    assert (people / "out.mp4").exists()


def test_a_model_of_another_reference_frame(capsys: pytest.CaptureFixture[str], people: Path) -> None:
    own = Identity.load("p06.guise").reference.id.encode()
    (people / "alien.guise").write_bytes(model_file("p06").read_bytes().replace(own, b"0123456789ab"))
    code, _, err = run(capsys, "info", "alien.guise")
    assert code == 2
    assert err == (
        f"error: alien.guise was enrolled on reference frame 0123456789ab, this Guise has {own.decode()}; enroll the "
        "person again\n"
    )


@pytest.mark.slow
def test_swap_says_what_was_done(capsys: pytest.CaptureFixture[str], people: Path) -> None:
    clip = cut("p01", people / "clip.mp4", 10)
    code, out, err = run(capsys, "swap", str(clip), *SWAP)
    assert (code, err) == (0, "")
    assert out.startswith("out.mp4: 10 of 10 frames swapped, 0 held, 0 lost; ")
    speed, grade = out.splitlines()
    assert speed.endswith(" frames per second")
    assert grade.startswith("quality: ")


@pytest.mark.slow
def test_json_is_one_object_and_quiet_is_silent(capsys: pytest.CaptureFixture[str], people: Path) -> None:
    clip = str(cut("p01", people / "clip.mp4", 6))
    code, out, err = run(capsys, "swap", clip, *SWAP, "--json")
    assert code == 0
    assert {json.loads(line)["event"] for line in err.splitlines()} == {"progress"}
    report = json.loads(out)
    assert (report["output"], report["frames"], report["swapped"]) == ("out.mp4", 6, 6)
    assert report["frames_per_second"] > 0
    assert run(capsys, "swap", clip, *SWAP, "--force", "--quiet") == (0, "", "")


def test_force_replaces(capsys: pytest.CaptureFixture[str], people: Path) -> None:
    clip = str(cut("p01", people / "clip.mp4", 5))
    (people / "out.mp4").write_bytes(b"old")
    assert main(["swap", clip, *SWAP, "-q", "--force"]) == 0
    assert (people / "out.mp4").stat().st_size > 1000


def test_a_puppets_image_needs_a_source(capsys: pytest.CaptureFixture[str], people: Path) -> None:
    import cv2

    cv2.imwrite("one.png", np.full((64, 64, 3), 90, np.uint8))
    code, _, err = run(capsys, "puppet", "one.png", "--identity", "p06.guise", "-o", "two.png")
    assert code == 2
    assert err == (
        "error: one.png is a single image, which isn't enough to enroll a face from: give the model of the person in "
        "it with --source\n"
    )
    assert not (people / "two.png").exists()


def test_a_fault_is_one_sentence(
    capsys: pytest.CaptureFixture[str], people: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of course")

    monkeypatch.setattr("guise.app.photos.swap.swap_any", broken)
    code, _, err = run(capsys, "swap", TALK2, *SWAP)
    assert code == 1
    assert err == "error: Guise failed (ZeroDivisionError: of course); GUISE_DEBUG=1 shows where\n"
    monkeypatch.setenv("GUISE_DEBUG", "1")
    code, _, err = run(capsys, "swap", TALK2, *SWAP)
    assert code == 1
    assert "Traceback" in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.slow
def test_interrupted_in_the_middle_nothing_is_left(people: Path, number: signal.Signals) -> None:
    before = sorted(people.iterdir())
    command = [sys.executable, "-m", "guise", "swap", str(SAMPLES / "p01" / "talk.mp4"), *SWAP]
    slow = [*command, "--encoder-preset", "placebo"]
    running = subprocess.Popen(slow, cwd=people, stderr=subprocess.PIPE, text=True)
    part = people / "out.mp4.part"
    deadline = time.monotonic() + 150
    while not part.exists() or part.stat().st_size == 0:
        assert running.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    time.sleep(0.5)
    running.send_signal(number)
    _, err = running.communicate(timeout=60)
    assert running.returncode == 130
    assert err == "error: interrupted; nothing was written\n"
    assert sorted(people.iterdir()) == before


def test_the_callers_handler_of_a_signal_is_given_back(capsys: pytest.CaptureFixture[str]) -> None:
    def own(number: int, frame: object) -> None:
        raise AssertionError

    before = signal.signal(signal.SIGTERM, own)
    try:
        for command in ("--help", "enroll"):
            run(capsys, command)
            assert signal.getsignal(signal.SIGTERM) is own
    finally:
        signal.signal(signal.SIGTERM, before)


def test_an_unwritable_folder(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("everything is writable for root")
    (here / "locked").mkdir(mode=0o500)
    code, _, err = run(capsys, "enroll", TALK2, "-o", "locked/a.guise")
    assert code == 2
    assert err == (
        "error: locked/a.guise cannot be written, the folder locked is not yours: choose another\n"
    )
