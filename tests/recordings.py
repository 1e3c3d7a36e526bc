"""Small recordings with sound, whose clock is as a test wants it."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import numpy as np

RATE, SAMPLES = 24, 48000  # pictures and samples per second
STEP, CLOCK = Fraction(1, RATE), Fraction(1, 90000)
_CODECS = {
    ".mpg": ("mpeg2video", "mp2"), ".vob": ("mpeg2video", "ac3"), ".webm": ("libvpx", "libopus"),
    ".wmv": ("wmv2", "wmav2"), ".avi": ("mpeg4", "mp2"),
}  # fmt: skip
_OPTIONS = {"libx264": {"preset": "ultrafast", "bf": "2"}, "mpeg2video": {"bf": "2"}}
Move = Callable[[Fraction], Fraction]
Adding = tuple[av.stream.Stream, bytes | None]


def stay(time: Fraction) -> Fraction:
    """The same time."""
    return time


def record(
    path: Path, start: Fraction | int = 0, frames: int = 24, *, pictures: Move = stay, sound: Move | None = stay,
    codecs: tuple[str, str] | None = None, options: dict[str, str] | None = None,
    layout: str = "stereo",
) -> Path:  # fmt: skip
    """A recording of 64 x 48 pixels.

    start : time of the first picture and sample, seconds.   frames : pictures, beside as much sound.
    pictures, sound : what their times become; None for no sound.   codecs : of pictures and sound.
    options : of the container.   layout : of the sound's channels.
    """
    codec, other = codecs or _CODECS.get(path.suffix, ("libx264", "aac"))
    with av.open(str(path), "w", container_options=options or {}) as out:
        packets = _pictures(out, codec, [pictures(start + i * STEP) for i in range(frames)])
        if sound is not None:
            audio = out.add_stream(other, SAMPLES, layout=layout)
            audio.bit_rate = 128_000
            audio.codec_context.open()
            size = audio.codec_context.frame_size or 1024
            blocks = range(int(frames * STEP * SAMPLES / size))
            packets += _sound(audio, [sound(start + Fraction(i * size, SAMPLES)) for i in blocks], size)
        for packet in sorted(packets, key=lambda p: p.dts * p.time_base):
            out.mux(packet)
    return path


def _pictures(out: av.container.OutputContainer, codec: str, times: list[Fraction]) -> list[av.Packet]:
    stream = out.add_stream(codec, RATE, _OPTIONS.get(codec, {}))
    stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
    clock = STEP if codec in ("mpeg2video", "mpeg4", "wmv2") else CLOCK
    stream.codec_context.time_base = clock
    stream.bit_rate = 4_000_000  # a program stream has wrong times where several pictures share a packet
    packets = []
    for index, time in enumerate(times):
        noise = np.random.default_rng(index).integers(0, 255, (48, 64, 3), np.uint8)
        frame = av.VideoFrame.from_ndarray(noise, "rgb24").reformat(format="yuv420p")
        frame.pts, frame.time_base = round(time / clock), clock
        packets += stream.encode(frame)
    return packets + stream.encode(None)


def _sound(stream: av.AudioStream, times: list[Fraction], size: int) -> list[av.Packet]:
    packets = []
    for index, time in enumerate(times):
        channels = stream.codec_context.channels
        noise = np.random.default_rng(index).normal(0, 0.1, (size // 16 + 1, channels)).astype(np.float32)
        noise = np.repeat(noise, 16, axis=0)[:size].reshape(1, -1).copy()
        frame = av.AudioFrame.from_ndarray(noise, "flt", stream.layout.name)
        frame.sample_rate, frame.pts, frame.time_base = SAMPLES, round(time * SAMPLES), Fraction(1, SAMPLES)
        packets += stream.encode(frame)
    return packets + stream.encode(None)


def join(path: Path, *parts: Path) -> Path:
    """Files one after the other."""
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    return path


def times(path: Path) -> tuple[list[Fraction], list[Fraction]]:
    """The times of a file's shown pictures and of its packets of sound, seconds, ascending."""
    with av.open(str(path)) as media:
        pictures = [frame.pts * frame.time_base for frame in media.decode(video=0)]
    with av.open(str(path)) as media:
        found = media.demux(audio=0) if media.streams.audio else ()
        sound = [p.pts * p.time_base for p in found if p.size and p.pts is not None]
    return sorted(pictures), sorted(sound)


def steps(found: list[Fraction]) -> list[float]:
    """From one time to the next, seconds."""
    return [float(b - a) for a, b in pairwise(found)]


def with_streams(
    path: Path, source: Path, *add: Callable[[av.container.OutputContainer], Adding], chapters: bool = False
) -> Path:
    """A copy of a file with more streams, each with ten packets over its first second, or none for None.

    add : adds a stream to the output; returns it and the packets' content.   chapters : whether there is one.
    """
    with av.open(str(source)) as media, av.open(str(path), "w") as out:
        copies = {s.index: out.add_stream_from_template(s, opaque=True) for s in media.streams}
        added = [function(out) for function in add]
        if chapters:
            entry = {
                "id": 1,
                "start": 0,
                "end": 500,
                "time_base": Fraction(1, 1000),
                "metadata": {"title": "a"},
            }
            out.set_chapters([entry])
        out.start_encoding()
        for stream, content in added:
            for number in range(0 if content is None else 10):
                packet = av.Packet(content)
                packet.pts = packet.dts = 100 * number
                packet.duration, packet.time_base, packet.stream = 100, Fraction(1, 1000), stream
                out.mux(packet)
        for packet in media.demux():
            if packet.size:
                packet.stream = copies[packet.stream_index]
                out.mux(packet)
    return path
