"""The container of glTF 2.0: JSON and one binary buffer, as a GLB file or as .gltf with its buffers.

pygltflib models the JSON as classes but does not decode accessors, and trimesh writes a new file.  Here the document is
changed in place, so that materials, textures, skeletons and unknown extensions stay.
"""

from __future__ import annotations

import base64
import copy
import json
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from guise.analogy.formats.gltf_compression import COMPONENT_TYPES, MESHOPT, expand
from guise.analogy.mesh import MeshError
from guise.common.arrays import F32, F64, Bool, Int

Json = dict[str, Any]

ELEMENT_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
GL_ARRAY_BUFFER = 34962  # ARRAY_BUFFER
GL_ELEMENT_ARRAY_BUFFER = 34963  # ELEMENT_ARRAY_BUFFER
MAX_ZERO_ACCESSOR_BYTES = 1 << 26  # of an accessor without a buffer view
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


class GltfContainer:
    """A glTF document.

    Parameters
    ----------
    json : with a single buffer.   buffer : its bytes.
    """

    def __init__(self, json: Json, buffer: bytearray) -> None:
        self.json, self.buffer = json, buffer

    @classmethod
    def read(cls, data: bytes, folder: Path) -> GltfContainer:
        """Read the bytes of a GLB or .gltf file; other buffers that it names lie in `folder`.

        Raises
        ------
        MeshError
            When it is not glTF 2.0, is compressed and the library is missing, or a buffer is missing.
        """
        text, binary = _read_chunks(data) if data[:4] == b"glTF" else (data, b"")
        try:
            held = json.loads(text)
            version = str(held["asset"]["version"])
        except (ValueError, KeyError, TypeError):
            raise MeshError("it is not a glTF file: it has no JSON with the version of an asset") from None
        if version.split(".")[0] != "2":
            raise MeshError(f"it is glTF {version}, but only 2.0 is read: export it again")
        whole = _join_buffers(held, binary, folder)
        expand(held, whole)
        return cls(held, whole)

    def copy(self) -> GltfContainer:
        return GltfContainer(copy.deepcopy(self.json), bytearray(self.buffer))

    def entries(self, name: str) -> list[Json]:
        """A top-level list, created if missing."""
        found: list[Json] = self.json.setdefault(name, [])
        return found

    def read_accessor(self, index: int) -> NDArray[Any]:
        """The values (count, width) of an accessor; normalised integers become floats."""
        accessor = self.json["accessors"][index]
        values = self._dense(accessor).copy()  # a view would keep the buffer from growing
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            rows = self._dense({**sparse["indices"], "count": sparse["count"], "type": "SCALAR"})[:, 0]
            values[rows] = self._dense({**accessor, **sparse["values"], "count": sparse["count"]})
        if accessor.get("normalized") and values.dtype.kind != "f":
            return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
        return values

    def update_accessor(self, index: int, values: F64, rows: Bool) -> int:
        """Replace given rows of an accessor by values (count, width); the index of the accessor that then holds them.

        Floats are replaced in place; otherwise a new accessor is appended.
        """
        accessor = self.json["accessors"][index]
        if accessor["componentType"] != 5126 or "sparse" in accessor or "bufferView" not in accessor:
            return self.append_accessor(values.astype(np.float32), GL_ARRAY_BUFFER)
        held = self._dense(accessor)
        held[rows] = values[rows]
        if "min" in accessor:
            accessor["min"], accessor["max"] = held.min(0).tolist(), held.max(0).tolist()
        return index

    def append_accessor(self, values: NDArray[Any], target: int) -> int:
        """Append an accessor with values (count, width), float32 or uint32; its index."""
        kind = {"f": 5126, "u": 5125}[values.dtype.kind]
        name = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[values.shape[1]]
        accessor = {
            "bufferView": self.append_view(np.ascontiguousarray(values).tobytes(), target),
            "componentType": kind,
            "count": len(values),
            "type": name,
            "min": values.min(0).tolist(),
            "max": values.max(0).tolist(),
        }
        self.entries("accessors").append(accessor)
        return len(self.json["accessors"]) - 1

    def append_sparse_accessor(self, values: F32, rows: Int) -> int:
        """Append an accessor of values (count, 3) that count as 0 except in `rows` (r,), ascending; its index.

        It is sparse where that is smaller.
        """
        count = len(values)
        ids = (rows if len(rows) else np.zeros(1, np.intp)).astype(
            np.uint16 if count < 1 << 16 else np.uint32
        )
        held = np.ascontiguousarray(values[ids])
        if ids.nbytes + held.nbytes >= values.nbytes:
            return self.append_accessor(values, GL_ARRAY_BUFFER)
        sparse = {
            "count": len(ids),
            "indices": {
                "bufferView": self.append_view(ids.tobytes()),
                "componentType": 5123 if ids.itemsize == 2 else 5125,
            },
            "values": {"bufferView": self.append_view(held.tobytes())},
        }
        low, high = held.min(0), held.max(0)
        if len(ids) < count:
            low, high = np.minimum(low, 0), np.maximum(high, 0)
        accessor = {"componentType": 5126, "count": count, "type": "VEC3", "sparse": sparse}
        self.entries("accessors").append({**accessor, "min": low.tolist(), "max": high.tolist()})
        return len(self.json["accessors"]) - 1

    def append_view(self, data: bytes, target: int | None = None) -> int:
        """Append a buffer view; its index."""
        self.buffer += bytes(-len(self.buffer) % 4)
        view: Json = {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(data)}
        self.entries("bufferViews").append(view if target is None else {**view, "target": target})
        self.buffer += data
        return len(self.json["bufferViews"]) - 1

    def to_glb(self) -> bytes:
        """The bytes of a GLB file."""
        self.buffer += bytes(-len(self.buffer) % 4)
        self.json["buffers"] = [{"byteLength": len(self.buffer)}]
        text = _to_json(self.json)
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), _JSON_CHUNK) + text
        body += struct.pack("<II", len(self.buffer), _BINARY_CHUNK) + bytes(self.buffer)
        return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body

    def to_gltf(self) -> bytes:
        """The bytes of a .gltf file with an embedded buffer."""
        address = "data:application/octet-stream;base64," + base64.b64encode(self.buffer).decode()
        self.json["buffers"] = [{"byteLength": len(self.buffer), "uri": address}]
        return _to_json(self.json)

    def _dense(self, accessor: Json) -> NDArray[Any]:
        """(count, width) values in the buffer, without sparse ones."""
        kind, width, count = (
            np.dtype(COMPONENT_TYPES[accessor["componentType"]]),
            ELEMENT_WIDTHS[accessor["type"]],
            accessor["count"],
        )
        if "bufferView" not in accessor:
            if not 0 <= count * width * kind.itemsize < MAX_ZERO_ACCESSOR_BYTES:
                raise MeshError(f"it is damaged: an accessor has {count} elements")
            return np.zeros((count, width), kind)
        view = self.json["bufferViews"][accessor["bufferView"]]
        begin = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        step = view.get("byteStride") or kind.itemsize * width
        if count < 0 or begin < 0 or begin + step * (count - 1) + kind.itemsize * width > len(self.buffer):
            raise MeshError("it is damaged: its buffer ends before the vertices or faces do")
        return np.ndarray((count, width), kind, self.buffer, begin, (step, kind.itemsize))


