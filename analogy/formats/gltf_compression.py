"""Expands compressed glTF: primitives of KHR_draco_mesh_compression, buffer views of EXT_meshopt_compression.

The libraries are optional: `pip install "guise-video[compressed]"` brings DracoPy and meshoptimizer.  What is expanded
becomes plain accessors and buffer views, and the document no longer names the extension.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.analogy.mesh import MeshError

Json = dict[str, Any]

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
LIBRARIES = {DRACO: "DracoPy", **dict.fromkeys(MESHOPT, "meshoptimizer")}
FILTERS = {
    "OCTAHEDRAL": "decode_filter_oct",
    "QUATERNION": "decode_filter_quat",
    "EXPONENTIAL": "decode_filter_exp",
}
COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


def expand(held: Json, buffer: bytearray) -> None:
    """Expand a document and its single buffer in place.

    Raises
    ------
    MeshError
        When the library is not installed, or the compressed data are damaged.
    """
    for name in (*MESHOPT, DRACO):
        if name not in held.get("extensionsUsed", []):
            continue
        library = _library(name)
        try:
            if name == DRACO:
                _expand_primitives(held, buffer, library)
            else:
                _expand_views(held, buffer, name, library)
        except MeshError:
            raise
        except Exception as error:  # each library has errors of its own
            raise MeshError(f"its compressed data are damaged ({name}): {error}") from error
        _forget(held, name)


def _library(name: str) -> ModuleType:
    try:
        return importlib.import_module(LIBRARIES[name])
    except ImportError:
        raise MeshError(
            f'it is compressed ({name}): pip install "guise-video[compressed]", or export it without compression'
        ) from None


def _expand_views(held: Json, buffer: bytearray, name: str, library: ModuleType) -> None:
    for view in held.get("bufferViews", []):
        packed = (view.get("extensions") or {}).pop(name, None)
        if packed is not None:
            start = packed.get("byteOffset", 0)
            data = _view_values(packed, bytes(buffer[start : start + packed["byteLength"]]), library)
            view["byteOffset"], view["byteLength"] = _append(buffer, data), len(data)


def _view_values(packed: Json, data: bytes, library: ModuleType) -> bytes:
    """The bytes of a view, from its compressed ones."""
    count, stride, mode = packed["count"], packed["byteStride"], packed["mode"]
    if mode != "ATTRIBUTES":
        decode = library.decode_index_buffer if mode == "TRIANGLES" else library.decode_index_sequence
        return bytes(decode(count, stride, data).tobytes()[: count * stride])
    values = library.decode_vertex_buffer(count, stride, data, dtype=np.dtype(f"V{stride}"))
    how = packed.get("filter", "NONE")
    if how != "NONE":
        if how not in FILTERS:
            raise MeshError(f"it is compressed with the filter {how}, which is not known: export it without")
        values = getattr(library, FILTERS[how])(values, count, stride)
    return bytes(values.tobytes())


def _expand_primitives(held: Json, buffer: bytearray, library: ModuleType) -> None:
    for mesh in held.get("meshes", []):
        for primitive in mesh["primitives"]:
            packed = (primitive.get("extensions") or {}).pop(DRACO, None)
            if packed is None:
                continue
            view = held["bufferViews"][packed["bufferView"]]
            start = view.get("byteOffset", 0)
            found = library.decode(bytes(buffer[start : start + view["byteLength"]]))
            _fill(held, buffer, primitive["indices"], found.faces.reshape(-1, 1))
            for attribute, number in packed["attributes"].items():
                values = found.get_attribute_by_unique_id(number)
                if values is None:
                    raise MeshError(f"its compressed data are damaged ({DRACO}): {attribute} is missing")
                _fill(held, buffer, primitive["attributes"][attribute], values["data"])


def _fill(held: Json, buffer: bytearray, index: int, values: NDArray[Any]) -> None:
    """Give an accessor a view of its own with values (count, width), and their bounds, which rounding has moved."""
    accessor = held["accessors"][index]
    exact = np.ascontiguousarray(values, COMPONENT_TYPES[accessor["componentType"]])
    data = exact.tobytes()
    if "min" in accessor and len(exact):
        accessor |= {"min": exact.min(axis=0).tolist(), "max": exact.max(axis=0).tolist()}
    held["bufferViews"].append({"buffer": 0, "byteOffset": _append(buffer, data), "byteLength": len(data)})
    accessor |= {"bufferView": len(held["bufferViews"]) - 1, "byteOffset": 0, "count": len(values)}


def _append(buffer: bytearray, data: bytes) -> int:
    """Append data to the buffer, aligned; where they begin."""
    buffer += bytes(-len(buffer) % 4)
    start = len(buffer)
    buffer += data
    return start


def _forget(held: Json, name: str) -> None:
    """Remove an extension's name."""
    for key in ("extensionsUsed", "extensionsRequired"):
        if name in held.get(key, []):
            held[key].remove(name)
            if not held[key]:
                del held[key]
