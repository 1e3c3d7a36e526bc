"""The pipeline: order, bounds, errors and memory."""

from __future__ import annotations

import os
import resource
import threading
import time
import weakref
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from clips import cut

from guise.app.media import EncodeOptions, Frame, open_input, open_sink, process
from guise.app.media.input import MediaInput
from guise.app.media.sink import Sink

SHARED = Path(__file__).parents[2] / "shared"
SAMPLE = Path(__file__).parents[1] / "sample_videos" / "p01" / "talk2.mp4"


class Numbers(MediaInput):
    """Frames 0 .. count - 1; keeps track of how many are alive."""

    def __init__(self, count: int, fail_at: int | None = None) -> None:
        super().__init__(Path("numbers"))
        self.count, self.fail_at = count, fail_at
        self.alive: weakref.WeakSet[Frame] = weakref.WeakSet()
        self.most = 0

    def __iter__(self) -> Iterator[Frame]:
        for index in range(self.count):
            if index == self.fail_at:
                raise OSError("the drive is gone")
            frame = Frame.from_rgb(np.zeros((4, 4, 3), np.uint8), index, Fraction(1, 30), index)
            self.alive.add(frame)
            self.most = max(self.most, len(self.alive))
            yield frame
            del frame


class Memory(Sink):
    """Notes the indices written."""

    def __init__(self, delay: float = 0.0, fail_at: int | None = None) -> None:
        super().__init__(Path("memory"), force=False)
        self.indices: list[int] = []
        self.delay, self.fail_at = delay, fail_at

    def write(self, frame: Frame) -> None:
        if len(self.indices) == self.fail_at:
            raise OSError("the disk is full")
        time.sleep(self.delay)
        self.indices.append(frame.index)


@pytest.mark.parametrize("queue", [1, 3, 8])
def test_every_frame_passes_once_in_order(queue: int) -> None:
    source, sink = Numbers(100), Memory()
    worked: list[int] = []
    steps: list[int] = []
    stats = process(source, sink, lambda f: worked.append(f.index), progress=steps.append, queue=queue)
    assert sink.indices == worked == list(range(100))
    assert steps == list(range(1, 101))
    assert stats.frames == 100


@pytest.mark.parametrize("queue", [1, 4])
@pytest.mark.parametrize("slow", ["work", "sink"])
def test_the_number_of_frames_alive_is_bounded(slow: str, queue: int) -> None:
    source, sink = Numbers(80), Memory(delay=0.002 if slow == "sink" else 0)
    process(source, sink, lambda frame: time.sleep(0.002 if slow == "work" else 0), queue=queue)
    assert source.most <= 2 * queue + 3


@pytest.mark.parametrize("slow", ["ahead", "work", "sink"])
def test_what_runs_ahead_sees_every_frame_before_the_work_in_order_and_within_bounds(slow: str) -> None:
    source, sink = Numbers(60), Memory(delay=0.002 if slow == "sink" else 0)
    seen: list[int] = []
    places: set[int] = set()

    def ahead(frame: Frame) -> None:
        time.sleep(0.002 if slow == "ahead" else 0)
        places.add(threading.get_ident())
        seen.append(frame.index)

    def work(frame: Frame) -> None:
        time.sleep(0.002 if slow == "work" else 0)
        assert frame.index in seen

    process(source, sink, work, ahead=ahead, queue=2)
    assert seen == sink.indices == list(range(60))
    assert threading.get_ident() not in places
    assert source.most <= 3 * 2 + 4


def test_the_encoder_is_idle_while_the_work_is_slower() -> None:
    slow = process(Numbers(20), Memory(delay=0.001), lambda frame: time.sleep(0.02))
    quick = process(Numbers(20), Memory(delay=0.02), lambda frame: None)
    assert slow.encoder_idle_share > 0.5
    assert quick.encoder_idle_share < 0.2


