"""Pieces of a video: the same as a whole encoding, wherever and whenever they are made."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_media import (
    FAST,
    LOSSLESS,
    SAMPLE,
    UNEVEN,
    make_clip,
    packets,
    paint,
    run,
    video_planes,
    video_times,
)
from test_media_segments import GOP, facts, steady

from guise.app.media import EncodeOptions, Frame, MediaError, open_input
from guise.app.media.packets import PacketSink, assemble, decoding_times, read_packets
from guise.app.media.segments import read_frames, scan
from guise.app.media.stream_copies import Audio

OUTPUT = Path("out.mp4")  # that the pieces are for
TAGS = {"comment": "synthetic face"}


def make_pieces(clip: Path, folder: Path, options: EncodeOptions, length: int = 20) -> list[Path]:
    """The clip, painted, in pieces of at least `length` frames, made in reverse order."""
    found = scan(clip, length)
    parts = [folder / f"{piece.index}.packets" for piece in found.segments]
    with open_input(clip) as source:
        for piece in reversed(found.segments):
            with PacketSink(parts[piece.index], source, options, OUTPUT) as sink:
                for frame in read_frames(clip, found, piece.first, piece.end):
                    paint(frame)
                    sink.write(frame)
    return parts


def write_all(sink: PacketSink, frames: list[Frame]) -> None:
    with sink:
        for frame in frames:
            sink.write(frame)


def put_together(
    clip: Path, out: Path, options: EncodeOptions, *, length: int = 20, audio: Audio = "keep", private: bool = False,
    force: bool = False,
) -> int:  # fmt: skip
    """Make the pieces of a clip and the whole; returns how many pieces there were."""
    parts = make_pieces(clip, out.parent, options, length)
    with open_input(clip) as source:
        assemble(out, source, parts, options, tags=TAGS, private=private, audio=audio, force=force)
    for part in parts:
        part.unlink()
    return len(parts)


def look(path: Path) -> tuple[object, ...]:
    """How the video of a file is to be shown."""
    with av.open(str(path)) as clip:
        stream = clip.streams.video[0]
        frame = next(clip.decode(stream))
        return (
            frame.color_primaries, frame.color_trc, frame.colorspace, frame.color_range, frame.interlaced_frame,
            stream.codec_context.field_order, stream.sample_aspect_ratio, frame.rotation, stream.disposition,
            stream.metadata.get("language"), frame.format.name,
        )  # fmt: skip


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
@pytest.mark.slow
def test_pieces_make_the_video_that_one_encoding_makes(tmp_path: Path, suffix: str) -> None:
    times = np.cumsum(np.random.default_rng(0).integers(1, 3000, 70)).tolist()
    clip = make_clip(
        tmp_path / f"in{suffix}", times, options=GOP, sound=2, subtitles=suffix != ".mov", title="A"
    )
    out, direct = tmp_path / f"out{suffix}", tmp_path / f"direct{suffix}"
    assert put_together(clip, out, LOSSLESS) == 3
    run(clip, direct, paint, LOSSLESS, tags=TAGS)
    assert video_times(out) == video_times(direct)
    for pieces, whole in zip(video_planes(out), video_planes(direct), strict=True):
        for a, b in zip(pieces, whole, strict=True):
            np.testing.assert_array_equal(a, b)
    assert packets(out, "audio") == packets(direct, "audio") == packets(clip, "audio")
    if suffix != ".mov":
        assert packets(out, "subtitle") == packets(direct, "subtitle") == packets(clip, "subtitle")
    with av.open(str(out)) as a, av.open(str(direct)) as b:
        assert dict(a.metadata) == dict(b.metadata)
        assert (a.duration, a.start_time) == (b.duration, b.start_time)
        assert a.streams.video[0].average_rate == b.streams.video[0].average_rate


def test_rotation_tags_aspect_and_interlacing_are_those_of_one_encoding(tmp_path: Path) -> None:
    def adjust(video: av.VideoStream) -> None:
        context = video.codec_context
        context.color_primaries, context.color_trc, context.colorspace, context.color_range = 9, 14, 9, 1
        context.sample_aspect_ratio = Fraction(4, 3)
        video.set_display_rotation(90)
        video.metadata["language"] = "fin"

    interlaced = {"flags": "+ildct+ilme", "x264-params": "tff=1:scenecut=0"}
    clip = make_clip(tmp_path / "in.mp4", steady(40), adjust=adjust, options=GOP | interlaced)
    assert put_together(clip, tmp_path / "out.mp4", FAST) == 2
    run(clip, tmp_path / "direct.mp4", paint)
    assert look(tmp_path / "out.mp4") == look(tmp_path / "direct.mp4")
    assert look(tmp_path / "out.mp4")[4] is True


@pytest.mark.slow
def test_real_footage_with_sound_and_an_edit_list(tmp_path: Path) -> None:
    clip = SAMPLE.with_name("talk.mp4")
    assert put_together(clip, tmp_path / "out.mp4", FAST, length=50) == 2
    assert video_times(tmp_path / "out.mp4") == video_times(clip)
    assert packets(tmp_path / "out.mp4", "audio") == packets(clip, "audio")


@pytest.mark.parametrize("encoder", ["libx264", "libx265", "ffv1", "libvpx-vp9"])
@pytest.mark.slow
def test_a_piece_decodes_to_its_frames(tmp_path: Path, encoder: str) -> None:
    clip = make_clip(
        tmp_path / "in.mp4", steady(45), options=GOP, size=(64, 32),
        adjust=lambda video: video.set_display_rotation(90),
    )  # fmt: skip
    options = EncodeOptions(encoder=encoder, preset="ultrafast", lossless=True)
    found, parts = scan(clip, 20), make_pieces(clip, tmp_path, options)
    assert len(parts) == 2
    for piece, part in zip(found.segments, parts, strict=True):
        frames = list(read_frames(clip, found, piece.first, piece.end))
        for frame in frames:
            paint(frame)
        assert [facts(frame) for frame in read_packets(part)] == [facts(frame) for frame in frames]


@pytest.mark.parametrize(
    ("suffix", "encoder"), [(".mp4", "libx264"), (".mkv", "libx264"), (".mp4", "libx265")]
)
@pytest.mark.slow
def test_the_bytes_are_the_same_each_time(tmp_path: Path, suffix: str, encoder: str) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(75), size=(160, 120), options=GOP, sound=1)
    options = EncodeOptions(encoder=encoder)
    results = set()
    for number in range(4):
        put_together(clip, tmp_path / f"{number}{suffix}", options, private=True)
        results.add((tmp_path / f"{number}{suffix}").read_bytes())
    assert len(results) == 1


def test_a_transport_stream_can_be_joined_at_every_keyframe(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", steady(75), options=GOP)
    put_together(clip, tmp_path / "out.ts", FAST)
    with av.open(str(tmp_path / "out.ts")) as whole:
        keys = [p.pos for p in whole.demux(video=0) if p.is_keyframe and p.size]
    assert len(keys) == 3
    late = tmp_path / "late.ts"
    late.write_bytes((tmp_path / "out.ts").read_bytes()[keys[1] :])
    assert len(video_times(late)) >= 45


def test_sound_can_be_left_out(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", UNEVEN, sound=1, subtitles=True)
    put_together(clip, tmp_path / "out.mp4", FAST, audio="drop")
    with av.open(str(tmp_path / "out.mp4")) as result:
        assert [stream.type for stream in result.streams] == ["video", "subtitle"]


def test_an_empty_piece_is_nothing(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", UNEVEN)
    [part] = make_pieces(clip, tmp_path, FAST)
    with open_input(clip) as source:
        with PacketSink(tmp_path / "empty.packets", source, FAST, OUTPUT):
            pass
        parts = [part, tmp_path / "empty.packets"]
        assemble(tmp_path / "out.mp4", source, parts, FAST, tags={}, private=True)
    assert list(read_packets(tmp_path / "empty.packets")) == []
    assert video_times(tmp_path / "out.mp4") == video_times(clip)


def test_an_error_leaves_no_piece_and_no_output(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", UNEVEN)
    with open_input(clip) as source:
        frame = next(iter(source))
        with pytest.raises(ValueError, match="frame times must ascend"):
            write_all(PacketSink(tmp_path / "a.packets", source, FAST, OUTPUT), [frame, frame])
    assert list(tmp_path.iterdir()) == [clip]


def test_a_cut_piece_is_one_sentence(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", UNEVEN)
    [part] = make_pieces(clip, tmp_path, FAST)
    whole = part.read_bytes()
    with open_input(clip) as source:
        for length in (0, 10, len(whole) - 1):
            part.write_bytes(whole[:length])
            with pytest.raises(
                MediaError, match="is not a complete piece of a video: delete it and run again"
            ):
                assemble(tmp_path / "out.mp4", source, [part], FAST, tags={}, private=True)
    assert sorted(tmp_path.iterdir()) == [part, clip]


def test_an_existing_output_needs_force(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", UNEVEN)
    put_together(clip, tmp_path / "out.mp4", FAST)
    before = (tmp_path / "out.mp4").read_bytes()
    with pytest.raises(MediaError, match=r"out\.mp4 exists: use --force"):
        put_together(clip, tmp_path / "out.mp4", LOSSLESS)
    assert (tmp_path / "out.mp4").read_bytes() == before
    put_together(clip, tmp_path / "out.mp4", LOSSLESS, force=True)
    assert (tmp_path / "out.mp4").read_bytes() != before


@given(st.lists(st.integers(-1000, 1000), min_size=1, max_size=40, unique=True))
def test_decoding_times_ascend_and_are_never_late(pts: list[int]) -> None:
    dts = decoding_times(np.array(pts, np.int64))
    assert len(dts) == len(pts)
    assert (np.diff(dts) > 0).all()
    assert (dts <= pts).all()
    if pts == sorted(pts):
        assert dts.tolist() == pts


ABANDON = """
import sys
from pathlib import Path
from guise.app.media.packets import read_packets

for _ in range(100):
    next(read_packets(Path(sys.argv[1])))
"""


@pytest.mark.slow
def test_a_piece_need_not_be_read_to_its_end(tmp_path: Path) -> None:
    (part,) = make_pieces(SAMPLE, tmp_path, FAST, 1000)
    subprocess.run([sys.executable, "-c", ABANDON, part], check=True, timeout=60)
