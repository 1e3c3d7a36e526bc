"""Fit how the landmarker tells faces from other things to what the shipped one tells, also of hands alone.

    python -m training.face_logit --run RUN --parts PARTS --hands HANDS --output OUT

RUN is the output of `train_face.py`, PARTS and HANDS what it was trained with.  Limits in the package are logits, whose
scale each training leaves differently, and its samples without a face show no hands.  So the last layer of the logit is
fitted anew by ridge regression: for crops without a face to the shipped landmarker's logits (knowledge distillation,
Hinton, Vinyals and Dean 2015), for faces to the larger of these and its own.  Prints quantiles of the logits of crops
held back, and how often a face has more than another crop.  Writes `face.pt` to OUT.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch

from guise.common.arrays import F32, F64, U8, Bool
from training.augment import Props, Strength, negative, objects_alone, sample
from training.canvas import SIZE
from training.cutouts import make_props
from training.data import Pictures, load_parts
from training.face_net import FaceNet
from training.finish_face import DATA
from training.measure import answers_of_file

FACES, WITHOUT = 0.35, 0.35  # shares of the crops; the others show objects alone
SMALL, SMALL_PIXELS = 0.5, (10, 64)  # share of crops that are of low resolution, and their sides
RIDGE, HELD_BACK = 20.0, 5  # every so manieth crop
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def crops(pictures: Pictures, props: Props, count: int, seed: int = 3) -> Iterator[tuple[U8, bool]]:
    """Crops (128, 128, 3), and whether they show a face."""
    rng = np.random.default_rng(seed)
    cv2.setRNGSeed(seed)
    for _ in range(count):
        one, kind = pictures[int(rng.integers(len(pictures)))], rng.random()
        if kind < FACES:
            crop = sample(rng, one, props, Strength(), mapped=False).crop
        elif kind < FACES + WITHOUT:
            crop = negative(rng, one.image, one.points, props.backgrounds)
        else:
            crop = objects_alone(rng, one, props)
        if rng.random() < SMALL:
            side = int(rng.integers(*SMALL_PIXELS))
            crop = cv2.resize(
                cv2.resize(crop, (side, side), interpolation=cv2.INTER_AREA), (SIZE, SIZE)
            )  # as a small face is enlarged
        yield np.asarray(crop, np.uint8), kind < FACES


@torch.no_grad()
def seen(net: FaceNet, pictures: U8) -> tuple[F32, F32]:
    """What the logit's last layer sees of crops (n, k), and the logits (n,)."""
    found = [net.whole(net.squeeze(net.features(torch.from_numpy(part))[2]).flatten(1))
             for part in np.array_split(pictures, max(1, len(pictures) // 64))]  # fmt: skip
    whole = torch.cat(found)
    return whole.numpy(), net.face(whole)[:, 0].numpy()


def fitted(features: F32, target: F64) -> F64:
    """Weights (k + 1,) of ridge regression, the constant last."""
    known = np.column_stack([features, np.ones(len(features))]).astype(np.float64)
    scale = np.append(known[:, :-1].std(0) + 1e-6, 1.0)
    known /= scale
    damping = RIDGE * np.eye(known.shape[1])
    damping[-1, -1] = 0
    return np.asarray(np.linalg.solve(known.T @ known + damping, known.T @ target) / scale)


def _report(name: str, logits: F32, face: Bool) -> None:
    more = float((logits[face][:, None] > logits[~face]).mean())
    faces, others = (np.quantile(logits[some], QUANTILES).round(1).tolist() for some in (face, ~face))
    print(f"{name}: faces {faces}, others {others}; a face has more than another crop {100 * more:.2f} %")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("run", "parts", "hands", "output"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--count", type=int, default=6000)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    options.output.mkdir(parents=True, exist_ok=True)
    net = FaceNet()
    net.load_state_dict(torch.load(options.run / "face.pt", map_location="cpu"))
    net.eval()
    props = make_props(5, options.hands)
    made = list(crops(load_parts(options.parts, held_out=False), props, options.count))
    pictures, face = np.stack([crop for crop, _ in made]), np.array([is_face for _, is_face in made])
    features, own = seen(net, pictures)
    shipped = answers_of_file(DATA / "landmarks.onnx")(pictures).face
    target = np.where(face, np.maximum(shipped, own), shipped).astype(np.float64)
    out = np.arange(len(face)) % HELD_BACK == 0
    weights = fitted(features[~out], target[~out])
    for name, logits in (
        ("shipped", shipped),
        ("before", own),
        ("fitted", features @ weights[:-1] + weights[-1]),
    ):
        _report(name, logits[out], face[out])
    net.face.weight.data = torch.tensor(weights[None, :-1], dtype=torch.float32)
    net.face.bias.data = torch.tensor(weights[-1:], dtype=torch.float32)
    torch.save(net.state_dict(), options.output / "face.pt")
    shutil.copy(options.run / "facts.json", options.output)


if __name__ == "__main__":
    main()
