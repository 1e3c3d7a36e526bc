"""Pipes: pictures in and out as y4m, NUT and raw video, without a file."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from guise.aam.model import Identity
from guise.app.cli.main import main
from guise.app.media import EncodeOptions, MediaError
from guise.app.media.pipes import FORMATS, encoded_for, input_pipe, is_pipe, output_pipe
from guise.app.swapping.report import FileTimes, SwapReport

PASS = """
import sys
from guise.app.media import open_input, open_sink, process
from guise.app.media.pipes import input_pipe, output_pipe
with open_input(input_pipe(sys.argv[1] or None)) as media, open_sink(output_pipe(sys.argv[2]), media) as sink:
    print(*process(media, sink, lambda frame: None).problems, sep="\\n", file=sys.stderr)
"""
ODD = """
import sys
from guise.app.media import open_input
from guise.app.media.errors import MediaError
from guise.app.media.pipes import input_pipe
try:
    with open_input(input_pipe()) as media:
        list(media), list(media)
except MediaError as error:
    print(error)
"""


def stream(path: Path, kind: str, fmt: str, frames: int = 5) -> bytes:
    """A pipe's content: noise of 64 x 48 pixels."""
    with av.open(str(path), "w", format=FORMATS[kind], options={"strict": "-1"}) as out:
        video = out.add_stream("rawvideo", 25)
        assert isinstance(video, av.VideoStream)
        video.width, video.height, video.pix_fmt = 64, 48, fmt
        for k in range(frames):
            noise = np.random.default_rng(k).integers(0, 255, (48, 64, 3), np.uint8)
            frame = av.VideoFrame.from_ndarray(noise, "rgb24").reformat(format=fmt)
            frame.pts, frame.time_base = k, Fraction(1, 25)
            out.mux(video.encode(frame))
        out.mux(video.encode(None))
    return path.read_bytes()


def decoded(data: bytes, path: Path, fmt: str, raw: bool) -> list[np.ndarray]:
    path.write_bytes(data)
    options = {"video_size": "64x48", "pixel_format": fmt} if raw else {}
    with av.open(str(path), format="rawvideo" if raw else None, options=options) as media:
        assert raw or media.streams.video[0].average_rate == 25
        return [frame.to_ndarray() for frame in media.decode(video=0)]


def run(code: str, data: bytes, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([sys.executable, "-c", code, *arguments], input=data, capture_output=True)


@pytest.mark.parametrize("fmt", ["yuv420p", "yuv422p", "yuv444p", "yuv420p10le"])
@pytest.mark.parametrize(
    ("kind", "to"), [("y4m", "y4m"), ("nut", "nut"), ("rawvideo", "rawvideo"), ("nut", "y4m")]
)
@pytest.mark.slow
def test_pictures_pass_bit_by_bit(tmp_path: Path, kind: str, to: str, fmt: str) -> None:
    data = stream(tmp_path / "in", kind, fmt)
    done = run(PASS, data, f"64x48@25:{fmt}" if kind == "rawvideo" else "", to)
    assert done.returncode == 0, done.stderr
    before = decoded(data, tmp_path / "a", fmt, kind == "rawvideo")
    after = decoded(done.stdout, tmp_path / "b", fmt, to == "rawvideo")
    assert len(after) == 5
    assert all((a == b).all() for a, b in zip(before, after, strict=True))


@pytest.mark.parametrize(("content", "said"), [("y4m", "read only once"), ("", "--raw"), ("noise", "--raw")])
@pytest.mark.slow
def test_what_a_pipe_cannot_give_is_a_sentence(tmp_path: Path, content: str, said: str) -> None:
    noise = np.random.default_rng(1).integers(0, 255, 5000, np.uint8).tobytes()
    data = stream(tmp_path / "in", "y4m", "yuv420p") if content == "y4m" else noise if content else b""
    done = run(ODD, data)
    assert done.returncode == 0, done.stderr
    assert said in done.stdout.decode()
    assert done.stdout.count(b"\n") == 1


def test_raw_pictures_need_a_size_and_a_rate() -> None:
    assert is_pipe(input_pipe("640x480@30000/1001:yuv422p"))
    for wrong in ("640", "640x480", "x480@30", "640x480@", "640x480@30:"):
        with pytest.raises(MediaError, match="must be like 640x480@30"):
            input_pipe(wrong)


def test_only_nut_holds_coded_pictures() -> None:
    assert encoded_for(output_pipe("y4m"), EncodeOptions()).encoder == "rawvideo"
    assert encoded_for(output_pipe("nut"), EncodeOptions("libx264")).encoder == "libx264"
    with pytest.raises(MediaError, match="leave out --encoder"):
        encoded_for(output_pipe("y4m"), EncodeOptions("libx264"))


def test_the_command_leaves_stdout_to_the_pictures(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], p01: Identity
) -> None:
    asked: list[tuple[Path, Path]] = []

    def fake(video: Path, identity: object, output: Path, **given: Any) -> SwapReport:
        asked.append((video, output))
        return SwapReport("pipe", 2, 0, 0, 0, FileTimes(1.0, 1.0, 0.1, 0.0), "cpu", 1, 0.0, ())

    monkeypatch.setattr("guise.app.photos.swap.swap_file", fake)
    monkeypatch.setattr("guise.app.cli.video._open", lambda *given: (p01, None))
    call = ("swap", "-", "--identity", "Mei", "-o", "-", "--pipe", "y4m", "--raw", "640x480@30000/1001")
    for more in ((), ("--json",)):
        assert main([*call, *more]) == 0
        out, err = capsys.readouterr()
        assert out == ""
        assert "2" in err
    assert asked == [(input_pipe("640x480@30000/1001"), output_pipe("y4m"))] * 2
    assert main(["swap", "a.mp4", "--identity", "Mei", "-o", "b.mp4", "--raw", "640x480@30"]) == 2
    assert "--raw is for raw video from a pipe" in capsys.readouterr().err
