"""What a file is, told by its content: one picture, several, or anything else, which is a video for FFmpeg to open.

A suffix counts only where the content says nothing, so that a photo whose name lies is still a photo.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Literal

from guise.app.media import ifd
from guise.app.media.boxes import boxes

# "image": one picture.  "animation": pictures with delays.  "pages": pictures that each stand for themselves.
FileKind = Literal["image", "animation", "pages", "video"]

_HEAD_BYTES = 1 << 16  # of a file, in which its kind is told
IMAGE_SUFFIXES = frozenset(
    {
        ".png", ".jpg", ".jpeg", ".jpe", ".jfif", ".mpo", ".bmp", ".dib", ".tif", ".tiff", ".webp", ".heic", ".heif",
        ".hif", ".avif", ".jp2", ".j2k", ".jpx",
    }
)  # fmt: skip
# Pictures that are read but not written; most are told by their suffix alone.
READ_ONLY_SUFFIXES = frozenset(
    {
        ".tga",
        ".pcx",
        ".sgi",
        ".ico",
        ".icns",
        ".ppm",
        ".pgm",
        ".pnm",
        ".qoi",
        ".dds",
        ".psd",
        ".hdr",
        ".exr",
        ".jxl",
    }
)
_STILL_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"mif1", b"mif2", b"avif", b"miaf"}
_SEQUENCE_BRANDS = {b"avis", b"msf1", b"hevc", b"hevx"}
_OTHERS = (
    b"8BPS",
    b"qoif",
    b"#?RADIANCE",
    b"DDS ",
    b"\xff\x0a",
    b"\0\0\0\x0cJXL ",
    b"\0\0\x01\0",
    b"v/1\x01",
)
_RAW = (b"II*\0\x10\0\0\0CR", b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"IIU\0", b"MMOR")
_BITMAP_HEADERS = {12, 40, 52, 56, 64, 108, 124}  # bytes of a bitmap's own header


def kind_of(path: Path) -> FileKind:
    """What a file holds; a file that is not there, or cannot be read, is what its suffix says."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
            form = format_of(head)
            if form in _SEVERAL:
                return _SEVERAL[form](file, head)
    except OSError:
        form = ""
    if form:
        return "image" if form != "video" else "video"
    return "image" if path.suffix.lower() in IMAGE_SUFFIXES | READ_ONLY_SUFFIXES else "video"


def is_picture(path: Path) -> bool:
    """Whether a file holds one picture."""
    return kind_of(path) == "image"


