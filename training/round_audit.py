"""Round the audit's face detector to 8 bits, without training.

    python -m training.round_audit --network NETWORK --clips CLIP ... --out OUT

NETWORK is what `train_audit.py` writes.  Frames of the clips, upright, turned and negative, tell how large values
become.  The evening of contrast and the first layers keep float32, and so does what merges and votes.  Prints how far
the logits of the clips' faces move, and the time of both.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import numpy_helper
from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static

from guise.aam.landmarks.voting import levels, whole_blocks
from guise.app.media import open_input
from guise.common.arrays import F32, U8
from training.round_detector import FRAMES, STEP, Feed, run
from training.stored_weights import halve

SMALLEST = 30.0  # pixels of a face of the largest picture
KEPT = "/Add", "/stem/stem.0", "/back", "/lateral", "/head/head.0", "/head/head.3"  # names begin so


def seen(clips: list[Path]) -> Iterator[U8]:
    """Pictures (h, w, 3) of clips as the network gets them."""
    for clip in clips:
        with open_input(clip) as media:
            for turn, frame in enumerate(islice(media, 0, FRAMES * STEP, STEP)):
                rgb = np.ascontiguousarray(np.rot90(frame.rgb(), turn))
                for one in (rgb, 255 - rgb) if turn else (rgb,):
                    yield from (whole_blocks(level.image) for level in levels(one, SMALLEST))


def rounded(source: Path, target: Path, pictures: Iterator[U8]) -> None:
    """Write the network of `source` in 8 bits; pictures (h, w, 3) calibrate it."""
    model = onnx.load(source)
    kept = [node.name for node in model.graph.node if node.name.startswith(KEPT)]
    with tempfile.TemporaryDirectory() as folder:
        single = Path(folder) / "single.onnx"
        onnx.save(in_float32(model), single)
        quantize_static(
            single, target, Feed(pictures), quant_format=QuantFormat.QDQ,
            op_types_to_quantize=["Conv", "Relu", "Add"], activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8, per_channel=True, reduce_range=True,  # or older processors overflow
            calibrate_method=CalibrationMethod.MinMax, nodes_to_exclude=kept,
        )  # fmt: skip
    halve(target)


def in_float32(model: onnx.ModelProto) -> onnx.ModelProto:
    """A network whose stored weights are float16, with float32 instead."""
    graph = model.graph
    halves = {tensor.name: tensor for tensor in graph.initializer if tensor.name.endswith(".half")}
    for node in [node for node in graph.node if node.op_type == "Cast" and node.input[0] in halves]:
        values = numpy_helper.to_array(halves[node.input[0]]).astype(np.float32)
        graph.initializer.append(numpy_helper.from_array(values, node.output[0]))
        graph.node.remove(node)
    for tensor in halves.values():
        graph.initializer.remove(tensor)
    return model


def logits(session: Any, pictures: Iterable[U8]) -> F32:
    """Of all cells of pictures (h, w, 3)."""
    answers = (session.run(None, {"image": picture[None]})[0] for picture in pictures)
    return np.concatenate([votes[0, 0].ravel() for votes in answers])


if __name__ == "__main__":
    run(__doc__.splitlines()[0], seen, rounded, logits)
