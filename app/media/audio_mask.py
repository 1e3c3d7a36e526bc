"""Masked audio: a disguised voice that stays in sync with the picture.

Pitch and formants are lowered together, as by a tape that runs slower; then overlap-add restores the tempo
(FFmpeg filters `asetrate`, `aresample`, `atempo`).  This deceives listeners; anyone who knows the factor can undo it.
Or the voice is made a whisper (`guise.app.media.whisper`).
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import av
import av.error
import numpy as np
from av.audio.codeccontext import AudioCodecContext
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.filter import Graph

from guise.app.media.encoder import find_codec
from guise.app.media.errors import MediaError
from guise.app.media.reader import AnyPacket, ProblemLog
from guise.app.media.whisper import Whisper
from guise.common.arrays import F32

FREQUENCY_FACTOR = Fraction(4, 5)
_UNNAMED_LAYOUTS = {"1 channels": "mono", "2 channels": "stereo"}
_MIN_CHANNEL_BIT_RATE = 64_000
_FALLBACK_SAMPLE_RATE = 48_000  # Hz, which every fallback codec takes
_MAX_GAP_SECONDS = 0.02  # between the input's time stamps; a longer gap is filled with silence


def named_layout(name: str) -> str:
    """The layout's name; MP4 needs one even where there is only a channel count."""
    return _UNNAMED_LAYOUTS.get(name, name)


class MaskedAudio:
    """One audio stream of the input, re-encoded with the voices masked.

    whisper : make voices a whisper instead of lowering them.   stream : of the output.
    """

    def __init__(
        self, audio: AudioStream, output: OutputContainer, problems: ProblemLog, *, whisper: bool = False
    ) -> None:
        self._problems = problems
        self._layout = named_layout(audio.layout.name)
        self.stream = self._add_stream(audio, output)
        self._rate = self.stream.rate
        self._whisper = Whisper(self._rate, self.stream.channels) if whisper else None
        self._graph: Graph | None = None
        self._kind: tuple[object, ...] = ()
        self._next: int | None = None  # where the output ends, and where the input, samples from time zero
        self._end = 0

    def _add_stream(self, audio: AudioStream, output: OutputContainer) -> AudioStream:
        """A stream in the input's codec, or in one that the container takes."""
        own = audio.codec_context.codec.canonical_name
        bit_rate = max(audio.bit_rate or 0, _MIN_CHANNEL_BIT_RATE * audio.channels)
        for name, rate in [
            (own, audio.rate),
            ("aac", audio.rate),
            ("libopus", audio.rate),
            ("libopus", _FALLBACK_SAMPLE_RATE),
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
            f"Masked sound of {audio.channels} channels cannot be stored in {output.format.name}: use .mp4."
        )

    def feed(self, packet: AnyPacket) -> Iterator[AnyPacket]:
        """Take a packet of the input; yields packets for the output."""
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
        """Fill gaps; and, unless voices are whispered, play slower, restore the rate, then the tempo."""
        low = self._rate if self._whisper else round(self._rate * FREQUENCY_FACTOR)
        graph = Graph()
        graph.link_nodes(
            graph.add_abuffer(
                sample_rate=frame.sample_rate,
                format=frame.format,
                layout=frame.layout,
                time_base=frame.time_base,
            ),
            graph.add("aresample", f"{self._rate}:async=1:min_hard_comp={_MAX_GAP_SECONDS}"),
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
        """Yield what the filters still hold."""
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
            samples = np.asarray(frame.to_ndarray(), np.float32)
            yield from self._encode(samples if self._whisper is None else self._whisper(samples))

    def _encode(self, samples: F32) -> Iterator[AnyPacket]:
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
        """Yield the rest, up to the length of the input."""
        yield from self._drain()
        if self._whisper is not None and self._next is not None:
            yield from self._encode(self._whisper.rest())
        if self._next is not None:
            missing = max(self._end - self._next, 0)
            yield from self._encode(np.zeros((self.stream.channels, missing), np.float32))
            yield from self.stream.encode(None)


def _opens(name: str, rate: int, layout: str, bit_rate: int) -> bool:
    """Whether there is a non-experimental encoder of that name that takes these settings."""
    if (codec := find_codec(name, "w")) is None:
        return False
    context = av.CodecContext.create(codec, "w")
    assert isinstance(context, AudioCodecContext)
    context.sample_rate, context.layout, context.bit_rate = rate, layout, bit_rate
    if formats := codec.audio_formats:
        context.format = formats[0]
    try:
        context.open()
    except (av.error.FFmpegError, ValueError):
        return False
    return True
