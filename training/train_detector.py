"""Trains the built-in face detector and writes it as ONNX.

    python -m training.train_detector --parts PARTS [--real DATA] --output OUT

PARTS holds what `render_people.py` wrote; DATA is the folder with `pairs/london` and `real`, of which the pictures that
may be trained on are used. OUT gets `detector.onnx`, which `round_detector.py` rounds to 8 bits, `curves.csv` and the
weights. The same seed and data give the same scenes in the same order, and --resume goes on where a run was
interrupted. PyTorch is needed here only (`pip install "guise-video[train]"`).
"""

from __future__ import annotations

import argparse
import copy
import csv
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

import cv2
import numpy as np
import onnx
import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.utils.data import DataLoader, IterableDataset

from guise.common.arrays import F32
from training.backgrounds import faceless_photos
from training.data import load_parts
from training.dequantise import fill, module_name, values_of
from training.detector_net import STRIDES, UNIT, DetectorNet
from training.scenes import SIZE, Scene, Scenes, real_people

# Sides of faces, pixels, that a level must find, and outside of which it must not: between them it may.
MUST = ((0, 56), (28, 140), (96, 10_000))
MAY = ((0, 76), (20, 190), (72, 10_000))
LEAST_SPREAD, SPREAD = 0.45, 0.07  # of the bump about a face's centre: cells, and share of the face's side
BESIDE = 0.8  # cells, within which of the true centre a cell may say so too: else a centre between two has two halves
LEARNED = 0.3  # cells under a bump at least that high learn the box, as do those beside the centre
VALIDATION_SCENES = 160

Batch = tuple[Any, list[F32]]
Net = TypeVar("Net", bound=nn.Module)


class Samples(IterableDataset[Batch]):
    """Batches of scenes, each from a generator of its own: (seed, number)."""

    def __init__(self, scenes: Scenes, steps: int, batch: int, seed: int) -> None:
        self.scenes, self.steps, self.batch, self.seed = scenes, steps, batch, seed
        self.first = 0  # of the batches that are still to come

    def __iter__(self) -> Iterator[Batch]:
        """Yield this worker's share of the batches."""
        cv2.setNumThreads(1)
        info = torch.utils.data.get_worker_info()
        start, step = (info.id, info.num_workers) if info else (0, 1)
        for number in range(self.first + start, self.steps, step):
            rng = np.random.default_rng([self.seed, 2, number])
            cv2.setRNGSeed(int(rng.integers(1 << 31)))
            yield self.made(rng)

    def made(self, rng: np.random.Generator) -> Batch:
        """One batch: pictures (batch, SIZE, SIZE, 3), and what each level is to answer."""
        scenes = [self.scenes.make(rng) for _ in range(self.batch)]
        targets = [np.stack([target(s, level) for s in scenes]) for level in range(len(STRIDES))]
        return np.stack([s.image for s in scenes]), targets


def target(scene: Scene, level: int) -> F32:
    """(7, h, w) for one level: height of the bump, weight of the cell in it, weight of the box, and the box."""
    stride, cells = STRIDES[level], SIZE // STRIDES[level]
    out = np.zeros((7, cells, cells), np.float32)
    out[1] = 1
    ys, xs = np.mgrid[:cells, :cells].astype(np.float32)
    centres = np.stack([xs, ys], -1) * stride + (stride - 1) / 2
    for box in scene.unsure:
        out[1][((centres > box[:2]) & (centres < box[2:])).all(-1)] = 0
    for box in scene.boxes:
        side = float((box[2:] - box[:2]).max())
        middle = ((box[:2] + box[2:]) / 2 - (stride - 1) / 2) / stride
        nearest = np.clip(np.round(middle), 0, cells - 1)
        spread = max(LEAST_SPREAD, SPREAD * side / stride)
        bump = np.exp(-((xs - nearest[0]) ** 2 + (ys - nearest[1]) ** 2) / (2 * spread**2))
        if MUST[level][0] <= side < MUST[level][1]:
            higher = bump > out[0]
            out[0][higher] = bump[higher]
            out[3:, higher] = box[:, None]
            beside = np.hypot(xs - middle[0], ys - middle[1]) < BESIDE
            out[1][beside] = 0
            out[2][higher] = np.where(beside | (bump > LEARNED), np.maximum(bump, LEARNED), 0)[higher]
        elif MAY[level][0] <= side < MAY[level][1]:
            out[1][bump > 0.05] = 0
    out[1][out[0] > 0.999] = 1
    return out


