"""Round the face detector to 8 bits, without training.

    python -m training.round_detector --network NETWORK --clips CLIP ... --out OUT

NETWORK is what `train_detector.py` writes.  Frames of the clips, which all may be trained on, tell how large values
become.  The first layer keeps float32, whose steps would show, and so do the levels' merging and heads, which place
the boxes.  The answer is the same on every processor (`exact_rounding.py`).  What is written takes planes of float32,
which are made faster outside of it.  Prints how far the logits of the clips' faces move, and the time of both.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)

from guise.aam.landmarks.detector import MIDDLE_GREY
from guise.aam.onnx_model import open_session
from guise.aam.onnx_weights import without_tiny_weights
from guise.app.media import open_input
from guise.common.arrays import F32, U8
from training.exact_rounding import powers_of_two

ROUNDED = ("Conv", "Relu", "Add", "Resize")
PREPARING = "/Transpose", "/Cast", "/Sub", "/Div"  # a picture, before the first layer
LEVELS = "near", "middle", "far"
KEPT = "/stem/stem.0", "/lateral", "/Add", "/Resize", "/merge", "/heads"
FRAMES, STEP = 3, 25  # of a clip, and from one to the next
SIDES = 160, 320  # pixels, longer ones, in which a frame is seen


class Feed(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, pictures: Iterator[U8]) -> None:
        self._pictures = pictures

    def get_next(self) -> dict[str, U8] | None:
        picture = next(self._pictures, None)
        return None if picture is None else {"image": picture[None]}


def seen(clips: list[Path]) -> Iterator[U8]:
    """Frames of clips (h, w, 3) in the sizes in which faces are searched."""
    for clip in clips:
        with open_input(clip) as media:
            for frame in islice(media, 0, FRAMES * STEP, STEP):
                for side in SIDES:
                    factor = side / max(frame.width, frame.height)
                    size = round(frame.width * factor), round(frame.height * factor)
                    yield np.asarray(cv2.resize(frame.rgb(), size, interpolation=cv2.INTER_AREA), np.uint8)


def rounded(source: Path, target: Path, pictures: Iterator[U8]) -> None:
    """Write the network of `source` in 8 bits; pictures (h, w, 3) calibrate it."""
    nodes = [node.name for node in onnx.load(source).graph.node]
    kept = [name for name in nodes if name.startswith(KEPT)]
    quantize_static(
        source, target, Feed(pictures), quant_format=QuantFormat.QDQ, op_types_to_quantize=list(ROUNDED),
        activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, per_channel=True,
        reduce_range=True,  # or older processors overflow
        calibrate_method=CalibrationMethod.MinMax, nodes_to_exclude=kept,
    )  # fmt: skip
    powers_of_two(source, target)
    take_planes(target)
    target.write_bytes(without_tiny_weights(target.read_bytes()))  # nor negative zeros


def take_planes(path: Path) -> None:
    """Have a network begin with its first layer: it gets planes (1, 3, h, w) less 127.5, and nothing divides them."""
    model = onnx.load(path)
    graph = model.graph
    first = next(node for node in graph.node if node.op_type == "Conv")
    weights = next(one for one in graph.initializer if one.name == first.input[1])
    weights.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(weights) / np.float32(64), weights.name))
    first.input[0] = "image"
    needed = {name for node in graph.node if node.name not in PREPARING for name in node.input}
    for node in [node for node in graph.node if not {*needed, *LEVELS} & set(node.output)]:
        graph.node.remove(node)
    given = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "height", "width"])
    graph.input[0].CopyFrom(given)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def as_planes(picture: U8) -> F32:
    """What such a network gets of a picture (h, w, 3)."""
    return np.ascontiguousarray(picture.transpose(2, 0, 1)[None] - np.float32(MIDDLE_GREY))


def logits(session: Any, pictures: Iterable[U8]) -> F32:
    """Of all cells of pictures (h, w, 3)."""
    is_float = session.get_inputs()[0].type == "tensor(float)"
    given = (as_planes(picture) if is_float else picture[None] for picture in pictures)
    answers = (level for one in given for level in session.run(None, {"image": one}))
    return np.concatenate([level[0, 0].ravel() for level in answers])


def run(
    description: str, seen: Callable[[list[Path]], Iterator[U8]], rounded: Callable[[Path, Path, Iterator[U8]], None],
    logits: Callable[[Any, Iterable[U8]], F32],
) -> None:  # fmt: skip
    """Round the network that the command line names, and say how far the logits of faces move, and the time of both."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--network", type=Path, required=True)
    parser.add_argument("--clips", type=Path, nargs="+", required=True)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    pictures = list(seen(sorted(options.clips)))
    rounded(options.network, options.out, iter(pictures))
    found, seconds = [], []
    for file in (options.network, options.out):
        session = open_session(file.read_bytes())
        start = time.thread_time()
        found.append(logits(session, pictures))
        seconds.append(time.thread_time() - start)
    faces = found[0] > 0
    away = (found[1] - found[0])[faces]
    print(f"{faces.sum()} cells with a face: logits move by {away.mean():.3f} +- {away.std():.3f}, ", end="")
    print(
        f"{(found[1][faces] > 0).mean():.1%} stay above 0; {seconds[1] / seconds[0]:.2f} of the time, ",
        end="",
    )
    print(f"{options.out.stat().st_size:,} bytes instead of {options.network.stat().st_size:,}")


if __name__ == "__main__":
    run(__doc__.splitlines()[0], seen, rounded, logits)
