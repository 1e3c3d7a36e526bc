"""A stream of sound in a file that is being written, in time with its pictures."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream

from guise.app.media.audio_reader import SAMPLE_RATE, Samples
from guise.app.media.reader import AnyPacket

if TYPE_CHECKING:
    from av.container import OutputContainer

ENCODER = "aac"
JUMP_SECONDS = 0.06  # by which sound may seem early or late before it is put right


class SoundTrack:
    """Encodes blocks of sound.

    output : a file whose header is not written yet.
    """

    def __init__(self, output: OutputContainer) -> None:
        stream = output.add_stream(ENCODER, SAMPLE_RATE, layout="stereo")
        assert isinstance(stream, AudioStream)
        self._stream, self._length = stream, 0  # samples

    def encode(self, samples: Samples, at: float) -> Iterable[AnyPacket]:
        """The packets of a block (n, 2) that is heard `at` seconds after the first picture."""
        jump = JUMP_SECONDS if self._length else 0.0
        samples = in_time(samples, at, self._length / SAMPLE_RATE, jump)
        if not len(samples):
            return []
        block = AudioFrame.from_ndarray(np.ascontiguousarray(samples.T), "fltp", "stereo")
        block.sample_rate, block.pts, block.time_base = SAMPLE_RATE, self._length, Fraction(1, SAMPLE_RATE)
        self._length += len(samples)
        return self._stream.encode(block)

    def finish(self) -> Iterable[AnyPacket]:
        """The last packets."""
        return self._stream.encode(None) if self._length else []


def in_time(samples: Samples, at: float, due: float, jump_seconds: float) -> Samples:
    """A block at time `at` as it follows sound that has been written up to `due`.

    Silence fills a gap of more than `jump_seconds`, and what overlaps by more is left out; less is no gap, but the
    uncertainty of the times.
    """
    gap = at - due
    if gap > jump_seconds:
        return np.concatenate([np.zeros((round(gap * SAMPLE_RATE), 2), np.float32), samples])
    if gap < -jump_seconds:
        return samples[round(-gap * SAMPLE_RATE) :]
    return samples
