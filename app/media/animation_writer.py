"""Writing animations: GIF, PNG and AVIF by FFmpeg, WebP picture by picture.  Times are in seconds."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import av
import cv2
import numpy as np
from av.video.stream import VideoStream
from numpy.typing import NDArray

from guise.app.media import colour
from guise.app.media.boxes import box
from guise.app.media.encoder import EncodeOptions, encoder_settings, ordinary_priority
from guise.app.media.errors import MediaError
from guise.app.media.image_writing import XMP_BOX, with_chunk, with_tags, xmp
from guise.app.media.yuv import from_rgb

FORMS = {".gif": "gif", ".webp": "webp", ".png": "apng", ".apng": "apng", ".avif": "avif"}
LOSSLESS = frozenset({"webp", "apng"})  # the others never are
_AVIF_SIDE = 64  # least pixels; SVT-AV1 waits for ever for the rows of flat pictures
_WEBP_QUALITY = 90  # of lossy pictures, of 100
_GIF_XMP = b"\x21\xff\x0bXMP DataXMP"  # an application extension, and how it ends (XMP, part 3, 1.1.2)
_GIF_XMP_END = b"\1" + bytes(range(255, -1, -1)) + b"\0"


def can_move(path: Path) -> bool:
    """Whether a video can be written as a picture of this name; .png stays a single picture."""
    return path.suffix.lower() in FORMS.keys() - {".png"}


class AnimationWriter(Protocol):
    """Writes an animation to a file, picture by picture."""

    def add(self, rgba: NDArray[np.uint8], start: Fraction, end: Fraction) -> None:
        """Write a picture (h, w, 3 or 4), shown from start to end."""

    def close(self) -> None:
        """Complete the file; also after an error."""


def open_writer(
    path: Path, form: str, size: tuple[int, int], plays: int, *, alpha: bool, lossless: bool
) -> AnimationWriter:
    """A writer for a form of FORMS.

    size : width, height.   plays : how often it is played, 0 for ever.   alpha : pictures are RGBA instead of RGB.
    """
    if form == "avif" and min(size) < _AVIF_SIDE:
        raise MediaError(
            f"An animated AVIF has at least {_AVIF_SIDE} pixels a side, not {size[0]} x {size[1]}: write to .webp."
        )
    if form == "webp":
        return _WebP(path, size, plays, alpha=alpha, lossless=lossless)
    return _Muxed(path, form, size, plays, alpha=alpha)


def add_profile(path: Path, form: str, profile: bytes) -> None:
    """Put an ICC profile into a complete PNG or WebP file; the others hold none."""
    data = path.read_bytes()
    if form == "apng":
        path.write_bytes(with_chunk(data, b"iCCP" + b"icc\0\0" + zlib.compress(profile)))
    elif form == "webp":  # before all but its header, which is of 18 bytes
        start = 12 + 18
        chunks = bytearray(data[:start] + _chunk(b"ICCP", profile) + data[start:])
        chunks[4:8] = struct.pack("<I", len(chunks) - 8)
        chunks[20] |= _WEBP_PROFILE
        path.write_bytes(chunks)


def add_tags(path: Path, form: str, tags: Mapping[str, str]) -> None:
    """Put tags into a complete file, as XMP."""
    data, packet = path.read_bytes(), xmp(tags)
    if form == "apng":
        path.write_bytes(with_tags(data, "png", tags))
    elif form == "gif":
        path.write_bytes(data[:-1] + _GIF_XMP + packet + _GIF_XMP_END + data[-1:])
    elif form == "avif":
        path.write_bytes(data + box(b"uuid", XMP_BOX, packet))
    else:
        chunks = bytearray(data + _chunk(b"XMP ", packet))
        chunks[4:8] = struct.pack("<I", len(chunks) - 8)
        chunks[20] |= _WEBP_XMP
        path.write_bytes(chunks)


# FFmpeg's encoder, its options, and the unit of time
_CODERS = {
    "gif": ("gif", {}, Fraction(1, 100)),
    "apng": ("apng", {}, Fraction(1, 90_000)),
    "avif": (
        "libsvtav1",
        encoder_settings(EncodeOptions("libsvtav1", crf=20, preset="8")),
        Fraction(1, 90_000),
    ),
}


class _Muxed:
    """An animation that FFmpeg writes."""

    def __init__(self, path: Path, form: str, size: tuple[int, int], plays: int, *, alpha: bool) -> None:
        encoder, settings, self._unit = _CODERS[form]
        self._fmt = {"gif": "pal8", "avif": "yuv420p"}.get(form, "rgba" if alpha else "rgb24")
        loop = (plays - 1 or -1) if plays and form == "gif" else plays  # GIF counts repetitions
        self._container = av.open(
            str(path.absolute()), "w", format=form,
            container_options={"plays" if form == "apng" else "loop": str(loop)},
        )  # fmt: skip
        stream = self._container.add_stream(encoder, 25, settings)
        assert isinstance(stream, VideoStream)
        context = stream.codec_context
        context.width, context.height, context.pix_fmt = *size, self._fmt
        context.time_base = self._unit
        if form == "avif":
            context.color_range, context.colorspace = colour.FULL, colour.SMPTE170M
            context.color_primaries, context.color_trc = colour.BT709, 13
        with ordinary_priority():
            self._container.start_encoding()
        self._stream, self._ends, self._last = stream, dict[int, int](), 0
        self._path, self._form = path, form

    def add(self, rgba: NDArray[np.uint8], start: Fraction, end: Fraction) -> None:
        if self._form == "avif":
            picture = from_rgb(rgba[..., :3], self._fmt, 8)
        else:
            picture = av.VideoFrame.from_ndarray(
                np.ascontiguousarray(rgba), "rgba" if rgba.shape[2] == 4 else "rgb24"
            )
            picture = _with_palette(picture) if self._form == "gif" else picture
        picture.pts, picture.time_base = round(start / self._unit), self._unit
        self._ends[picture.pts] = round(end / self._unit)
        self._last = picture.duration = self._ends[picture.pts] - picture.pts
        self._mux(picture)

    def _mux(self, picture: av.VideoFrame | None) -> None:
        for packet in self._stream.encode(picture):
            if packet.pts in self._ends:
                packet.duration = self._ends.pop(packet.pts) - packet.pts
            self._container.mux_one(packet)

    def close(self) -> None:
        self._mux(None)
        self._container.close()
        if self._form == "apng":
            self._path.write_bytes(_with_last_delay(self._path.read_bytes(), self._last * self._unit))


def _with_last_delay(data: bytes, delay: Fraction) -> bytes:
    """An animated PNG whose last picture is shown for so long, seconds; FFmpeg repeats the delay of the one before."""
    name = data.rfind(b"\0\0\0\x1afcTL") + 4
    if name < 4:
        return data
    delay = delay.limit_denominator(0xFFFF)
    body = bytearray(data[name : name + 30])
    body[24:28] = struct.pack(">HH", min(delay.numerator, 0xFFFF), delay.denominator)
    return data[:name] + body + struct.pack(">I", zlib.crc32(body)) + data[name + 34 :]


def _with_palette(picture: av.VideoFrame) -> av.VideoFrame:
    """The picture with the 256 colours that suit it best, one of them transparent if it has alpha."""
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=picture.width, height=picture.height, format=picture.format, time_base=Fraction(1, 100)
    )
    clear = int(picture.format.name == "rgba")
    split, sink = graph.add("split"), graph.add("buffersink")
    palette = graph.add("palettegen", f"stats_mode=single:reserve_transparent={clear}")
    use = graph.add("paletteuse", "new=1")
    source.link_to(split)
    split.link_to(palette, 0, 0)
    split.link_to(use, 1, 0)
    palette.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()
    picture.pts, picture.time_base = 0, Fraction(1, 100)
    graph.push(picture)
    graph.push(None)
    made: Any = graph.pull()
    assert isinstance(made, av.VideoFrame)
    return made


_WEBP_ALPHA, _WEBP_ANIMATED, _WEBP_XMP, _WEBP_PROFILE = 0x10, 0x02, 0x04, 0x20
_WEBP_SIDE = 16_383  # most pixels


class _WebP:
    """An animated WebP file: each picture whole, coded by OpenCV (the container: RFC 9649, 2.7).

    FFmpeg and libwebp leave out pictures that show what is shown already.
    """

    def __init__(self, path: Path, size: tuple[int, int], plays: int, *, alpha: bool, lossless: bool) -> None:
        if max(size) > _WEBP_SIDE:
            raise MediaError(
                f"A WebP picture has at most {_WEBP_SIDE} pixels a side, not {size[0]} x {size[1]}."
            )
        self._file, self._size = path.open("w+b"), size
        self._quality = 101 if lossless else _WEBP_QUALITY
        sides = _int24(size[0] - 1) + _int24(size[1] - 1)
        flags = _WEBP_ANIMATED | _WEBP_ALPHA * alpha
        self._file.write(b"RIFF\0\0\0\0WEBP" + _chunk(b"VP8X", bytes([flags, 0, 0, 0]) + sides))
        self._file.write(_chunk(b"ANIM", bytes(4) + struct.pack("<H", min(plays, 0xFFFF))))

    def add(self, rgba: NDArray[np.uint8], start: Fraction, end: Fraction) -> None:
        order = [2, 1, 0, 3][: rgba.shape[2]]
        stored = np.ascontiguousarray(rgba[..., order])
        done, data = cv2.imencode(".webp", stored, [cv2.IMWRITE_WEBP_QUALITY, self._quality])
        if not done:
            raise MediaError(f"A picture of {self._size[0]} x {self._size[1]} cannot be written as WebP.")
        parts = b"".join(_coded_parts(data.tobytes()))
        sides = _int24(self._size[0] - 1) + _int24(self._size[1] - 1)
        delay = round(end * 1000) - round(start * 1000)
        # at (0, 0); 2: not blended with the picture before
        self._file.write(_chunk(b"ANMF", bytes(6) + sides + _int24(delay) + b"\2" + parts))

    def close(self) -> None:
        self._file.seek(0, 2)
        size = self._file.tell()
        self._file.seek(4)
        self._file.write(struct.pack("<I", size - 8))
        self._file.close()


def _coded_parts(data: bytes) -> list[bytes]:
    """The chunks of a single picture that hold its pixels."""
    found, at = [], 12
    while at + 8 <= len(data):
        size = struct.unpack_from("<I", data, at + 4)[0]
        whole = data[at : at + 8 + size + size % 2]
        found += [whole] if whole[:4] in (b"ALPH", b"VP8 ", b"VP8L") else []
        at += len(whole)
    return found


def _chunk(name: bytes, body: bytes) -> bytes:
    return name + struct.pack("<I", len(body)) + body + b"\0" * (len(body) % 2)


def _int24(value: int) -> bytes:
    return value.to_bytes(3, "little")
