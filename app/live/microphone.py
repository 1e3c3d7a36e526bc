"""The sound at the camera, kept just long enough to be recorded in time with the pictures.

Times are of `time.perf_counter`, seconds, as those of the pictures' arrival.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from guise.app.media.audio_reader import SAMPLE_RATE, Samples

KEPT_SECONDS = 2.0  # of sound that nobody has taken
CLOCK_BLOCKS = 500  # the last ones, of which the promptest tells how the sender's clock lies to ours


class Microphone:
    """Blocks of sound as they come, and those that were not taken yet; safe to use from any thread.

    clock : gives the time.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._blocks: deque[tuple[float, Samples]] = deque()
        self._position = 0  # of the last block
        self._offsets: deque[float] = deque(maxlen=CLOCK_BLOCKS)  # our clock minus the sender's
        self._lock = threading.Lock()

    def put(self, position: int, samples: Samples) -> None:
        """Offer a block (n, 2) whose first sample is number `position` of the sender's."""
        now = self._clock()
        with self._lock:
            if position < self._position:  # the sender began anew
                self._offsets.clear()
            self._position = position
            self._offsets.append(now - (position + len(samples)) / SAMPLE_RATE)
            at = position / SAMPLE_RATE + min(self._offsets)
            self._blocks.append((at, samples))
            while self._blocks[0][0] < now - KEPT_SECONDS:
                self._blocks.popleft()

    @property
    def is_on(self) -> bool:
        """Whether sound came lately."""
        return bool(self._blocks) and self._blocks[-1][0] > self._clock() - KEPT_SECONDS

    def take(self) -> list[tuple[float, Samples]]:
        """The blocks (time of the first sample, (n, 2) in [-1, 1]) that came since they were taken last."""
        with self._lock:
            taken = list(self._blocks)
            self._blocks.clear()
        return taken
