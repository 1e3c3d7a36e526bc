"""The command `guise deidentify`: what it says, what it returns, and what it refuses before any work."""

import json
import os
from pathlib import Path
from typing import Any

import pytest
from models import model_file
from test_cli_startup import modules_after
from test_deidentify_batch import report_of

from guise.app.cli.main import main
from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.report.report import write_report
from guise.app.deidentify.run import batch, checks
from guise.app.deidentify.run.results import beside
from guise.app.media import MediaError


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Files are written at once; what was asked for is remembered."""
    calls: list[dict[str, Any]] = []

    def fake(source: Path, output: Path, options: DeidentifyOptions, engine: Any, **more: Any) -> Any:
        calls.append({"source": source, "output": output, "options": options, "engine": engine, **more})
        if "bad" in source.name:
            raise MediaError(f"{source} is not a video.")
        if "stop" in source.name:
            raise KeyboardInterrupt
        if more["review"]:
            return None
        more["say"](f"{source.name}: something to know")
        output.touch()
        report = report_of(source, output, 3 if "covered" in source.name else 0)
        write_report(beside(output, ".report.json"), report)
        return report

    monkeypatch.setattr(batch, "deidentify_file", fake)
    return calls


def make(*names: str) -> None:
    for name in names:
        path = Path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    code = main(["deidentify", *arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_one_file(capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]) -> None:
    make("a.mp4")
    assert run(capsys, "a.mp4") == (
        0,
        "a_deidentified.mp4: No face was found in 10 frames. Report: a_deidentified.report.html\n",
        "a.mp4: something to know\n",
    )
    assert sorted(path.name for path in here.iterdir()) == [
        "a.mp4",
        "a_deidentified.mp4",
        "a_deidentified.report.json",
    ]


def test_frames_after_a_face_in_which_none_was_found_are_exit_code_3(
    capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]
) -> None:
    make("covered.mp4")
    assert run(capsys, "covered.mp4", "-q") == (3, "", "")


def test_a_file_that_fails_is_exit_code_1(
    capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]
) -> None:
    make("bad.mp4")
    assert run(capsys, "bad.mp4") == (1, "", "error: bad.mp4 is not a video.\n")


def test_a_batch_says_every_file_and_a_summary(
    capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]
) -> None:
    make("in/a.mp4", "in/bad.mp4", "in/covered.mp4", "in/notes.txt")
    code, out, err = run(capsys, "in", "-o", "out", "--workers", "1")
    assert code == 1
    *lines, last = out.splitlines()
    assert lines == [
        "[1/3] out/a_deidentified.mp4: No face was found in 10 frames. Report: out/a_deidentified.report.html",
        "[3/3] out/covered_deidentified.mp4: The faces that were found are covered in 3 frames. Covers: 0:00.0 to "
        "0:00.1. In 7 frames after a face none was found: not verified. Watch 0:00.1 to 0:00.3. "
        "Report: out/covered_deidentified.report.html",
    ]
    assert last.startswith(
        "3 files: 1 swapped, 0 with covered faces, 1 not verified, 1 failed; see out/deidentify-"
    )
    assert Path(last.split("see ")[1]).is_file()
    assert err.splitlines() == [
        "in: skipped 1 not a video or image",
        "a.mp4: something to know",
        "error: [2/3] in/bad.mp4 is not a video.",
        "covered.mp4: something to know",
    ]


def test_json_is_one_object(
    capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]
) -> None:
    make("a.mp4", "bad.mp4")
    code, out, err = run(capsys, "a.mp4", "bad.mp4", "--json")
    told = json.loads(out)
    assert (code, told["code"]) == (1, 1)
    assert [(f["input"], f["output"], f["code"]) for f in told["files"]] == [
        ("a.mp4", "a_deidentified.mp4", 0),
        ("bad.mp4", None, 1),
    ]
    assert told["files"][0]["counts"]["without face"] == 10
    assert Path(told["report"]).is_file()
    assert err == "a.mp4: something to know\nerror: [2/2] bad.mp4 is not a video.\n"


def test_every_option_arrives(
    capsys: pytest.CaptureFixture[str],
    here: Path,
    asked: list[dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(checks, "check_signing", lambda output, certificate, key: None)
    make("a.mp4", "cert.pem", "key.pem", "a.tracks.json")
    (here / "p01.guise").symlink_to(model_file("p01"))
    arguments = [
        "a.mp4", "-o", "b.mkv", "--identity", "mean:1", "--gallery", "p01.guise", "--cover", "blur", "--alpha", "0.3",
        "--tracks", "a.tracks.json", "--resume", "--seed", "7", "--keyfile", "people.json", "--audio", "drop",
        "--keep-metadata", "--label", "--c2pa", "cert.pem", "key.pem", "--encoder", "libx265", "--crf", "30",
        "--encoder-preset", "fast", "--lossless", "--renderer", "cpu", "--force",
    ]  # fmt: skip
    assert run(capsys, *arguments)[0] == 0
    (call,) = asked
    options = call["options"]
    assert (call["source"], call["output"]) == (here / "a.mp4", here / "b.mkv")
    assert (call["tracks"], call["resume"], call["force"], call["review"]) == (
        Path("a.tracks.json"),
        True,
        True,
        False,
    )
    assert options.gallery == (here / "p01.guise",)
    assert (options.donor, options.cover, options.alpha, options.seed) == ("mean:1", "blur", 0.3, 7)
    assert options.keyfile == here / "people.json"
    assert (options.audio, options.keep_metadata, options.label) == ("drop", True, True)
    assert (options.certificate, options.key) == (here / "cert.pem", here / "key.pem")
    assert (options.encode.encoder, options.encode.crf, options.encode.preset) == ("libx265", 30, "fast")
    assert (options.encode.lossless, options.renderer) == (True, "cpu")


def test_a_review_says_so(
    capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]
) -> None:
    make("a.mp4", "b.mp4")
    code, out, _ = run(capsys, "a.mp4", "b.mp4", "--review")
    assert (code, asked[0]["review"]) == (0, True)
    assert out.splitlines() == [
        "[1/2] a.mp4: The tracks are ready to be reviewed.",
        "[2/2] b.mp4: The tracks are ready to be reviewed.",
    ]
    assert sorted(path.name for path in here.iterdir()) == ["a.mp4", "b.mp4"]


def test_an_interruption_tells_how_to_go_on(
    capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]
) -> None:
    make("a.mp4", "stop.mp4", "z.mp4")
    code, out, err = run(capsys, "a.mp4", "stop.mp4", "z.mp4", "--workers", "1")
    assert (code, err.splitlines()[-1]) == (
        130,
        "error: interrupted; finished work is kept: continue with --resume",
    )
    assert out.startswith("[1/3] a_deidentified.mp4: No face was found in 10 frames.")
    assert out.count("\n") == 1
    code, out, _ = run(capsys, "a.mp4", "z.mp4", "--resume", "--workers", "1")
    assert code == 0
    assert [call["source"].name for call in asked] == ["a.mp4", "stop.mp4", "z.mp4"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "Missing argument 'INPUT...'."),
        (["no.mp4"], "no.mp4 does not exist: give a video, an image, a folder, a pattern in quotes or a URL"),
        (["a.mp4", "--engine", "cloud"], None),
        (["a.mp4", "--engine", "dask:tcp://127.0.0.1:1", "--workers", "2"], None),
        (["a.mp4", "--cover", "pixels"], None),
        (["a.mp4", "--audio", "loud"], None),
        (["a.mp4", "--workers", "0"], None),
        (["a.mp4", "--alpha", "1.5"], None),
        (["a.mp4", "--seed", "x"], None),
        (["a.mp4", "--identity", "nobody"], None),
        (
            ["a.mp4", "--identity", "nobody.guise"],
            "there is no model file nobody.guise; make one with: guise enroll VIDEO -o nobody.guise",
        ),
        (["a.mp4", "--identity", "a.mp4"], None),
        (["a.mp4", "--identity", "mean:1000"], None),
        (["a.mp4", "--identity", "mean:0"], None),
        (["a.mp4", "--gallery", "nobody.guise"], None),
        (["a.mp4", "--gallery", "a.mp4"], None),
        (
            ["a.mp4", "--c2pa", "cert.pem", "key.pem"],
            "the certificate cert.pem does not exist: give a PEM file",
        ),
        (["a.mp4", "--c2pa", "cert.pem"], None),
        (["a.mp4", "--c2pa", "a.mp4", "b.mp4"], None),
        (["a.mp4", "--keyfile", "a.tracks.json"], None),
        (["a.mp4", "--keyfile", "."], None),
        (
            ["a.mp4", "--keyfile", "nowhere/people.json"],
            "the key file nowhere/people.json can't be written because the folder nowhere does not exist: create it",
        ),
        (["a.mp4", "--encoder", "foo"], None),
        (["a.mp4", "--encoder-preset", "hasty"], None),
        (["a.mp4", "--crf", "60"], None),
        (["a.mp4", "--encoder", "mpeg4", "--lossless"], None),
        (
            ["a.mp4", "--review", "--tracks", "a.tracks.json"],
            "Invalid value: --review writes the file that --tracks reads: give one of them",
        ),
        (
            ["a.mp4", "b.mp4", "--tracks", "a.tracks.json"],
            "Invalid value: --tracks is for one input, got 2: with --resume, edited files beside the outputs are found",
        ),
        (["a.mp4", "b.mp4", "-o", "c.mp4"], None),
        (["a.mp4", "-o", "a.mp4"], "a.mp4, the output for a.mp4, is itself an input: choose another with -o"),
        (
            ["old.mp4"],
            "old_deidentified.mp4 exists: use --force to replace it, --resume to do only the rest, or -o to write "
            "elsewhere",
        ),
    ],
)
def test_misuse_is_one_sentence_and_nothing_is_done(
    capsys: pytest.CaptureFixture[str],
    here: Path,
    asked: list[dict[str, Any]],
    arguments: list[str],
    sentence: str | None,
) -> None:
    make("a.mp4", "b.mp4", "old.mp4", "old_deidentified.mp4", "a.tracks.json")
    before = sorted(here.iterdir())
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "Guise failed" not in err
    if sentence:
        assert err == f"error: {sentence}\n"
    assert (sorted(here.iterdir()), asked) == (before, [])


def test_names_cannot_command_the_terminal(
    capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]
) -> None:
    names = ["a\x1b[2J.mp4", "b\nad.mp4", "bad\x07.mp4", os.fsdecode(b"\xff.mp4")]
    make(*names)
    code, out, err = run(capsys, *names)
    assert code == 1
    assert not {"\x1b", "\x07"} & set(out + err)
    assert "b\\nad_deidentified.mp4" in out
    assert "\\udcff_deidentified.mp4" in out


def test_the_file_with_the_summary_is_not_an_input(
    capsys: pytest.CaptureFixture[str], here: Path, asked: list[dict[str, Any]]
) -> None:
    make("a.mp4", "b.mp4")
    run(capsys, ".")
    code, _, err = run(capsys, ".", "--resume")
    assert code == 0
    assert len(asked) == 2
    assert err == ".: skipped 6 from an earlier run\n"


def test_help_imports_no_heavy_library(here: Path) -> None:
    loaded = modules_after("from guise.app.cli.main import main; main(['deidentify', '--help'])", here)
    assert loaded.isdisjoint({"numpy", "cv2", "av", "scipy", "onnxruntime", "distributed", "fsspec"})
