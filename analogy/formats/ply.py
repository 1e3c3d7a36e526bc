"""PLY, ascii and binary of either byte order: read for its polygons, written by changing positions and normals in it.

Everything else - comments, other properties and elements, number types, order - stays byte for byte, and so does a
vertex that does not move.  plyfile reads all that too, but its licence (GPL) cannot be ours; trimesh and meshio drop
what they do not know.
"""

from __future__ import annotations

import re
from functools import cached_property

import numpy as np

from guise.analogy.formats.ply_rows import Binary, Change, Element, Rows, Text
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import MeshError, shown
from guise.analogy.normals import sound
from guise.common.arrays import F64, Int

KINDS = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
KINDS |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
KINDS |= {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
PLACE, NORMAL, COLOUR = ("x", "y", "z"), ("nx", "ny", "nz"), ("red", "green", "blue")
UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))


class PlyDocument:
    """A PLY file.

    Parameters
    ----------
    data : its bytes.   positions_only : what follows the vertices is not read.

    Attributes
    ----------
    vertices : (n, 3).   polygons : its faces with three corners or more.

    Raises
    ------
    MeshError
        When it is no PLY file, ends too early, or its vertices or faces are not as usual.
    """

    def __init__(self, data: bytes, *, positions_only: bool = False) -> None:
        order, elements, start = _header(data)
        self._head = data[:start]
        names = [element.name for element in elements]
        if "vertex" not in names:
            raise MeshError("it has no element `vertex`")
        self._body: Binary | Text = Binary(data, start, order) if order else Text(data, start)
        wanted = elements[: names.index("vertex") + 1] if positions_only else elements
        rows = {element.name: self._body.rows(element) for element in wanted}
        self._vertex = rows["vertex"]
        found = self._columns(PLACE)
        if found is None:
            raise MeshError("its vertices have no x, y and z")
        kinds = {name: kind for name, kind, _ in elements[names.index("vertex")].properties}
        if any(kinds[name][0] != "f" for name in PLACE):
            raise MeshError("the positions of its vertices are whole numbers; convert them to float")
        self._white = 1.0 if kinds.get("red", "f")[0] == "f" else 2.0 ** (8 * int(kinds["red"][1])) - 1
        self.vertices = found
        self.polygons, self._wedges = _polygons(rows.get("face"), len(found))

    @cached_property
    def normals(self) -> F64 | None:
        """(n, 3), where its vertices have them."""
        found = self._columns(NORMAL)
        return None if found is None else sound(found)

    @property
    def normal_ids(self) -> Int | None:
        return None if self.normals is None else self.polygons.corners

    @cached_property
    def uvs(self) -> F64 | None:
        """(m, 2), of its vertices or of its faces' corners."""
        found = (self._columns(pair) for pair in UVS)
        return next((uv for uv in found if uv is not None), self._wedges)

    @property
    def uv_ids(self) -> Int | None:
        if self.uvs is None:
            return None
        return np.arange(len(self.polygons.corners)) if self.uvs is self._wedges else self.polygons.corners

    @cached_property
    def colours(self) -> F64 | None:
        """(n, 3) from 0 to 1."""
        found = self._columns(COLOUR)
        return None if found is None else found / self._white

    @property
    def texture(self) -> str | None:
        """The picture that a comment names, as MeshLab writes it."""
        found = re.search(rb"^comment TextureFile (.+?)\s*$", self._head, re.MULTILINE)
        return found[1].decode("utf-8", "replace") if found else None

    def replaced(self, vertices: F64, normals: F64 | None) -> bytes:
        """The file with other vertices (n, 3) and normals (n, 3)."""
        changes = [Change(PLACE, vertices, (vertices != self.vertices).any(axis=1))]
        if normals is not None and self.normals is not None:
            changes.append(Change(NORMAL, normals, (normals != self.normals).any(axis=1)))
        return self._body.replaced("vertex", changes)

    def _columns(self, names: tuple[str, ...]) -> F64 | None:
        held = self._vertex.values
        if not all(name in held for name in names) or any(name in self._vertex.sizes for name in names):
            return None
        with np.errstate(invalid="ignore"):  # of NaN, which is found later
            return np.stack([held[name].astype(np.float64) for name in names], axis=1)


def _header(data: bytes) -> tuple[str, list[Element], int]:
    """Byte order ("": ascii), elements, and where the body starts."""
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
                order = ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2]), []))
            elif words[:1] == ["property"]:
                _add(elements[-1], _property(words))
        except (KeyError, IndexError, ValueError):
            raise MeshError(f"its header has a line that cannot be understood: {shown(line)}") from None
    if order is None:
        raise MeshError("its header names no format")
    return order, elements, stop + 1


def _add(element: Element, added: tuple[str, str, str]) -> None:
    if added[0] in [name for name, _, _ in element.properties]:
        raise ValueError("a property twice")
    element.properties.append(added)


def _property(words: list[str]) -> tuple[str, str, str]:
    """Name, type, and type of the length of a list, "" where it is none."""
    if words[1] == "list":
        return words[4], KINDS[words[3]], KINDS[words[2]]
    return words[2], KINDS[words[1]], ""


def _polygons(rows: Rows | None, count: int) -> tuple[Polygons, F64 | None]:
    """The faces, and texture coordinates (c, 2) of their corners."""
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
