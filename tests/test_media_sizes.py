"""A stream whose pictures change their size: whole and undistorted between bars, with one note for each change."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guise.app.media import open_input
from guise.app.media.letterbox import fitting_box, pasted
from guise.app.media.pixel_formats import SHALLOW_FORMATS
from guise.app.media.problems import ProblemLog
from guise.app.media.segments import read_frames, scan

SIDES = st.integers(16, 400)
TICK = Fraction(1, 90000)
Join = Callable[[Path, list[tuple[int, int]]], None]


@given(SIDES, SIDES, SIDES, SIDES, st.fractions(Fraction(1, 2), 2, max_denominator=16))
def test_a_box_keeps_the_aspect_ratio_and_fits(
    w: int, h: int, width: int, height: int, stretch: Fraction
) -> None:
    left, top, wide, tall = fitting_box(w, h, (width, height), stretch)
    assert 0 <= left <= left + wide <= width
    assert 0 <= top <= top + tall <= height
    assert left % 2 == top % 2 == 0
    assert abs(wide - tall * w * stretch / h) <= 2 * max(1, w * stretch / h)  # within rounding to even pixels
    assert wide >= width - 2 or tall >= height - 2


@pytest.mark.parametrize("fmt", [*SHALLOW_FORMATS, "yuv420p10le"])
def test_a_picture_is_pasted_into_black_of_its_range(fmt: str) -> None:
    grey = av.VideoFrame.from_ndarray(np.full((32, 20, 3), 200, np.uint8), "rgb24").reformat(format=fmt)
    whole = pasted(grey, (64, 32), 22, 0)
    shown = whole.reformat(format="rgb24").to_ndarray().astype(int)
    assert shown.shape == (32, 64, 3)
    assert shown[:, :20].max() <= 2
    assert shown[:, 44:].max() <= 2
    assert np.abs(shown[2:-2, 24:40] - 200).max() <= 3


def picture(width: int, height: int) -> av.VideoFrame:
    """A bright disk in the middle, a third of the shorter side in radius."""
    y, x = np.mgrid[:height, :width]
    disk = (x - width / 2) ** 2 + (y - height / 2) ** 2 < (min(width, height) / 3) ** 2
    grey = np.where(disk, np.uint8(230), np.uint8(90))
    return av.VideoFrame.from_ndarray(np.stack([grey] * 3, axis=2), "rgb24")


def joined_streams(path: Path, sizes: list[tuple[int, int]], frames: int = 6, begins: int = 0) -> None:
    """Transport streams of several sizes, one behind the other on one clock."""
    data = b""
    for number, (width, height) in enumerate(sizes):
        with av.open(str(path), "w", format="mpegts") as out:
            stream = out.add_stream("libx264", 30, {"bf": "0", "crf": "10", "preset": "ultrafast"})
            assert isinstance(stream, av.VideoStream)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.time_base = TICK
            for k in range(frames):
                frame = picture(width, height)
                frame.pts, frame.time_base = (begins + number * frames + k) * 3000, TICK
                out.mux(stream.encode(frame))
            out.mux(stream.encode(None))
        data += path.read_bytes()
    path.write_bytes(data)


def joined_pictures(path: Path, sizes: list[tuple[int, int]], frames: int = 6) -> None:
    """One stream of JPEG pictures of several sizes."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("mjpeg", 30)
        assert isinstance(stream, av.VideoStream)
        (stream.width, stream.height), stream.pix_fmt = sizes[0], "yuvj420p"
        out.start_encoding()
        for number, (width, height) in enumerate(sizes):
            encoder = av.CodecContext.create("mjpeg", "w")
            assert isinstance(encoder, av.VideoCodecContext)
            encoder.width, encoder.height, encoder.pix_fmt, encoder.time_base = (
                width,
                height,
                "yuvj420p",
                TICK,
            )
            for k in range(frames):
                frame = picture(width, height).reformat(format="yuvj420p")
                frame.pts, frame.time_base = (number * frames + k) * 3000, TICK
                for packet in encoder.encode(frame):
                    packet.stream = stream
                    out.mux_one(packet)


