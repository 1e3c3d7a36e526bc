"""The sound of a file, played in sync with its pictures.

The pictures are the clock: the sound is resampled slightly, below what can be heard, to stay with them, and jumps when
they jump.  PortAudio (sounddevice) plays it: it is the one library for all three operating systems that reports when a
sample will be heard.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from guise.app.live.output import Output, OutputFrame
from guise.app.media.audio_reader import SAMPLE_RATE, AudioReader, Samples
from guise.app.media.input import VideoInput
from guise.app.media.other_streams import first_pts
from guise.common.closing import Closing
from guise.common.errors import GuiseError
from guise.common.progress import Say


@dataclass(frozen=True)
class SyncLimits:
    """How sound is kept in sync with pictures."""

    decode_ahead_seconds: float = 1.0
    jump_seconds: float = 0.15  # offset beyond which the sound jumps instead of changing speed
    correction_share: float = 0.1  # of the offset, corrected within one block
    max_speed_change: float = 0.005  # relative; inaudible
    picture_weight: float = (
        0.05  # of one picture in the running estimate of the picture clock, which has jitter
    )


LIMITS = SyncLimits()

Fill = Callable[[Samples, float], None]
Clock = Callable[[], float]


class SoundOutput(Output):
    """Plays the sound of a file while its pictures are shown; without a sound device it says so once and is silent.

    Parameters
    ----------
    source : the file; it has sound.   say : called with messages for the user.
    device : opens a player, given a function that fills a block (n, 2) to be heard at a given time of the clock.
    clock : returns seconds.
    """

    def __init__(
        self, media: VideoInput, say: Say = print, device: Callable[[Fill], Closing] | None = None,
        clock: Clock = time.perf_counter,
    ) -> None:  # fmt: skip
        self._media, self._say, self._device, self._clock = media, say, device or Speaker, clock
        self._first = float(first_pts(media) * media.time_base)
        self._sound = SyncedSound(AudioReader(media))
        self._playing: Closing | None = None
        self._index, self._base = -1, 0.0

    def open(self, width: int, height: int, fps: float) -> None:
        """Open the device."""
        try:
            self._playing = self._device(self._sound.fill)
        except SoundError as error:
            self._say(f"Sound is off: {error}.")

    def show(self, shown: OutputFrame) -> None:
        """Note when a picture is shown."""
        if self._playing is None:
            return
        frame = shown.frame
        at = frame.seconds
        if frame.index < self._index:  # the file starts over
            self._base = at - frame.index / float(self._media.frame_rate)
        self._index = frame.index
        self._sound.sync(self._first + at - self._base, self._clock())

    def close(self) -> None:
        """Stop playing."""
        if self._playing is not None:
            self._playing.close()
        self._sound.close()


class SyncedSound(Closing):
    """Decoded sound around the current position; `sync` is called by one thread, `fill` by another."""

    def __init__(self, reader: AudioReader) -> None:
        self._reader = reader
        self._lock = threading.Lock()
        self._lead: float | None = None  # file time minus clock, seconds
        self._jump = True  # with the next block
        self._held = np.zeros((0, 2), np.float32)
        self._begin = 0.0  # file time of the first held sample

    def sync(self, position: float, now: float) -> None:
        """The picture at `position` (file time) is shown at `now` (clock), both in seconds."""
        with self._lock:
            change = position - now - (self._lead or 0.0)
            self._jump |= self._lead is None or abs(change) > LIMITS.jump_seconds
            self._lead = position - now - (0.0 if self._jump else (1 - LIMITS.picture_weight) * change)
        if not self._begin - LIMITS.jump_seconds <= position <= self._end + LIMITS.decode_ahead_seconds:
            self._reader.seek(position)
            with self._lock:
                self._held, self._begin = self._held[:0], position
        self._decode(position + LIMITS.decode_ahead_seconds)

    def fill(self, block: Samples, heard: float) -> None:
        """Fill a block (n, 2) whose first sample is heard at clock time `heard`."""
        block[:] = 0
        with self._lock:
            if self._lead is None:
                return
            late = heard + self._lead - self._begin
            if self._jump or abs(late) > LIMITS.jump_seconds:
                self._jump_by(late, block)
            else:
                most = LIMITS.max_speed_change * len(block)
                correction = LIMITS.correction_share * late * SAMPLE_RATE
                taken = len(block) + round(float(np.clip(correction, -most, most)))
                piece = stretched(self._take(taken), len(block), taken)
                block[: len(piece)] = piece

    def _jump_by(self, late: float, block: Samples) -> None:
        """Fill a block exactly in sync: late samples are skipped, silence precedes early ones."""
        self._take(round(max(late, 0.0) * SAMPLE_RATE))
        pause = min(round(max(-late, 0.0) * SAMPLE_RATE), len(block))
        piece = self._take(len(block) - pause)
        block[pause : pause + len(piece)] = piece
        self._jump = len(piece) == 0

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    @property
    def _end(self) -> float:
        return self._begin + len(self._held) / SAMPLE_RATE

    def _take(self, count: int) -> Samples:
        """The next samples, at most `count`."""
        taken, self._held = self._held[:count], self._held[count:]
        self._begin += len(taken) / SAMPLE_RATE
        return taken

    def _decode(self, until: float) -> None:
        while self._end < until and (read := self._reader.read()) is not None:
            at, samples = read
            with self._lock:
                gap = round((at - self._end) * SAMPLE_RATE)
                silence = np.zeros((max(gap, 0), 2), np.float32)
                self._held = np.concatenate([self._held, silence, samples[max(-gap, 0) :]])


def stretched(samples: Samples, length: int, taken: int) -> Samples:
    """Samples (m, 2), m <= taken, resampled so that `taken` of them last as long as `length`."""
    if taken == length or len(samples) == 0:
        return samples
    at = np.arange(round(len(samples) * length / taken)) * (taken / length)
    own = np.arange(len(samples))
    return np.stack([np.interp(at, own, channel) for channel in samples.T], axis=1).astype(np.float32)


class SoundError(GuiseError):
    """Sound cannot be played; the reason."""


class Speaker(Closing):
    """The default sound device of this computer."""

    def __init__(self, fill: Fill) -> None:
        self._fill = fill
        self._stream = _open_stream(self._callback)

    def close(self) -> None:
        """Release the device."""
        self._stream.close()

    def _callback(self, block: Samples, frames: int, times: Any, status: object) -> None:
        delay = max(0.0, times.outputBufferDacTime - times.currentTime)
        self._fill(block, time.perf_counter() + delay)


def _open_stream(callback: Callable[..., None]) -> Any:
    """A running sounddevice stream; SoundError when there is none."""
    try:
        import sounddevice
    except ImportError as error:
        raise SoundError('sounddevice is not installed; run pip install "guise-video[window]"') from error
    except OSError as error:
        raise SoundError(f"{error}; install PortAudio (libportaudio2 on Debian and Ubuntu)") from error
    try:
        stream = sounddevice.OutputStream(SAMPLE_RATE, channels=2, dtype="float32", callback=callback)
        stream.start()
    except sounddevice.PortAudioError as error:
        raise SoundError(f"there is no sound device ({error})") from error
    return stream
