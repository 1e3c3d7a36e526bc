"""HEIC and AVIF files as phones write them: a grid of tiles, turned, mirrored and cropped by properties."""

import struct
from collections.abc import Sequence

import numpy as np

from guise.app.media.boxes import box, full_box
from guise.app.media.heif import HeifPicture, main_item
from guise.app.media.heif_writer import write_heif


def grid_file(
    tiles: Sequence[Sequence[np.ndarray]], size: tuple[int, int], form: str, *, bits: int = 8,
    properties: Sequence[bytes] = (), profile: bytes | None = None, derived: bool = False,
) -> bytes:  # fmt: skip
    """A file of rows of tiles (h, w, 3), uint8 or uint16, of which (height, width) from the upper left is the picture.

    properties : transformations of the whole, as boxes.   derived : whether they are those of an item of its own.
    """
    coded = [
        main_item(write_heif(HeifPicture(tile, None, bits, None, None), form, b""))
        for row in tiles
        for tile in row
    ]
    height, width = tiles[0][0].shape[:2]
    headers = b"av1C" if form == "avif" else b"hvcC"
    colours = box(b"colr", b"prof", profile) if profile else coded[0][0].property(b"colr") or b""
    known = [box(headers, coded[0][0].property(headers) or b"")]
    known += [full_box(b"ispe", struct.pack(">II", *pair)) for pair in ((width, height), size[::-1])]
    known += [colours if profile else box(b"colr", colours), *properties]
    whole = len(coded) + 1
    kinds = [
        full_box(b"infe", struct.pack(">HH4sx", k + 1, 0, item.kind), version=2)
        for k, (item, _) in enumerate(coded)
    ]
    kinds.append(full_box(b"infe", struct.pack(">HH4sx", whole, 0, b"grid"), version=2))
    main = whole + derived
    if derived:
        kinds.append(full_box(b"infe", struct.pack(">HH4sx", main, 0, b"iden"), version=2))
    grid = struct.pack(">BBBBHH", 0, 0, len(tiles) - 1, len(tiles[0]) - 1, *size[::-1])
    # tiles have the first, second and fourth properties; the grid the third and all from the fourth
    uses = [struct.pack(">HB3B", k + 1, 3, 0x81, 2, 4) for k in range(len(coded))]
    own = [*range(5, len(known) + 1)]
    uses += [_uses(whole, [3, 4]), _uses(main, [3, *own])] if derived else [_uses(whole, [3, 4, *own])]
    parts = struct.pack(">H", len(coded)) + b"".join(struct.pack(">H", k + 1) for k in range(len(coded)))
    links = [box(b"dimg", struct.pack(">HHH", main, 1, whole))] * derived
    head = box(b"ftyp", form.encode(), bytes(4), b"mif1", form.encode())

    def meta(start: int) -> bytes:
        places = b""
        for number, (_, data) in enumerate(coded, start=1):
            places += struct.pack(">HHHHII", number, 0, 0, 1, start, len(data))
            start += len(data)
        places += struct.pack(">HHHHII", whole, 1, 0, 1, 0, len(grid))
        return full_box(
            b"meta", full_box(b"hdlr", bytes(4), b"pict", bytes(13)), full_box(b"pitm", struct.pack(">H", main)),
            full_box(b"iloc", b"\x44\0", struct.pack(">H", whole), places, version=1),
            full_box(b"iinf", struct.pack(">H", whole), *kinds),
            full_box(b"iref", box(b"dimg", struct.pack(">H", whole), parts), *links),
            box(b"iprp", box(b"ipco", *known), full_box(b"ipma", struct.pack(">I", main), *uses)),
            box(b"idat", grid),
        )  # fmt: skip

    return head + meta(len(head) + len(meta(0)) + 8) + box(b"mdat", *[data for _, data in coded])


def _uses(item: int, numbers: Sequence[int]) -> bytes:
    """The properties of an item, by number."""
    return struct.pack(">HB", item, len(numbers)) + bytes(numbers)