def loss_of(found: tuple[Tensor, ...], targets: list[Tensor]) -> tuple[Tensor, dict[str, float]]:
    """Penalty-reduced focal loss of the heat maps (Law & Deng 2018), and the boxes' corners in shares of the side."""
    heat, boxes, count, learned = torch.zeros(()), torch.zeros(()), torch.zeros(()), torch.zeros(())
    for level, (maps, wanted) in enumerate(zip(found, targets, strict=True)):
        maps = maps.float()
        logit, bump, weight = maps[:, 0], wanted[:, 0], wanted[:, 1]
        p = torch.sigmoid(logit)
        centre = (bump > 0.999).float()
        missed = centre * (1 - p) ** 2 * F.softplus(-logit)
        false = (1 - centre) * (1 - bump) ** 4 * p**2 * F.softplus(logit) * weight
        heat = heat + missed.sum() + false.sum()
        count = count + centre.sum()
        part = wanted[:, 2]
        side = (wanted[:, 5:] - wanted[:, 3:5]).amax(1).clamp(min=1)
        error = (corners(maps, STRIDES[level]) - wanted[:, 3:]).abs().sum(1) / side
        boxes = boxes + (part * error).sum()
        learned = learned + part.sum()
    heat, boxes = heat / count.clamp(min=1), boxes / learned.clamp(min=1)
    return heat + 2 * boxes, {"heat": float(heat.detach()), "box": float(boxes.detach()) / 4}


def corners(maps: Tensor, stride: int) -> Tensor:
    """Boxes (n, 4, h, w) in pixels from a level's maps (n, 5, h, w)."""
    ys, xs = torch.meshgrid(torch.arange(maps.shape[2]), torch.arange(maps.shape[3]), indexing="ij")
    place = torch.stack([xs, ys]).float() * stride + (stride - 1) / 2
    reach = maps[:, 1:] * (UNIT * stride)
    return torch.cat([place - reach[:, :2], place + reach[:, 2:]], 1)


@torch.no_grad()
def validate(net: DetectorNet, scenes: list[Scene]) -> dict[str, float]:
    """Share of faces whose cell says so at 0.5, and false centres at 0.5 a scene."""
    net.eval()
    found, faces, false = 0, 0, 0
    for scene in scenes:
        maps = net(torch.from_numpy(scene.image[None]))
        boxes, unsure = torch.from_numpy(scene.boxes), torch.from_numpy(scene.unsure)
        hit = torch.zeros(len(boxes), dtype=torch.bool)
        for level, stride in zip(maps, STRIDES, strict=True):
            heat = torch.sigmoid(level[:, :1])
            peak = (heat >= 0.5) & (heat == F.max_pool2d(heat, 3, 1, 1))
            places = corners(level, stride)[0].permute(1, 2, 0)[peak[0, 0]].double()
            hits = _overlaps(places, boxes) > 0.45
            allowed = _overlaps(places, torch.cat([boxes, unsure])) > 0.2
            hit |= hits.any(0)
            false += int((~allowed.any(1)).sum())
        found, faces = found + int(hit.sum()), faces + len(boxes)
    return {"recall": found / max(faces, 1), "false_a_scene": false / len(scenes)}


def _overlaps(a: Tensor, b: Tensor) -> Tensor:
    low = torch.maximum(a[:, None, :2], b[None, :, :2])
    high = torch.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = (high - low).clamp(min=0).prod(-1)
    areas = (a[:, 2:] - a[:, :2]).prod(-1)[:, None] + (b[:, 2:] - b[:, :2]).prod(-1)[None]
    return shared / (areas - shared).clamp(min=1e-6)


def export(net: DetectorNet, path: Path) -> None:
    """Write the network as ONNX: input `image` uint8 (1, h, w, 3), outputs `near`, `middle`, `far` (1, 5, h', w')."""
    net = copy.deepcopy(net).eval().float()
    names = ("near", "middle", "far")
    axes = {"image": {1: "height", 2: "width"}} | {n: {2: f"{n}_height", 3: f"{n}_width"} for n in names}
    torch.onnx.export(
        net, (torch.zeros(1, SIZE, SIZE, 3, dtype=torch.uint8),), str(path), dynamo=False, opset_version=17,
        input_names=["image"], output_names=list(names), dynamic_axes=axes,
    )  # fmt: skip


def load(net: DetectorNet, path: Path) -> None:
    """Weights from a .pt, or from a shipped .onnx, whose normalisations are within its convolutions."""
    if path.suffix == ".pt":
        net.load_state_dict(torch.load(path, weights_only=True))
        return
    graph, modules = onnx.load(path).graph, dict(net.named_modules())
    values = values_of(graph)
    for node in graph.node:
        if node.op_type == "Conv":
            weight, bias = (torch.from_numpy(values[name].copy()) for name in node.input[1:3])
            fill(modules, module_name(node.name), weight, bias)


@dataclass(frozen=True)
class Course(Generic[Net]):
    """How a network learns from batches of scenes.

    loss_of : of what the network gives and the targets of a batch, with its parts by name.
    validate : figures of the running average of the weights.
    output : folder.   frozen : keep the normalisations' means and variances.
    """

    loss_of: Callable[[Any, list[Tensor]], tuple[Tensor, dict[str, float]]]
    validate: Callable[[Net], dict[str, float]]
    rate: float
    workers: int
    output: Path
    frozen: bool = False
    resume: bool = False
    name: str = "detector"


