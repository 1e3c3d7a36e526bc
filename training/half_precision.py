"""Weights of an ONNX file in half precision, which the runtime makes float32 again when it loads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx

MIN_VALUES = 4096  # of weights that are stored so


def halve(path: Path) -> None:
    """Store the large float32 weights of an ONNX file as float16, cast back when it is loaded."""
    model = onnx.load(path)
    stored, casts = [], []
    for weights in model.graph.initializer:
        values = onnx.numpy_helper.to_array(weights)
        if values.dtype == np.float32 and values.size > MIN_VALUES:
            half = f"{weights.name}.half"
            casts.append(onnx.helper.make_node("Cast", [half], [weights.name], to=onnx.TensorProto.FLOAT))
            weights = onnx.numpy_helper.from_array(values.astype(np.float16), half)
        stored.append(weights)
    del model.graph.initializer[:]
    model.graph.initializer.extend(stored)
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    onnx.save(model, path)
