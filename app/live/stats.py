"""Counts, frame rate and latency of a live run."""

from __future__ import annotations

import statistics
import threading
import time
from collections import Counter, deque
from dataclasses import dataclass, field

from guise.common.report import Report

RECENT_FRAMES = 120  # over which frame rate and latency are measured


@dataclass(frozen=True)
class PipelineStats(Report):
    """What a pipeline has done so far.

    Parameters
    ----------
    frames : processed frames.   presented : frames shown by the first output.
    fps : of the first output, over the most recent frames.
    latency, latency_95 : milliseconds from capture to the end of presentation, recent frames: median, 95th percentile.
    dropped : captured frames that were never processed because newer ones arrived.
    skipped : processed frames that an output was too busy to show, summed over all outputs.
    seconds : since the start.
    outcomes : number of frames by outcome: swapped, covered, lost, off, shown, enrolling.
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


class PipelineMeter:
    """Counts frames and measures frame rate and latency; safe to use from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._start = time.perf_counter()
        self._outcomes: Counter[str] = Counter()
        self._presented = 0
        self._times: deque[float] = deque(maxlen=RECENT_FRAMES)
        self._latencies: deque[float] = deque(maxlen=RECENT_FRAMES)

    def count_processed(self, outcome: str) -> None:
        """Count a processed frame."""
        with self._lock:
            self._outcomes[outcome] += 1

    def count_presented(self, arrived: float) -> None:
        """Count a frame that was captured at `arrived` and has just been presented."""
        now = time.perf_counter()
        with self._lock:
            self._presented += 1
            self._times.append(now)
            self._latencies.append(1000 * (now - arrived))

    def stats(self, dropped: int, skipped: int) -> PipelineStats:
        """The current figures."""
        with self._lock:
            latencies, times = sorted(self._latencies), self._times
            span = times[-1] - times[0] if len(times) > 1 else 0.0
            return PipelineStats(
                self._outcomes.total(), self._presented,
                (len(times) - 1) / span if span > 0 else 0.0,
                statistics.median(latencies) if latencies else 0.0,
                latencies[int(0.95 * (len(latencies) - 1))] if latencies else 0.0,
                dropped, skipped, time.perf_counter() - self._start, dict(self._outcomes),
            )  # fmt: skip