def train(net: Net, samples: Samples, course: Course[Net]) -> Net:
    """Run all steps, warm up then cosine to zero; the running average of the weights."""
    rate, workers, output = course.rate, course.workers, course.output
    average = copy.deepcopy(net)
    steps, warm = samples.steps, min(200, samples.steps // 5)
    optimiser = torch.optim.AdamW(net.parameters(), lr=rate, weight_decay=0.01)
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser,
        lambda i: min(
            (i + 1) / warm, 0.5 * (1 + math.cos(math.pi * min(1, max(0, i - warm) / (steps - warm))))
        ),
    )
    kept, done = output / "state.pt", 0
    if course.resume and kept.exists():
        state = torch.load(kept, weights_only=True)
        for part, name in (
            (net, "net"),
            (average, "average"),
            (optimiser, "optimiser"),
            (schedule, "schedule"),
        ):
            part.load_state_dict(state[name])
        samples.first = done = state["step"]
    loader = DataLoader(samples, batch_size=None, num_workers=workers, prefetch_factor=6 if workers else None)
    start, sums = time.time(), dict[str, float]()
    for step, (images, targets) in enumerate(loader, done + 1):
        net.train()
        if course.frozen:
            _freeze(net)
        with torch.autocast("cpu", torch.bfloat16):
            found = net(images)
        loss, figures = course.loss_of(found, targets)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        _follow(average, net, min(0.997, step / (step + 20)))
        sums = {k: sums.get(k, 0.0) + v for k, v in figures.items()}
        if step % 250 == 0 or step == steps:
            count = step % 250 or 250
            row = {"step": step, "seconds": round(time.time() - start)}
            row |= {k: f"{v / count:.4f}" for k, v in sums.items()}
            row |= {k: f"{v:.4f}" for k, v in course.validate(average).items()}
            _log(output / "curves.csv", row)
            torch.save(average.state_dict(), output / f"{course.name}.pt")
            state = {"net": net, "average": average, "optimiser": optimiser, "schedule": schedule}
            torch.save({k: v.state_dict() for k, v in state.items()} | {"step": step}, output / "state.part")
            (output / "state.part").replace(kept)
            sums = {}
    return average


def _freeze(net: nn.Module) -> None:
    for module in net.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()


@torch.no_grad()
def _follow(average: nn.Module, net: nn.Module, keep: float) -> None:
    for mine, new in zip(average.state_dict().values(), net.state_dict().values(), strict=True):
        if mine.dtype.is_floating_point:
            mine.lerp_(new, 1 - keep)
        else:
            mine.copy_(new)


def _log(path: Path, row: dict[str, object]) -> None:
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, row)
        if new:
            writer.writeheader()
        writer.writerow(row)
    print(" ".join(f"{k}={v}" for k, v in row.items()), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Train the built-in face detector.")
    parser.add_argument("--parts", type=Path, required=True, help="folder of rendered parts")
    parser.add_argument(
        "--real", type=Path, help="folder with pairs/london and real; without it, rendered alone"
    )
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--start", type=Path, help="weights to start from (.pt, or a shipped .onnx)")
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--batch", type=int, default=24)
    parser.add_argument("--rate", type=float, default=3e-3)
    parser.add_argument(
        "--real-share", type=float, default=0.25, help="share of real people among those pasted"
    )
    parser.add_argument("--limit", type=int, help="use that many parts")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    torch.set_flush_denormal(True)
    torch.set_num_threads(options.threads)
    cv2.setNumThreads(0)  # before OpenCV starts any: the workers are forked
    torch.manual_seed(options.seed)
    options.output.mkdir(parents=True, exist_ok=True)
    real = real_people(options.real) if options.real else []
    photos = faceless_photos(options.real / "real") if options.real else []
    unseen = load_parts(options.parts, held_out=True, limit=options.limit)
    rng = np.random.default_rng([options.seed, 3])
    held = Scenes(unseen, [], [], 0, options.seed + 1, backgrounds=60)
    validation = [held.make(rng) for _ in range(VALIDATION_SCENES)]
    del held, unseen
    rendered = load_parts(options.parts, held_out=False, limit=options.limit)
    print(
        f"{len(rendered)} rendered pictures, {len(real)} real ones, {len(photos)} photographs without faces"
    )
    scenes = Scenes(rendered, real, photos, options.real_share, options.seed)
    net = DetectorNet()
    if options.start:
        load(net, options.start)
    samples = Samples(scenes, options.steps, options.batch, options.seed)
    net = net.to(memory_format=torch.channels_last)
    frozen = options.start is not None and options.start.suffix == ".onnx"
    course = Course(
        loss_of, partial(validate, scenes=validation), options.rate, options.workers, options.output, frozen=frozen,
        resume=options.resume,
    )  # fmt: skip
    average = train(net, samples, course)
    export(average, options.output / "detector.onnx")


if __name__ == "__main__":
    main()
