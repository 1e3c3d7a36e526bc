"""`guise swap` with several inputs: one mechanism with `guise deidentify`, one output for each."""

import json
from pathlib import Path
from typing import Any

import pytest

from guise.app.cli.main import main
from guise.app.media import MediaError
from guise.app.swapping.report import FileTimes, SwapReport


@pytest.fixture
def swapped(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Path, Path]]:
    """Inputs and outputs of the swaps, which copy their input; one called bad fails, and fault is a fault of ours."""
    asked: list[tuple[Path, Path]] = []

    def fake(video: Path, identity: object, output: Path, *, source: object, settings: Any) -> SwapReport:
        asked.append((video, output))
        if video.stem == "bad":
            raise MediaError(f"{video} is not a video.")
        if video.stem == "fault":
            raise ZeroDivisionError("x")
        settings.say(f"{video.name}: a note")
        settings.progress("swapping", 0.5)
        output.write_bytes(video.read_bytes() if video.is_file() else b"")
        return SwapReport(str(output), 2, 0, 1, 0, FileTimes(1.0, 1.0, 0.1, 0.0), "cpu", 1, 0.0, ())

    monkeypatch.setattr("guise.app.photos.swap.swap_any", fake)
    monkeypatch.setattr("guise.app.cli.video._open", lambda *given: (None, None))
    return asked


def make(*names: str) -> None:
    for name in names:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(b"film " + name.encode())


def swap(*arguments: str) -> int:
    return main(["swap", *arguments, "--identity", "Mei"])


def names(folder: str) -> list[str]:
    return sorted(path.name for path in Path(folder).iterdir())


@pytest.mark.parametrize("inputs", [("a.mp4", "b.mkv"), ("*.m*",), ("in", "--each"), ("in/a.mp4", "b.mkv")])
def test_several_inputs_have_an_output_each(here: Path, swapped: list[Any], inputs: tuple[str, ...]) -> None:
    make("a.mp4", "b.mkv", "in/a.mp4", "in/b.mkv", "in/notes.txt")
    assert swap(*inputs, "-o", "out") == 0
    assert names("out") == ["a_swapped.mp4", "b_swapped.mkv"]
    assert Path("out/b_swapped.mkv").read_bytes().endswith(b"b.mkv")


def test_a_folder_of_images_is_one_sequence_unless_each_is_asked_for(here: Path, swapped: list[Any]) -> None:
    make("frames/1.png", "frames/2.png", "frames/3.jpg")
    assert swap("frames", "-o", "out.mp4") == 0
    assert [video for video, _ in swapped] == [Path("frames")]
    swapped.clear()
    assert swap("frames", "--each", "-o", "out") == 0
    assert [video.name for video, _ in swapped] == ["1.png", "2.png", "3.jpg"]
    assert names("out") == ["1_swapped.png", "2_swapped.png", "3_swapped.jpg"]


@pytest.mark.parametrize(
    ("made", "code"), [(["bad.mp4", "good.mp4"], 2), (["bad.mp4", "fault.mp4"], 1), (["good.mp4"], 0)]
)
def test_a_bad_one_does_not_stop_the_others(
    here: Path, swapped: list[Any], capsys: pytest.CaptureFixture[str], made: list[str], code: int
) -> None:
    make(*(f"in/{name}" for name in made), "in/z.mp4")
    assert swap("in", "--each", "-o", "out", "--json") == code
    out, err = capsys.readouterr()
    files = json.loads(out)["files"]
    assert [Path(one["input"]).name for one in files] == [*made, "z.mp4"]
    assert files[-1] == {
        "input": "in/z.mp4", "output": "out/z_swapped.mp4", "code": 0, "sentence": files[-1]["sentence"],
        "counts": {"swapped": 2, "held": 0, "covered": 1, "lost": 0},
    }  # fmt: skip
    assert err.count("error: ") == len({"bad.mp4", "fault.mp4"} & set(made))
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.mp4", "b.mp4", "-o", "x.mp4"], "names one file"),
        (["a.mp4", "b.mp4", "-o", "done"], "exists"),
        (["a.mp4", "b.mp4", "-o", "o", "--landmarks", "a.npz"], "--landmarks is for one video"),
        (["clips", "-o", "out.mp4"], "--each swaps them one by one"),
        (["empty", "--each", "-o", "out"], "holds no video or image to swap"),
        (["no*.mp4", "-o", "out"], "no video or image matches"),
        (["a.mp4", "none.mp4", "-o", "out"], "none.mp4 does not exist"),
        (["gopher://x/a.mp4", "-o", "out.mp4"], "gopher"),
    ],
)
def test_a_mistake_is_one_sentence_before_any_work(
    here: Path, swapped: list[Any], capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    make("a.mp4", "b.mp4", "a.npz", "done/a_swapped.mp4", "clips/1.mp4")
    (here / "empty").mkdir()
    assert swap(*arguments) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert swapped == []


def test_a_url_is_fetched_and_an_output_is_sent(
    here: Path, swapped: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    fsspec = pytest.importorskip("fsspec")
    files = fsspec.filesystem("memory")
    files.pipe("/films/a.mp4", b"film")
    try:
        assert swap("memory://films/a.mp4", "-o", "out.mp4", "-q") == 0
        assert Path("out.mp4").read_bytes() == b"film"
        assert swap("memory://films/a.mp4", "-o", "memory://out/b.mp4") == 0
        assert files.cat_file("/out/b.mp4") == b"film"
        assert "memory://out/b.mp4" in capsys.readouterr().out
        assert swap("memory://films/none.mp4", "-o", "x.mp4") == 2
    finally:
        files.rm("/", recursive=True)
    assert names(".") == ["out.mp4"]
    assert not any(video.exists() for video, _ in swapped)
