"""PLY, ASCII and binary of either byte order: reads polygons, and writes a file by changing positions and normals.

Everything else (comments, other properties and elements, number types, order) stays byte for byte, as do vertices that
do not move.  plyfile could do this, but its licence (GPL) is incompatible; trimesh and meshio drop what they do not
know.
"""

from __future__ import annotations

import re
from functools import cached_property

import numpy as np

from guise.analogy.formats.ply_rows import BinaryBody, ColumnChange, Element, Rows, TextBody
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import MeshError, printable_excerpt
from guise.analogy.normals import finite_or_zero
from guise.common.arrays import F64, Int

PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
PLY_TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
PLY_TYPES |= {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
POSITION_PROPERTIES, NORMAL_PROPERTIES, COLOUR_PROPERTIES = (
    ("x", "y", "z"),
    ("nx", "ny", "nz"),
    ("red", "green", "blue"),
)
UV_PROPERTIES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))


class PlyDocument:
    """A PLY file.

    Parameters
    ----------
    data : its bytes.   positions_only : skip everything after the vertices.

    Attributes
    ----------
    vertices : (n, 3).   polygons : its faces with three corners or more.

    Raises
    ------
    MeshError
        When it is not a PLY file, ends too early, or its vertices or faces are not supported.
    """

    def __init__(self, data: bytes, *, positions_only: bool = False) -> None:
        order, elements, start = _parse_header(data)
        self._head = data[:start]
        names = [element.name for element in elements]
        if "vertex" not in names:
            raise MeshError("it has no element `vertex`")
        self._body: BinaryBody | TextBody = BinaryBody(data, start, order) if order else TextBody(data, start)
        wanted = elements[: names.index("vertex") + 1] if positions_only else elements
        rows = {element.name: self._body.rows(element) for element in wanted}
        self._vertex = rows["vertex"]
        found = self._columns(POSITION_PROPERTIES)
        if found is None:
            raise MeshError("its vertices have no x, y and z")
        kinds = {name: kind for name, kind, _ in elements[names.index("vertex")].properties}
        if any(kinds[name][0] != "f" for name in POSITION_PROPERTIES):
            raise MeshError("the positions of its vertices are integers: convert them to float")
        self._white = 1.0 if kinds.get("red", "f")[0] == "f" else 2.0 ** (8 * int(kinds["red"][1])) - 1
        self.vertices = found
        self.polygons, self._wedges = _read_polygons(rows.get("face"), len(found))

    @cached_property
    def normals(self) -> F64 | None:
        """(n, 3), if its vertices have them."""
        found = self._columns(NORMAL_PROPERTIES)
        return None if found is None else finite_or_zero(found)

    @property
    def normal_ids(self) -> Int | None:
        return None if self.normals is None else self.polygons.corners

    @cached_property
    def uvs(self) -> F64 | None:
        """(m, 2), of its vertices or of the corners of its faces."""
        found = (self._columns(pair) for pair in UV_PROPERTIES)
        return next((uv for uv in found if uv is not None), self._wedges)

    @property
    def uv_ids(self) -> Int | None:
        if self.uvs is None:
            return None
        return np.arange(len(self.polygons.corners)) if self.uvs is self._wedges else self.polygons.corners

    @cached_property
    def colours(self) -> F64 | None:
        """(n, 3) from 0 to 1."""
        found = self._columns(COLOUR_PROPERTIES)
        return None if found is None else found / self._white

    @property
    def texture(self) -> str | None:
        """The texture named in a comment, as MeshLab writes it."""
        found = re.search(rb"^comment TextureFile (.+?)\s*$", self._head, re.MULTILINE)
        return found[1].decode("utf-8", "replace") if found else None

    def encode(self, vertices: F64, normals: F64 | None) -> bytes:
        """The bytes of the file with other vertices (n, 3) and normals (n, 3)."""
        changes = [ColumnChange(POSITION_PROPERTIES, vertices, (vertices != self.vertices).any(axis=1))]
        if normals is not None and self.normals is not None:
            changes.append(ColumnChange(NORMAL_PROPERTIES, normals, (normals != self.normals).any(axis=1)))
        return self._body.encode("vertex", changes)

    def _columns(self, names: tuple[str, ...]) -> F64 | None:
        held = self._vertex.values
        if not all(name in held for name in names) or any(name in self._vertex.sizes for name in names):
            return None
        with np.errstate(invalid="ignore"):  # NaN is reported later
            return np.stack([held[name].astype(np.float64) for name in names], axis=1)


def _parse_header(data: bytes) -> tuple[str, list[Element], int]:
    """Byte order ("": ASCII), elements, and the offset of the body."""
    if data[:3] != b"ply":
        raise MeshError("it is no PLY file, which would begin with `ply`")
    end = data.find(b"end_header")
    stop = data.find(b"\n", end)
    if end < 0 or stop < 0:
        raise MeshError("its header has no end")
    order: str | None = None
    elements: list[Element] = []
    for line in data[:end].decode("utf-8", "replace").splitlines():
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = BYTE_ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2]), []))
            elif words[:1] == ["property"]:
                _add_property(elements[-1], _parse_property(words))
        except (KeyError, IndexError, ValueError):
            raise MeshError(
                f"its header has a line that cannot be parsed: {printable_excerpt(line)}"
            ) from None
    if order is None:
        raise MeshError("its header names no format")
    return order, elements, stop + 1


def _add_property(element: Element, added: tuple[str, str, str]) -> None:
    if added[0] in [name for name, _, _ in element.properties]:
        raise ValueError("a property twice")
    element.properties.append(added)


def _parse_property(words: list[str]) -> tuple[str, str, str]:
    """Name, type, and type of the length of a list ("" if it is not a list)."""
    if words[1] == "list":
        return words[4], PLY_TYPES[words[3]], PLY_TYPES[words[2]]
    return words[2], PLY_TYPES[words[1]], ""


def _read_polygons(rows: Rows | None, count: int) -> tuple[Polygons, F64 | None]:
    """The faces, and the texture coordinates (c, 2) of their corners."""
    name = "vertex_index" if rows is not None and "vertex_index" in rows.sizes else "vertex_indices"
    if rows is None or name not in rows.sizes:
        return Polygons(np.zeros(0, np.intp), np.zeros(0, np.intp)), None
    named, sizes = rows.values[name], rows.sizes[name]
    wrong = named[~((named >= 0) & (named < count))]
    if len(wrong):
        raise MeshError(
            f"a face names vertex {wrong[0]:g}, but the ids of its {count} vertices end at {count - 1}"
        )
    corners = named.astype(np.intp)
    good = sizes >= 3
    used = np.repeat(good, sizes)
    wedges = rows.values.get("texcoord", np.zeros(0))
    uvs = wedges.astype(np.float64).reshape(-1, 2)[used] if len(wedges) == 2 * len(corners) > 0 else None
    return Polygons(corners[used], sizes[good]), uvs
