"""Videos of 12 containers, 11 codecs and odd clocks through the media layer: what differs and is not told.

Nothing is drawn.  A file and its copy are read by PyAV alone and compared: streams, pictures, packets of sound, and the
times of both after the first picture.  A difference that a note names is none: streams that are left out, sound that is
encoded anew, a clock that jumps (then pictures must come at even steps), times that do not ascend.
"""

from __future__ import annotations

import argparse
import os
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import av.error
import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from guise.app.media import EncodeOptions, MediaError, open_input, open_sink, process

RATE, SAMPLES, FRAMES = 24, 48000, 24
CLOCK = Fraction(1, 90000)
WRAP = Fraction(2**33, 90000)  # seconds, after which the clock of a transport stream begins again
MOST_OFF = 0.0021  # seconds: containers with a clock of milliseconds round twice
# By suffix, the sound; all codecs are tried in each, and a container refuses what it has not.
CONTAINERS = {
    "mp4": "aac", "mov": "pcm_s16le", "3gp": "aac", "mkv": "libopus", "webm": "libopus", "avi": "mp2", "ts": "ac3",
    "vob": "mp2", "flv": "aac", "wmv": "wmav2", "nut": "flac", "mxf": "pcm_s16le",
}  # fmt: skip
CODECS = {
    "libx264": {"preset": "ultrafast", "bf": "2"}, "libx265": {"preset": "ultrafast", "x265-params": "log-level=none"},
    "libvpx": {"deadline": "realtime"}, "libvpx-vp9": {"deadline": "realtime"}, "libsvtav1": {"preset": "12"},
    "mpeg4": {"bf": "2"}, "mpeg2video": {"bf": "2"}, "mjpeg": {}, "prores_ks": {}, "ffv1": {}, "wmv2": {},
}  # fmt: skip
TICKING = ("mpeg4", "mpeg2video", "wmv2", "prores_ks")  # codecs whose own clock ticks once a picture
# Containers that store no others: the times of pictures in another order can be told only where their steps are even.
DECODING_TIMES = ("avi", "wmv", "mxf")
REORDERING = ("libx264", "libx265", "mpeg4", "mpeg2video")
EVEN = ("steady", "early", "sound late", "a day")
JOINABLE = ("ts", "vob", "flv", "mkv", "webm")
Times = Callable[[Fraction], Fraction]
CLOCKS: dict[str, tuple[Times, Times]] = {  # what becomes of the times of pictures and of sound, seconds
    "steady": (lambda t: t, lambda t: t),
    "uneven": (lambda t: t + Fraction(int(t * RATE) // 3, RATE), lambda t: t),
    "late": (lambda t: t + 5, lambda t: t + 5),
    "early": (lambda t: t - Fraction(1, 2), lambda t: t - Fraction(1, 2)),
    "sound late": (lambda t: t, lambda t: t + Fraction(3, 4)),
    "pictures late": (lambda t: t + Fraction(3, 4), lambda t: t),
    "a day": (lambda t: t + WRAP - Fraction(1, 2), lambda t: t + WRAP - Fraction(1, 2)),
    "gap": (lambda t: t + 12 * (2 * t >= 1), lambda t: t + 12 * (2 * t >= 1)),
    "joined": (lambda t: t, lambda t: t),
}


def write(path: Path, codec: str, sound: str, clock: str) -> None:
    """A clip of one second; ValueError or FFmpegError where container, codec and clock do not go together."""
    pictures, heard = CLOCKS[clock]
    with av.open(str(path), "w") as out:
        video = out.add_stream(codec, RATE, CODECS[codec])
        video.width, video.height = 64, 64
        video.pix_fmt = (
            "yuv422p10le" if codec == "prores_ks" else "yuvj420p" if codec == "mjpeg" else "yuv420p"
        )
        unit = Fraction(1, RATE) if codec in TICKING or path.suffix == ".mxf" else CLOCK
        video.codec_context.time_base, video.bit_rate = unit, 4_000_000
        audio = out.add_stream(sound, SAMPLES, layout="stereo")
        audio.bit_rate = 128_000
        audio.codec_context.open()
        size = audio.codec_context.frame_size or 1024
        packets = []
        for number in range(FRAMES):
            noise = np.random.default_rng(number).integers(0, 255, (64, 64, 3), np.uint8)
            frame = av.VideoFrame.from_ndarray(noise, "rgb24").reformat(format=video.pix_fmt)
            frame.pts, frame.time_base = round(pictures(Fraction(number, RATE)) / unit), unit
            packets += video.encode(frame)
        packets += video.encode(None)
        planar, kind = audio.format.is_planar, audio.format.name
        for begin in range(0, FRAMES * SAMPLES // RATE, size):
            values = np.zeros((2, size) if planar else (1, 2 * size))
            block = av.AudioFrame.from_ndarray(values.astype(_TYPES[kind.rstrip("p")]), kind, "stereo")
            block.sample_rate, block.time_base = SAMPLES, Fraction(1, SAMPLES)
            block.pts = round(heard(Fraction(begin, SAMPLES)) * SAMPLES)
            packets += audio.encode(block)
        packets += audio.encode(None)
        for packet in sorted(packets, key=lambda p: p.dts * p.time_base):
            out.mux(packet)
    if clock == "joined":
        path.write_bytes(2 * path.read_bytes())


_TYPES = {"flt": np.float32, "s16": np.int16, "s32": np.int32}


@dataclass(frozen=True)
class Found:
    """What is in a file: its streams, and times of pictures and of packets of sound, seconds.

    Samples without a codec have no packets of their own, so that only their beginning counts.
    """

    streams: tuple[str, ...]
    pictures: list[Fraction]
    sound: list[Fraction]


def read(path: Path) -> Found:
    """A file as PyAV alone reads it; what is left out by an edit list is not there."""
    with av.open(str(path)) as media:
        streams = tuple(sorted(s.type for s in media.streams if s.type != "data"))
        frames = [frame for frame in media.decode(video=0) if frame.pts is not None]
        pictures = sorted(frame.pts * frame.time_base for frame in frames)
        known = (
            media.streams.video[0].codec_context.name != "mpeg4"
        )  # whose demuxers tell the pictures' times
    if path.suffix[1:] in DECODING_TIMES and known:
        with av.open(str(path)) as media:
            found = [p.dts * p.time_base for p in media.demux(video=0) if p.size and p.dts is not None]
        pictures = [time - min(found[0], 0) for time in found]
    with av.open(str(path)) as media:
        packets = [p for p in media.demux(audio=0) if p.size and p.pts is not None]
        heard = [p.pts * p.time_base for p in packets]
        raw = media.streams.audio[0].name.startswith("pcm")
    return Found(streams, pictures, heard[:1] if raw else heard)


def differences(before: Found, after: Found, notes: str, given: Sequence[Fraction]) -> Iterator[str]:
    """What differs without a note from the input, and from the times that its pictures were given."""
    anew = "encoded anew" in notes or "left out" in notes
    if before.streams != after.streams and "left out" not in notes:
        yield f"streams {before.streams} became {after.streams}"
    if len(before.pictures) != len(after.pictures):
        yield f"{len(before.pictures)} pictures became {len(after.pictures)}"
    if len(before.sound) != len(after.sound) and not anew:
        yield f"{len(before.sound)} packets of sound became {len(after.sound)}"
    if "jumps" in notes:
        steps = [float(b - a) for a, b in pairwise(after.pictures)]
        if max(steps, default=0) - min(steps, default=0) > MOST_OFF:
            yield f"steps of {min(steps):.4f} to {max(steps):.4f} s"
        return
    if "not ascend" in notes:
        return
    times = [("pictures", before.pictures, before.pictures[0], after.pictures)]
    if len(given) == len(before.pictures):
        times += [("pictures, as they were given,", list(given), given[0], after.pictures)]
    times += [("sound", before.sound, before.pictures[0], after.sound)] * (not anew)
    for what, old, first, new in times:
        off = max(
            (float(abs((b - after.pictures[0]) - (a - first))) for a, b in zip(old, new, strict=False)),
            default=0,
        )
        if off > MOST_OFF:
            yield f"{what} up to {off:.4f} s elsewhere"


def measure(options: argparse.Namespace) -> Report:
    """All that can be written, to MP4, Matroska and transport streams."""
    os.environ["SVT_LOG"] = "1"
    tried: Counter[str] = Counter()
    said: Counter[tuple[str, str]] = Counter()
    rows: list[tuple[str, str, str, str, str]] = []
    targets = ("mp4",) if options.quick else ("mp4", "mkv", "ts")
    with tempfile.TemporaryDirectory() as folder:
        for suffix, codec, clock in _cases(options.quick):
            source = Path(folder) / f"in.{suffix}"
            try:
                write(source, codec, CONTAINERS[suffix], clock)
                before = read(source)
            except (ValueError, IndexError, av.error.FFmpegError):
                continue  # they do not go together, or nobody reads it
            if not before.pictures:
                continue
            tried[suffix] += 1
            told = suffix not in DECODING_TIMES or clock == "steady"
            given = [CLOCKS[clock][0](Fraction(n, RATE)) for n in range(FRAMES * told)]
            for target in targets:
                name = (suffix, codec, clock, target)
                found, notes = _copied(source, Path(folder) / f"out.{target}", before, given)
                rows += [(*name, text) for text in found]
                said.update((suffix, re.sub(r"[\d.]+ s", "T s", note)) for note in notes)
    common.say(f"{sum(tried.values())} files")
    return Report(
        "containers", "Videos of all containers, codecs and clocks, copied",
        [
            Criterion("differences that no note names", len(rows), "<=", 0),
            Criterion("files copied", sum(tried.values()), ">=", 12 if options.quick else 300),
        ],
        [
            Table("Files by container", ("container", "files"), list(tried.items())),
            Table("Notes", ("container", "note", "times"), [(*note, n) for note, n in said.items()]),
            Table("Differences", ("container", "codec", "clock", "to", "what"), rows),
        ],
    )  # fmt: skip


def _cases(quick: bool) -> Iterator[tuple[str, str, str]]:
    for suffix in CONTAINERS:
        for codec in CODECS:
            for clock in ("steady", "joined") if quick else CLOCKS:
                known = clock != "joined" or suffix in JOINABLE
                if suffix in DECODING_TIMES and codec in REORDERING:
                    known = clock in EVEN
                if known and (not quick or codec in ("libx264", "mpeg2video")):
                    yield suffix, codec, clock


def _copied(
    source: Path, target: Path, before: Found, given: Sequence[Fraction]
) -> tuple[list[str], list[str]]:
    """The differences of a file's copy, and the notes."""
    try:
        with (
            open_input(source) as media,
            open_sink(target, media, EncodeOptions(preset="ultrafast", crf=40), force=True) as sink,
        ):
            process(media, sink, lambda frame: None)
            notes = list(media.problems)
        return list(differences(before, read(target), " ".join(notes), given)), notes
    except MediaError as error:
        return [str(error)], []


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
