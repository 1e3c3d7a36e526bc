"""Rounds a network to 8 bits so that every processor gives the same answer: its sums are exact in float32.

A rounded network steps: where a sum lies on the border of two steps its last bit decides, and one step moves what
follows by more than its own size. Sums in another order, as other instruction sets or the runtime's fused and plain
forms take them, differ in that bit. With scales that are powers of two nothing is left to differ: values are whole
numbers of 8 bits, weights of 7 (of 10 in layers that keep float32), and sums of their products stay within the 24 bits
that float32 holds, but for extremes that do not occur.

No layer with rounded values before and behind may keep float32: the runtime rounds its weights itself when it fuses,
to all 8 bits, with which older processors overflow.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import NodeProto, numpy_helper

from guise.common.arrays import F32, F64

LARGEST = 64  # of a weight in 8 bits: two products with 255 fit 16 bits, in which older processors add them
LARGEST_UNROUNDED = 512  # of a weight of a layer in float32
PICTURE_STEP = 1 / 128  # of what the first layer gets: bytes less 127.5, divided by 64

Arrays = dict[str, NDArray[Any]]


def powers_of_two(source: Path, target: Path) -> None:
    """Make the scales of `target`, which `quantize_static` made of `source`, powers of two, and round weights anew."""
    model = onnx.load(target)
    exact = {tensor.name: numpy_helper.to_array(tensor) for tensor in onnx.load(source).graph.initializer}
    held = {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type == "QuantizeLinear":
            held |= _of_values(node, held)
    made = {name: node for node in model.graph.node for name in node.output}
    for node in model.graph.node:
        if node.op_type == "Conv":
            step = _step(made.get(node.input[0]), held)
            if node.input[1] in exact:
                held |= _in_float32(node, exact, step)
            else:
                held |= _in_8_bits(made[node.input[1]], made[node.input[2]], exact, step)
    for tensor in model.graph.initializer:
        tensor.CopyFrom(numpy_helper.from_array(held[tensor.name], tensor.name))
    onnx.save(model, target)


def whole_numbers(weights: F32, largest: int) -> tuple[F64, F64]:
    """Weights (n, ...) as whole numbers up to `largest`, and a power of two (n,) each, with the least squared error.

    >>> whole, scales = whole_numbers(np.array([[0.5, -1.0], [0.3, 0.26]], np.float32), 64)
    >>> whole.tolist(), scales.tolist()
    ([[32.0, -64.0], [38.0, 33.0]], [0.015625, 0.0078125])
    """
    flat = weights.reshape(len(weights), -1).astype(np.float64)
    fit = 2.0 ** np.ceil(np.log2(np.maximum(np.abs(flat).max(1), 1e-12) / largest))
    scales = np.stack([fit, fit / 2])
    whole = np.clip(np.rint(flat / scales[..., None]), -largest, largest)
    best = ((whole * scales[..., None] - flat) ** 2).sum(2).argmin(0), np.arange(len(flat))
    return whole[best].reshape(weights.shape), scales[best]


def _of_values(node: NodeProto, held: Arrays) -> Arrays:
    """Scale and zero of values, by name: the least power of two that holds their range, which keeps its middle."""
    _, scale_name, zero_name = node.input
    scale, zero = float(held[scale_name]), float(held[zero_name])
    power = 2.0 ** np.ceil(np.log2(scale))
    centred = np.rint(127.5 - (127.5 - zero) * scale / power)
    return {
        scale_name: np.array(power, np.float32),
        zero_name: np.array(centred if zero else 0, np.uint8),
    }


def _step(made: NodeProto | None, held: Arrays) -> float:
    """Of which the values that a layer gets are multiples, from what makes them."""
    rounded = made is not None and made.op_type == "DequantizeLinear"
    return float(held[made.input[1]]) if rounded and made is not None else PICTURE_STEP


def _in_float32(layer: NodeProto, exact: Arrays, step: float) -> Arrays:
    """Weights and biases, by name, that are multiples of powers of two."""
    _, weights, biases = layer.input
    whole, scales = whole_numbers(exact[weights], LARGEST_UNROUNDED)
    return {
        weights: (whole * scales.reshape(-1, 1, 1, 1)).astype(np.float32),
        biases: (np.rint(exact[biases] / (scales * step)) * scales * step).astype(np.float32),
    }


def _in_8_bits(weights: NodeProto, biases: NodeProto, exact: Arrays, step: float) -> Arrays:
    """Weights, biases and their scales, by name."""
    whole, scales = whole_numbers(exact[_original(weights)], LARGEST)
    steps = scales * step
    return {
        weights.input[0]: whole.astype(np.int8),
        weights.input[1]: scales.astype(np.float32),
        biases.input[0]: np.rint(exact[_original(biases)] / steps).astype(np.int32),
        biases.input[1]: steps.astype(np.float32),
    }


def _original(made: NodeProto) -> str:
    """Name that a rounded tensor had before."""
    return str(made.input[0]).removesuffix("_quantized")
