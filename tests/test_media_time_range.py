"""A part of a video: the frames and sounds of a whole pass that lie in it, whatever the container and its clock."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from recordings import STEP, join, record, times

from guise.app.media import MediaError, open_input, open_sink, process
from guise.app.media.segments import read_frames, scan
from guise.app.media.time_range import TimeRange, time_of, within

SECONDS = st.fractions(0, 6, max_denominator=12)
KINDS = (
    "a.mp4", "a.mov", "a.mkv", "a.webm", "a.ts", "a.avi", "a.mpg", "a.wmv", "late.mkv", "early.ts", "joined.ts",
    "a.h264",
)  # fmt: skip


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Five seconds each, several groups of pictures, with B pictures and sound."""
    folder = tmp_path_factory.mktemp("recordings")
    made = {}
    for name in KINDS:
        path = folder / name
        if name.startswith("joined"):
            join(path, record(folder / "1.ts", 5, 60), record(folder / "2.ts", 1, 60))
        elif name == "a.h264":
            record(path, frames=120, sound=None)
        else:
            start = {"late": 5, "early": Fraction(-1, 2)}.get(path.stem, 0)
            record(path, start, 120)
        made[name] = path
    return made


def shown(path: Path, part: TimeRange | None = None) -> list[tuple[Fraction, np.ndarray]]:
    with open_input(path, part=part) as media:
        return [(frame.pts * frame.time_base, frame.luma.copy()) for frame in media]


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(start=SECONDS, length=st.none() | st.fractions(Fraction(1, 12), 2, max_denominator=12))
def test_a_part_holds_the_frames_of_the_whole(
    recordings: dict[str, Path], name: str, start: Fraction, length: Fraction | None
) -> None:
    path, part = recordings[name], TimeRange(start, None if length is None else start + length)
    whole = shown(path)
    first = whole[0][0]
    wanted = [(time, luma) for time, luma in whole if part.holds(time - first)]
    if not wanted:
        with pytest.raises(MediaError, match=r"lies after the last picture|shows no picture"):
            shown(path, part)
        return
    found = shown(path, part)
    assert len(found) == len(wanted)
    for (time, luma), (before, original) in zip(found, wanted, strict=True):
        assert abs(time - (before - wanted[0][0])) <= Fraction(1, 500)
        np.testing.assert_array_equal(luma, original)


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.ts", "late.mkv", "early.ts", "joined.ts", "a.wmv"])
@pytest.mark.parametrize("begins", [1, 3])
def test_sound_is_cut_with_the_pictures_and_stays_in_step(
    recordings: dict[str, Path], tmp_path: Path, name: str, begins: int
) -> None:
    output, part = tmp_path / "out.mkv", TimeRange(Fraction(begins), Fraction(begins + 1))
    with open_input(recordings[name]) as media, open_sink(tmp_path / "whole.mkv", media) as sink:
        process(media, sink, lambda frame: None)
    with open_input(recordings[name], part=part) as media, open_sink(output, media) as sink:
        process(media, sink, lambda frame: None)
    pictures, sounds = times(output)
    before, heard = times(tmp_path / "whole.mkv")
    begin = min(time for time in before if part.holds(time - before[0]))
    wanted = [time - begin for time in heard if begin <= time < before[0] + begins + 1]
    assert len(pictures) == 24
    assert pictures[0] == 0
    late = Fraction(1, 8) if name == "a.wmv" else Fraction(1, 50)  # WMA has up to ten frames in a packet
    assert abs(len(sounds) - len(wanted)) <= 1 + late * 48
    assert abs(sounds[0] - wanted[0]) <= late
    assert abs(sounds[-1] - wanted[-1]) <= late


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "late.mkv", "joined.ts"])
def test_segments_of_a_part_show_what_a_pass_shows(recordings: dict[str, Path], name: str) -> None:
    path, part = recordings[name], TimeRange(Fraction(1, 2), Fraction(5, 2))
    whole = shown(path, part)
    found = scan(path, 12, part)
    assert found.pts.tolist() == [time / found.time_base for time, _ in whole]
    cut = [
        frame.luma.copy()
        for segment in found.segments
        for frame in read_frames(path, found, segment.first, segment.end, part=part)
    ]
    assert all((a == luma).all() for a, (_, luma) in zip(cut, whole, strict=True))


