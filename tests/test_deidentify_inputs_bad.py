"""Bad and odd inputs through the whole command: the right result or one sentence, and the others are done."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from clips import empty_scene
from made_up import SAMPLES

from guise.app.cli.main import main
from guise.app.deidentify.run import engines
from guise.app.deidentify.stages.jobs import Job
from guise.app.media import open_input

pytestmark = pytest.mark.slow

FRAMES = 6
MIN_CHANGE = 5  # grey levels, in the middle of a face; encoding makes less than 2
FAST = {"preset": "ultrafast", "qp": "10"}
TURNED = (0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30)  # shown a quarter turn from how it is stored


@pytest.fixture(scope="module")
def faces() -> list[np.ndarray]:
    """Some pictures (480, 640, 3) of a face."""
    with open_input(SAMPLES / "p02" / "talk2.mp4") as source:
        return [frame.rgb().copy() for _, frame in zip(range(FRAMES), source, strict=False)]


def encode(
    path: str, pictures: list[np.ndarray], codec: str = "libx264", pixels: str = "yuv420p",
    options: dict[str, str] | None = None, turned: bool = False,
) -> Path:  # fmt: skip
    """A video of pictures (h, w, 3 or 4), 30 a second."""
    with av.open(path, "w") as out:
        stream = out.add_stream(codec, 30, FAST if options is None else options)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = pixels
        if turned:
            stream.set_display_matrix(TURNED)
        for index, picture in enumerate(pictures):
            kind = "rgb24" if picture.shape[2] == 3 else "rgba"
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), kind).reformat(format=pixels)
            frame.pts, frame.time_base = index, Fraction(1, 30)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return Path(path)


def with_alpha(pictures: list[np.ndarray]) -> list[np.ndarray]:
    return [np.dstack([p, np.full(p.shape[:2], 128, np.uint8)]) for p in pictures]


def sound_alone(path: str) -> None:
    with av.open(path, "w") as out:
        stream = out.add_stream("aac", 16000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), "fltp", "mono")
        frame.sample_rate, frame.pts = 16000, 0
        out.mux(stream.encode(frame))
        out.mux(stream.encode(None))


def deidentify(*arguments: str) -> int:
    return main(["deidentify", "--encoder-preset", "ultrafast", "--workers", "1", *arguments])


def shown(path: Path) -> list[np.ndarray]:
    """The pictures as they are shown."""
    with open_input(path) as source:
        return [frame.rgb().copy() for frame in source]


def assert_hidden(before: list[np.ndarray], after: list[np.ndarray]) -> None:
    """Every picture is there, as large, and its face is another one or covered; the corner above is as it was."""
    assert [p.shape for p in after] == [p.shape for p in before]
    for old, new in zip(before, after, strict=True):
        change = np.abs(old.astype(int) - new).mean(2)
        h, w = change.shape
        assert change[h * 3 // 10 : h // 2, w * 2 // 5 : w * 3 // 5].mean() > MIN_CHANGE
        assert change[: h // 10, : w // 10].mean() < 4


@pytest.mark.parametrize(
    ("name", "codec", "pixels", "options"),
    [
        ("ten.mp4", "libx265", "yuv420p10le", {"preset": "ultrafast", "x265-params": "log-level=none"}),
        ("interlaced.mp4", "libx264", "yuv420p", FAST | {"flags": "+ildct+ilme"}),
        ("grey.mkv", "ffv1", "gray", {}),
        ("prores.mov", "prores_ks", "yuva444p10le", {}),
        ("alpha.webm", "libvpx-vp9", "yuva420p", {"crf": "20", "b": "0", "cpu-used": "8"}),
        ("tv.mpg", "mpeg2video", "yuv420p", {"qmin": "1", "qmax": "4"}),
    ],
)
def test_odd_videos_come_out_right(
    here: Path, faces: list[np.ndarray], name: str, codec: str, pixels: str, options: dict[str, str]
) -> None:
    pictures = with_alpha(faces) if "yuva" in pixels else faces
    source = encode(name, pictures, codec, pixels, options)
    assert deidentify(name, "-o", "out.mp4", "-q") == 0
    assert_hidden(shown(source), shown(Path("out.mp4")))


def test_odd_sizes(here: Path, faces: list[np.ndarray]) -> None:
    source = encode("odd.mkv", [p[:-1, :-1] for p in faces], "ffv1", "yuv420p", {})
    assert deidentify("odd.mkv", "-q") == 0
    after = shown(Path("odd_deidentified.mkv"))
    assert after[0].shape == (480, 640, 3)
    assert_hidden(shown(source), [p[:-1, :-1] for p in after])


def test_a_portrait_with_a_rotation_flag(here: Path, faces: list[np.ndarray]) -> None:
    source = encode("turned.mp4", [np.rot90(p) for p in faces], turned=True)
    assert shown(source)[0].shape == (480, 640, 3)
    assert deidentify("turned.mp4", "-q") == 0
    assert_hidden(shown(source), shown(Path("turned_deidentified.mp4")))
    with open_input(Path("turned_deidentified.mp4")) as output:
        assert output.rotation != 0


def test_a_size_that_changes_midway(here: Path, faces: list[np.ndarray]) -> None:
    half = [cv2.resize(p, (320, 240)) for p in faces]
    parts = [encode(f"{n}.ts", part, options=FAST | {"g": "1"}) for n, part in enumerate((faces, half))]
    Path("both.ts").write_bytes(b"".join(part.read_bytes() for part in parts))
    assert deidentify("both.ts", "-q") == 0
    assert_hidden(shown(Path("both.ts")), shown(Path("both_deidentified.ts")))


@pytest.mark.parametrize("name", ["alpha.png", "photo.jpg", "deep.png", "old.bmp"])
def test_images(here: Path, faces: list[np.ndarray], name: str) -> None:
    picture = faces[0][..., ::-1]
    if name == "alpha.png":
        picture = with_alpha([picture])[0]
    cv2.imwrite(name, picture.astype(np.uint16) * 257 if name == "deep.png" else picture)
    assert deidentify(name, "-q") == 0
    output = Path(name).with_stem(Path(name).stem + "_deidentified")
    assert_hidden(shown(Path(name)), shown(output))
    if name == "alpha.png":
        assert (cv2.imread(str(output), cv2.IMREAD_UNCHANGED)[..., 3] == 128).all()


def test_a_folder_of_images_is_a_clip(here: Path, faces: list[np.ndarray]) -> None:
    Path("frames").mkdir()
    for index, picture in enumerate(faces):
        cv2.imwrite(f"frames/{index}.png", picture[..., ::-1])
    assert deidentify("frames", "-q") == 0
    assert [p.name for p in sorted(Path("frames_deidentified").iterdir())] == [
        f"{i}.png" for i in range(FRAMES)
    ]
    assert_hidden(faces, shown(Path("frames_deidentified")))


@pytest.mark.parametrize(
    "name", ["a b\nc.mp4", "-dash.mp4", "10:30.mp4", "a[1]*.mp4", os.fsdecode(b"\xff.mp4")]
)
def test_any_name_will_do(
    here: Path, faces: list[np.ndarray], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    source = encode("plain.mp4", faces[:2]).rename(name)
    assert deidentify("--", name) == 0
    assert capsys.readouterr().out.count("\n") == 1
    assert_hidden(shown(source), shown(Path(name).with_stem(Path(name).stem + "_deidentified")))


def test_what_cannot_be_read_is_a_sentence_and_the_rest_is_done(
    here: Path, faces: list[np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    good = encode("good.mp4", faces)
    data = good.read_bytes()
    Path("cut.mp4").write_bytes(data[: len(data) // 2])
    Path("empty.mp4").touch()
    Path("text.mp4").write_text("not a film\n" * 100)
    Path("broken.png").write_bytes(b"\x89PNG\r\n\x1a\nxxxx")
    sound_alone("sound.mp4")
    Path("gone.mp4").symlink_to("nowhere.mp4")
    empty_scene(Path("nobody.mp4"))
    assert deidentify(".", "-o", "out", "--json") == 1
    out, err = capsys.readouterr()
    files = {f["input"]: f for f in json.loads(out)["files"]}
    assert {name: f["code"] for name, f in files.items()} == {
        "broken.png": 2, "cut.mp4": 2, "empty.mp4": 2, "gone.mp4": 2, "good.mp4": 0, "nobody.mp4": 0, "sound.mp4": 2,
        "text.mp4": 2,
    }  # fmt: skip
    for name in ("broken.png", "cut.mp4", "empty.mp4", "gone.mp4", "sound.mp4", "text.mp4"):
        assert name in files[name]["sentence"]
        assert "Guise failed" not in files[name]["sentence"]
    assert sum(line.startswith("error: ") for line in err.splitlines()) == err.count("error: ") == 6
    assert "Traceback" not in err
    made = {path.name for path in Path("out").iterdir() if not path.name.startswith("deidentify-")}
    assert made == {
        f"{stem}_deidentified{suffix}"
        for stem in ("good", "nobody")
        for suffix in (".mp4", ".report.json", ".report.html")
    }


def test_a_broken_image_is_one_line_on_the_terminal(here: Path) -> None:
    Path("broken.png").write_bytes(b"\x89PNG\r\n\x1a\nxxxx")
    code = "import sys; from guise.app.cli.main import main; sys.exit(main(['deidentify', 'broken.png']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("error: broken.png is not an image that can be read")


def test_a_file_cut_short_gives_what_is_there(here: Path, faces: list[np.ndarray]) -> None:
    data = encode("whole.mkv", faces * 3, "ffv1", options={}).read_bytes()
    Path("cut.mkv").write_bytes(data[: len(data) * 2 // 3])
    before = shown(Path("cut.mkv"))
    assert 3 <= len(before) < 18
    assert deidentify("cut.mkv", "-q") == 0
    assert_hidden(before, shown(Path("cut_deidentified.mkv")))


def test_a_file_that_may_not_be_read(
    here: Path, faces: list[np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    encode("secret.mp4", faces).chmod(0)
    if os.access("secret.mp4", os.R_OK):
        pytest.skip("everything is readable for root")
    assert deidentify("secret.mp4") == 2
    assert capsys.readouterr().err == (
        "error: secret.mp4 cannot be read (Permission denied): check its permissions.\n"
    )


@pytest.mark.parametrize("stage", ["detect", "render"])
def test_an_input_that_vanishes_midway_is_a_sentence_and_can_be_resumed(
    here: Path,
    faces: list[np.ndarray],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    stage: str,
) -> None:
    perform = engines.perform

    def lose(job: Job) -> None:
        if job.stage == stage:
            Path("a.mp4").rename("away.mp4")
        perform(job)

    encode("a.mp4", faces)
    encode("b.mp4", faces)
    monkeypatch.setattr(engines.SerialEngine.__init__, "__defaults__", (lose,))
    assert deidentify("a.mp4") == 1
    err = capsys.readouterr().err
    assert "a.mp4" in err
    assert "Guise failed" not in err
    assert err.count("\n") == 1
    monkeypatch.undo()
    os.chdir(here)
    Path("away.mp4").rename("a.mp4")
    assert deidentify("a.mp4", "--resume", "-q") == 0
    assert_hidden(shown(Path("b.mp4")), shown(Path("a_deidentified.mp4")))


def test_an_input_that_is_replaced_midway_is_noticed(
    here: Path,
    faces: list[np.ndarray],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The report would otherwise tell of other frames than the file that now has its name."""
    perform = engines.perform

    def replace(job: Job) -> None:
        perform(job)
        if job.stage == "render":
            encode("new.mp4", faces[:2]).replace("a.mp4")

    encode("a.mp4", faces)
    monkeypatch.setattr(engines.SerialEngine.__init__, "__defaults__", (replace,))
    assert deidentify("a.mp4") == 1
    assert "a.mp4 was changed or replaced while it was being de-identified" in capsys.readouterr().err
    assert not Path("a_deidentified.mp4").exists()


