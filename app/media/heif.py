"""HEIC and AVIF pictures: the items of a HEIF file (ISO/IEC 23008-12), tiles put together, decoded by FFmpeg.

A phone stores a photo as a grid of tiles, each coded by itself; FFmpeg shows those as so many videos.  Transformations
(turn, mirror, crop) and colours are properties of an item; EXIF says nothing about them.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import av
import av.error
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext

from guise.app.media import colour
from guise.app.media.boxes import boxes, find
from guise.app.media.errors import MediaError
from guise.app.media.orientation import Orientation
from guise.app.media.yuv import YUV, Plane, read_planes, to_rgb

MAX_PIXELS = 1 << 30  # as OpenCV has it
# What codes an item: FFmpeg's decoder, and the property that has its headers.
_DECODERS = {
    b"hvc1": ("hevc", b"hvcC"),
    b"av01": ("libdav1d", b"av1C"),
    b"avc1": ("h264", b"avcC"),
    b"jpeg": ("mjpeg", b""),
}
_ALPHA = (b"urn:mpeg:mpegB:cicp:systems:auxiliary:alpha", b"urn:mpeg:hevc:2015:auxid:1")
_AV1C_HEADER = 4  # bytes of an av1C box before its units
_TURNS = {
    1: Orientation(transpose=True, flip_y=True),
    2: Orientation(flip_x=True, flip_y=True),
    3: Orientation(transpose=True, flip_x=True),
}  # by quarter turns anticlockwise (6.5.10)


@dataclass(frozen=True, eq=False)
class HeifPicture:
    """A picture as it is shown.

    pixels : (h, w) grey or (h, w, 3) RGB, uint8, or uint16 with `bits` significant ones scaled to the full range.
    alpha : (h, w) of the same type, or None.   profile : the bytes of its ICC profile, or None.
    code_points : its primaries and transfer as H.273 numbers them, or None.
    """

    pixels: Plane
    alpha: Plane | None
    bits: int
    profile: bytes | None
    code_points: tuple[int, int] | None


@dataclass
class Item:
    """A picture or something about one: its kind, where its bytes are, its properties in order.

    extents : (construction method, offset, length) of each part.
    """

    kind: bytes = b""
    extents: list[tuple[int, int, int]] = field(default_factory=list)
    properties: list[tuple[bytes, bytes]] = field(default_factory=list)

    def property(self, name: bytes) -> bytes | None:
        """The body of the first property of a name."""
        return next((body for found, body in self.properties if found == name), None)


def read_heif(data: bytes) -> HeifPicture:
    """The main picture of a HEIF file.  Raises MediaError with what is wrong, to follow the name of the file."""
    try:
        return _Heif(data).picture()
    except MediaError:
        raise
    except (struct.error, KeyError, IndexError, ValueError, cv2.error, av.error.FFmpegError) as error:
        raise MediaError("is a damaged HEIC or AVIF file: copy it anew from where it was taken.") from error


def main_item(data: bytes) -> tuple[Item, bytes]:
    """The main picture of an intact HEIF file, and its coded bytes."""
    file = _Heif(data)
    item = file.items[file.main]
    return item, file.bytes_of(item)


class _Heif:
    """The items of a file, from its meta box."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        meta = (find(data, b"meta") or b"")[4:]
        self._stored = find(meta, b"idat") or b""
        self.items: defaultdict[int, Item] = defaultdict(Item)
        self._references: defaultdict[bytes, list[tuple[int, list[int]]]] = defaultdict(list)
        self._read_kinds(find(meta, b"iinf") or b"")
        self._read_places(find(meta, b"iloc") or b"")
        self._read_properties(find(meta, b"iprp") or b"")
        self._read_references(find(meta, b"iref") or bytes(4))
        main = find(meta, b"pitm") or b""
        self.main = int.from_bytes(main[4:])

    def picture(self) -> HeifPicture:
        item = self.items[self.main]
        turns = [*item.properties]
        while item.kind == b"iden" and self._parts(self.main):  # another item, turned (6.6.2.1)
            self.main = self._parts(self.main).pop(0)
            item = self.items[self.main]
            turns = [*item.properties, *turns]
        decoded, about = self._decode(self.main), self._coloured(self.main)
        code_points, matrix, span = None, decoded.matrix, decoded.span
        profile = None
        for body in (body for name, body in about.properties if name == b"colr"):
            if body[:4] == b"nclx":
                *code_points_, matrix, full = struct.unpack(">HHHB", body[4:11])
                code_points, span = tuple(code_points_), colour.FULL if full & 0x80 else colour.LIMITED
            else:
                profile = body[4:]
        pixels = to_rgb(replace(decoded, matrix=matrix, span=span))
        alpha = self._alpha()
        shown = _transformed(pixels, turns)
        if alpha is not None and alpha.shape != pixels.shape[:2]:
            alpha = np.asarray(cv2.resize(alpha, pixels.shape[1::-1]), alpha.dtype)
        covered = None if alpha is None else _transformed(alpha.astype(pixels.dtype), turns)
        return HeifPicture(shown, covered, decoded.bits, profile, code_points)

    def _coloured(self, number: int) -> Item:
        """The item itself, or the first tile where only that says which colours it has."""
        item = self.items[number]
        parts = self._parts(number)
        return item if item.property(b"colr") or not parts else self.items[parts[0]]

    def _parts(self, number: int) -> list[int]:
        return next((to for source, to in self._references[b"dimg"] if source == number), [])

    def _alpha(self) -> Plane | None:
        """The main picture's alpha (h, w), full range."""
        for number, to in self._references[b"auxl"]:
            auxiliary = self.items[number].property(b"auxC") or b""
            if self.main in to and auxiliary[4:].split(b"\0")[0] in _ALPHA:
                decoded = self._decode(number)
                return to_rgb(replace(decoded, planes=decoded.planes[:1]))
        return None

    # -- the boxes ----------------------------------------------------------------------------------------

    def _read_kinds(self, body: bytes) -> None:
        start = 6 if body[0] == 0 else 8
        for _, entry in boxes(body[start:]):
            wide = entry[0] >= 3
            number = int.from_bytes(entry[4 : 8 if wide else 6])
            self.items[number].kind = entry[10 if wide else 8 :][:4]

    def _read_places(self, body: bytes) -> None:
        read = _Numbers(body[4:])
        version = body[0]
        offset, length = divmod(read.next(1), 16)
        base, index = divmod(read.next(1), 16)
        wide = 4 if version == 2 else 2
        for _ in range(read.next(wide)):
            item = self.items[read.next(wide)]
            construction = read.next(2) & 15 if version else 0
            read.next(2)
            start = read.next(base)
            for _ in range(read.next(2)):
                read.next(index if version else 0)
                place = start + read.next(offset)
                item.extents.append((construction, place, read.next(length)))

    def _read_properties(self, body: bytes) -> None:
        known = list(boxes(find(body, b"ipco") or b""))
        for table in (inner for name, inner in boxes(body) if name == b"ipma"):
            read = _Numbers(table[4:])
            item_bytes, property_bytes = 4 if table[0] else 2, 2 if table[3] & 1 else 1
            for _ in range(read.next(4)):
                item = self.items[read.next(item_bytes)]
                for _ in range(read.next(1)):
                    number = read.next(property_bytes) & (0x7FFF if property_bytes == 2 else 0x7F)
                    item.properties += known[number - 1 : number] if number else []

    def _read_references(self, body: bytes) -> None:
        wide = 4 if body[0] else 2
        for name, inner in boxes(body[4:]):
            read = _Numbers(inner)
            source = read.next(wide)
            self._references[name].append((source, [read.next(wide) for _ in range(read.next(2))]))

    def bytes_of(self, item: Item) -> bytes:
        """The data of an item; ValueError when it is not there."""
        parts = []
        for construction, start, length in item.extents:
            held = self._stored if construction == 1 else self._data
            part = held[start : start + length] if length else held[start:]
            if construction > 1 or len(part) < length:
                raise ValueError("the data of an item is not there")
            parts.append(part)
        return b"".join(parts)

    # -- pictures -----------------------------------------------------------------------------------------

    def _decode(self, number: int, *, inner: bool = False) -> YUV:
        item = self.items[number]
        if item.kind in _DECODERS:
            return _decoded(item, self.bytes_of(item))
        if item.kind == b"grid" and not inner:
            return self._grid(item, [self._decode(part, inner=True) for part in self._parts(number)])
        raise MediaError(
            f"holds a picture of kind {item.kind.decode('latin-1')!r}, which Guise does not read: save it as PNG first."
        )

    def _grid(self, item: Item, tiles: list[YUV]) -> YUV:
        """Tiles put together row by row (6.6.2.3)."""
        body = self.bytes_of(item)
        rows, columns = body[2] + 1, body[3] + 1
        width, height = struct.unpack_from(">II" if body[1] & 1 else ">HH", body, 4)
        tall, wide = tiles[0].planes[0].shape
        if len(tiles) != rows * columns or width > wide * columns or height > tall * rows:
            raise ValueError("the tiles do not cover the picture")
        if width * height > MAX_PIXELS:
            raise MediaError("is too large: give one of less than 32768 x 32768 pixels.")
        planes = []
        for k, first in enumerate(tiles[0].planes):
            h, w = first.shape
            whole = np.concatenate(
                [
                    np.concatenate([t.planes[k] for t in tiles[r * columns :][:columns]], axis=1)
                    for r in range(rows)
                ]
            )
            planes.append(whole[: -(-height * h // tall), : -(-width * w // wide)])
        return YUV(planes, tiles[0].bits, tiles[0].matrix, tiles[0].span)


class _Numbers:
    """Big-endian numbers, one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def next(self, size: int) -> int:
        """The next one, of `size` bytes; 0 for none."""
        part = self._data[self._at : self._at + size]
        if len(part) < size:
            raise ValueError("a table is cut")
        self._at += size
        return int.from_bytes(part)


def _decoded(item: Item, data: bytes) -> YUV:
    """One coded picture."""
    decoder, headers = _DECODERS[item.kind]
    size = item.property(b"ispe") or bytes(12)
    if np.prod(struct.unpack(">II", size[4:12]), dtype=np.int64) > MAX_PIXELS:
        raise MediaError("is too large: give one of less than 32768 x 32768 pixels.")
    context: Any = av.CodecContext.create(decoder, "r")
    assert isinstance(context, VideoCodecContext)
    context.thread_count = 1
    extra = item.property(headers) if headers else b""
    if extra and item.kind != b"av01":
        context.extradata = extra
    elif extra:
        data = (b"" if _has_sequence_header(data) else extra[_AV1C_HEADER:]) + data
    pictures = [*context.decode(av.Packet(data)), *context.decode(None)]
    if not pictures or pictures[0].is_corrupt:
        raise ValueError("an item cannot be decoded")
    picture = pictures[0]
    bits = max(component.bits for component in picture.format.components)
    full = picture.format.name.startswith("yuvj") or picture.color_range == colour.FULL
    matrix = colour.RGB if picture.format.name.startswith("gbr") else int(picture.colorspace)
    return YUV(read_planes(picture, bits), bits, matrix, colour.FULL if full else colour.LIMITED)


def _has_sequence_header(data: bytes) -> bool:
    """Whether AV1 data begins with a sequence header, perhaps after a temporal delimiter (AV1, 5.3.1)."""
    return data[:1] in (b"\x0a", b"\x08") or data[:3] == b"\x12\x00\x0a"


def _transformed(plane: Plane, properties: Sequence[tuple[bytes, bytes]]) -> Plane:
    """A decoded picture as shown: cropped, turned and mirrored as its properties say, in their order."""
    for name, body in properties:
        if name == b"clap":
            plane = _cropped(plane, body)
        elif name == b"irot" and body[0] & 3:
            plane = _TURNS[body[0] & 3].view(plane)
        elif name == b"imir":
            plane = Orientation(flip_x=bool(body[0] & 1), flip_y=not body[0] & 1).view(plane)
    return np.ascontiguousarray(plane)


def _cropped(plane: Plane, body: bytes) -> Plane:
    """The clean aperture of a picture (ISO/IEC 14496-12, 12.1.4), to whole pixels."""
    n = struct.unpack(">IIIIiIiI", body[:32])
    width, height, right, down = (n[i] / n[i + 1] for i in range(0, 8, 2))
    h, w = plane.shape[:2]
    x, y = round((w - width) / 2 + right), round((h - height) / 2 + down)
    if x < 0 or y < 0 or width < 1 or height < 1 or x + width > w + 0.5 or y + height > h + 0.5:
        raise ValueError("the crop is not within the picture")
    return plane[y : y + round(height), x : x + round(width)]