def read_uri(address: str, folder: Path) -> bytes:
    """The bytes of a `uri` of a document in `folder`."""
    if address.startswith("data:"):
        return base64.b64decode(address.partition(",")[2])
    path = folder / unquote(address)
    if not path.is_file():
        raise MeshError(f"it names the file {address}, which is not in {folder}")
    return path.read_bytes()


def _read_chunks(data: bytes) -> tuple[bytes, bytes]:
    """The JSON and binary chunks of a GLB file."""
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, at)
        if at + 8 + length > len(data):
            raise MeshError("it is damaged: it ends too early")
        found.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length
    return found.get(_JSON_CHUNK, b""), found.get(_BINARY_CHUNK, b"")


def _join_buffers(held: Json, binary: bytes, folder: Path) -> bytearray:
    """All buffers concatenated; the offsets of the views are adjusted."""
    whole, starts = bytearray(), []
    for buffer in held.get("buffers", []):
        whole += bytes(-len(whole) % 4)
        starts.append(len(whole))
        if not _is_fallback(buffer):
            whole += read_uri(buffer["uri"], folder) if "uri" in buffer else binary
    for view in held.get("bufferViews", []):
        for place in (view, *(held for name, held in _extensions(view) if name in MESHOPT)):
            place["byteOffset"] = place.get("byteOffset", 0) + starts[place["buffer"]]
            place["buffer"] = 0
    return whole


def _is_fallback(buffer: Json) -> bool:
    """Whether a buffer only stands for what compressed views expand to."""
    return any(held.get("fallback") for name, held in _extensions(buffer) if name in MESHOPT)


def _extensions(held: Json) -> Iterable[tuple[str, Json]]:
    return (held.get("extensions") or {}).items()


def _to_json(held: Json) -> bytes:
    return json.dumps(held, ensure_ascii=False, separators=(",", ":")).encode()