@pytest.mark.usefixtures("no_thread_left")
@pytest.mark.parametrize("where", ["source", "ahead", "work", "sink"])
@pytest.mark.parametrize("at", [0, 5, 29])
def test_the_first_error_stops_everything_and_comes_once(where: str, at: int) -> None:
    source = Numbers(30, at if where == "source" else None)
    sink = Memory(fail_at=at if where == "sink" else None)

    def work(frame: Frame) -> None:
        if where == "work" and frame.index == at:
            raise OSError("the work failed")

    def ahead(frame: Frame) -> None:
        if where == "ahead" and frame.index == at:
            raise OSError("the work failed")

    with pytest.raises(OSError, match=r"the (drive is gone|work failed|disk is full)"):
        process(source, sink, work, ahead=ahead, queue=2)


def test_decoding_working_and_encoding_overlap() -> None:
    class Slow(Numbers):
        def __iter__(self) -> Iterator[Frame]:
            for frame in super().__iter__():
                time.sleep(0.01)
                yield frame

    start = time.perf_counter()
    stats = process(Slow(30), Memory(delay=0.01), lambda frame: time.sleep(0.01))
    seconds = time.perf_counter() - start
    assert seconds < 0.75 * (stats.decode_seconds + stats.work_seconds + stats.encode_seconds)


def test_work_runs_in_the_callers_thread() -> None:
    threads: set[int] = set()
    process(Numbers(5), Memory(), lambda frame: threads.add(threading.get_ident()))
    assert threads == {threading.get_ident()}


def long_clip(path: Path, count: int) -> Path:
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", 30, {"preset": "ultrafast", "crf": "40"})
        video.width, video.height = 320, 240
        frame = av.VideoFrame.from_ndarray(np.full((240, 320, 3), 90, np.uint8), "rgb24")
        for index in range(count):
            frame.pts, frame.time_base = index, Fraction(1, 30)
            out.mux(video.encode(frame))
        out.mux(video.encode(None))
    return path


@pytest.mark.slow
def test_memory_does_not_grow_with_length(tmp_path: Path) -> None:
    def touch(frame: Frame) -> None:
        roi = frame.align_roi(10, 10, 100, 100)
        frame.write_roi(roi[0], roi[1], frame.read_roi(*roi))

    peaks = []
    for number, count in enumerate([300, 1500]):
        clip = long_clip(tmp_path / f"in{number}.mp4", count)
        with (
            open_input(clip) as source,
            open_sink(tmp_path / f"out{number}.mp4", source, EncodeOptions(preset="ultrafast")) as sink,
        ):
            assert process(source, sink, touch).frames == count
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    assert peaks[1] - peaks[0] < 25  # MiB; 1,200 frames more are 132 MiB


@pytest.mark.skipif(not (SHARED / "data/real/room_s18.mp4").exists(), reason="needs the shared 720p clip")
@pytest.mark.slow
def test_a_720p_clip_with_audio_passes_through(tmp_path: Path) -> None:
    clip = SHARED / "data/real/room_s18.mp4"
    with (
        open_input(clip) as source,
        open_sink(tmp_path / "out.mp4", source, EncodeOptions(preset="ultrafast", crf=35)) as sink,
    ):
        stats = process(source, sink, lambda frame: None)
    assert stats.frames == 282
    assert stats.problems == ()
    with open_input(tmp_path / "out.mp4") as result:
        assert result.has_audio
        assert sum(1 for _ in result) == 282


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="needs Linux")
@pytest.mark.skipif("libsvtav1" not in av.codecs_available, reason="needs SVT-AV1")
def test_no_encoder_takes_real_time_priority(tmp_path: Path) -> None:
    options = EncodeOptions("libsvtav1", crf=40)
    with (
        open_input(cut("p01", tmp_path / "clip.mp4", 4)) as source,
        open_sink(tmp_path / "out.mkv", source, options) as sink,
    ):
        process(source, sink, lambda frame: None)
        threads = os.listdir("/proc/self/task")
        assert len(threads) > 10  # those of the encoder among them
        policies = {os.sched_getscheduler(int(thread)) for thread in threads}
    assert policies <= {os.SCHED_OTHER, os.SCHED_BATCH}
