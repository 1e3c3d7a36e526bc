"""Segments of a file: cut at keyframes, and read as a whole pass would read them."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from test_media import SAMPLE, SHARED, damage, make_clip, picture

from guise.app.media import Frame, open_input, segments
from guise.app.media.frame import plane_arrays
from guise.app.media.input import VideoInput
from guise.app.media.problems import ProblemLog
from guise.app.media.segments import KeptFrames, Scan, read_frames, scan

THOUSANDTHS = Fraction(1, 1000)
GOP = {"g": "10", "bf": "2", "x264-params": "scenecut=0"}
OPEN = GOP | {"x264-params": "open-gop=1:scenecut=0"}


def facts(frame: Frame) -> tuple[object, ...]:
    """Times, index and planes of a frame, to compare."""
    video = frame.video_frame
    planes = [frame.rgb()] if video is None else plane_arrays(video)
    return frame.index, frame.pts, frame.duration, frame.orientation, [plane.tobytes() for plane in planes]


def whole(path: Path) -> list[tuple[object, ...]]:
    with open_input(path) as source:
        return [facts(frame) for frame in source]


def check_windows(path: Path, length: int = 20) -> Scan:
    """Every segment, and windows that cut across them, equal the slices of a pass from the start."""
    found, frames = scan(path, length), whole(path)
    assert [frame[1] for frame in frames] == found.pts.tolist()
    windows = [(piece.first, piece.end) for piece in found.segments]
    rng = np.random.default_rng(0)
    windows += [tuple(sorted(rng.integers(0, found.frames + 1, 2).tolist())) for _ in range(4)]
    for first, last in windows:
        assert [facts(frame) for frame in read_frames(path, found, first, last)] == frames[first:last]
    return found


def steady(count: int, step: int = 512) -> range:
    return range(0, count * step, step)


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".ts"])
@pytest.mark.parametrize("options", [GOP, OPEN], ids=["closed", "open"])
@pytest.mark.slow
def test_windows_equal_slices_of_a_whole_pass(tmp_path: Path, suffix: str, options: dict[str, str]) -> None:
    clock = {".mkv": THOUSANDTHS, ".ts": Fraction(1, 90000)}.get(suffix, Fraction(1, 15360))
    step = int(clock.denominator // 30)
    clip = make_clip(tmp_path / f"in{suffix}", steady(75, step), clock=clock, options=options)
    assert len(check_windows(clip).segments) == 3


def test_segments_begin_at_keyframes_and_have_the_length() -> None:
    path = SAMPLE.with_name("talk.mp4")
    found = scan(path, 50)
    with av.open(str(path)) as clip:
        keys = [p.pts for p in clip.demux(video=0) if p.is_keyframe and p.size]
    assert found.pts[found.keyframes].tolist() == keys
    assert all(piece.first in found.keyframes and piece.count >= 50 for piece in found.segments)
    assert [piece.first for piece in found.segments[1:]] == [piece.end for piece in found.segments[:-1]]
    assert found.segments[-1].end == found.frames
    assert len(found.segments) == 2


def test_a_short_rest_stays_with_the_segment_before(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(75), options=GOP)
    assert [(p.first, p.count) for p in scan(clip, 30).segments] == [(0, 30), (30, 45)]
    assert [(p.first, p.count) for p in scan(clip, 38).segments] == [(0, 75)]


def test_variable_rate_and_late_start(tmp_path: Path) -> None:
    times = np.cumsum(np.random.default_rng(0).integers(1, 3000, 60)).tolist()
    clip = make_clip(tmp_path / "in.mp4", times, options=GOP)
    assert check_windows(clip).pts.tolist() == times


@pytest.mark.parametrize(
    ("encoder", "suffix", "fmt"),
    [("ffv1", ".mkv", "yuv422p"), ("libx265", ".mp4", "yuv420p10le"), ("mpeg4", ".avi", "yuv420p"),
     ("libvpx-vp9", ".webm", "yuv420p"), ("mjpeg", ".avi", "yuvj420p")],
)  # fmt: skip
@pytest.mark.slow
def test_other_codecs(tmp_path: Path, encoder: str, suffix: str, fmt: str) -> None:
    options = {"g": "10", "x265-params": "log-level=none:keyint=10:scenecut=0"}
    clock = THOUSANDTHS if suffix in (".mkv", ".webm") else Fraction(1, 30)
    step = 1 if clock.denominator == 30 else 33
    clip = make_clip(
        tmp_path / f"in{suffix}", steady(60, step), encoder=encoder, fmt=fmt, clock=clock, options=options
    )
    assert len(check_windows(clip).segments) == 3


def test_rotated_video_comes_upright_from_the_middle(tmp_path: Path) -> None:
    clip = make_clip(
        tmp_path / "in.mp4", steady(40), options=GOP, size=(64, 32),
        adjust=lambda video: video.set_display_rotation(90),
    )  # fmt: skip
    assert len(check_windows(clip).segments) == 2
    with open_input(clip) as source:
        assert (source.width, source.height) == (32, 64)


def cut_by_copying(path: Path, out: Path, after: int) -> Path:
    """The packets from the keyframe before a time on, shown from that time by an edit list."""
    with av.open(str(path)) as source, av.open(str(out), "w") as result:
        old = source.streams.video[0]
        new = result.add_stream_from_template(old, opaque=True)
        source.seek(after, stream=old)
        for packet in source.demux(old):
            if packet.dts is not None:
                packet.pts, packet.dts = packet.pts - after, packet.dts - after
                packet.stream = new
                result.mux(packet)
    return out


def test_an_edit_list_hides_the_same_frames(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(75), options=GOP)
    cut = cut_by_copying(clip, tmp_path / "cut.mp4", 25 * 512)
    with av.open(str(cut)) as container:
        assert sum(packet.is_discard for packet in container.demux(video=0)) > 2
    assert check_windows(cut).frames < 55


def test_missing_time_stamps_make_one_segment(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.h264", range(60), clock=Fraction(1, 30), options=GOP)
    with av.open(str(clip)) as container:
        assert any(packet.pts is None and packet.size for packet in container.demux(video=0))
    assert len(check_windows(clip).segments) == 1


def test_a_stream_that_starts_without_a_keyframe_is_read_as_the_decoder_gives_it(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.ts", steady(75, 3000), clock=Fraction(1, 90000), options=OPEN)
    with av.open(str(clip)) as container:
        starts = [p.pos for p in container.demux(video=0) if p.is_keyframe and p.size]
    cut = tmp_path / "cut.ts"
    cut.write_bytes(clip.read_bytes()[starts[1] - starts[1] % 188 + 188 * 3 :])
    check_windows(cut)


def test_a_damaged_keyframe_is_decoded_from_before_it(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(60), options=GOP | {"bf": "0"})
    found = scan(clip, 20)
    damage(clip, 20)
    again, frames, problems = scan(clip, 20), whole(clip), ProblemLog()
    assert again.pts.tolist() == found.pts.tolist()
    index = {pts: i for i, pts in enumerate(found.pts.tolist())}
    expected = [frame[1:] for frame in frames if 20 <= index[frame[1]] < 40]
    got = [facts(frame) for frame in read_frames(clip, found, 20, 40, problems=problems)]
    assert [frame[1:] for frame in got] == expected
    assert [index[frame[1]] for frame in got] == [frame[0] for frame in got]
    assert any("damaged" in problem for problem in problems)


def test_a_damaged_file_gives_the_same_on_any_machine(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(60), size=(160, 120), options=GOP)
    found = scan(clip, 20)
    for number in (4, 13, 27, 44, 45):
        damage(clip, number, seed=number)
    with open_input(clip) as source:
        assert isinstance(source, VideoInput)
        reader = source.open_reader(ProblemLog())
        reader.use_one_thread()
        frames = [facts(frame)[1:] for frame in source.frames_of(reader)]
        assert reader.damaged
    for first, last in [(0, 60), *((piece.first, piece.end) for piece in found.segments)]:
        got = [facts(frame)[1:] for frame in read_frames(clip, found, first, last)]
        assert len(got) > (last - first) // 2
        assert got == [frame for frame in frames if found.pts[first] <= frame[0] <= found.pts[last - 1]]


def test_images_are_one_segment(tmp_path: Path) -> None:
    for number in range(5):
        rgb = picture(number, 32, 24, "rgb24").to_ndarray()
        (tmp_path / f"{number}.png").write_bytes(_png(rgb))
    (tmp_path / "2b.png").write_bytes(b"broken")
    found = check_windows(tmp_path, 1)
    assert (found.frames, len(found.segments)) == (5, 1)
    assert [frame.name for frame in read_frames(tmp_path, found, 2, 4)] == ["2.png", "3.png"]


def _png(rgb: np.ndarray) -> bytes:
    from guise.app.media.image_writing import encode_image

    return encode_image(rgb, None, ".png", {})


def test_a_scan_survives_json(tmp_path: Path) -> None:
    found = scan(make_clip(tmp_path / "in.mp4", steady(75), options=GOP), 20)
    again = Scan.from_json(json.loads(json.dumps(found.as_json())))
    assert again.segments == found.segments
    assert again.time_base == found.time_base
    for name in ("pts", "keyframes", "dts"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
        assert getattr(again, name).dtype == getattr(found, name).dtype


@pytest.mark.parametrize("name", ["franck.mp4", "gesture_bird.mkv", "grid_bbaf2n.mpg", "phone_s29.mp4"])
@pytest.mark.slow
def test_real_clips(name: str) -> None:
    path = SHARED / "data/real" / name
    if not path.exists():
        pytest.skip(f"{path} is not there")
    found = scan(path)
    piece = found.segments[-1]
    first = max(piece.first, piece.end - 300)
    got = [facts(frame) for frame in read_frames(path, found, first, piece.end)]
    with open_input(path) as source:
        frames = [facts(frame) for frame in source if frame.index >= first]
    assert got == frames


def read(path: Path, found: Scan, kept: KeptFrames, first: int = 0, last: int | None = None) -> list[Frame]:
    return list(read_frames(path, found, first, found.frames if last is None else last, kept=kept))


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The inputs that were opened."""
    paths: list[Path] = []

    def recorded(path: Path, **more: Any) -> object:
        paths.append(path)
        return open_input(path, **more)

    monkeypatch.setattr(segments, "open_input", recorded)
    return paths


