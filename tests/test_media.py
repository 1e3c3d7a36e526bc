"""Video in and out: what must survive, what must fail cleanly, and what may never be left behind."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.codec.context import Flags

from guise.app.media import EncodeOptions, Frame, ProcessStats, open_input, open_sink, process
from guise.app.media.frame import plane_arrays

SHARED = Path(__file__).parents[2] / "shared"
SAMPLE = Path(__file__).parents[1] / "sample_videos" / "p01" / "talk2.mp4"
LOSSLESS = EncodeOptions(lossless=True, preset="ultrafast")
FAST = EncodeOptions(preset="ultrafast", crf=30)
STEADY = [0, 512, 1024, 1536, 2048, 2560, 3072, 3584, 4096, 4608, 5120, 5632]
UNEVEN = [0, 512, 1100, 1537, 4000, 4001, 4700, 9000, 9512, 9513, 12000, 12345]
LATE = [time + 7000 for time in UNEVEN]
CLOCK = Fraction(1, 15360)


# -- making and reading clips --------------------------------------------------------------------------


def picture(index: int, width: int, height: int, fmt: str) -> av.VideoFrame:
    """Moving texture with some noise: every frame differs from every other in every block."""
    y, x = np.mgrid[:height, :width]
    rng = np.random.default_rng(index)
    waves = [127 + 90 * np.sin((x + 5 * index + 30 * c) / 9) * np.cos((y - 3 * index) / 7) for c in range(3)]
    rgb = (np.stack(waves, axis=-1) + rng.integers(-8, 8, (height, width, 3))).clip(0, 255).astype(np.uint8)
    return av.VideoFrame.from_ndarray(rgb, "rgb24").reformat(format=fmt)


def make_clip(
    path: Path, times: Iterable[int] = STEADY, *, size: tuple[int, int] = (64, 48), fmt: str = "yuv420p",
    encoder: str = "libx264", clock: Fraction = CLOCK, options: dict[str, str] | None = None, sound: int = 0,
    adjust: Callable[[av.VideoStream], None] | None = None, title: str | None = None, subtitles: bool = False,
) -> Path:  # fmt: skip
    """A small clip; `sound` counts audio streams, `adjust` may set the video stream up further."""
    settings = {"preset": "ultrafast", "crf": "18", "bf": "2"} if encoder == "libx264" else {}
    precise = {} if path.suffix == ".mkv" else {"movie_timescale": str(clock.denominator)}
    with av.open(str(path), "w", container_options=precise) as out:
        video = out.add_stream(encoder, 30, settings | (options or {}))
        video.width, video.height = size
        video.pix_fmt = fmt
        video.codec_context.time_base = clock
        if adjust is not None:
            adjust(video)
        audio = [out.add_stream("aac", 44100) for _ in range(sound)]
        text = out.add_mux_stream("subrip" if path.suffix == ".mkv" else "mov_text") if subtitles else None
        if title:
            out.metadata["title"] = title
        video.codec_context.flags |= Flags.frame_duration
        moments = list(times)
        for index, time in enumerate(moments):
            frame = picture(index, *size, fmt)
            frame.pts, frame.time_base = time, clock
            frame.duration = (moments[index + 1] if index + 1 < len(moments) else time + moments[1]) - time
            out.mux(video.encode(frame))
        out.mux(video.encode(None))
        for number, stream in enumerate(audio):
            add_sound(out, stream, number)
        if text is not None:
            add_subtitles(out, text, "subrip" if path.suffix == ".mkv" else "mov_text")
    return path


def add_sound(out: av.container.OutputContainer, stream: av.AudioStream, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0, 0.1, (2, 17 * 1024)).astype(np.float32)
    for start in range(0, noise.shape[1], 1024):
        frame = av.AudioFrame.from_ndarray(noise[:, start : start + 1024].copy(), "fltp", "stereo")
        frame.sample_rate, frame.pts, frame.time_base = 44100, start, Fraction(1, 44100)
        out.mux(stream.encode(frame))
    out.mux(stream.encode(None))


def add_subtitles(out: av.container.OutputContainer, stream: av.stream.Stream, codec: str) -> None:
    for start, words in [(0, b"first line"), (200, b"second line")]:
        body = words if codec == "subrip" else len(words).to_bytes(2, "big") + words
        packet = av.Packet(body)
        packet.pts = packet.dts = start
        packet.duration, packet.time_base, packet.stream = 150, Fraction(1, 1000), stream
        out.mux(packet)


def video_times(path: Path) -> list[Fraction]:
    with av.open(str(path)) as clip:
        return [frame.pts * Fraction(frame.time_base) for frame in clip.decode(video=0)]


def video_planes(path: Path) -> list[tuple[np.ndarray, ...]]:
    with av.open(str(path)) as clip:
        return [tuple(p.copy() for p in plane_arrays(frame)) for frame in clip.decode(video=0)]


def packets(path: Path, kind: str) -> dict[int, list[tuple[Fraction, Fraction, bytes]]]:
    """Time, duration and bytes of every packet, for each stream of a kind."""
    found: dict[int, list[tuple[Fraction, Fraction, bytes]]] = {}
    with av.open(str(path)) as clip:
        order = [stream.index for stream in clip.streams if stream.type == kind]
        for packet in clip.demux([clip.streams[index] for index in order]):
            if packet.dts is not None:
                base = Fraction(packet.time_base)
                entry = (packet.pts * base, (packet.duration or 0) * base, bytes(packet))
                found.setdefault(order.index(packet.stream_index), []).append(entry)
    return found


def run(
    inp: Path, out: Path, work: Callable[[Frame], None] = lambda frame: None,
    options: EncodeOptions = FAST, *, force: bool = False, tags: dict[str, str] | None = None,
    private: bool = False, progress: Callable[[int], None] | None = None, queue: int = 8,
) -> ProcessStats:  # fmt: skip
    with (
        open_input(inp) as source,
        open_sink(out, source, options, force=force, tags=tags or {}, private=private) as sink,
    ):
        return process(source, sink, work, progress=progress, queue=queue)


def paint(frame: Frame) -> None:
    x, y, w, h = frame.align_roi(10, 12, 31, 29)
    frame.write_roi(x, y, 255 - frame.read_roi(x, y, w, h))


# -- what survives -------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
@pytest.mark.parametrize(
    "times", [STEADY, UNEVEN, [t + 7000 for t in UNEVEN]], ids=["steady", "uneven", "late"]
)
def test_time_stamps_survive(tmp_path: Path, times: list[int], suffix: str) -> None:
    clip = make_clip(tmp_path / "in.mp4", times)
    run(clip, tmp_path / f"out{suffix}")
    before, after = video_times(clip), video_times(tmp_path / f"out{suffix}")
    assert [time / CLOCK for time in before] == times
    tolerance = Fraction(1, 2000) if suffix == ".mkv" else 0  # Matroska counts milliseconds
    assert len(after) == len(before)
    assert max(abs(a - b) for a, b in zip(before, after, strict=True)) <= tolerance


def test_time_base_and_frame_durations_survive(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", UNEVEN, options={"bf": "0"})
    run(clip, tmp_path / "out.mp4")
    with av.open(str(clip)) as a, av.open(str(tmp_path / "out.mp4")) as b:
        assert a.streams.video[0].time_base == b.streams.video[0].time_base
        assert a.streams.video[0].duration == b.streams.video[0].duration
    clips = (packets(path, "video")[0] for path in (clip, tmp_path / "out.mp4"))
    before, after = ([(time, length) for time, length, _ in sorted(clip)] for clip in clips)
    assert before == after


def test_matroska_time_stamps_survive_in_mp4(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mkv", [33, 66, 101, 134, 500], clock=Fraction(1, 1000))
    run(clip, tmp_path / "out.mp4")
    assert video_times(tmp_path / "out.mp4") == video_times(clip)
    assert video_times(clip)[0] == Fraction(33, 1000)


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_every_audio_packet_is_copied_byte_for_byte(tmp_path: Path, suffix: str) -> None:
    clip = make_clip(tmp_path / f"in{suffix}", sound=2)
    run(clip, tmp_path / f"out{suffix}")
    before, after = packets(clip, "audio"), packets(tmp_path / f"out{suffix}", "audio")
    assert len(before) == 2
    assert before == after


@pytest.mark.slow
def test_real_audio_with_an_edit_list_is_copied_with_its_times(tmp_path: Path) -> None:
    run(SAMPLE, tmp_path / "out.mp4")
    assert packets(SAMPLE, "audio") == packets(tmp_path / "out.mp4", "audio")
    assert video_times(SAMPLE) == video_times(tmp_path / "out.mp4")


@pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
def test_subtitles_are_kept(tmp_path: Path, suffix: str) -> None:
    clip = make_clip(tmp_path / f"in{suffix}", sound=1, subtitles=True)
    run(clip, tmp_path / f"out{suffix}")
    before, after = packets(clip, "subtitle"), packets(tmp_path / f"out{suffix}", "subtitle")
    assert before == after
    assert any(b"second line" in data for _, _, data in after[0])


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".mov"])
@pytest.mark.parametrize("angle", [90, 180, -90])
def test_rotation_is_kept_and_frames_come_upright(tmp_path: Path, angle: int, suffix: str) -> None:
    clip = make_clip(
        tmp_path / "in.mp4", size=(64, 32), adjust=lambda video: video.set_display_rotation(angle)
    )
    out = tmp_path / f"out{suffix}"
    run(clip, out, paint, LOSSLESS)
    with open_input(clip) as source, open_input(out) as result:
        assert result.rotation == source.rotation == -angle % 360
        assert (source.width, source.height) == ((64, 32) if angle == 180 else (32, 64))
        for before, after in zip(source, result, strict=True):
            np.testing.assert_array_equal(
                before.luma, np.rot90(plane_arrays(before.video_frame)[0], angle // 90)
            )
            paint(before)
            np.testing.assert_array_equal(before.luma, after.luma)


def test_mirrored_video_is_shown_mirrored(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", adjust=lambda video: video.set_display_rotation(0, hflip=True))
    plain = make_clip(tmp_path / "plain.mp4")
    with open_input(clip) as source, open_input(plain) as straight:
        for mirrored, frame in zip(source, straight, strict=True):
            np.testing.assert_array_equal(mirrored.luma, frame.luma[:, ::-1])


def test_colour_tags_and_sample_aspect_ratio_are_kept(tmp_path: Path) -> None:
    def tag(video: av.VideoStream) -> None:
        context = video.codec_context
        context.color_primaries, context.color_trc, context.colorspace, context.color_range = 9, 14, 9, 1
        context.sample_aspect_ratio = Fraction(4, 3)

    clip = make_clip(tmp_path / "in.mp4", adjust=tag)
    for suffix in (".mp4", ".mkv"):
        run(clip, tmp_path / f"out{suffix}")
        with av.open(str(tmp_path / f"out{suffix}")) as result:
            stream = result.streams.video[0]
            frame = next(result.decode(stream))
            assert stream.sample_aspect_ratio == Fraction(4, 3)
            tags = (frame.color_primaries, frame.color_trc, frame.colorspace, frame.color_range)
            assert tags == (9, 14, 9, 1)


@pytest.mark.parametrize("name", ["libx264", "libx265", "ffv1", "libvpx-vp9"])
@pytest.mark.parametrize("fmt", ["yuv420p", "yuvj420p", "yuv422p", "yuv444p", "gray"])
@pytest.mark.slow
def test_lossless_is_bit_identical_outside_the_written_rectangle(tmp_path: Path, fmt: str, name: str) -> None:
    if name == "libvpx-vp9" and fmt == "gray":
        pytest.skip("VP9 has no grey pictures")
    clip = make_clip(tmp_path / "in.mkv", STEADY[:5], fmt=fmt, clock=Fraction(1, 1000))
    out = tmp_path / "out.mkv"
    run(clip, out, paint, EncodeOptions(encoder=name, preset="ultrafast", lossless=True))
    before, after = video_planes(clip), video_planes(out)
    assert len(before) == len(after) == 5
    for old, new in zip(before, after, strict=True):
        for a, b in zip(old, new, strict=True):
            sx, sy = 64 // a.shape[1], 48 // a.shape[0]
            inside = np.zeros(a.shape, bool)
            inside[12 // sy : 30 // sy, 10 // sx : 32 // sx] = True
            np.testing.assert_array_equal(a[~inside], b[~inside])
        assert not np.array_equal(old[0], new[0])


def test_full_range_stays_full_range(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mkv", fmt="yuvj420p", clock=Fraction(1, 1000))
    for name in ("libx264", "ffv1"):
        run(clip, tmp_path / f"{name}.mkv", options=EncodeOptions(encoder=name, preset="ultrafast"))
        with open_input(clip) as source, open_input(tmp_path / f"{name}.mkv") as result:
            a, b = next(iter(source)), next(iter(result))
            np.testing.assert_array_equal(a.colour.to_rgb, b.colour.to_rgb)
            assert np.abs(a.rgb().astype(int) - b.rgb()).mean() < 4


def test_metadata_chapters_languages_and_tags_are_kept(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "plain.mp4", sound=1, title="A title")
    rich = tmp_path / "in.mkv"
    with av.open(str(clip)) as source, av.open(str(rich), "w") as out:
        copies = {s.index: out.add_stream_from_template(s, opaque=True) for s in source.streams}
        copies[1].metadata["language"] = "fin"
        out.metadata.update(source.metadata | {"custom": "kept"})
        second = {
            "id": 1,
            "start": 0,
            "end": 200,
            "time_base": Fraction(1, 1000),
            "metadata": {"title": "One"},
        }
        out.set_chapters([second])
        for packet in source.demux():
            if packet.dts is not None:
                packet.stream = copies[packet.stream_index]
                out.mux(packet)
    for suffix in (".mkv", ".mp4"):
        run(rich, tmp_path / f"out{suffix}", tags={"comment": "synthetic face", "guise_model": "x"})
        with av.open(str(tmp_path / f"out{suffix}")) as result:
            metadata = {key.lower(): value for key, value in result.metadata.items()}
            assert metadata["title"] == "A title"
            assert metadata["comment"] == "synthetic face"
            assert metadata["guise_model"] == "x"
            assert metadata["custom"] == "kept"
            assert [chapter["metadata"]["title"] for chapter in result.chapters()] == ["One"]
            assert result.streams.audio[0].language == "fin"
    run(rich, tmp_path / "private.mp4", tags={"comment": "synthetic face"}, private=True)
    with av.open(str(tmp_path / "private.mp4")) as result:
        assert "title" not in result.metadata
        assert result.metadata["comment"] == "synthetic face"
        assert result.chapters() == []


@pytest.mark.parametrize(
    "name", ["in:side.mp4", "http:x.mp4", "two\nlines and spaces.mp4", "100%d.mp4", "-x.mp4"]
)
def test_any_name_will_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    clip, out = make_clip(tmp_path / "plain.mp4").rename(name), Path(f"out{name}")
    run(clip, out)
    assert video_times(out.absolute()) == video_times(clip.absolute())


# -- pixel formats and sizes ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fmt", "encoder", "native"),
    [
        ("yuv410p", "ffv1", "yuv420p"),
        ("yuv411p", "ffv1", "yuv422p"),
        ("bgr0", "ffv1", "yuv444p"),
        ("gbrp10le", "ffv1", "yuv444p10le"),
    ],
)
def test_other_pixel_formats_are_converted_once_and_reported(
    tmp_path: Path, fmt: str, encoder: str, native: str
) -> None:
    clip = make_clip(tmp_path / "in.mkv", STEADY[:3], fmt=fmt, encoder=encoder, clock=Fraction(1, 1000))
    stats = run(clip, tmp_path / "out.mkv", options=LOSSLESS)
    bits = native.partition("p")[2].removesuffix("le") or "8"
    assert f"Pictures were converted from {fmt} to {bits}-bit {native}." in stats.problems
    with av.open(str(clip)) as a, av.open(str(tmp_path / "out.mkv")) as b:
        for old, new in zip(a.decode(video=0), b.decode(video=0), strict=True):
            assert native == "gray" or new.format.name == native  # H.264 without chroma decodes as yuv420p
            gap = old.to_ndarray(format="rgb24").astype(int) - new.to_ndarray(format="rgb24")
            assert np.abs(gap).mean() < 5
            assert np.abs(gap.mean(axis=(0, 1))).max() < 1.5


def test_odd_sizes_stay_odd_where_the_encoder_can(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mkv", STEADY[:4], size=(37, 23), encoder="ffv1", clock=Fraction(1, 1000))
    run(clip, tmp_path / "out.mkv", options=EncodeOptions(encoder="ffv1"))
    for old, new in zip(video_planes(clip), video_planes(tmp_path / "out.mkv"), strict=True):
        for a, b in zip(old, new, strict=True):
            np.testing.assert_array_equal(a, b)


def test_odd_sizes_grow_by_a_repeated_edge_for_h264(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mkv", STEADY[:4], size=(37, 23), encoder="ffv1", clock=Fraction(1, 1000))
    stats = run(clip, tmp_path / "out.mkv", options=LOSSLESS)
    assert "The picture was extended from 37 x 23 to 38 x 24, as libx264 needs even sizes." in stats.problems
    for old, new in zip(video_planes(clip), video_planes(tmp_path / "out.mkv"), strict=True):
        np.testing.assert_array_equal(np.pad(old[0], ((0, 1), (0, 1)), mode="edge"), new[0])
        np.testing.assert_array_equal(old[1], new[1])


def test_frames_of_another_size_can_be_written(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", UNEVEN, sound=1)
    out = tmp_path / "out.mp4"
    with open_input(clip) as source, open_sink(out, source, FAST, size=(128, 48)) as sink:
        for frame in source:
            wide = np.hstack([frame.rgb(), frame.rgb()])
            sink.write(Frame.from_rgb(wide, frame.pts, frame.time_base, frame.index))
    assert video_times(out) == video_times(clip)
    assert packets(out, "audio") == packets(clip, "audio")
    with open_input(clip) as source, open_input(out) as result:
        for a, b in zip(source, result, strict=True):
            assert np.abs(a.rgb().astype(int) - b.rgb()[:, :64]).mean() < 12


# -- decoding ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_changing_a_frame_does_not_change_later_ones() -> None:
    with open_input(SAMPLE) as clean, open_input(SAMPLE) as painted:
        for before, after in zip(clean, painted, strict=True):
            np.testing.assert_array_equal(before.luma, after.luma)
            after.write_roi(0, 0, np.zeros((after.height, after.width, 3), np.uint8))


def test_a_view_of_a_frame_outlives_it() -> None:
    with open_input(SAMPLE) as source:
        views = [frame.luma for frame, _ in zip(source, range(12), strict=False)]
    with open_input(SAMPLE) as source:
        for view, frame in zip(views, source, strict=False):
            np.testing.assert_array_equal(view, frame.luma)


@pytest.mark.slow
def test_a_source_can_be_read_twice_and_keeps_its_audio_for_the_sink(tmp_path: Path) -> None:
    with open_input(SAMPLE) as source:
        first = [frame.pts for frame in source]
        with open_sink(tmp_path / "out.mp4", source, FAST) as sink:
            process(source, sink, lambda frame: None)
    assert [time / Fraction(1, 15360) for time in video_times(tmp_path / "out.mp4")] == first
    assert packets(tmp_path / "out.mp4", "audio") == packets(SAMPLE, "audio")


def test_describe_gives_the_facts(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", sound=1)
    with open_input(clip) as source:
        assert source.describe() == {
            "name": "in.mp4", "kind": "video", "width": 64, "height": 48, "frame_rate": "30",
            "frame_count": 12, "duration_seconds": 0.4, "rotation": 0, "has_audio": True,
        }  # fmt: skip


def damage(path: Path, number: int, *, seed: int = 0) -> Path:
    """Overwrite the inside of one video packet of a clip with noise."""
    with av.open(str(path)) as clip:
        spots = [(p.pos, p.size) for p in clip.demux(video=0) if p.dts is not None]
    position, size = spots[number]
    data = bytearray(path.read_bytes())
    data[position + 4 : position + size] = np.random.default_rng(seed).bytes(size - 4)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("encoder", ["libx264", "mpeg4", "ffv1"])
def test_a_corrupt_packet_is_passed_over_and_reported(tmp_path: Path, encoder: str) -> None:
    suffix = ".mkv" if encoder == "ffv1" else ".mp4"
    clock = Fraction(1, 30) if encoder == "mpeg4" else CLOCK
    times = range(60) if encoder == "mpeg4" else range(0, 60 * 512, 512)
    clip = make_clip(tmp_path / f"in{suffix}", times, encoder=encoder, clock=clock, sound=1)
    sound = packets(clip, "audio")
    stats = run(damage(clip, 20), tmp_path / f"out{suffix}")
    assert stats.frames >= 58
    assert len(stats.problems) >= 1
    assert any("damaged" in problem and " s" in problem for problem in stats.problems)
    assert len(video_times(tmp_path / f"out{suffix}")) == stats.frames
    copied = packets(tmp_path / f"out{suffix}", "audio")
    assert [(time, data) for time, _, data in copied[0]] == [(time, data) for time, _, data in sound[0]]


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_a_file_cut_short_gives_what_is_there_and_says_so(tmp_path: Path, suffix: str) -> None:
    clip = make_clip(tmp_path / "whole.mp4", range(0, 120 * 512, 512))
    cut = tmp_path / f"in{suffix}"
    with (
        av.open(str(clip)) as source,
        av.open(
            str(cut), "w", container_options={"movflags": "+faststart"} if suffix == ".mp4" else {}
        ) as out,
    ):
        stream = out.add_stream_from_template(source.streams.video[0], opaque=True)
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                out.mux(packet)
    data = cut.read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    stats = run(cut, tmp_path / f"out{suffix}")
    assert 40 < stats.frames < 110
    assert len(stats.problems) >= 1
    assert len(video_times(tmp_path / f"out{suffix}")) == stats.frames
