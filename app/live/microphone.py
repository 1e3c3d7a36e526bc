"""The sound at the camera, kept just long enough to be recorded in time with the pictures.

Times are of `time.perf_counter`, seconds, as those of the pictures' arrival.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable

from guise.app.media.audio_reader import SAMPLE_RATE, Samples

KEPT_SECONDS = 2.0  # of sound that nobody has taken
CLOCK_MESSAGES = 500  # the last ones, of which the promptest tells how the sender's clock lies to ours


class SenderClock:
    """Our times for a sender's, whatever their messages took; those that took least tell how the clocks lie."""

    def __init__(self) -> None:
        self._last = -math.inf
        self._offsets: deque[float] = deque(maxlen=CLOCK_MESSAGES)  # our clock minus the sender's

    def ours(self, theirs: float, now: float) -> float:
        """Our time, seconds, of the sender's time `theirs`; a message of that time has just come."""
        if theirs < self._last:  # the sender began anew
            self._offsets.clear()
        self._last = theirs
        self._offsets.append(now - theirs)
        return theirs + min(self._offsets)


class Microphone:
    """Blocks of sound as they come, and those that were not taken yet; safe to use from any thread.

    clock : gives the time.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._blocks: deque[tuple[float, Samples]] = deque()
        self._sender = SenderClock()
        self._lock = threading.Lock()

    def put(self, position: int, samples: Samples) -> None:
        """Offer a block (n, 2) whose first sample is number `position` of the sender's."""
        now = self._clock()
        with self._lock:
            length = len(samples) / SAMPLE_RATE
            at = self._sender.ours(position / SAMPLE_RATE + length, now) - length
            self._blocks.append((at, samples))
            while self._blocks and self._blocks[0][0] < now - KEPT_SECONDS:
                self._blocks.popleft()

    @property
    def is_on(self) -> bool:
        """Whether sound came lately."""
        with self._lock:
            return bool(self._blocks) and self._blocks[-1][0] > self._clock() - KEPT_SECONDS

    def take(self) -> list[tuple[float, Samples]]:
        """The blocks (time of the first sample, (n, 2) in [-1, 1]) that came since they were taken last."""
        with self._lock:
            taken = list(self._blocks)
            self._blocks.clear()
        return taken
