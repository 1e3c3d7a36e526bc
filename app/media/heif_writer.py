"""Writing HEIC and AVIF pictures: one item, its alpha and its XMP in a HEIF file (ISO/IEC 23008-12)."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import av
import cv2
import numpy as np
from av.video.stream import VideoStream
from numpy.typing import NDArray

from guise.app.media import colour
from guise.app.media.boxes import box, find, full_box
from guise.app.media.heif import HeifPicture, main_item
from guise.app.media.yuv import Plane, from_rgb

_SRGB = (1, 13)  # primaries and transfer, as H.273 numbers them
_X265 = {"crf": "14", "x265-params": "log-level=error:info=0"}
_AVIF_QUALITY = 95  # of 100
_ALPHA = b"urn:mpeg:mpegB:cicp:systems:auxiliary:alpha\0"
_SAMPLE_ENTRY = (
    8 + 78
)  # bytes of a sample description before its boxes: counts, then the entry (14496-12, 12.1.3)
_XMP_TYPE = b"application/rdf+xml\0"


@dataclass(frozen=True)
class _Coded:
    """A coded picture: the kind of its item, its data, the property with its headers, and its matrix (H.273)."""

    kind: bytes
    data: bytes
    headers: bytes
    matrix: int


def write_heif(picture: HeifPicture, form: str, xmp: bytes) -> bytes:
    """The bytes of a file.

    picture : of more than 8 bits, 10 are written.   form : "heic" or "avif".   xmp : a packet, or b"" for none.
    """
    bits = 8 if picture.bits == 8 else 10
    code = _av1 if form == "avif" else _hevc
    items = [code(plane, bits) for plane in (picture.pixels, picture.alpha) if plane is not None]
    kinds = [struct.pack(">HH4sx", number, 0, item.kind) for number, item in enumerate(items, start=1)]
    links = [box(b"auxl", struct.pack(">HHH", 2, 1, 1))] * (len(items) - 1)
    data = [item.data for item in items]
    if xmp:
        data.append(xmp)
        kinds.append(struct.pack(">HH4sx", len(data), 0, b"mime") + _XMP_TYPE)
        links.append(box(b"cdsc", struct.pack(">HHH", len(data), 1, 1)))
    return _file(form.encode(), data, kinds, links, _properties(picture, bits, items))


def _properties(picture: HeifPicture, bits: int, items: Sequence[_Coded]) -> bytes:
    """The properties of the picture, and of its alpha if there are two items."""
    h, w = picture.pixels.shape[:2]
    code_points = struct.pack(">HHHB", *(picture.code_points or _SRGB), items[0].matrix, 0x80)
    shared = [full_box(b"ispe", struct.pack(">II", w, h)), full_box(b"pixi", bytes([3, bits, bits, bits]))]
    own = [items[0].headers, box(b"colr", b"nclx", code_points)]
    own += [box(b"colr", b"prof", picture.profile)] if picture.profile else []
    alpha = [part for item in items[1:] for part in (item.headers, full_box(b"auxC", _ALPHA))]
    tables = [_associated(1, [1, 2, *range(3, 3 + len(own))])]
    tables += [_associated(2, [1, 2, *range(3 + len(own), 5 + len(own))])] if alpha else []
    known = box(b"ipco", *shared, *own, *alpha)
    return box(b"iprp", known, full_box(b"ipma", struct.pack(">I", len(tables)), *tables))


def _associated(item: int, numbers: Sequence[int]) -> bytes:
    """The properties of an item by number; the third one, its headers, is essential."""
    return struct.pack(">HB", item, len(numbers)) + bytes(
        number | 0x80 * (place == 2) for place, number in enumerate(numbers)
    )


def _file(
    brand: bytes, data: Sequence[bytes], kinds: Sequence[bytes], links: Sequence[bytes], properties: bytes
) -> bytes:
    """A file with items of these data, counted from 1; the first is the picture."""
    head = box(b"ftyp", brand, bytes(4), b"mif1", brand, b"miaf")
    infos = [full_box(b"infe", kind, version=2) for kind in kinds]

    def meta(start: int) -> bytes:
        places = b""
        for number, part in enumerate(data, start=1):
            places += struct.pack(">HHHII", number, 0, 1, start, len(part))
            start += len(part)
        return full_box(
            b"meta",
            full_box(b"hdlr", bytes(4), b"pict", bytes(13)),
            full_box(b"pitm", struct.pack(">H", 1)),
            full_box(b"iloc", b"\x44\0", struct.pack(">H", len(data)), places),
            full_box(b"iinf", struct.pack(">H", len(infos)), *infos),
            full_box(b"iref", *links) if links else b"",
            properties,
        )

    start = len(head) + len(meta(0)) + 8
    return head + meta(start) + box(b"mdat", *data)


def _hevc(plane: Plane, bits: int) -> _Coded:
    """A picture (h, w) or (h, w, 3) coded by x265, with chroma at half the size where that is even."""
    h, w = plane.shape[:2]
    fmt = ("yuv420p" if h % 2 == w % 2 == 0 else "yuv444p") + ("" if bits == 8 else "10le")
    picture = from_rgb(plane, fmt, bits)
    held = io.BytesIO()
    with av.open(held, "w", format="mp4") as output:
        stream = output.add_stream("libx265", 1, _X265)
        assert isinstance(stream, VideoStream)
        context = stream.codec_context
        context.width, context.height, context.pix_fmt = w, h, fmt
        context.color_range, context.colorspace = colour.FULL, colour.SMPTE170M
        for packet in [*stream.encode(picture), *stream.encode(None)]:
            packet.pts = packet.dts = 0  # x265 makes one up
            output.mux(packet)
    data = held.getvalue()
    table = find(data, b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd") or b""
    headers = find(table[8 + _SAMPLE_ENTRY :], b"hvcC") or b""
    return _Coded(b"hvc1", find(data, b"mdat") or b"", box(b"hvcC", headers), colour.SMPTE170M)


def _av1(plane: Plane, bits: int) -> _Coded:
    """A picture (h, w) or (h, w, 3) coded as OpenCV does, whose file has neither colours nor a profile."""
    values = _rgb16(plane)[..., ::-1] >> np.uint16(16 - bits)
    settings = [cv2.IMWRITE_AVIF_QUALITY, _AVIF_QUALITY, cv2.IMWRITE_AVIF_DEPTH, bits]
    done, data = cv2.imencode(".avif", values.astype(np.uint8) if bits == 8 else values, settings)
    assert done
    item, coded = main_item(data.tobytes())
    about = item.property(b"colr") or b""
    return _Coded(b"av01", coded, box(b"av1C", item.property(b"av1C") or b""), int.from_bytes(about[8:10]))


def _rgb16(plane: Plane) -> NDArray[np.uint16]:
    """Grey (h, w) or RGB (h, w, 3), uint8 or uint16, as 16-bit RGB (h, w, 3)."""
    deep = plane.astype(np.uint16) * np.uint16(257) if plane.dtype == np.uint8 else plane
    rgb = np.repeat(deep[..., None], 3, axis=2) if deep.ndim == 2 else deep
    return np.ascontiguousarray(rgb, np.uint16)
