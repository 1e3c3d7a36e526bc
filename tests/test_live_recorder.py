"""Recordings: nothing of a file is lost, times are true, and what goes wrong ends the recording, not the show."""

from __future__ import annotations

import contextlib
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import av
import cv2
import numpy as np
import pytest
from clips import cut, pictures, tags

from guise.app.live.capture import FileCapture
from guise.app.live.face import FaceResult
from guise.app.live.output import Output, OutputFrame
from guise.app.live.pipeline import Pipeline
from guise.app.live.recorder import TIME_BASE, Recordings, VideoRecorder, numbered, snapshot
from guise.app.live.stats import PipelineStats
from guise.app.media import EncodeOptions, Frame, MediaError, open_input, open_sink, process
from guise.app.media.audio_tracks import audio_tracks
from guise.app.media.synthetic import synthetic_tags
from guise.common.errors import OutputError

LOSSLESS = EncodeOptions(preset="ultrafast", lossless=True)
FAST = EncodeOptions(preset="ultrafast", crf=30)
needs_limit = pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")


class Plain:
    """Work that leaves pictures as they are."""

    def __init__(self, each: Callable[[Frame], None] = lambda frame: None) -> None:
        self._each = each

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        self._each(frame)
        return OutputFrame(frame, FaceResult("swapped"), stats, arrived)

    def close(self) -> None:
        pass


def play(
    capture: FileCapture, *outputs: Output, each: Callable[[Frame], None] = lambda frame: None
) -> PipelineStats:
    with capture:
        return Pipeline(capture, lambda: Plain(each), outputs).run()


def shown(level: int, arrived: float, size: tuple[int, int] = (64, 48)) -> OutputFrame:
    rgb = np.full((size[1], size[0], 3), level, np.uint8)
    return OutputFrame(Frame.from_rgb(rgb), FaceResult("swapped"), PipelineStats(), arrived)


def noisy(arrived: float) -> OutputFrame:
    """A picture that takes many bytes."""
    rgb = np.random.default_rng(round(1000 * arrived)).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    return OutputFrame(Frame.from_rgb(rgb), FaceResult("swapped"), PipelineStats(), arrived)


def times(path: Path) -> list[Fraction]:
    """When each picture of a video is shown, seconds."""
    with av.open(str(path)) as container:
        return [frame.pts * Fraction(frame.time_base) for frame in container.decode(video=0)]


