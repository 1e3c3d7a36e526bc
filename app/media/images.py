"""Image files: reading, writing, natural order, and tags inside PNG and JPEG.

RGB uint8, (h, w, 3); EXIF orientation is applied on reading and, like other metadata, not written.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from app.media.errors import MediaError
from app.media.reader import Problems

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
_JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})
_JPEG_QUALITY = 95
_PNG_HEADER = 8 + 25  # signature and IHDR chunk

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
    if suffix == ".webp":
        settings = [cv2.IMWRITE_WEBP_QUALITY, 101]  # above 100 is lossless
    done, data = cv2.imencode(suffix, cv2.merge(channels), settings)
    if not done:
        raise MediaError(
            f"An image of {rgb.shape[1]} x {rgb.shape[0]} cannot be written as {suffix}: use .png."
        )
    return _with_tags(data.tobytes(), suffix, tags)


def is_lossy(suffix: str) -> bool:
    """Whether writing with this suffix changes pixels."""
    return suffix.lower() in _JPEG_SUFFIXES


def _with_tags(data: bytes, suffix: str, tags: Mapping[str, str]) -> bytes:
    """The file with each tag in it, as PNG iTXt chunks or JPEG comments; other formats stay as they are."""
    if suffix == ".png":
        chunks = b"".join(_png_text(key, value) for key, value in tags.items())
        return data[:_PNG_HEADER] + chunks + data[_PNG_HEADER:]
    if suffix in _JPEG_SUFFIXES:
        comments = b"".join(_jpeg_comment(f"{key}: {value}") for key, value in tags.items())
        return data[:2] + comments + data[2:]
    return data


def _png_text(key: str, value: str) -> bytes:
    """One iTXt chunk: a keyword of at most 79 Latin-1 bytes, then UTF-8 text (PNG 3, 11.3.3.4)."""
    body = b"iTXt" + key.encode("latin-1", "replace")[:79] + b"\0\0\0\0\0" + value.encode()
    return struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))


def _jpeg_comment(text: str) -> bytes:
    """One COM segment; its length field holds at most 65,533 bytes of text."""
    body = text.encode()[:65533]
    return b"\xff\xfe" + struct.pack(">H", len(body) + 2) + body
