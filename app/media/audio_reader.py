"""The audio of a video file, decoded to be played."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import av
import av.error
import numpy as np
from av.audio.frame import AudioFrame
from av.audio.resampler import AudioResampler

from guise.app.media.clock import Retimer
from guise.app.media.container import open_container
from guise.app.media.input import VideoInput
from guise.app.media.reader import AnyPacket
from guise.common.arrays import F32
from guise.common.closing import Closing

Samples = F32  # (n, 2), in [-1, 1]

SAMPLE_RATE = 48_000  # Hz


class AudioReader(Closing):
    """The first audio stream of a video file, decoded from any time on as stereo, SAMPLE_RATE samples per second.

    The input's `has_audio` tells whether there is one.
    """

    def __init__(self, media: VideoInput) -> None:
        self._media = media
        self._container = open_container(media.path)
        self.seek(0.0)

    def seek(self, seconds: float) -> None:
        """Continue with what is heard at that time of the file, or slightly before."""
        clock = self._media.clock
        if clock.jumps:  # only a pass from the start tells where packets lie
            self._container.close()
            self._container = open_container(self._media.path)
        else:
            index = self._container.streams.audio[0].index
            raw = max(seconds, 0.0) - float(clock.shift(index))
            with contextlib.suppress(av.error.FFmpegError):  # without an index, from the beginning
                self._container.seek(round(raw * av.time_base))
        self._blocks = self._decoded(seconds if clock.jumps else 0.0)

    def read(self) -> tuple[float, Samples] | None:
        """The next block: its time in the file, seconds, and (n, 2) float32 in [-1, 1]; None at the end."""
        return next(self._blocks, None)

    def close(self) -> None:
        """Close the file."""
        self._container.close()

    def _decoded(self, begin: float) -> Iterator[tuple[float, Samples]]:
        resampler = AudioResampler("flt", "stereo", SAMPLE_RATE)
        for packet in self._packets():
            try:
                frames = packet.decode()
            except av.error.FFmpegError:
                continue  # a damaged packet is silence
            for frame in frames:
                assert isinstance(frame, AudioFrame)
                if frame.time is not None and frame.time + frame.samples / frame.sample_rate < begin:
                    continue
                for block in resampler.resample(frame):
                    yield float(block.time or 0.0), np.asarray(block.to_ndarray(), np.float32).reshape(-1, 2)

    def _packets(self) -> Iterator[AnyPacket]:
        retime, stream = Retimer(self._media.clock), self._container.streams.audio[0]
        with contextlib.suppress(av.error.FFmpegError):  # the file is cut short
            packet: AnyPacket
            for packet in self._container.demux(stream):  # type: ignore[assignment]
                retime(packet)
                yield packet
