"""The sound of a file, played in step with its pictures.

The pictures are the clock: the sound runs a little faster or slower to stay with them, which nobody hears, and jumps
where they do.
PortAudio (sounddevice) plays it, as the one library for all three systems that tells when a sample will be heard.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from guise.app.live.capture import Say
from guise.app.live.output import Output, Shown
from guise.app.media.beside import RATE, Samples, SoundReader, first_pts
from guise.app.media.source import VideoSource
from guise.common.closing import Closing

AHEAD = 1.0  # seconds that are decoded in advance
JUMP = 0.15  # seconds out of step from which the sound jumps
PULL = 0.1  # share of being out of step that is made up for in a block
GENTLE = 0.005  # change of speed that nobody hears
CALM = 0.05  # share that a picture has in where the pictures are: their moments vary

Fill = Callable[[Samples, float], None]
Clock = Callable[[], float]


class Sound(Output):
    """Plays the sound of a file while its pictures are shown; without a device it says so once and is silent.

    Parameters
    ----------
    source : the file; it has sound.   say : takes the note.
    device : opens what plays, given a function that fills a block (n, 2) which is heard at a time of the clock.
    clock : seconds.
    """

    def __init__(
        self, source: VideoSource, say: Say = print, device: Callable[[Fill], Closing] | None = None,
        clock: Clock = time.perf_counter,
    ) -> None:  # fmt: skip
        self._source, self._say, self._device, self._clock = source, say, device or Speaker, clock
        self._first = float(first_pts(source) * source.time_base)
        self._track = Track(SoundReader(source))
        self._playing: Closing | None = None
        self._index, self._base = -1, 0.0

    def open(self, width: int, height: int, fps: float) -> None:
        """Open the device."""
        try:
            self._playing = self._device(self._track.fill)
        except SoundError as error:
            self._say(f"The sound is not played: {error}.")

    def show(self, shown: Shown) -> None:
        """Take the moment at which a picture is seen."""
        if self._playing is None:
            return
        frame = shown.frame
        at = float(frame.pts * frame.time_base)
        if frame.index < self._index:  # the file begins again
            self._base = at - frame.index / float(self._source.frame_rate)
        self._index = frame.index
        self._track.follow(self._first + at - self._base, self._clock())

    def close(self) -> None:
        """Be silent."""
        if self._playing is not None:
            self._playing.close()
        self._track.close()


class Track(Closing):
    """Decoded sound around the present; `follow` is called by one thread, `fill` by another."""

    def __init__(self, reader: SoundReader) -> None:
        self._reader = reader
        self._lock = threading.Lock()
        self._lead: float | None = None  # file time minus clock, seconds
        self._jump = True  # with the next block
        self._held = np.zeros((0, 2), np.float32)
        self._begin = 0.0  # file time of what is held first

    def follow(self, position: float, now: float) -> None:
        """The picture of that time in the file is seen now, seconds of the clock."""
        with self._lock:
            change = position - now - (self._lead or 0.0)
            self._jump |= self._lead is None or abs(change) > JUMP
            self._lead = position - now - (0.0 if self._jump else (1 - CALM) * change)
        if not self._begin - JUMP <= position <= self._end + AHEAD:
            self._reader.seek(position)
            with self._lock:
                self._held, self._begin = self._held[:0], position
        self._decode(position + AHEAD)

    def fill(self, block: Samples, heard: float) -> None:
        """Fill a block (n, 2) whose first sample is heard at that time of the clock."""
        block[:] = 0
        with self._lock:
            if self._lead is None:
                return
            late = heard + self._lead - self._begin
            if self._jump or abs(late) > JUMP:
                self._jump_by(late, block)
            else:
                most = GENTLE * len(block)
                taken = len(block) + round(float(np.clip(PULL * late * RATE, -most, most)))
                piece = stretched(self._take(taken), len(block), taken)
                block[: len(piece)] = piece

    def _jump_by(self, late: float, block: Samples) -> None:
        """Fill a block exactly in step: what comes too late is left out, and before what comes too early is silence."""
        self._take(round(max(late, 0.0) * RATE))
        pause = min(round(max(-late, 0.0) * RATE), len(block))
        piece = self._take(len(block) - pause)
        block[pause : pause + len(piece)] = piece
        self._jump = len(piece) == 0

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    @property
    def _end(self) -> float:
        return self._begin + len(self._held) / RATE

    def _take(self, count: int) -> Samples:
        """The next samples, at most so many."""
        taken, self._held = self._held[:count], self._held[count:]
        self._begin += len(taken) / RATE
        return taken

    def _decode(self, until: float) -> None:
        while self._end < until and (read := self._reader.read()) is not None:
            at, samples = read
            with self._lock:
                gap = round((at - self._end) * RATE)
                silence = np.zeros((max(gap, 0), 2), np.float32)
                self._held = np.concatenate([self._held, silence, samples[max(-gap, 0) :]])


def stretched(samples: Samples, length: int, taken: int) -> Samples:
    """Samples (m, 2), m <= taken, as they are heard when `taken` of them last as long as `length`."""
    if taken == length or len(samples) == 0:
        return samples
    at = np.arange(round(len(samples) * length / taken)) * (taken / length)
    own = np.arange(len(samples))
    return np.stack([np.interp(at, own, channel) for channel in samples.T], axis=1).astype(np.float32)


class SoundError(Exception):
    """There is nothing that could play; the reason."""


class Speaker(Closing):
    """The sound device of this computer that the user has chosen for all programs."""

    def __init__(self, fill: Fill) -> None:
        self._fill = fill
        self._stream = _open_stream(self._callback)

    def close(self) -> None:
        """Let the device go."""
        self._stream.close()

    def _callback(self, block: Samples, frames: int, times: Any, status: object) -> None:
        delay = max(0.0, times.outputBufferDacTime - times.currentTime)
        self._fill(block, time.perf_counter() + delay)


def _open_stream(callback: Callable[..., None]) -> Any:
    """A running stream of sounddevice; SoundError when there is none."""
    try:
        import sounddevice
    except ImportError as error:
        raise SoundError('install it with pip install "guise-video[window]"') from error
    except OSError as error:
        raise SoundError(f"{error}; install libportaudio2, or PortAudio as your system calls it") from error
    try:
        stream = sounddevice.OutputStream(RATE, channels=2, dtype="float32", callback=callback)
        stream.start()
    except sounddevice.PortAudioError as error:
        raise SoundError(f"there is no device for it ({error})") from error
    return stream
