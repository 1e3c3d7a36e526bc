"""Vanishing weights of an ONNX model set to zero, because arithmetic with subnormal floats is slow.

A trained network can hold weights such as 1e-40; on common CPUs a product with one costs a hundred times
a normal one (PFLD: 45 ms a call with them, 2 ms without). onnxruntime can flush subnormals to zero itself,
but does so for the whole thread of the caller, where NumPy then computes and warns differently.

The walk follows only the fields of the ONNX format (protobuf) that lead to weights: ModelProto.graph,
GraphProto.initializer and .node, NodeProto.attribute, AttributeProto.t and .g, TensorProto.raw_data.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

_TINY = 1e-30
_FLOAT = 1  # TensorProto.DataType.FLOAT

# Message -> field number -> message in that field.
_CHILDREN = {
    "model": {7: "graph"},
    "graph": {1: "node", 5: "tensor"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph"},
}
_DATA_TYPE, _RAW_DATA = 2, 9


def without_tiny_weights(model: bytes) -> bytes:
    """The ONNX file's bytes with every float32 weight below 1e-30 set to zero.

    Bytes that are no such file come back as they were, for the runtime to refuse.

    Examples
    --------
    >>> without_tiny_weights(b"no model")
    b'no model'
    """
    content = bytearray(model)
    try:
        _walk(content, 0, len(content), "model")
    except (IndexError, ValueError, RecursionError):
        return model
    return bytes(content)


def _walk(content: bytearray, start: int, end: int, message: str) -> None:
    if message == "tensor":
        _flush(content, start, end)
        return
    for field, begin, stop in _fields(content, start, end):
        child = _CHILDREN[message].get(field)
        if child is not None and stop > begin:
            _walk(content, begin, stop, child)


def _flush(content: bytearray, start: int, end: int) -> None:
    kind, raw = 0, (0, 0)
    for field, begin, stop in _fields(content, start, end):
        if field == _DATA_TYPE:
            kind = _varint(content, begin)[0]
        elif field == _RAW_DATA:
            raw = (begin, stop)
    if kind != _FLOAT or (raw[1] - raw[0]) % 4:
        return
    values = np.frombuffer(content[raw[0] : raw[1]], dtype="<f4").copy()
    values[np.abs(values) < _TINY] = 0
    content[raw[0] : raw[1]] = values.tobytes()


def _fields(content: bytearray, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Field number, begin and end of the value, of each field of a message."""
    position = start
    while position < end:
        key, position = _varint(content, position)
        wire = key & 7
        if wire == 0:
            stop = _varint(content, position)[1]
        elif wire == 2:
            length, position = _varint(content, position)
            stop = position + length
        elif wire in {1, 5}:
            stop = position + (8 if wire == 1 else 4)
        else:
            raise ValueError("not a protobuf message")
        if stop > end:
            raise ValueError("not a protobuf message")
        yield key >> 3, position, stop
        position = stop


def _varint(content: bytearray, position: int) -> tuple[int, int]:
    value, shift = 0, 0
    while True:
        byte = content[position]
        value |= (byte & 127) << shift
        position, shift = position + 1, shift + 7
        if byte < 128:
            return value, position
