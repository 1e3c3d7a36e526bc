"""One clock for all streams: joined files, gaps, times below zero, and files without times."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import av
import pytest
from recordings import RATE, SAMPLES, STEP, join, record, steps, times

from guise.app.media import EncodeOptions, open_input, open_sink, process
from guise.app.media.audio_reader import AudioReader
from guise.app.media.clock import FileClock, Retimer, _Joined, _Trace
from guise.app.media.input import VideoInput
from guise.app.media.segments import read_frames, scan

WRAP = Fraction(2**33, 90000)
FAST = EncodeOptions(preset="ultrafast", crf=40)


def copied(source: Path, suffix: str = ".mp4") -> tuple[Path, list[str]]:
    """The file through the media layer, and the notes."""
    target = source.with_name(f"{source.name}.out{suffix}")
    with open_input(source) as media, open_sink(target, media, FAST) as sink:
        process(media, sink, lambda frame: None)
        return target, list(media.problems)


def clock_by(packets: list[SimpleNamespace], unit: Fraction) -> FileClock:
    """The clock by packets of pictures (stream 0) and sound (1)."""
    traces = {index: _Trace(SimpleNamespace(time_base=unit)) for index in (0, 1)}
    for packet in packets:
        traces[packet.stream_index].feed(packet, traces)
    return _Joined(traces, 0, {1: traces[1]}, Fraction(0), closes_gaps=True).clock()


def is_steady(found: list[Fraction]) -> bool:
    return steps(found) == pytest.approx([1 / RATE] * (len(found) - 1), abs=2e-3)


# FFmpeg reads two files of Matroska in one, and a gap there is as long as it says.
_JOINED = [(suffix, (0, 0)) for suffix in (".ts", ".vob", ".mkv", ".webm")] + [
    (suffix, starts)
    for suffix in (".ts", ".vob")
    for starts in [(0, 0, 0), (0, 50), (100, 0), (3600, 30, 7200)]
]


@pytest.mark.parametrize(("suffix", "starts"), _JOINED)
def test_what_was_joined_goes_on_steadily(tmp_path: Path, suffix: str, starts: tuple[int, ...]) -> None:
    parts = [record(tmp_path / f"{i}{suffix}", start) for i, start in enumerate(starts)]
    counts = [times(part) for part in parts]
    source = join(tmp_path / f"joined{suffix}", *parts)
    with open_input(source) as media:
        assert float(media.duration) == pytest.approx(len(parts), abs=0.05)
        assert media.frame_count == sum(len(pictures) for pictures, _ in counts)
    target, notes = copied(source)
    pictures, sound = times(target)
    assert len(pictures) == sum(len(p) for p, _ in counts)
    assert len(sound) == sum(len(s) for _, s in counts)
    assert is_steady(pictures)
    assert ["jumps" in note for note in notes] == [True]
    last, begin = counts[-1]
    apart = [p - s for p, s in [(pictures[-1], sound[-1]), (last[-1], begin[-1])]]
    assert float(apart[0]) == pytest.approx(float(apart[1]), abs=0.02)


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".ts"])
def test_sound_whose_channels_change_keeps_its_pitch(tmp_path: Path, suffix: str) -> None:
    """Packets of AAC in .ts say what they are; elsewhere the file says it once, for all of them."""
    parts = [record(tmp_path / f"{kind}.ts", layout=kind) for kind in ("stereo", "mono")]
    target, notes = copied(join(tmp_path / "joined.ts", *parts), suffix)
    assert ["change of its rate or channels" in note for note in notes] == [False] + [True] * (
        suffix != ".ts"
    )
    with av.open(str(target)) as media:
        found = [(f.layout.name, f.samples) for f in media.decode(audio=0)]
    assert {layout for layout, _ in found} == {"stereo"} | ({"mono"} if suffix == ".ts" else set())
    assert sum(samples for _, samples in found) / SAMPLES == pytest.approx(2, abs=0.1)


def test_streams_that_begin_too_late_to_be_known_are_named(tmp_path: Path) -> None:
    other = record(tmp_path / "b.ts", options={"mpegts_start_pid": "600"})
    source = join(tmp_path / "joined.ts", record(tmp_path / "a.ts"), other)
    target, notes = copied(source)
    assert len(times(target)[0]) == 24
    assert [note.split(" (")[0] for note in notes] == ["Video stream 2", "Audio stream 3"]


@pytest.mark.parametrize("suffix", [".ts", ".flv", ".mkv", ".mp4"])
@pytest.mark.parametrize("seconds", [12, 400])
def test_a_gap_in_all_streams_is_closed_where_clocks_may_jump(
    tmp_path: Path, suffix: str, seconds: int
) -> None:
    def late(time: Fraction) -> Fraction:
        return time + seconds * (time >= Fraction(1, 2))

    source = record(tmp_path / f"gap{suffix}", pictures=late, sound=late)
    target, notes = copied(source)
    pictures, sound = times(target)
    assert (len(pictures), len(sound)) == tuple(map(len, times(source)))
    closed = suffix in (".ts", ".flv")
    assert is_steady(pictures) == closed
    assert ["jumps" in note for note in notes] == [True] * closed
    assert max(steps(sound)) == pytest.approx(0.021 if closed else seconds, abs=0.03)


def test_pictures_that_are_missing_while_the_sound_goes_on_stay_away(tmp_path: Path) -> None:
    source = record(tmp_path / "still.ts", frames=24, pictures=lambda t: t + 20 * (t > Fraction(1, 2)))
    with open_input(source) as media:
        assert max(steps([f.pts * f.time_base for f in media])) == pytest.approx(20 + float(STEP), abs=1e-3)
        assert not media.problems


@pytest.mark.parametrize("before", [Fraction(1, 2), Fraction(10), Fraction(100)])
def test_a_clock_that_wraps_hides_no_picture(tmp_path: Path, before: Fraction) -> None:
    source = record(tmp_path / "wrap.ts", WRAP - before, frames=48)
    target, notes = copied(source)
    pictures, sound = times(target)
    assert len(pictures) == 48
    assert is_steady(pictures)
    assert len(sound) == len(times(source)[1])
    assert min(pictures[0], sound[0]) >= 0
    assert not notes


@pytest.mark.parametrize(
    ("suffix", "options"),
    [(".mp4", {"movflags": "frag_keyframe+empty_moov+delay_moov"}),
     (".ts", {"avoid_negative_ts": "disabled", "mpegts_copyts": "1"})],
)  # fmt: skip
def test_times_below_zero_hide_no_picture_and_say_nothing_false(
    tmp_path: Path, suffix: str, options: dict[str, str]
) -> None:
    source = record(tmp_path / f"early{suffix}", -1, frames=48, options=options)
    before = times(source)
    assert before[0][0] < 0
    target, notes = copied(source)
    after = times(target)
    assert len(after[0]) == 48
    assert min(after[0]) >= 0
    assert float(after[1][-1] - after[0][0]) == pytest.approx(float(before[1][-1] - before[0][0]), abs=1e-3)
    assert not notes


@pytest.mark.parametrize("rate", [24, 30, 50, Fraction(30000, 1001)])
@pytest.mark.parametrize("codec", ["h264", "hevc"])
def test_a_raw_stream_has_the_rate_of_its_codec(tmp_path: Path, codec: str, rate: Fraction | int) -> None:
    source = tmp_path / f"raw.{codec}"
    with av.open(str(source), "w", format=codec) as out:
        stream = out.add_stream("libx264" if codec == "h264" else "libx265", rate, {"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(10):
            out.mux(stream.encode(av.VideoFrame(64, 48, "yuv420p")))
        out.mux(stream.encode(None))
    with open_input(source) as media:
        assert media.frame_rate == rate
        found = [frame.pts * frame.time_base for frame in media]
    assert steps(found) == pytest.approx([float(1 / Fraction(rate))] * 9, abs=1e-5)


@pytest.mark.parametrize("suffix", [".mkv", ".mp4", ".mov", ".flv", ".ts"])
@pytest.mark.parametrize("start", [5, 100])
def test_a_late_start_counts_once(tmp_path: Path, suffix: str, start: int) -> None:
    source = record(tmp_path / f"late{suffix}", start)
    with open_input(source) as media:
        assert float(media.duration) == pytest.approx(1, abs=0.1)
        assert [float(f.pts * f.time_base) for f in media] == pytest.approx(
            [start + i / RATE for i in range(24)], abs=0.05
        )
        assert not media.problems


@pytest.mark.parametrize(
    ("suffix", "codecs"),
    [(".avi", ("libx264", "mp2")), (".wmv", ("libx264", "wmav2")), (".mxf", ("mpeg2video", "pcm_s16le")),
     (".mxf", ("libx264", "pcm_s16le"))],
)  # fmt: skip
def test_pictures_whose_times_of_decoding_alone_are_stored_come_evenly(
    tmp_path: Path, suffix: str, codecs: tuple[str, str]
) -> None:
    source = record(tmp_path / f"b{suffix}", codecs=codecs)
    with open_input(source) as media:
        found = [frame.pts * frame.time_base for frame in media]
        assert not media.problems
    assert len(found) == 24
    assert is_steady(found)
    assert found[0] >= 0
    assert [f.pts * f.time_base for f in read_frames(source, scan(source, 10), 5, 9)] == found[5:9]


@pytest.mark.parametrize("off", [Fraction(3600), Fraction(12), Fraction(-1), Fraction(-9)])
@pytest.mark.parametrize("wrong", [1, 5])
def test_a_few_wrong_times_move_nothing_else(off: Fraction, wrong: int) -> None:
    unit = Fraction(1, 90000)
    rows = [(index, number * 3750) for number in range(72) for index in (0, 1)]
    rows = [
        (index, time + round(off / unit) * (index == 0 and 30 <= n // 2 < 30 + wrong))
        for n, (index, time) in enumerate(rows)
    ]
    packets = [
        SimpleNamespace(stream_index=index, pts=time, dts=time, time_base=unit) for index, time in rows
    ]
    clock = clock_by(packets, unit)
    retime = Retimer(clock)
    for packet in packets:
        retime(packet)
    for index in (0, 1):
        assert [p.pts for p in packets if p.stream_index == index] == [n * 3750 for n in range(72)]


@pytest.mark.parametrize("first", [0, 500])
@pytest.mark.parametrize("second", [0, 500])
@pytest.mark.parametrize("silent", [0, 1, None])
def test_a_sound_that_ends_or_begins_at_the_jump_goes_with_the_pictures(
    first: int, second: int, silent: int | None
) -> None:
    unit, step = Fraction(1, 90000), 3750
    rows = [
        (index, start * 90000 + number * step)
        for part, start in enumerate((first, second)) for number in range(48) for index in (0, 1)
        if (index, part) != (1, silent)
    ]  # fmt: skip
    packets = [
        SimpleNamespace(stream_index=index, pts=time, dts=time, time_base=unit) for index, time in rows
    ]
    retime = Retimer(clock_by(packets, unit))
    for packet in packets:
        retime(packet)
    pictures = [packet.pts for packet in packets if packet.stream_index == 0]
    assert pictures == [first * 90000 + number * step for number in range(96)]
    sound = [packet.pts for packet in packets if packet.stream_index == 1]
    assert sound == pictures[48 * (silent == 0) : 48 * (1 + (silent != 1))]


def test_a_joined_file_is_read_from_its_start_by_all_who_seek(tmp_path: Path) -> None:
    part = record(tmp_path / "part.ts")
    source = join(tmp_path / "joined.ts", part, part, part)
    with open_input(source) as media:
        expected = [frame.pts for frame in media]
    found = scan(source, 10)
    assert found.pts.tolist() == expected
    assert [frame.pts for frame in read_frames(source, found, 30, 40)] == expected[30:40]


@pytest.mark.parametrize("kind", ["wrap", "joined", "plain"])
def test_sound_is_played_on_the_same_clock(tmp_path: Path, kind: str) -> None:
    part = record(tmp_path / "part.ts", WRAP - 1 if kind == "wrap" else 0, frames=48)
    source = join(tmp_path / "source.ts", *[part] * (2 if kind == "joined" else 1))
    with VideoInput(source) as media, AudioReader(media) as reader:
        heard = [time for time, _ in iter(reader.read, None)]
        shown = [float(frame.pts * frame.time_base) for frame in media]
        assert heard[0] == pytest.approx(shown[0], abs=0.05)
        assert heard[-1] == pytest.approx(shown[-1], abs=0.05)
        middle = shown[len(shown) * 3 // 4]
        reader.seek(middle)
        time = next(time for time, _ in iter(reader.read, None))
        assert middle - 1.5 < time < middle + 0.1
        reader.seek(0)
        assert next(time for time, _ in iter(reader.read, None)) == heard[0]


@pytest.mark.parametrize("pictures", [2, 3, 5])
def test_recordings_with_sound_that_overlap_a_little_are_joined(tmp_path: Path, pictures: int) -> None:
    """As one is that a recorder has split: the second part repeats the times of a few pictures."""
    first = record(tmp_path / "1.ts", 5, 36)
    second = record(tmp_path / "2.ts", 5 + (36 - pictures) * STEP, 36)
    with open_input(join(tmp_path / "joined.ts", first, second)) as media:
        found = [frame.pts * frame.time_base for frame in media]
        assert not media.problems
    assert len(found) == 72
    assert is_steady(found)
