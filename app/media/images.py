"""Image files: reading, writing, natural order, and tags inside PNG and JPEG.

RGB uint8, (h, w, 3); EXIF orientation is applied on reading and, like other metadata, not written.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import cv2
import numpy as np
from numpy.typing import NDArray

from app.media.errors import MediaError
from app.media.reader import Problems

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
_JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})
_JPEG_QUALITY = 95
_PNG_HEADER = 8 + 25  # signature and IHDR chunk

_XMP = (
    '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
    'xmlns:Iptc4xmpExt="http://iptc.org/std/Iptc4xmpExt/2008-02-29/" xmlns:dc="http://purl.org/dc/elements/1.1/" '
    "Iptc4xmpExt:DigitalSourceType={kind}><dc:description><rdf:Alt><rdf:li xml:lang='x-default'>{description}"
    '</rdf:li></rdf:Alt></dc:description></rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="r"?>'
)

Image = NDArray[np.uint8]


def looks_like_image(path: Path) -> bool:
    """Whether the suffix is that of a still image."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """A sort key under which frame2 comes before frame10.

    >>> sorted(["a10.png", "a2.png"], key=natural_key)
    ['a2.png', 'a10.png']
    """
    parts = re.split(r"(\d+)", name.casefold())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


def list_images(folder: Path) -> list[Path]:
    """The image files of a folder in natural order, hidden ones left out."""
    files = [file for file in folder.iterdir() if looks_like_image(file) and not file.name.startswith(".")]
    return sorted((file for file in files if file.is_file()), key=lambda file: natural_key(file.name))


def read_image(path: Path, problems: Problems) -> tuple[Image, Image | None] | None:
    """An image as RGB (h, w, 3) and its alpha (h, w) or None; None when it cannot be read."""
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError:
        return None
    raw = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if raw is None:
        return None
    if raw.dtype != np.uint8:
        problems.note(f"{path.name} was converted from {raw.dtype.itemsize * 8} to 8 bits a component.")
    if raw.ndim == 3 and raw.shape[2] == 4 and raw.dtype == np.uint8:
        return np.ascontiguousarray(raw[..., 2::-1]), np.ascontiguousarray(raw[..., 3])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR_RGB), np.uint8), None


def encode_image(rgb: Image, alpha: Image | None, suffix: str, tags: Mapping[str, str]) -> bytes:
    """The bytes of an image file.  JPEG has no alpha."""
    suffix = suffix.lower()
    channels = [*cv2.split(rgb)[::-1]]
    if alpha is not None and suffix not in _JPEG_SUFFIXES:
        channels.append(alpha)
    settings = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY] if suffix in _JPEG_SUFFIXES else []
    picture = cv2.merge(channels)
    if suffix == ".webp":
        settings = [cv2.IMWRITE_WEBP_QUALITY, 101]  # above 100 is lossless
        kinds, blocks = ([cv2.IMAGE_METADATA_XMP], [np.frombuffer(xmp(tags), np.uint8)]) if tags else ([], [])
        done, data = cv2.imencodeWithMetadata(suffix, picture, kinds, blocks, settings)
    else:
        done, data = cv2.imencode(suffix, picture, settings)
    if not done:
        raise MediaError(
            f"An image of {rgb.shape[1]} x {rgb.shape[0]} cannot be written as {suffix}: use .png."
        )
    return _with_tags(data.tobytes(), suffix, tags)


def is_lossy(suffix: str) -> bool:
    """Whether writing with this suffix changes pixels."""
    return suffix.lower() in _JPEG_SUFFIXES


def xmp(tags: Mapping[str, str]) -> bytes:
    """The tags as an XMP packet: IPTC's source type, and all others as one description.

    >>> b"digitalsourcetype/x" in xmp({"digital_source_type": "http://cv.iptc.org/newscodes/digitalsourcetype/x"})
    True
    """
    others = "; ".join(value for key, value in tags.items() if key != "digital_source_type")
    kind = quoteattr(tags.get("digital_source_type", ""))
    return _XMP.format(kind=kind, description=escape(others)).encode()


def _with_tags(data: bytes, suffix: str, tags: Mapping[str, str]) -> bytes:
    """The file with the tags in it, as PNG iTXt chunks, or JPEG comments and XMP; other formats stay as they are."""
    if not tags:
        return data
    if suffix == ".png":
        chunks = b"".join(_png_text(key, value) for key, value in tags.items())
        chunks += _png_text("XML:com.adobe.xmp", xmp(tags).decode())
        return data[:_PNG_HEADER] + chunks + data[_PNG_HEADER:]
    if suffix in _JPEG_SUFFIXES:
        segments = b"".join(_jpeg_segment(0xFE, f"{key}: {value}".encode()) for key, value in tags.items())
        segments += _jpeg_segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0" + xmp(tags))
        end = 4 + int.from_bytes(data[4:6], "big")  # of the JFIF segment, which comes first
        return data[:end] + segments + data[end:]
    return data


def _png_text(key: str, value: str) -> bytes:
    """One iTXt chunk: a keyword of at most 79 Latin-1 bytes, then UTF-8 text (PNG 3, 11.3.3.4)."""
    body = b"iTXt" + key.encode("latin-1", "replace")[:79] + b"\0\0\0\0\0" + value.encode()
    return struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))


def _jpeg_segment(mark: int, body: bytes) -> bytes:
    """One segment of a JPEG file; its length field holds at most 65,533 bytes of body."""
    body = body[:65533]
    return bytes([0xFF, mark]) + struct.pack(">H", len(body) + 2) + body
