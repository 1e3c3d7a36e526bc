"""Converts the weights of a shipped 8-bit network back to a trainable one.

The export folds batch normalisation into the convolutions. `load_shipped` separates them again: each normalisation
gets the statistics of its input on sample crops, and the scale and shift that undo them, so that the network gives the
same output as the file and trains as if it had never been exported. The crops must resemble those of the training that
follows, where batches are normalised by their own statistics: with statistics of plain crops the network would start
out different.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from guise.common.arrays import F32, U8
from training.branches import joined
from training.landmark_net import LandmarkNet


def load_shipped(net: LandmarkNet, path: Path, crops: U8) -> None:
    """Give `net` the weights of an 8-bit ONNX file, with normalisation statistics from crops (n, 128, 128, 3).

    What the file does not hold, as the points of `face.onnx`, keeps the weights it has.
    """
    graph = joined(onnx.load(path)).graph
    values = values_of(graph)
    state = net.state_dict()
    for name in set(values) & set(state):
        state[name].copy_(torch.from_numpy(values[name].copy()))
    modules = dict(net.named_modules())
    filled = []
    for node in graph.node:
        if node.op_type == "Conv" and not node.name.startswith("face/"):  # which `face_head.py` has added
            weight, bias = (torch.from_numpy(values[name].copy()) for name in node.input[1:3])
            filled.append(fill(modules, module_name(node.name), weight, bias))
    _unfold(net, torch.from_numpy(crops), [module for module in filled if module is not None])


def module_name(node: str) -> str:
    """Name of the module that an exported node is of.

    >>> module_name("/fine/fine.2/first/first.0/Conv")
    'fine.2.first.0'
    """
    names: list[str] = []
    for part in node.strip("/").split("/")[:-1]:
        if names and part.startswith(names[-1].split(".")[0] + "."):
            names[-1] = part
        else:
            names.append(part)
    return ".".join(names)


def values_of(graph: Any) -> dict[str, F32]:
    """Initialisers of an ONNX graph as float, by the name they have in the network before quantisation."""
    raw = {tensor.name: numpy_helper.to_array(tensor) for tensor in graph.initializer}
    found = {name: value for name, value in raw.items() if value.dtype == np.float32}
    for node in graph.node:
        if node.op_type == "Cast" and node.input[0] in raw:
            found[node.output[0]] = raw[node.input[0]].astype(np.float32)
        if node.op_type == "DequantizeLinear" and node.input[0] in raw:
            quantised, scale, zero = (raw[name] for name in node.input)
            shape = (-1,) + (1,) * (quantised.ndim - 1)
            value = (quantised.astype(np.float32) - zero.reshape(shape)) * scale.reshape(shape)
            found[node.output[0]] = value.astype(np.float32)
    return {name.removeprefix("net."): value for name, value in found.items()} | found


def fill(modules: dict[str, nn.Module], name: str, weight: Tensor, bias: Tensor) -> nn.Module | None:
    """Set a convolution; its bias goes to the normalisation behind it, if it has none of its own, which is returned."""
    with torch.no_grad():
        convolution = modules[name]
        convolution.weight.copy_(weight)
        if convolution.bias is not None:
            convolution.bias.copy_(bias)
            return None
        parent, _, index = name.rpartition(".")
        normalisation = modules[f"{parent}.{int(index) + 1}"]
        normalisation.weight.fill_(1)
        normalisation.bias.copy_(bias)
        normalisation.running_mean.fill_(0)
        normalisation.running_var.fill_(1 - normalisation.eps)
    return normalisation


def _unfold(net: LandmarkNet, crops: Tensor, normalisations: list[nn.Module]) -> None:
    """Replace the neutral statistics of the normalisations by those of crops; the output stays the same."""
    sums: dict[nn.Module, list[Tensor]] = {}

    def watch(module: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        x = inputs[0].double()
        sums.setdefault(module, []).append(torch.stack([x.mean((0, 2, 3)), (x**2).mean((0, 2, 3))]))

    hooks = [m.register_forward_pre_hook(watch) for m in normalisations]
    net.eval()
    with torch.no_grad():
        for start in range(0, len(crops), 64):
            net(crops[start : start + 64])
        for module in normalisations:
            mean, square = torch.stack(sums[module]).mean(0)
            spread = (square - mean**2).clamp(min=1e-6)
            module.running_mean.copy_(mean)
            module.running_var.copy_(spread)
            module.weight.copy_((spread + module.eps).sqrt())
            module.bias.add_(mean.float())
    for hook in hooks:
        hook.remove()
