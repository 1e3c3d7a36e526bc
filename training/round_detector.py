"""Round the face detector to 8 bits, without training.

    python -m training.round_detector --network NETWORK --clips CLIP ... --out OUT

NETWORK is what `train_detector.py` writes.  Frames of the clips, which all may be trained on, tell how large values
become.  The first layer keeps float32, whose steps would show, and so do the levels' merging and heads, which place
the boxes.  The answer is the same on every processor (`exact_rounding.py`).  Prints how far the logits of the clips'
faces move, and the time of both.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)

from guise.aam.onnx_model import open_session
from guise.aam.onnx_weights import without_tiny_weights
from guise.app.media import open_input
from guise.common.arrays import F32, U8
from training.exact_rounding import powers_of_two

ROUNDED = ("Conv", "Relu", "Add", "Resize")
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
    target.write_bytes(without_tiny_weights(target.read_bytes()))  # nor negative zeros


def logits(session: Any, pictures: Iterable[U8]) -> F32:
    """Of all cells of pictures (h, w, 3)."""
    answers = (level for picture in pictures for level in session.run(None, {"image": picture[None]}))
    return np.concatenate([level[0, 0].ravel() for level in answers])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
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
    main()
