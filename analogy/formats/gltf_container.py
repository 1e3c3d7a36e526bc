"""The container of glTF 2.0: JSON and one binary buffer, as a GLB file or as .gltf with its buffers.

pygltflib holds the JSON as classes but decodes no accessor, and trimesh writes its own file; here the document that was
read is changed in place, so that materials, textures, skeletons and unknown extensions stay.
"""

from __future__ import annotations

import base64
import copy
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from guise.analogy.mesh import MeshError
from guise.common.arrays import F64, Bool

Json = dict[str, Any]

KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
VERTICES = 34962  # ARRAY_BUFFER
INDICES = 34963  # ELEMENT_ARRAY_BUFFER
LARGEST = 1 << 26  # bytes of an accessor that is all zeros
_JSON, _BIN = 0x4E4F534A, 0x004E4942


class Container:
    """A glTF document.

    Parameters
    ----------
    json : its JSON, of which all buffers are one.   buffer : that.
    """

    def __init__(self, json: Json, buffer: bytearray) -> None:
        self.json, self.buffer = json, buffer

    @classmethod
    def read(cls, data: bytes, folder: Path) -> Container:
        """Of a GLB's or .gltf's bytes; other buffers that it names lie in `folder`.

        Raises
        ------
        MeshError
            When it is none, or compressed, or a buffer is missing.
        """
        text, binary = _chunks(data) if data[:4] == b"glTF" else (data, b"")
        try:
            held = json.loads(text)
            version = str(held["asset"]["version"])
        except (ValueError, KeyError, TypeError):
            raise MeshError("it is no glTF file: no JSON with an asset's version in it") from None
        if version.split(".")[0] != "2":
            raise MeshError(f"it is glTF {version}, and only 2.0 is read; export it again")
        packed = [name for name in COMPRESSED if name in held.get("extensionsUsed", [])]
        if packed:
            raise MeshError(f"it is compressed ({packed[0]}); export it without compression")
        return cls(held, _joined(held, binary, folder))

    def copy(self) -> Container:
        return Container(copy.deepcopy(self.json), bytearray(self.buffer))

    def entries(self, name: str) -> list[Json]:
        """A top-level list, made if there is none."""
        found: list[Json] = self.json.setdefault(name, [])
        return found

    def array(self, index: int) -> NDArray[Any]:
        """The numbers (count, width) of an accessor; normalised integers as float."""
        accessor = self.json["accessors"][index]
        values = self._dense(accessor).copy()  # a view would keep the buffer from growing
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            rows = self._dense({**sparse["indices"], "count": sparse["count"], "type": "SCALAR"})[:, 0]
            values[rows] = self._dense({**accessor, **sparse["values"], "count": sparse["count"]})
        if accessor.get("normalized") and values.dtype.kind != "f":
            return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
        return values

    def change(self, index: int, values: F64, rows: Bool) -> int:
        """Other numbers (count, width) in those rows of an accessor; the accessor that then holds them.

        In place where it holds floats; otherwise they are put into a new one.
        """
        accessor = self.json["accessors"][index]
        if accessor["componentType"] != 5126 or "sparse" in accessor or "bufferView" not in accessor:
            return self.append(values.astype(np.float32), VERTICES)
        held = self._dense(accessor)
        held[rows] = values[rows]
        if "min" in accessor:
            accessor["min"], accessor["max"] = held.min(0).tolist(), held.max(0).tolist()
        return index

    def append(self, values: NDArray[Any], target: int) -> int:
        """A new accessor with numbers (count, width), float32 or uint32; its index."""
        kind = {"f": 5126, "u": 5125}[values.dtype.kind]
        name = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[values.shape[1]]
        accessor = {
            "bufferView": self.append_bytes(np.ascontiguousarray(values).tobytes(), target),
            "componentType": kind,
            "count": len(values),
            "type": name,
            "min": values.min(0).tolist(),
            "max": values.max(0).tolist(),
        }
        self.entries("accessors").append(accessor)
        return len(self.json["accessors"]) - 1

    def append_bytes(self, data: bytes, target: int | None = None) -> int:
        """A new view of the buffer; its index."""
        self.buffer += bytes(-len(self.buffer) % 4)
        view: Json = {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(data)}
        self.entries("bufferViews").append(view if target is None else {**view, "target": target})
        self.buffer += data
        return len(self.json["bufferViews"]) - 1

    def glb(self) -> bytes:
        """As one GLB file."""
        self.buffer += bytes(-len(self.buffer) % 4)
        self.json["buffers"] = [{"byteLength": len(self.buffer)}]
        text = _text(self.json)
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), _JSON) + text
        body += struct.pack("<II", len(self.buffer), _BIN) + bytes(self.buffer)
        return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body

    def gltf(self) -> bytes:
        """As one .gltf file, the buffer in it."""
        address = "data:application/octet-stream;base64," + base64.b64encode(self.buffer).decode()
        self.json["buffers"] = [{"byteLength": len(self.buffer), "uri": address}]
        return _text(self.json)

    def _dense(self, accessor: Json) -> NDArray[Any]:
        """(count, width) numbers of the buffer itself, sparse ones left out."""
        kind, width, count = (
            np.dtype(KINDS[accessor["componentType"]]),
            WIDTHS[accessor["type"]],
            accessor["count"],
        )
        if "bufferView" not in accessor:
            if not 0 <= count * width * kind.itemsize < LARGEST:
                raise MeshError(f"it is damaged: an accessor has {count} elements")
            return np.zeros((count, width), kind)
        view = self.json["bufferViews"][accessor["bufferView"]]
        begin = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        step = view.get("byteStride") or kind.itemsize * width
        if count < 0 or begin < 0 or begin + step * (count - 1) + kind.itemsize * width > len(self.buffer):
            raise MeshError("it is damaged: its buffer ends before the vertices or faces do")
        return np.ndarray((count, width), kind, self.buffer, begin, (step, kind.itemsize))


def content(address: str, folder: Path) -> bytes:
    """The bytes of a `uri` of a document that lies in `folder`."""
    if address.startswith("data:"):
        return base64.b64decode(address.partition(",")[2])
    path = folder / unquote(address)
    if not path.is_file():
        raise MeshError(f"it names the file {address}, which is not in {folder}")
    return path.read_bytes()


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """The JSON and the binary of a GLB file."""
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, at)
        if at + 8 + length > len(data):
            raise MeshError("it is damaged: it ends too early")
        found.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length
    return found.get(_JSON, b""), found.get(_BIN, b"")


def _joined(held: Json, binary: bytes, folder: Path) -> bytearray:
    """All buffers one after another; the views' offsets follow."""
    whole, starts = bytearray(), []
    for buffer in held.get("buffers", []):
        whole += bytes(-len(whole) % 4)
        starts.append(len(whole))
        whole += content(buffer["uri"], folder) if "uri" in buffer else binary
    for view in held.get("bufferViews", []):
        view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
        view["buffer"] = 0
    return whole


def _text(held: Json) -> bytes:
    return json.dumps(held, ensure_ascii=False, separators=(",", ":")).encode()