def disk_box(rgb: np.ndarray) -> tuple[int, int]:
    """Width and height of the bright disk."""
    bright = rgb[:, :, 1] > 170
    return int(np.ptp(np.flatnonzero(bright.any(0)))), int(np.ptp(np.flatnonzero(bright.any(1))))


@pytest.mark.parametrize(
    "sizes",
    [
        [(160, 120), (66, 120)],
        [(64, 120), (160, 120), (64, 120)],
        [(160, 90), (90, 160), (320, 180), (90, 160)],
    ],
)
@pytest.mark.parametrize("join", [joined_streams, joined_pictures])
def test_every_size_is_shown_whole_with_one_note_a_change(
    tmp_path: Path, sizes: list[tuple[int, int]], join: Join
) -> None:
    path = tmp_path / ("a.ts" if join is joined_streams else "a.mkv")
    join(path, sizes)
    with open_input(path) as media:
        pictures = [frame.rgb() for frame in media]
        said = [note for note in media.problems if "picture changes" in note]
    assert len(pictures) == 6 * len(sizes)
    assert {picture.shape for picture in pictures} == {(sizes[0][1], sizes[0][0], 3)}
    assert len(said) == len(sizes) - 1
    for size, note in zip(sizes[1:], said, strict=True):
        assert f"{size[0]} x {size[1]}" in note
        assert ("letterboxed" in note) == (size != sizes[0])
        assert ("changes back to" in note) == (size == sizes[0])
    for picture in pictures:
        wide, tall = disk_box(picture)
        assert abs(wide - tall) <= 3


def test_segments_show_what_a_whole_pass_shows(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    joined_pictures(path, [(160, 120), (66, 120), (160, 120)], frames=6)
    with open_input(path) as media:
        whole = [frame.rgb() for frame in media]
        noted = [note for note in media.problems if "picture changes" in note]
    found = scan(path, length=4)
    cut, said = [], []
    for segment in found.segments:
        log = ProblemLog()
        cut += [frame.rgb() for frame in read_frames(path, found, segment.first, segment.end, problems=log)]
        said += [note for note in log if "picture changes" in note]
    assert len(found.segments) > 1
    assert all((a == b).all() for a, b in zip(whole, cut, strict=True))
    assert list(dict.fromkeys(said)) == noted


@pytest.mark.parametrize("change", ["replaced", "grown", "gone", "none"])
def test_an_input_that_changes_while_it_is_read_is_noted(tmp_path: Path, change: str) -> None:
    path = tmp_path / "a.mkv"
    joined_pictures(path, [(32, 32)])
    joined_pictures(tmp_path / "b.mkv", [(32, 32)], 3)
    with open_input(path) as media:
        for frame in media:
            if frame.index == 2 and change == "replaced":
                (tmp_path / "b.mkv").replace(path)
            elif frame.index == 2 and change == "grown":
                with path.open("ab") as file:
                    file.write(b"more")
            elif frame.index == 2 and change == "gone":
                path.unlink()
        assert any("was changed or replaced" in note for note in media.problems) == (change != "none")


def test_recordings_that_overlap_by_a_few_pictures_are_joined_with_one_note(tmp_path: Path) -> None:
    """As a phone that is turned writes them: the second one's times begin before the first one's end."""
    path = tmp_path / "a.ts"
    joined_streams(path, [(160, 120)], 30)
    first = path.read_bytes()
    joined_streams(path, [(66, 120)], 30, begins=28)
    path.write_bytes(first + path.read_bytes())
    with open_input(path) as media:
        found = [frame.pts for frame in media]
        assert len(media.problems) == 1
    assert len(found) == 60
    assert set(np.diff(found)) == {3000}


def test_a_change_in_a_stream_without_times_is_told_at_its_own_picture(tmp_path: Path) -> None:
    data = b""
    for size in [(160, 120), (66, 120)]:
        joined_streams(tmp_path / "a.ts", [size], 12)
        with av.open(str(tmp_path / "a.ts")) as media:
            data += b"".join(bytes(packet) for packet in media.demux(video=0))
    (tmp_path / "a.h264").write_bytes(data)
    with open_input(tmp_path / "a.h264") as media:
        found = [float(frame.pts * frame.time_base) for frame in media]
        assert any(f"At {found[12]:.2f} s the picture changes to 66 x 120" in note for note in media.problems)