def has_image_name(path: Path) -> bool:
    """Whether the suffix is that of a picture that can be written."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def format_of(head: bytes) -> str:
    """The name of a picture's format from the first bytes of its file, "video", or "" where they do not tell.

    >>> format_of(b"GIF89a"), format_of(b"\\x1aE\\xdf\\xa3"), format_of(b"some text")
    ('gif', 'video', '')
    """
    for mark, form in _MARKS.items():
        if head.startswith(mark):
            return form
    if head.startswith(_OTHERS):
        return "other"
    if head.startswith(_RAW):
        return "raw"
    if head.startswith(_VIDEOS) or head[: 2 * _TS_PACKET + 1 : _TS_PACKET] == b"GGG":
        return "video"
    if head[:4] == b"RIFF":
        return "webp" if head[8:12] == b"WEBP" else "video"
    if head[:2] == b"BM" and len(head) > 18 and struct.unpack_from("<I", head, 14)[0] in _BITMAP_HEADERS:
        return "bmp"
    if head[:1] == b"P" and head[1:2] in b"1234567" and head[2:3].isspace():
        return "other"
    return _iso_format(head) if head[4:8] == b"ftyp" else ""


_MARKS = {
    b"\x89PNG\r\n\x1a\n": "png",
    b"\xff\xd8\xff": "jpeg",
    b"GIF87a": "gif",
    b"GIF89a": "gif",
    b"\0\0\0\x0cjP  ": "jp2",
    b"\xff\x4f\xff\x51": "jp2",
}
_MARKS |= dict.fromkeys((b"II*\0\x08", b"MM\0*", b"II*\0", b"II+\0", b"MM\0+"), "tiff")
# Matroska, ASF, Ogg, Flash, MPEG programs and elementary streams, MXF, YUV4MPEG2
_VIDEOS = (
    b"\x1aE\xdf\xa3",
    b"0&\xb2u\x8ef\xcf\x11",
    b"OggS",
    b"FLV",
    b"\0\0\1",
    b"\0\0\0\1",
    b"\6\x0e+4",
    b"YUV4MPEG2",
)
_TS_PACKET = 188


def _iso_format(head: bytes) -> str:
    """A HEIF picture or a video, by the brands of its first box."""
    _, body = next(boxes(head))
    brands = {body[:4], *(body[i : i + 4] for i in range(8, len(body), 4))}
    if body[:4] == b"crx ":
        return "raw"
    if body[:4] in _STILL_BRANDS | _SEQUENCE_BRANDS or brands & {b"heic", b"avif", b"avis"}:
        return "heif"
    return "video"


def _png_kind(file: BinaryIO, head: bytes) -> FileKind:
    start = head.find(b"acTL")
    moves = 0 < start < head.find(b"IDAT") and int.from_bytes(head[start + 4 : start + 8]) > 1
    return "animation" if moves else "image"


def _webp_kind(file: BinaryIO, head: bytes) -> FileKind:
    if head[12:16] != b"VP8X" or not head[20] & 2:
        return "image"
    file.seek(0)
    return "animation" if file.read().count(b"ANMF") > 1 else "image"


def _heif_kind(file: BinaryIO, head: bytes) -> FileKind:
    """A sequence, if a brand says so and there is a track: AVIF's is an animation, HEVC's a video."""
    _, body = next(boxes(head))
    brands = {body[:4], *(body[i : i + 4] for i in range(8, len(body), 4))}
    file.seek(0)
    if not brands & _SEQUENCE_BRANDS or all(name != b"moov" for name, _ in boxes(file.read())):
        return "image"
    return "animation" if b"avis" in brands else "video"


def _gif_kind(file: BinaryIO, head: bytes) -> FileKind:
    from PIL import Image

    file.seek(0)
    try:
        with Image.open(file) as picture:
            return "animation" if getattr(picture, "is_animated", False) else "image"
    except (OSError, ValueError, SyntaxError, IndexError):
        return "image"


def _tiff_kind(file: BinaryIO, head: bytes) -> FileKind:
    return "pages" if len(ifd.pages(file)) > 1 else "image"


def _jpeg_kind(file: BinaryIO, head: bytes) -> FileKind:
    """Pages for several views; a video for pictures one after the other without an index."""
    if b"MPF\0" in head:
        return "pages" if len(views(file)) > 1 else "image"
    scan = head.find(b"\xff\xda")
    return "video" if scan > 0 and _many_jpegs(file, scan) else "image"


def _many_jpegs(file: BinaryIO, scan: int) -> bool:
    """Whether another picture follows the first, whose scan begins here."""
    file.seek(scan)
    return b"\xff\xd9\xff\xd8\xff" in file.read()


def views(file: BinaryIO) -> list[int]:
    """The numbers of a multi-picture JPEG's views: those as large as the first; others are previews or depth maps."""
    from PIL import Image

    file.seek(0)
    with Image.open(file) as picture:
        found, size = [0], picture.size
        for number in range(1, getattr(picture, "n_frames", 1)):
            try:
                picture.seek(number)
            except (OSError, ValueError, SyntaxError):
                continue
            found += [number] if picture.size == size else []
    return found


_SEVERAL: dict[str, Callable[[BinaryIO, bytes], FileKind]] = {
    "png": _png_kind,
    "webp": _webp_kind,
    "heif": _heif_kind,
    "gif": _gif_kind,
    "tiff": _tiff_kind,
    "jpeg": _jpeg_kind,
}
