"""Masked sound: a voice that is not known by ear, in step with the picture.

Pitch and formants are lowered together, as by a tape that runs slower; then the tempo is restored by overlap-add
(FFmpeg filters `asetrate`, `aresample`, `atempo`).  That fools the ear; whoever knows the factor can undo it.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import TYPE_CHECKING

import av
import av.error
import numpy as np
from av.audio.codeccontext import AudioCodecContext
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.filter import Graph
from numpy.typing import NDArray

from guise.app.media.codecs import has_encoder
from guise.app.media.errors import MediaError
from guise.app.media.reader import ProblemLog

if TYPE_CHECKING:
    from guise.app.media.reader import AnyPacket

FREQUENCY_FACTOR = Fraction(4, 5)  # of all frequencies
_UNNAMED_LAYOUTS = {"1 channels": "mono", "2 channels": "stereo"}
_LEAST_BIT_RATE = 64_000  # a channel
_ALWAYS = 48_000  # a sample rate that every fallback takes
_JUMP = 0.02  # seconds; a longer gap in the input's time stamps is filled with silence


def named_layout(name: str) -> str:
    """The layout's name; MP4 wants one for what has only a count of channels."""
    return _UNNAMED_LAYOUTS.get(name, name)


class MaskedAudio:
    """One sound stream of the input, encoded again with the voices masked.

    stream : of the output.
    """

    def __init__(self, source: AudioStream, output: OutputContainer, problems: ProblemLog) -> None:
        self._problems = problems
        self._layout = named_layout(source.layout.name)
        self.stream = self._add_stream(source, output)
        self._rate = self.stream.rate
        self._graph: Graph | None = None
        self._kind: tuple[object, ...] = ()
        self._next: int | None = (
            None  # where the output has come to, and where the input, samples from time zero
        )
        self._end = 0

    def _add_stream(self, source: AudioStream, output: OutputContainer) -> AudioStream:
        """A stream in the input's codec, or in one that the container takes."""
        own = source.codec_context.codec.canonical_name
        bit_rate = max(source.bit_rate or 0, _LEAST_BIT_RATE * source.channels)
        for name, rate in [
            (own, source.rate),
            ("aac", source.rate),
            ("libopus", source.rate),
            ("libopus", _ALWAYS),
        ]:
            if not _opens(name, rate, self._layout, bit_rate):
                continue
            try:
                stream = output.add_stream(name, rate)
            except ValueError:
                continue
            assert isinstance(stream, AudioStream)
            stream.codec_context.layout, stream.codec_context.bit_rate = self._layout, bit_rate
            return stream
        raise MediaError(
            f"Masked sound of {source.channels} channels cannot be stored in {output.format.name}: use .mp4."
        )

    def feed(self, packet: AnyPacket) -> Iterator[AnyPacket]:
        """Take a packet of the input; gives packets for the output."""
        try:
            frames = packet.decode()
        except EOFError:
            return
        except av.error.FFmpegError as error:
            self._problems.note(f"A damaged sound packet was replaced by silence ({error.strerror}).")
            return
        for frame in frames:
            assert isinstance(frame, AudioFrame)
            yield from self._mask(frame)

    def _mask(self, frame: AudioFrame) -> Iterator[AnyPacket]:
        kind = (frame.format.name, frame.layout.name, frame.sample_rate, frame.time_base)
        if kind != self._kind:
            yield from self._drain()
            self._kind, self._graph = kind, self._make_graph(frame)
        begin = self._end if frame.pts is None else round(frame.pts * self._rate * (frame.time_base or 0))
        self._end = begin + round(Fraction(frame.samples * self._rate, frame.sample_rate))
        if self._next is None:
            self._next = begin
        assert self._graph is not None
        self._graph.push(frame)
        yield from self._pull()

    def _make_graph(self, frame: AudioFrame) -> Graph:
        """Fill gaps; play slower; restore the rate, then the tempo."""
        low = round(self._rate * FREQUENCY_FACTOR)
        graph = Graph()
        graph.link_nodes(
            graph.add_abuffer(
                sample_rate=frame.sample_rate,
                format=frame.format,
                layout=frame.layout,
                time_base=frame.time_base,
            ),
            graph.add("aresample", f"{self._rate}:async=1:min_hard_comp={_JUMP}"),
            graph.add("aformat", f"sample_fmts=fltp:channel_layouts={self._layout}"),
            graph.add("asetrate", str(low)),
            graph.add("aresample", str(self._rate)),
            graph.add("atempo", f"{self._rate / low:.15g}"),
            graph.add(
                "aformat", f"sample_fmts=fltp:sample_rates={self._rate}:channel_layouts={self._layout}"
            ),
            graph.add("abuffersink"),
        ).configure()
        return graph

    def _drain(self) -> Iterator[AnyPacket]:
        """What the filters still hold."""
        if self._graph is not None:
            self._graph.push(None)
            yield from self._pull()
            self._graph = None

    def _pull(self) -> Iterator[AnyPacket]:
        assert self._graph is not None
        while True:
            try:
                frame = self._graph.pull()
            except (av.error.BlockingIOError, av.error.EOFError):
                return
            assert isinstance(frame, AudioFrame)
            yield from self._encode(np.asarray(frame.to_ndarray(), np.float32))

    def _encode(self, samples: NDArray[np.float32]) -> Iterator[AnyPacket]:
        """Encode samples (channels, n) as far as the input goes."""
        assert self._next is not None
        samples = samples[:, : max(self._end - self._next, 0)]
        if samples.shape[1] == 0:
            return
        frame = AudioFrame.from_ndarray(np.ascontiguousarray(samples), "fltp", self._layout)
        frame.sample_rate, frame.time_base, frame.pts = self._rate, Fraction(1, self._rate), self._next
        self._next += samples.shape[1]
        yield from self.stream.encode(frame)

    def finish(self) -> Iterator[AnyPacket]:
        """The rest, as long as the input."""
        yield from self._drain()
        if self._next is not None:
            missing = max(self._end - self._next, 0)
            yield from self._encode(np.zeros((self.stream.channels, missing), np.float32))
            yield from self.stream.encode(None)


def _opens(name: str, rate: int, layout: str, bit_rate: int) -> bool:
    """Whether there is an encoder of that name that takes these settings without being an experiment."""
    if not has_encoder(name):
        return False
    context = av.CodecContext.create(av.Codec(name, "w"), "w")
    assert isinstance(context, AudioCodecContext)
    context.sample_rate, context.layout, context.bit_rate = rate, layout, bit_rate
    formats = context.codec.audio_formats
    if formats:
        context.format = formats[0]
    try:
        context.open()
    except (av.error.FFmpegError, ValueError):
        return False
    return True
