"""Boxes of the ISO base media file format (ISO/IEC 14496-12, 4.2), of which MP4, HEIF and JPEG 2000 files consist."""

from __future__ import annotations

import struct
from collections.abc import Iterator

_LONG = 1  # a size that stands for one of 64 bits, which follows the name


def boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The name and body of each box; one that reaches beyond the end, or is shorter than its header, is the last.

    >>> list(boxes(box(b"free", b"ab") + box(b"skip")))
    [(b'free', b'ab'), (b'skip', b'')]
    """
    start = 0
    while start + 8 <= len(data):
        size, name = struct.unpack_from(">I4s", data, start)
        header = 8
        if size == _LONG and start + 16 <= len(data):
            header, (size,) = 16, struct.unpack_from(">Q", data, start + 8)
        end = start + size if size else len(data)
        yield name, data[start + header : end]
        if end < start + header or end > len(data):
            return
        start = end


def find(data: bytes, *names: bytes) -> bytes | None:
    """The body of the first box with the last of the names, inside of those before; None where there is none."""
    for name, body in boxes(data):
        if name == names[0]:
            return body if len(names) == 1 else find(body, *names[1:])
    return None


def box(name: bytes, *bodies: bytes) -> bytes:
    """A box of these bodies, one after the other."""
    body = b"".join(bodies)
    return struct.pack(">I4s", 8 + len(body), name) + body


def full_box(name: bytes, *bodies: bytes, version: int = 0, flags: int = 0) -> bytes:
    """A box that begins with a version and flags."""
    return box(name, struct.pack(">I", version << 24 | flags), *bodies)
