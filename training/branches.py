"""Parts of the landmarker's network that run only where they are asked for.

What tells faces comes first, unless the input `looks` is false.  Then come points and sigma, unless the likeness is
below the input `least`: they are NaN then.  A branch holds its own weights, which the runtime lays out for its fastest
kernels only there.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import GraphProto, ModelProto, NodeProto, TensorProto, helper, numpy_helper

# Names in the file of the trunk's features, (128, 8, 8), (64, 16, 16) and (32, 32, 32), and of what is known of the
# whole face, (192,).
FEATURES = (
    "/coarse/coarse.2/Relu_output_0_DequantizeLinear_Output",
    "/middle/middle.2/Relu_output_0_DequantizeLinear_Output",
    "/fine.2/Relu_output_0_DequantizeLinear_Output",
    "/whole/whole.1/Relu_output_0",
)
SHAPES = {"points": (1, 81, 2), "sigma": (1, 81)}
_WITHIN = {name: f"{name}/points" for name in (*FEATURES[:3], *SHAPES)}  # names in the branch


def branch(path: Path) -> None:
    """Put points behind the likeness in an ONNX file, and the branches' weights into them."""
    model = onnx.load(path)
    graph = model.graph
    face = next(node for node in graph.node if node.name == "face")
    told, trunk = {name for node in _then(face).node for name in node.input}, set(FEATURES)
    for node in reversed(graph.node):
        trunk |= set(node.input) if trunk & set(node.output) else set()
    shared = [node for node in graph.node if (trunk | told) & set(node.output)]
    apart = [node for node in graph.node if not (trunk | told | {"face"}) & set(node.output)]
    # The steps of the trunk are read once more, or the runtime could not fuse what follows.
    again = [node for node in shared if set(_WITHIN) & set(node.output)]
    within = [_renamed(node, _WITHIN) for node in (*again, *apart)]
    nothing = {
        name: numpy_helper.from_array(np.full(shape, np.nan, np.float32)) for name, shape in SHAPES.items()
    }
    none = [helper.make_node("Constant", [], [f"none/{name}"], value=nothing[name]) for name in SHAPES]
    points = helper.make_node(
        "If", ["is like"], list(SHAPES), name="points",
        then_branch=_graph("like", within, {_WITHIN[name]: shape for name, shape in SHAPES.items()}),
        else_branch=_graph("unlike", none, {f"none/{name}": shape for name, shape in SHAPES.items()}),
    )  # fmt: skip
    likes = helper.make_node("GreaterOrEqual", ["face", "least"], ["is like"], name="is like")
    del graph.node[:]
    graph.node.extend([*shared, face, likes, points])
    graph.input.append(helper.make_tensor_value_info("least", TensorProto.FLOAT, [1]))
    graph.initializer.append(numpy_helper.from_array(np.array([-np.inf], np.float32), "least"))
    for name in ("face", "points"):
        _take_weights(graph, _then(next(node for node in graph.node if node.name == name)))
    onnx.checker.check_model(model)
    onnx.save(model, path)


def joined(model: ModelProto) -> ModelProto:
    """The network, in place, without the branch for points: as it was before `branch`, but for the branch `face`."""
    graph, back = model.graph, {value: key for key, value in _WITHIN.items()}
    for node in [node for node in graph.node if node.name == "points"]:
        then = _then(node)
        graph.node.remove(node)
        graph.initializer.extend(then.initializer)
        made = {name for one in graph.node for name in one.output}
        inner = [_renamed(one, back) for one in then.node]
        graph.node.extend(one for one in inner if not made & set(one.output))
        graph.node.remove(next(one for one in graph.node if one.name == "is like"))
        for given in (graph.input, graph.initializer):
            given.remove(next(one for one in given if one.name == "least"))
    return model


def _take_weights(graph: GraphProto, branch: GraphProto) -> None:
    """Move what only a branch needs into it: initialisers, and what makes float32 of them."""
    wanted = {name for node in branch.node for name in node.input}
    casts = [node for node in graph.node if node.op_type == "Cast" and node.output[0] in wanted]
    for node in casts:
        graph.node.remove(node)
    wanted |= {node.input[0] for node in casts}
    others = {name for node in graph.node for name in node.input}
    taken = [one for one in graph.initializer if one.name in wanted and one.name not in others]
    for one in taken:
        graph.initializer.remove(one)
    branch.initializer.extend(taken)
    rest = list(branch.node)
    del branch.node[:]
    branch.node.extend([*casts, *rest])


def _graph(name: str, nodes: list[NodeProto], outputs: dict[str, tuple[int, ...]]) -> GraphProto:
    given = [helper.make_tensor_value_info(one, TensorProto.FLOAT, shape) for one, shape in outputs.items()]
    return helper.make_graph(nodes, name, [], given)


def _then(node: NodeProto) -> GraphProto:
    return next(one.g for one in node.attribute if one.name == "then_branch")


def _renamed(node: NodeProto, names: dict[str, str]) -> NodeProto:
    made = NodeProto()
    made.CopyFrom(node)
    for one in (made.input, made.output):
        one[:] = [names.get(name, name) for name in one]
    return made
