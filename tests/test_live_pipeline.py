"""Threads, drops, errors and ends of the live pipeline."""

import threading
import time
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pytest

from guise.app.live.capture import Capture
from guise.app.live.face import FaceResult
from guise.app.live.output import Output, OutputFrame
from guise.app.live.pipeline import Pipeline
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame, MediaError

pytestmark = pytest.mark.usefixtures("no_thread_left")


class Numbers(Capture):
    """Frames whose index counts; the end, or an error, after `count`."""

    width, height = 8, 6

    def __init__(
        self, count: int, *, paced: bool, delay: float = 0.0, error: Exception | None = None
    ) -> None:
        self.paced, self._count, self._delay, self._error, self.stopped = paced, count, delay, error, False

    def __iter__(self) -> Iterator[Frame]:
        for index in range(self._count):
            if self.stopped:
                return
            time.sleep(self._delay)
            yield Frame.from_rgb(np.zeros((6, 8, 3), np.uint8), index, Fraction(1, 30), index)
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        self.stopped = True


class Pass:
    """Work that shows frames as they are."""

    closed = 0

    def __init__(self, delay: float = 0.0, fail_at: int | None = None) -> None:
        self._delay, self._fail_at = delay, fail_at

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        if frame.index == self._fail_at:
            raise RuntimeError("broken")
        time.sleep(self._delay)
        return OutputFrame(frame, FaceResult("swapped"), stats, arrived)

    def close(self) -> None:
        type(self).closed += 1


class Memory(Output):
    """Keeps the indices that it was shown, and says in which thread."""

    def __init__(
        self, *, lossless: bool = False, main: bool = False, delay: float = 0.0, ends_at: int = 10**9,
        fails: str = "",
    ) -> None:  # fmt: skip
        self.lossless, self.main_thread, self._delay, self._ends_at, self._fails = (
            lossless,
            main,
            delay,
            ends_at,
            fails,
        )
        self.seen: list[int] = []
        self.calls: list[str] = []
        self.threads: set[str] = set()

    def open(self, width: int, height: int, fps: float) -> None:
        self.calls.append(f"open {width}x{height}")
        if self._fails == "open":
            raise MediaError("no device.")

    def show(self, shown: OutputFrame) -> None:
        if self._fails == "show":
            raise MediaError("gone.")
        self.threads.add(threading.current_thread().name)
        time.sleep(self._delay)
        self.seen.append(shown.frame.index)

    def pump(self) -> bool:
        return len(self.seen) < self._ends_at

    def close(self) -> None:
        self.calls.append("close")


def test_without_pace_and_loss_every_frame_reaches_the_file() -> None:
    out = Memory(lossless=True, delay=0.001)
    stats = Pipeline(Numbers(60, paced=False), Pass, [out]).run()
    assert out.seen == list(range(60))
    assert out.calls == ["open 8x6", "close"]
    assert (stats.frames, stats.presented, stats.dropped, stats.skipped) == (60, 60, 0, 0)
    assert stats.outcomes == {"swapped": 60}


def test_work_that_is_late_drops_frames_and_says_how_many() -> None:
    out = Memory()
    stats = Pipeline(Numbers(60, paced=True, delay=0.002), lambda: Pass(0.02), [out]).run()
    assert stats.dropped > 0
    assert stats.frames + stats.dropped == 60
    assert out.seen == sorted(out.seen)


def test_a_slow_output_does_not_hold_up_a_quick_one() -> None:
    quick, slow = Memory(lossless=True), Memory(delay=0.05)
    stats = Pipeline(Numbers(40, paced=False), Pass, [quick, slow]).run()
    assert quick.seen == list(range(40))
    assert len(slow.seen) < 40
    assert stats.skipped == 40 - len(slow.seen)


def test_an_output_of_the_main_thread_is_shown_to_there_and_can_end_it() -> None:
    window = Memory(main=True, ends_at=5)
    capture = Numbers(10_000, paced=True, delay=0.001)
    Pipeline(capture, Pass, [window]).run()
    assert window.threads == {threading.current_thread().name}
    assert capture.stopped
    assert 5 <= len(window.seen) < 10_000
    assert window.calls == ["open 8x6", "close"]


def test_what_is_asked_in_the_main_thread_ends_it() -> None:
    capture, calls = Numbers(10_000, paced=True, delay=0.001), iter(range(100))
    Pipeline(capture, Pass, [Memory()], lambda: next(calls) < 3).run()
    assert capture.stopped


@pytest.mark.parametrize("main", [False, True])
@pytest.mark.parametrize("where", ["open", "show"])
def test_an_output_that_fails_ends_all_with_its_error(where: str, main: bool) -> None:
    out, other = Memory(fails=where, main=main), Memory()
    with pytest.raises(MediaError, match=r"no device|gone"):
        Pipeline(Numbers(10_000, paced=True, delay=0.001), Pass, [other, out]).run()
    assert out.calls[-1] == "close"


def test_work_and_capture_that_fail_end_all_with_their_error() -> None:
    before = Pass.closed
    with pytest.raises(RuntimeError, match="broken"):
        Pipeline(Numbers(50, paced=False), lambda: Pass(fail_at=7), [Memory(lossless=True)]).run()
    assert Pass.closed == before + 1
    with pytest.raises(MediaError, match=r"unplugged"):
        Pipeline(Numbers(5, paced=False, error=MediaError("unplugged.")), Pass, [Memory(lossless=True)]).run()


def test_latency_is_that_from_capture_to_the_first_output() -> None:
    stats = Pipeline(Numbers(20, paced=False), lambda: Pass(0.01), [Memory(lossless=True, delay=0.01)]).run()
    assert stats.latency >= 20
    assert stats.latency_95 >= stats.latency
