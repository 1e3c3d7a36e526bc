"""Capture, work and outputs, each in a thread of its own, with one place between them: the latest picture wins.

The main thread pumps the outputs that need it.  The first error of any thread ends all of them and is raised once.
"""

from __future__ import annotations

import statistics
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

from guise.app.live.capture import Capture
from guise.app.live.output import Output, Shown
from guise.app.live.slot import Slot
from guise.app.media import Frame

RECENT = 120  # pictures over which rate and latency are told
IDLE = 0.02  # seconds that the main thread sleeps when it has nothing to pump


@dataclass(frozen=True)
class Stats:
    """What has happened so far.

    Parameters
    ----------
    frames : pictures that were worked on.   presented : by the first output.
    fps : of the first output, lately.
    latency, latency_95 : milliseconds from capture to the end of presenting, lately: median, 95th percentile.
    dropped : pictures of the capture that were not worked on, as newer ones came.
    skipped : finished ones that an output had no time for, over all outputs.
    seconds : since the start.
    outcomes : how many pictures were swapped, covered, lost, off, shown.
    """

    frames: int = 0
    presented: int = 0
    fps: float = 0.0
    latency: float = 0.0
    latency_95: float = 0.0
    dropped: int = 0
    skipped: int = 0
    seconds: float = 0.0
    outcomes: dict[str, int] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """The figures as JSON holds them."""
        return asdict(self)


class Work(Protocol):
    """What is done with a picture; made, used and closed in the work thread."""

    def step(self, frame: Frame, arrived: float, stats: Stats) -> Shown:
        """Change the frame in place and say what was done."""

    def close(self) -> None:
        """Release what is held."""


class Pipeline:
    """Runs a capture through work to outputs.

    Parameters
    ----------
    capture : Capture.   make_work : makes the work, in its thread.   outputs : at least one.
    pump : called in the main thread all the time; False ends the run.
    """

    def __init__(
        self, capture: Capture, make_work: Callable[[], Work], outputs: Sequence[Output],
        pump: Callable[[], bool] = lambda: True,
    ) -> None:  # fmt: skip
        self._capture, self._make_work, self._pump = capture, make_work, pump
        self._taps = [_Tap(output, self) for output in outputs]
        self._caught: Slot[tuple[Frame, float]] = Slot(lossless=not capture.paced)
        self._meter = Meter()
        self._errors: list[BaseException] = []
        self._ended = threading.Event()

    @property
    def stats(self) -> Stats:
        """As they are now; from any thread."""
        return self._meter.stats(self._caught.dropped, sum(tap.slot.dropped for tap in self._taps))

    def stop(self) -> None:
        """End the run soon; from any thread."""
        self._capture.stop()
        self._caught.close()

    def run(self) -> Stats:
        """Until the capture ends, an output is closed by the user, `pump` says so, or an error."""
        here = [tap for tap in self._taps if tap.output.main_thread]
        threads = [
            threading.Thread(target=self._guarded, args=(target,), name=f"guise-live-{name}")
            for name, target in [
                ("capture", self._run_capture),
                ("work", self._run_work),
                *((f"output{n}", tap.run) for n, tap in enumerate(self._taps) if tap not in here),
            ]
        ]
        try:
            for tap in here:
                tap.output.open(self._capture.width, self._capture.height, self._capture.fps)
            for thread in threads:
                thread.start()
            self._pump_until_end(here)
        finally:
            self._end(here, [thread for thread in threads if thread.ident is not None])
        if self._errors:
            raise self._errors[0]
        return self.stats

    def presented(self, shown: Shown, tap: _Tap) -> None:
        """An output has shown a picture."""
        if tap is self._taps[0]:
            self._meter.presented(shown.arrived)

    def _pump_until_end(self, here: list[_Tap]) -> None:
        while not self._ended.is_set():
            busy = False
            for tap in here:
                busy |= tap.show_one()
                if not tap.output.pump():
                    self.stop()
            if not self._pump():
                self.stop()
            if not here or not busy:
                self._ended.wait(0.001 if here else IDLE)
        for tap in here:
            tap.show_one()

    def _end(self, here: list[_Tap], threads: list[threading.Thread]) -> None:
        self.stop()
        for tap in self._taps:
            if tap.output.main_thread:
                tap.slot.close()
        for thread in threads:
            thread.join()
        for tap in here:
            tap.output.close()

    def _run_capture(self) -> None:
        try:
            for frame in self._capture:
                self._caught.put((frame, time.perf_counter()))
        finally:
            self._caught.close()

    def _run_work(self) -> None:
        try:
            work = self._make_work()
            try:
                while (caught := self._caught.get()) is not None:
                    self._work_on(work, *caught)
            finally:
                work.close()
        finally:
            for tap in self._taps:
                tap.slot.close()
            self._ended.set()

    def _work_on(self, work: Work, frame: Frame, arrived: float) -> None:
        shown = work.step(frame, arrived, self.stats)
        self._meter.worked(shown.look.outcome)
        for tap in self._taps:
            tap.slot.put(shown)

    def _guarded(self, target: Callable[[], None]) -> None:
        try:
            target()
        except BaseException as error:
            self._errors.append(error)
            self.stop()
            self._ended.set()


class _Tap:
    """An output with its place."""

    def __init__(self, output: Output, pipeline: Pipeline) -> None:
        self.output, self._pipeline = output, pipeline
        self.slot: Slot[Shown] = Slot(lossless=output.lossless)

    def run(self) -> None:
        """In a thread of its own, until nothing more comes."""
        capture = self._pipeline._capture
        try:
            self.output.open(capture.width, capture.height, capture.fps)
            while (shown := self.slot.get()) is not None:
                self._show(shown)
        finally:
            self.slot.close()
            self.output.close()

    def show_one(self) -> bool:
        """Show what lies there, if anything does."""
        shown = self.slot.get(timeout=0)
        if shown is not None:
            self._show(shown)
        return shown is not None

    def _show(self, shown: Shown) -> None:
        self.output.show(shown)
        self._pipeline.presented(shown, self)


class Meter:
    """Counts, and measures rate and latency; safe to use from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._start = time.perf_counter()
        self._outcomes: Counter[str] = Counter()
        self._presented = 0
        self._times: deque[float] = deque(maxlen=RECENT)
        self._latencies: deque[float] = deque(maxlen=RECENT)

    def worked(self, outcome: str) -> None:
        """A picture is finished."""
        with self._lock:
            self._outcomes[outcome] += 1

    def presented(self, arrived: float) -> None:
        """A picture that was captured at `arrived` is shown."""
        now = time.perf_counter()
        with self._lock:
            self._presented += 1
            self._times.append(now)
            self._latencies.append(1000 * (now - arrived))

    def stats(self, dropped: int, skipped: int) -> Stats:
        """As they are now."""
        with self._lock:
            latencies, times = sorted(self._latencies), self._times
            span = times[-1] - times[0] if len(times) > 1 else 0.0
            return Stats(
                self._outcomes.total(), self._presented,
                (len(times) - 1) / span if span > 0 else 0.0,
                statistics.median(latencies) if latencies else 0.0,
                latencies[int(0.95 * (len(latencies) - 1))] if latencies else 0.0,
                dropped, skipped, time.perf_counter() - self._start, dict(self._outcomes),
            )  # fmt: skip
