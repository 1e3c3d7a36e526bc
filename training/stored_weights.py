"""Large weights of an ONNX file in fewer bits, which the runtime makes float32 again once, when it loads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper

from guise.common.arrays import F32

MIN_VALUES = 4096  # of weights that are stored so
LARGEST = 127
SCALES = np.linspace(
    0.7, 1, 16
)  # of a filter's largest weight, of which the best becomes the largest in 8 bits

Stored = tuple[list[TensorProto], list[NodeProto]]


def halve(path: Path) -> None:
    """Store the large float32 weights of an ONNX file as float16."""

    def stored(name: str, values: F32) -> Stored:
        half = f"{name}.half"
        cast = helper.make_node("Cast", [half], [name], to=TensorProto.FLOAT)
        return [numpy_helper.from_array(values.astype(np.float16), half)], [cast]

    _replace(path, stored, min_filters=1)


def quarter(path: Path) -> None:
    """Store the large float32 weights of an ONNX file in 8 bits, with a scale for each filter, the first axis."""

    def stored(name: str, values: F32) -> Stored:
        whole, scale = f"{name}.whole", f"{name}.scale"
        rounded, scales = in_8_bits(values)
        weights = numpy_helper.from_array(rounded, whole), numpy_helper.from_array(scales, scale)
        cast = helper.make_node("Cast", [whole], [f"{name}.cast"], to=TensorProto.FLOAT)
        return list(weights), [cast, helper.make_node("Mul", [f"{name}.cast", scale], [name])]

    _replace(path, stored, min_filters=2)


def in_8_bits(values: F32) -> tuple[NDArray[np.int8], F32]:
    """Weights (n, ...) as whole numbers of that shape, and scales (n, 1, ...) with the least squared error.

    >>> rounded, scales = in_8_bits(np.array([[0.0, 0.5, -1.0], [10.0, 5.0, 0.0]], np.float32))
    >>> np.round(rounded * scales, 1).tolist()
    [[0.0, 0.5, -1.0], [10.0, 5.0, 0.0]]
    """
    flat = values.reshape(len(values), -1)
    largest = np.maximum(np.abs(flat).max(1, keepdims=True), 1e-12)
    scales = (largest / LARGEST)[None] * SCALES[:, None, None].astype(np.float32)
    rounded = np.clip(np.rint(flat / scales), -LARGEST, LARGEST)
    best = ((rounded * scales - flat) ** 2).sum(2).argmin(0), np.arange(len(flat))
    shape = (len(values), *[1] * (values.ndim - 1))
    return rounded[best].reshape(values.shape).astype(np.int8), scales[best].reshape(shape).astype(np.float32)


def _replace(path: Path, stored: Callable[[str, F32], Stored], min_filters: int) -> None:
    model: ModelProto = onnx.load(path)
    kept, nodes = [], []
    for weights in model.graph.initializer:
        values = numpy_helper.to_array(weights)
        if values.dtype == np.float32 and values.size > MIN_VALUES and len(values) >= min_filters:
            tensors, steps = stored(weights.name, values)
            kept += tensors
            nodes += steps
        else:
            kept.append(weights)
    nodes += model.graph.node
    del model.graph.initializer[:], model.graph.node[:]
    model.graph.initializer.extend(kept)
    model.graph.node.extend(nodes)
    onnx.save(model, path)
