"""Mistakes of a user are one sentence and leave nothing behind; neither does an interrupt."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest

from guise.app.media import EncodeOptions, Frame, MediaError, open_input, open_sink, process
from guise.app.media.image_writing import encode_image

SAMPLE = Path(__file__).parents[1] / "sample_videos" / "p01" / "talk2.mp4"
FAST = EncodeOptions(preset="ultrafast", crf=35)


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """A clip of 20 small grey pictures."""
    path = tmp_path / "in.mp4"
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 30, {"preset": "ultrafast"})
        stream.width, stream.height = 64, 48
        for index in range(20):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), index * 9, np.uint8), "rgb24")
            frame.pts = index
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def one_sentence(error: BaseException) -> bool:
    text = str(error)
    return text.endswith(".") and "\n" not in text and 20 < len(text) < 300


def expect(match: str, action: Callable[[], object], folder: Path) -> None:
    """The action fails with one matching sentence and leaves the folder as it was."""
    before = {file: file.stat().st_mtime_ns for file in folder.rglob("*")}
    with pytest.raises(MediaError, match=match) as caught:
        action()
    assert one_sentence(caught.value)
    assert {file: file.stat().st_mtime_ns for file in folder.rglob("*")} == before


def convert(
    inp: Path, out: Path, options: EncodeOptions = FAST, *, force: bool = False,
    work: Callable[[Frame], None] = lambda frame: None,
) -> None:  # fmt: skip
    with open_input(inp) as source, open_sink(out, source, options, force=force) as sink:
        process(source, sink, work)


# -- inputs -------------------------------------------------------------------------------------------------


def test_missing_input(tmp_path: Path) -> None:
    expect("none.mp4 does not exist: give a video file", lambda: open_input(tmp_path / "none.mp4"), tmp_path)


@pytest.mark.parametrize("content", [b"", b"just some text\n" * 50], ids=["empty", "text"])
@pytest.mark.parametrize("name", ["in.mp4", "in.txt", "in.mkv"])
def test_input_that_is_no_video(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    expect(
        "is not a video that can be read|is a text file",
        lambda: open_input(tmp_path / name),
        tmp_path,
    )


def test_input_without_video(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "in.mp4"), "w") as out:
        stream = out.add_stream("aac", 44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((2, 1024), np.float32), "fltp", "stereo")
        frame.sample_rate, frame.pts = 44100, 0
        out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    expect("in.mp4 holds no video stream", lambda: open_input(tmp_path / "in.mp4"), tmp_path)


@pytest.mark.parametrize("name", ["in.mkv", "in.mp4"])
def test_input_with_zero_frames(tmp_path: Path, name: str) -> None:
    with av.open(str(tmp_path / name), "w") as out:
        stream = out.add_stream("libx264", 30)
        stream.width, stream.height = 64, 48
        out.start_encoding()
    expect(
        f"{name} (is not a video|holds no picture|holds no video)",
        lambda: open_input(tmp_path / name),
        tmp_path,
    )


def test_empty_folder_and_broken_image(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    expect("is a folder without images", lambda: open_input(tmp_path / "folder"), tmp_path)
    (tmp_path / "in.png").write_bytes(b"no image")
    expect("in.png is not an image that can be read", lambda: open_input(tmp_path / "in.png"), tmp_path)


# -- outputs ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("in.mp4", "in.mp4 is the input itself: choose another name"),
        ("old.mp4", "old.mp4 exists: use --force to replace it"),
        ("folder", "folder is a folder: give a file name such as .*out.mp4"),
        ("none/out.mp4", r"cannot be written \(No such file or directory\)"),
        ("in.mp4/out.mp4", r"cannot be written \(Not a directory\)"),
        ("out", "does not name a video container: use .mp4, .mov or .mkv"),
        ("out.xyz", "does not name a video container"),
        ("out.avi", "out.avi cannot keep video with its time stamps"),
        ("out.png", "out.png is one image but in.mp4 is not"),
        ("out.webm", "out.webm cannot hold video from encoder 'libx264'"),
    ],
)
def test_outputs_that_cannot_be(tmp_path: Path, clip: Path, name: str, match: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "old.mp4").write_bytes(b"precious")
    options = EncodeOptions("libx264", preset="ultrafast")
    expect(match, lambda: convert(clip, tmp_path / name, options), tmp_path)


def test_the_input_is_never_replaced_even_by_force(tmp_path: Path, clip: Path) -> None:
    os.link(clip, tmp_path / "same.mp4")
    expect("is the input itself", lambda: convert(clip, clip, force=True), tmp_path)
    expect("is the input itself", lambda: convert(clip, tmp_path / "same.mp4", force=True), tmp_path)


def test_a_part_file_of_another_run_is_respected(tmp_path: Path, clip: Path) -> None:
    (tmp_path / "out.mp4.part").write_bytes(b"someone is writing")
    expect("out.mp4.part exists, from another run", lambda: convert(clip, tmp_path / "out.mp4"), tmp_path)
    convert(clip, tmp_path / "out.mp4", force=True)
    assert not (tmp_path / "out.mp4.part").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_without_write_permission(tmp_path: Path, clip: Path) -> None:
    (tmp_path / "shut").mkdir(mode=0o500)
    expect(r"\(Permission denied\)", lambda: convert(clip, tmp_path / "shut" / "out.mp4"), tmp_path)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"encoder": "nope"}, "Encoder 'nope' is not available: use one of libx264, "),
        ({"encoder": "aac"}, "Encoder 'aac' makes audio, not video: use one of libx264, "),
        ({"encoder": "h264"}, ""),
        ({"encoder": "ffv1", "lossless": True}, ""),
        ({"encoder": "mpeg4", "lossless": True}, "Encoder 'mpeg4' has no lossless mode: use libx264"),
        ({"preset": "quick"}, "Preset 'quick' is unknown: use one of ultrafast"),
        ({"crf": 60}, "crf of libx264 must be from 0 .best. to 51, got 60"),
        ({"crf": -1}, "crf must be from 0 .best. to 63, got -1"),
        (
            {"encoder": "libsvtav1", "preset": "quick"},
            "Encoder 'libsvtav1' or out.mp4 refuses",
        ),
    ],
)
def test_encoder_settings(tmp_path: Path, clip: Path, options: dict[str, object], match: str) -> None:
    def attempt() -> None:
        convert(clip, tmp_path / "out.mp4", EncodeOptions(**options))  # type: ignore[arg-type]

    if match:
        expect(match, attempt, tmp_path)
    else:
        attempt()


def test_rotation_that_the_container_cannot_hold(tmp_path: Path) -> None:
    turned = tmp_path / "in.mp4"
    with av.open(str(turned), "w") as out:
        stream = out.add_stream("libx264", 30)
        stream.width, stream.height = 64, 48
        stream.set_display_rotation(90)
        out.mux(stream.encode(av.VideoFrame(64, 48, "yuv420p")))
        out.mux(stream.encode(None))
    expect(
        "out.ts cannot keep the picture's rotation", lambda: convert(turned, tmp_path / "out.ts"), tmp_path
    )


# -- while working ------------------------------------------------------------------------------------------


def fail_at(index: int, error: BaseException) -> Callable[[Frame], None]:
    def work(frame: Frame) -> None:
        if frame.index == index:
            raise error

    return work


@pytest.mark.usefixtures("no_thread_left")
@pytest.mark.parametrize("error", [RuntimeError("broken"), KeyboardInterrupt(), MediaError("no.")], ids=repr)
def test_an_error_in_the_work_removes_the_part_file(tmp_path: Path, clip: Path, error: BaseException) -> None:
    out = tmp_path / "out.mp4"
    with pytest.raises(type(error)):
        convert(clip, out, work=fail_at(7, error))
    assert sorted(tmp_path.iterdir()) == [clip]


def test_an_error_keeps_the_old_output(tmp_path: Path, clip: Path) -> None:
    out = tmp_path / "out.mp4"
    out.write_bytes(b"the old one")
    with pytest.raises(RuntimeError):
        convert(clip, out, force=True, work=fail_at(3, RuntimeError()))
    assert out.read_bytes() == b"the old one"
    convert(clip, out, force=True)
    assert out.stat().st_size > 100


@pytest.mark.usefixtures("no_thread_left")
def test_an_interrupt_signal_leaves_no_half_file(tmp_path: Path) -> None:
    def work(frame: Frame) -> None:
        assert (tmp_path / "out.mp4.part").exists()
        if frame.index == 30:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        convert(SAMPLE, tmp_path / "out.mp4", work=work)
    assert list(tmp_path.iterdir()) == []


def test_the_output_appears_only_when_it_is_complete(tmp_path: Path, clip: Path) -> None:
    out = tmp_path / "out.mp4"
    with open_input(clip) as source, open_sink(out, source, FAST) as sink:
        for frame in source:
            sink.write(frame)
            assert not out.exists()
    assert out.exists()
    assert sorted(tmp_path.iterdir()) == [clip, out]


def test_nothing_is_written_when_no_frame_came(tmp_path: Path, clip: Path) -> None:
    def attempt() -> None:
        with open_input(clip) as source, open_sink(tmp_path / "out.mp4", source, FAST):
            pass

    expect("out.mp4 was not written: no frame came from the input", attempt, tmp_path)


def test_an_output_that_appears_meanwhile_is_not_replaced(tmp_path: Path, clip: Path) -> None:
    out = tmp_path / "out.mp4"

    def work(frame: Frame) -> None:
        out.write_bytes(b"someone else's")

    with pytest.raises(MediaError, match="appeared meanwhile"):
        convert(clip, out, work=work)
    assert out.read_bytes() == b"someone else's"
    assert sorted(tmp_path.iterdir()) == [clip, out]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_one_sentence(tmp_path: Path, clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from guise.app.media.sink import Sink

    def claim(self: Sink) -> None:
        self.part.symlink_to("/dev/full")

    monkeypatch.setattr(Sink, "claim", claim)
    expect(r"No space left on device", lambda: convert(clip, tmp_path / "out.mp4"), tmp_path)


def test_frames_must_ascend_and_fit(tmp_path: Path, clip: Path) -> None:
    with open_input(clip) as source, open_sink(tmp_path / "out.mp4", source, FAST) as sink:
        frame = next(iter(source))
        sink.write(frame)
        with pytest.raises(ValueError, match="frame times must ascend, got 0 s after 0 s"):
            sink.write(frame)
        small = Frame.from_rgb(np.zeros((10, 10, 3), np.uint8), 99)
        with pytest.raises(MediaError, match="has 10 x 10 pixels but the video 64 x 48"):
            sink.write(small)
        sink.abort()
    assert sorted(tmp_path.iterdir()) == [clip]


def test_unwritable_image_format() -> None:
    with pytest.raises(MediaError, match="An image of 70000 x 4 cannot be written"):
        encode_image(np.zeros((4, 70000, 3), np.uint8), None, ".jpg", {})


def test_a_wait_can_be_interrupted(tmp_path: Path, clip: Path) -> None:
    """A caller that waits for a stuck encoder still answers to Ctrl-C."""
    with open_input(clip) as source, open_sink(tmp_path / "out.mp4", source, FAST) as sink:
        release = threading.Event()
        sink.write = lambda frame: release.wait(5) and None  # type: ignore[method-assign]

        def interrupt() -> None:
            for _ in range(2):  # the second while the threads are ending
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.1)
            release.set()

        timer = threading.Timer(0.3, interrupt)
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            process(source, sink, lambda frame: None, queue=2)
        timer.join()
        sink.abort()
    assert sorted(tmp_path.iterdir()) == [clip]