def test_a_part_of_images_and_of_an_animation(tmp_path: Path) -> None:
    pictures = [Image.new("L", (16, 16), 40 * k) for k in range(6)]
    (tmp_path / "frames").mkdir()
    for k, picture in enumerate(pictures):
        picture.save(tmp_path / "frames" / f"{k}.png")
    pictures[0].save(tmp_path / "a.png", save_all=True, append_images=pictures[1:], duration=100)
    tenths = TimeRange(Fraction(2, 10), Fraction(5, 10))
    assert [int(luma[0, 0]) for _, luma in shown(tmp_path / "a.png", tenths)] == [80, 120, 160]
    assert [time for time, _ in shown(tmp_path / "a.png", tenths)] == [0, Fraction(1, 10), Fraction(2, 10)]
    images = TimeRange(Fraction(2, 30), Fraction(4, 30))
    assert [int(luma[0, 0]) for _, luma in shown(tmp_path / "frames", images)] == [80, 120]
    for path in (tmp_path / "a.png", tmp_path / "frames"):
        with pytest.raises(MediaError, match="from 9 s"):
            shown(path, TimeRange(Fraction(9)))


def test_chapters_are_cut_too(recordings: dict[str, Path], tmp_path: Path) -> None:
    def chapter(number: int) -> dict[str, object]:
        return {
            "id": number, "start": number * 1000, "end": number * 1000 + 1000, "time_base": Fraction(1, 1000),
            "metadata": {"title": str(number)},
        }  # fmt: skip

    source = tmp_path / "chapters.mkv"
    with open_input(recordings["a.mkv"]) as media, open_sink(source, media) as sink:
        sink._output.set_chapters([chapter(k) for k in range(3)])  # type: ignore[attr-defined,list-item]
        process(media, sink, lambda frame: None)
    with open_input(source, part=TimeRange(Fraction(3, 2), Fraction(9, 4))) as media:
        found = [
            (c["metadata"]["title"], c["start"] * c["time_base"], c["end"] * c["time_base"])
            for c in media.chapters()
        ]  # type: ignore[attr-defined]
    assert [title for title, _, _ in found] == ["1", "2"]
    assert found[0][1] == 0
    assert abs(found[0][2] - Fraction(1, 2)) < STEP
    assert abs(found[1][2] - Fraction(3, 4)) < STEP


@given(st.integers(0, 99), st.integers(0, 59), st.fractions(0, Fraction(599, 10), max_denominator=1000))
def test_times_are_read_as_people_write_them(hours: int, minutes: int, seconds: Fraction) -> None:
    seconds = Fraction(round(seconds * 1000), 1000)
    text = f"{float(seconds):.3f}"
    assert time_of(text) == seconds
    assert time_of(f"{minutes}:{text}") == 60 * minutes + seconds
    assert time_of(f"{hours}:{minutes}:{text}") == 3600 * hours + 60 * minutes + seconds


@pytest.mark.parametrize("text", ["", "x", "1:xx", "-1", "1:2:3:4", "1,5", "1e3", "inf"])
def test_what_is_no_time_is_a_sentence(text: str) -> None:
    with pytest.raises(MediaError, match="is not a time: give seconds"):
        time_of(text)


def test_a_part_that_ends_before_it_begins_is_a_sentence() -> None:
    with pytest.raises(MediaError, match="--to 1 must be later than --from 2"):
        TimeRange.between("2", "1")
    assert TimeRange.between(None, None) is None


def test_within_counts_from_the_first_frame(recordings: dict[str, Path]) -> None:
    is_within = within(TimeRange(Fraction(1), Fraction(2)))
    with open_input(recordings["late.mkv"]) as media:
        found = [is_within(frame) for frame in media]
    assert found == [False] * 24 + [True] * 24 + [False] * 72