def made(path: Path, at: list[int], sound: bool = True) -> Path:
    """A video whose pictures have these times, milliseconds."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 30, {"preset": "ultrafast"})
        stream.width, stream.height = 64, 48
        stream.codec_context.time_base = Fraction(1, 1000)
        voice = out.add_stream("aac", 48000) if sound else None
        for number, pts in enumerate(at):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 5 * number, np.uint8), "rgb24")
            frame.pts, frame.time_base = pts, Fraction(1, 1000)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
        for number in range(20 if voice else 0):
            noise = np.random.default_rng(number).normal(0, 0.1, (2, 1024)).astype(np.float32)
            block = av.AudioFrame.from_ndarray(noise, "fltp", "stereo")
            block.sample_rate, block.pts = 48000, 1024 * number
            out.mux(voice.encode(block))
        if voice:
            out.mux(voice.encode(None))
    return path


# -- a file -------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_thread_left")
@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
@pytest.mark.slow
def test_a_file_is_recorded_whole_with_its_times_and_sound(tmp_path: Path, suffix: str) -> None:
    clip, out = cut("p01", tmp_path / "in.mp4", 25), tmp_path / f"out{suffix}"
    capture = FileCapture(clip, paced=False)
    recorder = VideoRecorder(out, media=capture.media, encode=LOSSLESS)
    stats = play(capture, recorder)
    assert (stats.frames, stats.presented, stats.skipped) == (25, 25, 0)
    assert all((a == b).all() for a, b in zip(pictures(out), pictures(clip), strict=True))
    assert times(out) == times(rewritten(clip, tmp_path / f"as_file{suffix}"))
    assert [s.digest for s in audio_tracks(out)] == [s.digest for s in audio_tracks(clip)] != []
    assert synthetic_tags().items() <= {key.lower(): value for key, value in tags(out).items()}.items()
    assert not list(tmp_path.glob("*.part"))


def rewritten(clip: Path, path: Path) -> Path:
    """The clip as commands for files write it, whose times have tests of their own."""
    with open_input(clip) as source, open_sink(path, source, FAST) as sink:
        process(source, sink, lambda frame: None)
    return path


@pytest.mark.parametrize("lagging", ["work", "recorder"])
def test_no_picture_of_a_file_is_lost_however_slow_a_part_is(tmp_path: Path, lagging: str) -> None:
    at = [0, 40, 50, 130, 140, 240, 250, 300]
    capture = FileCapture(made(tmp_path / "in.mkv", at), paced=False)
    recorder = VideoRecorder(tmp_path / "out.mkv", media=capture.media, encode=FAST)
    if lagging == "recorder":
        show = recorder.show
        recorder.show = lambda shown: (time.sleep(0.02), show(shown))[1]  # type: ignore[method-assign]
    play(capture, recorder, each=lambda frame: time.sleep(0.02 if lagging == "work" else 0))
    assert [1000 * t for t in times(tmp_path / "out.mkv")] == at


def test_a_file_that_does_not_begin_at_zero_keeps_step_with_its_sound(tmp_path: Path) -> None:
    at = [500, 540, 600, 640]
    capture = FileCapture(made(tmp_path / "in.mkv", at), paced=False)
    play(capture, VideoRecorder(tmp_path / "out.mkv", media=capture.media, encode=FAST))
    assert [1000 * t for t in times(tmp_path / "out.mkv")] == at
    assert [s.digest for s in audio_tracks(tmp_path / "out.mkv")] == [
        s.digest for s in audio_tracks(tmp_path / "in.mkv")
    ]


def test_a_recording_that_ends_before_its_file_has_the_sound_of_its_pictures(tmp_path: Path) -> None:
    clip, out = cut("p01", tmp_path / "in.mkv", 60), tmp_path / "out.mkv"
    with open_input(clip) as source:
        recorder = VideoRecorder(out, media=source, encode=FAST)
        recorder.open(source.width, source.height, 30)
        for frame in source:
            if frame.index == 30:
                recorder.close()
            recorder.show(OutputFrame(frame, FaceResult("swapped"), PipelineStats(), 0.0))
    assert len(times(out)) == 30
    assert audio_tracks(out)[0].seconds == pytest.approx(
        1.0, abs=0.25
    )  # packets lie in the file ahead of pictures


@pytest.mark.parametrize("shown_of_it", [5, 8])
def test_a_file_that_must_be_whole_is_kept_only_when_it_is(tmp_path: Path, shown_of_it: int) -> None:
    with open_input(made(tmp_path / "in.mkv", [0, 40, 50, 130, 140, 240, 250, 300])) as source:
        recorder = VideoRecorder(tmp_path / "out.mkv", media=source, encode=FAST, whole=True)
        recorder.open(64, 48, 25)
        for frame in source:
            if frame.index < shown_of_it:
                recorder.show(OutputFrame(frame, FaceResult("swapped"), PipelineStats(), 0.0))
        recorder.close()
    kept = {file.name for file in tmp_path.iterdir()} - {"in.mkv"}
    assert kept == ({"out.mkv"} if shown_of_it == 8 else set())


def test_a_file_that_was_read_before_is_recorded_with_its_sound(tmp_path: Path) -> None:
    at = [500, 540, 600, 640]
    capture = FileCapture(made(tmp_path / "in.mkv", at), paced=False)
    recorder = VideoRecorder(tmp_path / "out.mkv", media=capture.media, encode=FAST)
    next(iter(capture.media))  # as to see who is in it
    play(capture, recorder)
    assert [1000 * t for t in times(tmp_path / "out.mkv")] == at
    assert [s.digest for s in audio_tracks(tmp_path / "out.mkv")] == [
        s.digest for s in audio_tracks(tmp_path / "in.mkv")
    ]


# -- a camera -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_times_are_those_of_arrival(tmp_path: Path, suffix: str) -> None:
    arrived = 1000 + np.cumsum(np.random.default_rng(1).uniform(0.005, 0.2, 30))
    recorder = VideoRecorder(tmp_path / f"out{suffix}", encode=FAST)
    recorder.open(64, 48, 30)
    for number, at in enumerate(arrived):
        recorder.show(shown(8 * number, float(at)))
    recorder.close()
    kept = np.array([float(t) for t in times(tmp_path / f"out{suffix}")])
    unit = 0.001 if suffix == ".mkv" else float(TIME_BASE)
    np.testing.assert_allclose(kept, arrived - arrived[0], atol=unit)
    levels = [int(picture[24, 32]) for picture in pictures(tmp_path / f"out{suffix}")]
    assert levels == sorted(set(levels))


def test_a_picture_that_comes_with_the_last_one_is_left_out(tmp_path: Path) -> None:
    recorder = VideoRecorder(tmp_path / "out.mp4", encode=FAST)
    recorder.open(64, 48, 30)
    for at in (1.0, 1.0, 1.1, 1.05, 1.2):
        recorder.show(shown(90, at))
    recorder.close()
    assert [round(float(t), 3) for t in times(tmp_path / "out.mp4")] == [0, 0.1, 0.2]


def test_a_picture_of_another_size_is_recorded_whole(tmp_path: Path) -> None:
    recorder = VideoRecorder(tmp_path / "out.mp4", encode=LOSSLESS)
    recorder.open(64, 48, 30)
    recorder.show(shown(200, 1.0))
    recorder.show(shown(200, 1.1, (128, 48)))
    recorder.close()
    first, second = pictures(tmp_path / "out.mp4")
    assert first.min() == first.max() == second[24, 32]
    assert ((second > 100).sum(axis=0) == 24).all()


def test_colours_are_kept(tmp_path: Path) -> None:
    rgb = np.zeros((48, 64, 3), np.uint8)
    rgb[:24, :32], rgb[:24, 32:], rgb[24:, :32], rgb[24:, 32:] = (
        (200, 40, 40),
        (40, 200, 40),
        (40, 40, 200),
        120,
    )
    recorder = VideoRecorder(tmp_path / "out.mp4", encode=LOSSLESS)
    recorder.open(64, 48, 30)
    recorder.show(OutputFrame(Frame.from_rgb(rgb), FaceResult("swapped"), PipelineStats(), 0.0))
    recorder.close()
    with open_input(tmp_path / "out.mp4") as source:
        kept = next(iter(source)).rgb()
    assert np.abs(kept[12::24, 16::32].astype(int) - rgb[12::24, 16::32]).max() <= 3


@pytest.mark.parametrize("end", ["close", "abort"])
def test_nothing_is_left_where_nothing_is_to_be_kept(tmp_path: Path, end: str) -> None:
    recorder = VideoRecorder(tmp_path / "out.mp4", encode=FAST)
    recorder.open(64, 48, 30)
    if end == "abort":
        recorder.show(shown(0, 0.0))
        recorder.abort()
    recorder.close()
    assert list(tmp_path.iterdir()) == []


# -- what goes wrong ----------------------------------------------------------------------------------------


@contextlib.contextmanager
def full_disk() -> Iterator[None]:
    """A limit on the size of files, at which writing fails as on a full disk."""
    import resource

    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, old[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)


@needs_limit
@pytest.mark.usefixtures("no_thread_left")
def test_a_full_disk_ends_the_recording_with_one_sentence_and_not_the_show(tmp_path: Path) -> None:
    said: list[str] = []
    seen = Counting()
    clip = cut("p01", tmp_path / "in.mp4", 20)
    capture = FileCapture(clip, paced=False)
    recorder = VideoRecorder(tmp_path / "out.mp4", media=capture.media, encode=LOSSLESS, say=said.append)
    with full_disk():
        stats = play(capture, seen, recorder)
    assert len(said) == 1
    assert "File too large" in said[0]
    assert stats.frames == seen.count == 20
    assert list(tmp_path.iterdir()) == [clip]


@needs_limit
@pytest.mark.usefixtures("no_thread_left")
def test_a_full_disk_is_an_error_where_there_is_nothing_but_the_file(tmp_path: Path) -> None:
    capture = FileCapture(cut("p01", tmp_path / "in.mp4", 20), paced=False)
    recorder = VideoRecorder(tmp_path / "out.mp4", media=capture.media, encode=LOSSLESS)
    with full_disk(), pytest.raises(MediaError, match="File too large"):
        play(capture, recorder)
    assert [file.name for file in tmp_path.iterdir()] == ["in.mp4"]


class Counting(Output):
    """Counts what is shown."""

    lossless = True
    count = 0

    def show(self, shown: OutputFrame) -> None:
        self.count += 1


def test_a_recording_is_completed_before_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    free = [10**9, 10**9, 10**7, 10**7, 10**7]
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=free.pop(0)))
    recorder = VideoRecorder(tmp_path / "out.mp4", encode=FAST, say=said.append)
    recorder.open(64, 48, 30)
    for number in range(50):
        recorder.show(shown(number, 100 + number / 10))
    recorder.close()
    assert said == ["The disk is nearly full: out.mp4 ends here, and what was recorded is kept."]
    assert len(times(tmp_path / "out.mp4")) == 21


def test_outputs_that_cannot_be_are_refused_before_anything_is_done(tmp_path: Path) -> None:
    clip = made(tmp_path / "in.mkv", [0, 40])
    (tmp_path / "old.mp4").write_bytes(b"precious")
    with open_input(clip) as source:
        for path, sentence in [
            (clip, "in.mkv is the input itself"),
            (tmp_path / "old.mp4", "old.mp4 exists: use --force"),
            (tmp_path, "is a folder"),
            (tmp_path / "none" / "out.mp4", "there is no folder"),
        ]:
            with pytest.raises(OutputError, match=sentence):
                VideoRecorder(path, media=source)
    for name, sentence in [("out.avi", "use .mp4, .mov or .mkv"), ("out", "does not name a video container")]:
        recorder = VideoRecorder(tmp_path / name)
        with pytest.raises(MediaError, match=sentence):
            recorder.open(64, 48, 30)
        recorder.close()
    assert (tmp_path / "old.mp4").read_bytes() == b"precious"
    assert len(list(tmp_path.iterdir())) == 2


def test_force_replaces_only_when_the_recording_is_complete(tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    out.write_bytes(b"old")
    recorder = VideoRecorder(out, encode=FAST, force=True)
    recorder.open(64, 48, 30)
    recorder.show(shown(0, 0.0))
    assert out.read_bytes() == b"old"
    recorder.close()
    assert len(times(out)) == 1


# -- by a key -----------------------------------------------------------------------------------------------


def test_each_recording_has_a_file_of_its_own(tmp_path: Path) -> None:
    said: list[str] = []
    (tmp_path / "guise-002.mp4").write_bytes(b"of yesterday")
    recordings = Recordings(tmp_path, FAST, said.append)
    recordings.open(64, 48, 30)
    for number in range(12):
        if number in (2, 5, 7):
            recordings.toggle()
        recordings.show(shown(number, number / 10))
    recordings.close()
    assert len(times(tmp_path / "guise-001.mp4")) == 3
    assert len(times(tmp_path / "guise-003.mp4")) == 5
    assert (tmp_path / "guise-002.mp4").read_bytes() == b"of yesterday"
    assert [sentence.split()[0] for sentence in said] == ["Recording", "Recorded"] * 2
    assert len(list(tmp_path.iterdir())) == 3


def test_a_folder_that_is_not_there_is_said_and_another_try_may_succeed(tmp_path: Path) -> None:
    said: list[str] = []
    recordings = Recordings(tmp_path / "films", FAST, said.append)
    recordings.open(64, 48, 30)
    recordings.toggle()
    recordings.show(shown(0, 0.0))
    assert not recordings.recording
    assert "there is no folder" in said[0]
    (tmp_path / "films").mkdir()
    recordings.toggle()
    recordings.show(shown(0, 0.1))
    recordings.close()
    assert len(times(tmp_path / "films" / "guise-001.mp4")) == 1


@needs_limit
def test_a_full_disk_ends_a_recording_by_key_too(tmp_path: Path) -> None:
    said: list[str] = []
    recordings = Recordings(tmp_path, LOSSLESS, said.append)
    recordings.open(320, 240, 30)
    recordings.toggle()
    with full_disk():
        for number in range(20):
            recordings.show(noisy(number / 30))
        recordings.close()
    assert len(said) == 2
    assert "File too large" in said[1]
    assert not recordings.recording
    assert list(tmp_path.iterdir()) == []


def test_a_snapshot_holds_the_picture_and_says_that_it_is_synthetic(tmp_path: Path) -> None:
    rgb = np.random.default_rng(3).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    paths = [snapshot(Frame.from_rgb(rgb), tmp_path) for _ in range(2)]
    assert [path.name for path in paths] == ["guise-001.png", "guise-002.png"]
    assert (cv2.imread(str(paths[1]), cv2.IMREAD_COLOR_RGB) == rgb).all()
    assert synthetic_tags()["comment"].encode() in paths[0].read_bytes()
    with pytest.raises(OutputError, match="there is no folder"):
        snapshot(Frame.from_rgb(rgb), tmp_path / "none")


def test_a_name_that_is_being_written_is_taken(tmp_path: Path) -> None:
    (tmp_path / "guise-001.mp4.part").write_bytes(b"")
    assert numbered(tmp_path, ".mp4").name == "guise-002.mp4"
