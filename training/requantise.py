"""Round the shipped networks for points, irises and parsing of faces to 8 bits anew, without training.

    python -m training.requantise --parts PARTS --real DATA --out OUT [--networks face.onnx ...] [--ship]

PARTS and DATA are those of `train_face.py`, of which people held out calibrate and measure; `finish_face.py` has the
rounding.  Prints errors and unrest of the networks before and after: how far what is found moves about its mean as the
crop moves by hundredths of its side, which jitters in a video, in per cent of the inter-ocular distance.  `fused` is
how far the answers move, as a share of an output's range, when the runtime fuses nothing.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import nn

from guise.aam.landmarks import interocular
from guise.aam.landmarks.builtin import CROP, cut
from guise.aam.landmarks.crops import upright_square
from guise.common.arrays import F32, F64, U8
from training.canvas import Sample
from training.crops import plain_samples
from training.data import Pictures, load_parts, load_real
from training.definitions import read_alignment
from training.dequantise import load_shipped
from training.face_net import FaceNet
from training.finish_face import DATA, OUTPUTS, Landmarker, eight_bit, export, milliseconds
from training.finish_parsing import FaceParser
from training.measure import AGREEMENT_EVERY, Answer, answers_of_file, figures_of, fused_apart

NETWORKS: dict[str, tuple[type[nn.Module], tuple[str, ...]]] = {
    "landmarks.onnx": (Landmarker, OUTPUTS),
    "face.onnx": (FaceParser, ("iris", "parsing")),
}
MOVES, MOVED = 6, (0.01, 0.01, 0.004)  # crops of a face; standard deviations of turn, size and place


def unrest(answer: Answer, pictures: Pictures) -> float:
    """Median over faces of the mean distance of what is found, points or irises, from its mean over crops, per cent."""
    rng = np.random.default_rng(1)
    figures = []
    for image, points in zip(pictures.images, pictures.points, strict=True):
        found = np.array([_found(answer, image, points, rng) for _ in range(MOVES)])
        away = np.linalg.norm(found - found.mean(0), axis=2).mean()
        figures.append(100 * away / interocular(points))
    return float(np.median(figures))


def _found(answer: Answer, image: U8, points: F32, rng: np.random.Generator) -> F64:
    """(k, 2) points or irises, pixels of the picture, found in a crop near a face."""
    centre, side, turn = upright_square(points.astype(np.float64))
    more, size, place = rng.normal(0, MOVED, 3)
    away = place * side * np.array([np.cos(100 * size), np.sin(100 * size)])
    crop, to_picture = cut(image, centre + away, CROP.side_head_boxes * side * np.exp(size), turn + more)
    seen = answer(crop[None])
    found = seen.points if seen.points is not None else seen.iris
    assert found is not None
    return np.asarray(cv2.transform(found[:1, :, :2].astype(np.float64), to_picture)[0])


def rounded(name: str, out: Path, crops: U8) -> Path:
    """The file of a shipped network that is rounded anew, calibrated on crops."""
    module, outputs = NETWORKS[name]
    net = FaceNet()
    load_shipped(net, DATA / name, crops)
    exact = out / f"float32_{name}"
    export(module(net), exact, outputs)
    eight_bit(exact, out / name, crops)
    return out / name


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("parts", "real", "out"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--networks", nargs="+", choices=NETWORKS, default=list(NETWORKS))
    parser.add_argument("--ship", action="store_true", help="copy the networks to aam/data")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    alignment = read_alignment()
    unseen = alignment.rendered(load_parts(options.parts, held_out=True))
    real = alignment.real(load_real(options.real, held_out=True))
    plain: list[Sample] = plain_samples(unseen, min(300, len(unseen)))
    crops = np.stack([sample.crop for sample in plain + plain_samples(real, len(real))])
    for name in options.networks:
        files = DATA / name, rounded(name, options.out, crops)
        for file, ms in zip(files, milliseconds(list(files), crops[0]), strict=True):
            answer = answers_of_file(file)
            figures = {k: v for k, v in figures_of(answer, plain).items() if isinstance(v, float)}
            figures |= {"unrest": unrest(answer, unseen), "unrest of real": unrest(answer, real), "ms": ms}
            figures |= {"fused": fused_apart(file, crops[::AGREEMENT_EVERY])}
            print(file, {k: round(v, 3) for k, v in figures.items()}, file.stat().st_size, flush=True)
        if options.ship:
            shutil.copy(files[1], files[0])


if __name__ == "__main__":
    main()
