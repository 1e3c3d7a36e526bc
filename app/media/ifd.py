"""Reading and adding tags of a TIFF directory, as in TIFF files and EXIF blocks.

TIFF 6.0, section 2.  Only the first directory is used; BigTIFF is not supported.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import BinaryIO

ORIENTATION, PHOTOMETRIC, XMP, PROFILE, SUBFILE_TYPE = 0x0112, 0x0106, 0x02BC, 0x8773, 0x00FE
BITS, EXTRA_SAMPLES = 0x0102, 0x0152

_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 6: 1, 7: 1, 8: 2, 9: 4, 11: 4, 5: 8, 10: 8, 12: 8}  # bytes, by type
_SHORT, _BYTES, _UNDEFINED = 3, 1, 7
_ENTRY = 12
_MAX_PAGES = 65_536


def read_values(data: bytes) -> dict[int, bytes]:
    """The bytes of each tag's value in the first directory; nothing where the data is damaged.

    >>> read_values(b"MM\\0*" + bytes([0, 0, 0, 8, 0, 1, 1, 18, 0, 3, 0, 0, 0, 1, 0, 6, 0, 0, 0, 0, 0, 0]))
    {274: b'\\x00\\x06'}
    """
    order = _order(data)
    if order is None:
        return {}
    try:
        return dict(_value(data, order, entry) for entry in _entries(data, order)[0])
    except (struct.error, KeyError):
        return {}


def read_short(data: bytes, tag: int) -> int | None:
    """A tag that is one 16-bit number, or None."""
    value = read_values(data).get(tag, b"")
    order = _order(data)
    return None if order is None or len(value) != 2 else int(struct.unpack(order + "H", value)[0])


def read_number(data: bytes, tag: int) -> int | None:
    """A tag that is one number of 16 or 32 bits, or None."""
    value, order = read_values(data).get(tag, b""), _order(data)
    if order is None or len(value) not in (2, 4):
        return None
    return int.from_bytes(value, "little" if order == "<" else "big")


def pages(file: BinaryIO) -> dict[int, int | None]:
    """The numbers of a TIFF file's directories that are pictures of their own, not previews or masks; also BigTIFF.

    With the photometric interpretation of each.  A damaged chain ends where it cannot be followed.
    """
    file.seek(0)
    head = file.read(16)
    order = "<" if head[:2] == b"II" else ">"
    big = head[2:4] in (b"+\0", b"\0+")
    counts, offsets, entry = ("Q", "Q", 20) if big else ("H", "I", _ENTRY)
    found: dict[int, int | None] = {}
    seen: set[int] = set()
    try:
        (start,) = struct.unpack_from(order + offsets, head, 8 if big else 4)
        while start and start not in seen and len(seen) < _MAX_PAGES:
            seen.add(start)
            file.seek(start)
            (count,) = struct.unpack(order + counts, file.read(struct.calcsize(counts)))
            table = file.read(entry * min(count, 0xFFFF))
            kind = _number(table, order, entry, SUBFILE_TYPE) or 0
            if not kind & (1 | 4):  # smaller than another, or a mask
                found[len(seen) - 1] = _number(table, order, entry, PHOTOMETRIC)
            (start,) = struct.unpack(order + offsets, file.read(struct.calcsize(offsets)))
    except (struct.error, OverflowError):
        pass
    return found


def _number(table: bytes, order: str, entry: int, wanted: int) -> int | None:
    """A tag of a directory that is one number of 16 or 32 bits, or None.   entry : bytes of each entry."""
    for i in range(0, len(table) - entry + 1, entry):
        tag, kind = struct.unpack_from(order + "HH", table, i)
        if tag == wanted:
            value = table[i + entry - (entry - 4) // 2 :][:4]
            return int(struct.unpack_from(order + ("H" if kind == _SHORT else "I"), value)[0])
    return None


def with_values(data: bytes, values: Mapping[int, bytes]) -> bytes:
    """A TIFF file with more tags; the directory is rewritten at the end of the file."""
    order = _order(data)
    assert order is not None
    entries, following = _entries(data, order)
    kept = [entry for entry in entries if struct.unpack(order + "H", entry[:2])[0] not in values]
    out = bytearray(data + b"\0" * (len(data) % 2))
    for tag, value in values.items():
        kind = _UNDEFINED if tag == PROFILE else _BYTES
        kept.append(struct.pack(order + "HHII", tag, kind, len(value), len(out)))
        out += value + b"\0" * (len(value) % 2)
    kept.sort(key=lambda entry: int(struct.unpack(order + "H", entry[:2])[0]))
    out[4:8] = struct.pack(order + "I", len(out))
    out += struct.pack(order + "H", len(kept)) + b"".join(kept) + following
    return bytes(out)


def _order(data: bytes) -> str | None:
    """The byte order in the notation of `struct`; None when the data is not a TIFF."""
    return {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])


def _entries(data: bytes, order: str) -> tuple[list[bytes], bytes]:
    """The entries of the first directory, and the bytes that locate the next one."""
    (start,) = struct.unpack(order + "I", data[4:8])
    (count,) = struct.unpack(order + "H", data[start : start + 2])
    end = start + 2 + _ENTRY * count
    return [data[i : i + _ENTRY] for i in range(start + 2, end, _ENTRY)], data[end : end + 4]


def _value(data: bytes, order: str, entry: bytes) -> tuple[int, bytes]:
    tag, kind, count = struct.unpack(order + "HHI", entry[:8])
    length = _SIZES[kind] * count
    (place,) = struct.unpack(order + "I", entry[8:])
    return tag, entry[8 : 8 + length] if length <= 4 else data[place : place + length]
