"""Large weights of an ONNX file in fewer bits, which the runtime makes float32 again once, when it loads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper

from guise.common.arrays import F32

MIN_VALUES = 4096  # of weights that are stored so

Stored = tuple[list[TensorProto], list[NodeProto]]


def halve(path: Path) -> None:
    """Store the large float32 weights of an ONNX file as float16."""

    def stored(name: str, values: F32) -> Stored:
        half = f"{name}.half"
        cast = helper.make_node("Cast", [half], [name], to=TensorProto.FLOAT)
        return [numpy_helper.from_array(values.astype(np.float16), half)], [cast]

    _replace(path, stored, min_filters=1)


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