@pytest.mark.parametrize("letter", ["n", "é", "😀"])
def test_a_name_as_long_as_they_may_be_will_do(here: Path, faces: list[np.ndarray], letter: str) -> None:
    size = len(letter.encode())
    name = letter * (251 // size) + "x" * (251 % size) + ".mp4"
    encode("plain.mp4", faces[:2]).rename(name)
    assert deidentify("-q", name) == 0
    (made,) = Path().glob("*_deidentified.mp4")
    assert len(shown(made)) == 2
    assert not list(Path().glob("*.work"))
    assert deidentify("-q", name, "-o", "y" * 251 + ".mp4") == 0


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 24 KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = [shutil.which("mount") or "false", "-t", "tmpfs", "-o", "size=24k", "tmpfs", disk]
    if subprocess.run(command, capture_output=True).returncode:
        pytest.skip("no disk can be mounted here")
    yield disk
    subprocess.run(["umount", disk], check=True)


def test_a_full_disk_is_a_sentence_and_can_be_resumed(
    here: Path, small_disk: Path, faces: list[np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    encode("a.mp4", faces)
    assert deidentify("a.mp4", "-o", str(small_disk)) == 1
    err = capsys.readouterr().err
    assert "the disk is full" in err
    assert err.endswith("; finished work is kept for --resume\n")
    subprocess.run(["mount", "-o", "remount,size=16m", small_disk], check=True)
    assert deidentify("a.mp4", "-o", str(small_disk), "--resume", "-q") == 0
    assert_hidden(shown(Path("a.mp4")), shown(small_disk / "a_deidentified.mp4"))


@pytest.mark.parametrize("outside", ["cut", "keep"])
def test_faces_outside_a_part_are_cut_off_or_left_as_asked(
    here: Path, faces: list[np.ndarray], outside: str
) -> None:
    encode("a.mkv", faces, "ffv1", options={})
    call = (
        "a.mkv",
        "-o",
        "b.mkv",
        "--encoder",
        "ffv1",
        "--from",
        "0.05",
        "--to",
        "0.15",
        "--outside",
        outside,
    )
    deidentify("-q", *call)
    before, after = shown(Path("a.mkv")), shown(Path("b.mkv"))
    first = 2 if outside == "cut" else 0
    assert len(after) == (3 if outside == "cut" else 6)
    same = [bool((a == b).all()) for a, b in zip(before[first:], after, strict=False)]
    assert same == ([False] * 3 if outside == "cut" else [True] * 2 + [False] * 3 + [True])
    report = json.loads(Path("b.report.json").read_text())
    assert report["counts"]["left"] == (0 if outside == "cut" else 3)
    assert report["settings"]["outside"] == outside
