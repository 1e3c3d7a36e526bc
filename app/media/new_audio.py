"""Audio that is encoded anew, in sync with the picture: as it is, or masked, with a disguised voice.

Pitch and formants are lowered together, as by a tape that runs slower; then overlap-add restores the tempo
(FFmpeg filters `asetrate`, `aresample`, `atempo`).  This deceives listeners; anyone who knows the factor can undo it.
Or the voice is made a whisper (`guise.app.media.whisper`).
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Literal

import av
import av.error
import numpy as np
from av.audio.codeccontext import AudioCodecContext
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.filter import Graph

from guise.app.media.encoder import find_codec
from guise.app.media.problems import ProblemLog
from guise.app.media.reader import AnyPacket
from guise.app.media.trial import SoundEncoding
from guise.app.media.whisper import Whisper
from guise.common.arrays import F32

FREQUENCY_FACTOR = Fraction(4, 5)
_UNNAMED_LAYOUTS = {"1 channels": "mono", "2 channels": "stereo"}
_CHANNEL_BIT_RATES = 64_000, 160_000  # a channel's least, and its most where sound changes its codec
_COMMON_RATE = 48_000  # Hz, which every fallback codec takes
_LAYOUTS = {1: "mono", 2: "stereo", 3: "3.0", 4: "quad", 5: "5.0", 6: "5.1", 7: "6.1", 8: "7.1"}
_MAX_GAP_SECONDS = 0.02  # between the input's time stamps; a longer gap is filled with silence


def named_layout(name: str) -> str:
    """The layout's name; MP4 needs one even where there is only a channel count."""
    return _UNNAMED_LAYOUTS.get(name, name)


Voice = Literal["keep", "mask", "disguise"]


class NewAudio:
    """One audio stream of the input, encoded anew.

    voice : kept, lowered (mask) or made a whisper (disguise).   stream : of the output.
    """

    def __init__(
        self, encoding: SoundEncoding, output: OutputContainer, problems: ProblemLog, voice: Voice
    ) -> None:
        self._problems, self._voice = problems, voice
        self._layout = encoding.layout
        self.stream = encoding.add_to(output)
        self._rate = self.stream.rate
        self._whisper = Whisper(self._rate, self.stream.channels) if voice == "disguise" else None
        self._graph: Graph | None = None
        self._decoder: AudioCodecContext | None = None
        self._kind: tuple[str, str, int, Fraction | None] | None = None
        self._next: int | None = None  # where the output ends, and where the input, samples from time zero
        self._end = 0

    def feed(self, packet: AnyPacket) -> Iterator[AnyPacket]:
        """Take a packet of the input; yields packets for the output."""
        assert isinstance(packet.stream, AudioStream)
        self._decoder = packet.stream.codec_context
        yield from self._decoded(packet)

    def _decoded(self, packet: AnyPacket | None) -> Iterator[AnyPacket]:
        if self._decoder is None:
            return
        try:
            frames = self._decoder.decode(packet)
        except EOFError:
            return
        except av.error.FFmpegError as error:
            self._problems.note(f"A damaged sound packet was replaced by silence ({error.strerror}).")
            return
        for frame in frames:
            yield from self._filtered(frame)

    def _filtered(self, frame: AudioFrame) -> Iterator[AnyPacket]:
        if frame.pts is None and self._kind and (unit := self._kind[3]):  # the last one of some decoders
            frame.time_base, frame.pts = unit, round(Fraction(self._end, self._rate) / unit)
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
        """Fill gaps; and, where voices are lowered, play slower, restore the rate, then the tempo."""
        low = round(self._rate * FREQUENCY_FACTOR)
        lowered = [
            ("asetrate", str(low)),
            ("aresample", str(self._rate)),
            ("atempo", f"{self._rate / low:.15g}"),
        ]
        form = f"sample_fmts=flt:sample_rates={self._rate}:channel_layouts={self._layout}"
        graph = Graph()
        source = graph.add_abuffer(
            sample_rate=frame.sample_rate,
            format=frame.format,
            layout=frame.layout,
            time_base=frame.time_base,
        )
        filters = [
            ("aresample", f"{self._rate}:async=1:min_hard_comp={_MAX_GAP_SECONDS}"),
            ("aformat", f"sample_fmts=fltp:channel_layouts={self._layout}"),
            *(lowered if self._voice == "mask" else []),
            ("aformat", form),
        ]
        graph.link_nodes(source, *(graph.add(*f) for f in filters), graph.add("abuffersink")).configure()
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
            # packed, as PyAV 18 miscounts the planes of eight channels
            samples = np.asarray(frame.to_ndarray(), np.float32).reshape(frame.samples, -1).T
            yield from self._encode(samples if self._whisper is None else self._whisper(samples))

    def _encode(self, samples: F32) -> Iterator[AnyPacket]:
        """Encode samples (channels, n) as far as the input goes."""
        assert self._next is not None
        samples = samples[:, : max(self._end - self._next, 0)]
        if samples.shape[1] == 0:
            return
        packed = np.ascontiguousarray(samples.T).reshape(1, -1)
        frame = AudioFrame.from_ndarray(packed, "flt", self._layout)
        frame.sample_rate, frame.time_base, frame.pts = self._rate, Fraction(1, self._rate), self._next
        self._next += samples.shape[1]
        yield from self.stream.encode(frame)

    def finish(self) -> Iterator[AnyPacket]:
        """Yield the rest, up to the length of the input."""
        yield from self._decoded(None)
        yield from self._drain()
        if self._whisper is not None and self._next is not None:
            yield from self._encode(self._whisper.rest())
        if self._next is not None:
            missing = max(self._end - self._next, 0)
            yield from self._encode(np.zeros((self.stream.channels, missing), np.float32))
            yield from self.stream.encode(None)


def sound_encodings(audio: AudioStream, *, own: bool) -> Iterator[SoundEncoding]:
    """Encodings for a stream that work here, the best first: in its own codec if it may be that, then common ones."""
    layout, name = named_layout(audio.layout.name), audio.codec_context.codec.canonical_name
    least, most = _CHANNEL_BIT_RATES
    bit_rate = max(audio.bit_rate or 0, least * audio.channels)
    if own and _opens(encoding := SoundEncoding(name, audio.rate, layout, bit_rate)):
        yield encoding
    plain = _LAYOUTS.get(audio.channels, "stereo")  # one that every encoder takes
    for name, rate, kind in [
        ("aac", audio.rate, layout), ("libopus", audio.rate, layout), ("libopus", _COMMON_RATE, layout),
        *((name, _COMMON_RATE, kind) for kind in (plain, "stereo") for name in ("aac", "libopus")),
    ]:  # fmt: skip
        enough = min(bit_rate, most * av.AudioLayout(kind).nb_channels)
        if _opens(encoding := SoundEncoding(name, rate, kind, enough)):
            yield encoding


def _opens(encoding: SoundEncoding) -> bool:
    """Whether there is a non-experimental encoder of that name that takes these settings."""
    if (codec := find_codec(encoding.name, "w")) is None:
        return False
    context = av.CodecContext.create(codec, "w")
    assert isinstance(context, AudioCodecContext)
    context.sample_rate, context.layout = encoding.rate, encoding.layout
    context.bit_rate = encoding.bit_rate
    if formats := codec.audio_formats:
        context.format = formats[0]
    try:
        context.open()
    except (av.error.FFmpegError, ValueError):
        return False
    return True