def test_a_file_that_is_kept_is_read_once_and_stays_as_it_was(tmp_path: Path, opened: list[Path]) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(40), options=GOP)
    found, kept = scan(clip), KeptFrames(lambda: 1 << 30)
    opened.clear()
    frames = [facts(frame) for frame in read(clip, found, kept)]
    for frame in read(clip, found, kept):
        frame.write_roi(0, 0, 255 - frame.read_roi(0, 0, frame.width, frame.height))
    assert [facts(frame) for frame in read(clip, found, kept, 5, 25)] == frames[5:25]
    assert opened == [clip]
    assert frames == whole(clip)


@pytest.mark.parametrize("last", [40, 39])
def test_neither_a_file_that_is_too_large_nor_a_part_is_kept(
    tmp_path: Path, opened: list[Path], last: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(40), options=GOP)
    found, size = scan(clip), sum(frame.nbytes for frame in open_input(clip))
    kept = KeptFrames(lambda: size if last == 39 else size - 1)
    opened.clear()
    monkeypatch.setattr(Frame, "copy", lambda frame: pytest.fail("a frame was copied"))
    assert len(read(clip, found, kept, 0, last)) == last
    assert kept.frames(clip, ProblemLog()) is None
    assert opened == [clip]


def test_another_file_of_the_same_name_is_read_anew(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(40), options=GOP)
    kept = KeptFrames(lambda: 1 << 30)
    read(clip, scan(clip), kept)
    make_clip(clip, steady(30), options=GOP)
    assert [facts(frame) for frame in read(clip, scan(clip), kept)] == whole(clip)
    kept.clear()
    assert kept.frames(clip, ProblemLog()) is None


def test_what_went_wrong_is_said_of_kept_frames_as_well(tmp_path: Path) -> None:
    clip = damage(make_clip(tmp_path / "in.mp4", steady(40), options=GOP), 20)
    found, kept = scan(clip), KeptFrames(lambda: 1 << 30)
    told = [ProblemLog() for _ in range(2)]
    frames = [list(read_frames(clip, found, 0, found.frames, problems=log, kept=kept)) for log in told]
    assert [facts(frame) for frame in frames[0]] == [facts(frame) for frame in frames[1]]
    assert told[0] == told[1] != []
