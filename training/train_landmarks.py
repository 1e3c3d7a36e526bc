"""Trains the built-in landmarker and writes it as ONNX.

    python -m training.train_landmarks --parts PARTS [--real DATA] --output OUT

PARTS holds what `render_people.py` wrote; DATA is the folder with `pairs/london` and `real`, whose trainable pictures
join in the second stage. OUT gets `rendered.onnx` (after the first stage, rendered people alone), `landmarks.onnx`,
`curves.csv`, and the last weights. The same seed and data give the same samples in the same order. PyTorch is needed
here only (`pip install "guise-video[train]"`).
"""

from __future__ import annotations

import argparse
import copy
import csv
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import JAW, LEFT_TEMPLE, NOSE_TIP, RIGHT_TEMPLE, TEMPLES
from guise.common.arrays import F32, F64, U8
from training import definitions
from training.augment import SIZE, negative, sample
from training.clutter import clutter
from training.crops import plain_crops
from training.data import Pictures, load_parts, load_real
from training.landmark_net import LandmarkNet

BACKGROUNDS, BACKGROUND_SIZE = 1500, 192
EVERY = 250  # steps from one line of the curves to the next
NEGATIVES = 0.12  # share of samples without a face


@dataclass(frozen=True)
class Stage:
    """A stretch of training: batches, the highest learning rate, the share of real pictures."""

    number: int
    name: str
    steps: int
    rate: float
    real: float


class Samples(IterableDataset[tuple[NDArray, ...]]):
    """Batches of samples, each from a generator of its own: (seed, stage, number)."""

    def __init__(
        self, rendered: Pictures, real: Pictures | None, backgrounds: U8, stage: Stage, batch: int,
        seed: int,
    ) -> None:  # fmt: skip
        self.rendered, self.real, self.backgrounds = rendered, real, backgrounds
        self.stage, self.batch, self.seed = stage, batch, seed

    def __iter__(self) -> Iterator[tuple[NDArray, ...]]:
        """Yield this worker's share of the batches."""
        cv2.setNumThreads(1)
        info = torch.utils.data.get_worker_info()
        start, step = (info.id, info.num_workers) if info else (0, 1)
        for number in range(start, self.stage.steps, step):
            yield self.make(number)

    def make(self, number: int) -> tuple[NDArray, ...]:
        """Batch `number`: crops (n, 128, 128, 3) uint8, points (n, 81, 2), seen (n, 81), face (n,)."""
        rng = np.random.default_rng([self.seed, self.stage.number, number])
        cv2.setRNGSeed(int(rng.integers(1 << 31)))
        crops = np.empty((self.batch, SIZE, SIZE, 3), np.uint8)
        points = np.zeros((self.batch, 81, 2), np.float32)
        seen = np.zeros((self.batch, 81), bool)
        face = np.ones(self.batch, np.float32)
        for k in range(self.batch):
            source = self.real if self.real is not None and rng.random() < self.stage.real else self.rendered
            i = int(rng.integers(len(source)))
            if rng.random() < NEGATIVES:
                crops[k], face[k] = negative(rng, source.images[i], source.points[i], self.backgrounds), 0
                continue
            mask = source.masks[i] if len(source.masks) else None
            crops[k], points[k], seen[k] = sample(
                rng, source.images[i], source.points[i], source.visible[i], mask, self.backgrounds
            )
        return crops, points, seen, face


def make_backgrounds(seed: int) -> U8:
    """(m, s, s, 3) procedural backgrounds."""
    rng = np.random.default_rng(seed)
    return np.stack([clutter(rng, BACKGROUND_SIZE) for _ in range(BACKGROUNDS)])


def loss_of(net: LandmarkNet, crops: Tensor, points: Tensor, face: Tensor) -> tuple[Tensor, dict[str, float]]:
    """Gaussian likelihood of the points, absolute errors of both guesses, cross entropy of the face logit."""
    mixed, local, guess, log_sigma, logit = net.parts(crops)
    there = face > 0.5
    squared = ((mixed - points) ** 2).sum(-1)
    likelihood = (0.5 * squared * torch.exp(-2 * log_sigma) + 2 * log_sigma)[there].mean()
    near = (local - points).abs()[there].clamp(max=40).mean()
    far = (guess - points).abs()[there].mean()
    entropy = torch.nn.functional.binary_cross_entropy_with_logits(logit, face)
    total = likelihood + 0.3 * near + 0.3 * far + entropy
    error = squared.detach()[there].sqrt().mean()
    return total, {"loss": float(total.detach()), "error_px": float(error), "face": float(entropy.detach())}


@torch.no_grad()
def answers(net: LandmarkNet, crops: U8) -> F32:
    """Points (n, 81, 2) of crops (n, 128, 128, 3)."""
    net.eval()
    found = [net(torch.from_numpy(crops[i : i + 64]))[0].numpy() for i in range(0, len(crops), 64)]
    return np.concatenate(found)


def error_of(net: LandmarkNet, crops: U8, points: F32) -> float:
    """Mean distance to the truth in per cent of the outer-eye distance."""
    miss = np.linalg.norm(answers(net, crops) - points, axis=2).mean(1)
    return float(100 * (miss / interocular(points)).mean())


def export(net: LandmarkNet, path: Path) -> None:
    """Write the network as ONNX: input `crop` uint8 (1, 128, 128, 3), outputs points, sigma, face."""
    net = copy.deepcopy(net).eval().float()
    torch.onnx.export(
        net, (torch.zeros(1, SIZE, SIZE, 3, dtype=torch.uint8),), str(path), dynamo=False, opset_version=17,
        input_names=["crop"], output_names=["points", "sigma", "face"],
    )  # fmt: skip


class Trainer:
    """Network, its running average, curves."""

    def __init__(self, output: Path, batch: int, seed: int, workers: int) -> None:
        torch.manual_seed(seed)
        self.net = LandmarkNet().to(memory_format=torch.channels_last)
        self.average = copy.deepcopy(self.net)
        self.output, self.batch, self.seed, self.workers = output, batch, seed, workers
        self.start = time.time()
        output.mkdir(parents=True, exist_ok=True)

    def run(
        self, stage: Stage, rendered: Pictures, real: Pictures | None, backgrounds: U8,
        validation: dict[str, tuple[U8, F32]],
    ) -> None:  # fmt: skip
        """One stage: warm up, cosine to zero; now and then a line of the curves."""
        self.net.load_state_dict(self.average.state_dict())
        optimiser = torch.optim.AdamW(self.net.parameters(), lr=stage.rate, weight_decay=0.01)
        warm = min(300, stage.steps // 5)
        schedule = torch.optim.lr_scheduler.LambdaLR(
            optimiser,
            lambda i: min(
                (i + 1) / warm, 0.5 * (1 + np.cos(np.pi * min(1, max(0, i - warm) / (stage.steps - warm))))
            ),
        )
        samples = Samples(rendered, real, backgrounds, stage, self.batch, self.seed)
        loader = DataLoader(
            samples, batch_size=None, num_workers=self.workers, prefetch_factor=8 if self.workers else None
        )
        sums: dict[str, float] = {}
        for step, (crops, points, _, face) in enumerate(loader, 1):
            self.net.train()
            with torch.autocast("cpu", torch.bfloat16):
                loss, figures = loss_of(self.net, crops, points, face)
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
            optimiser.step()
            schedule.step()
            self._follow(min(0.998, step / (step + 20)))
            sums = {k: sums.get(k, 0) + v for k, v in figures.items()}
            if step % EVERY == 0 or step == stage.steps:
                count = EVERY if step % EVERY == 0 else step % EVERY
                self._log(stage, step, {k: v / count for k, v in sums.items()}, validation)
                sums = {}
        torch.save(self.average.state_dict(), self.output / f"{stage.name}.pt")

    @torch.no_grad()
    def _follow(self, keep: float) -> None:
        for mine, new in zip(self.average.state_dict().values(), self.net.state_dict().values(), strict=True):
            if mine.dtype.is_floating_point:
                mine.lerp_(new, 1 - keep)
            else:
                mine.copy_(new)

    def _log(self, stage: Stage, step: int, figures: dict[str, float], validation: dict) -> None:
        errors = {f"{k}_percent": error_of(self.average, *v) for k, v in validation.items()}
        row = {"stage": stage.name, "step": step, "seconds": round(time.time() - self.start)} | {
            k: f"{v:.4f}" for k, v in (figures | errors).items()
        }
        path = self.output / "curves.csv"
        new = not path.exists()
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, row)
            if new:
                writer.writeheader()
            writer.writerow(row)
        print(" ".join(f"{k}={v}" for k, v in row.items()), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Train the built-in landmarker.")
    parser.add_argument("--parts", type=Path, required=True, help="folder of rendered parts")
    parser.add_argument(
        "--real", type=Path, help="folder with pairs/london and real; without it, rendered people alone"
    )
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument(
        "--steps", type=int, default=6000, help="batches of the first stage, rendered people alone"
    )
    parser.add_argument(
        "--more", type=int, default=4500, help="batches of the second stage, with real pictures"
    )
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--limit", type=int, help="use that many parts")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    torch.set_flush_denormal(
        True
    )  # before any thread is made, as they inherit it: far weights of heat maps are tiny
    torch.set_num_threads(options.threads)
    cv2.setNumThreads(0)  # before OpenCV starts any: the workers are forked
    rendered = load_parts(options.parts, held_out=False, limit=options.limit)
    unseen = load_parts(options.parts, held_out=True, limit=options.limit)
    print(
        f"{len(rendered)} rendered pictures of {len(set(rendered.person))} people, {len(set(unseen.person))} held out"
    )
    validation = {"unseen": plain_crops(unseen, 600)}
    real = load_real(options.real, held_out=False) if options.real else None
    backgrounds = make_backgrounds(options.seed)
    trainer = Trainer(options.output, options.batch, options.seed, options.workers)
    write_facts(options, trainer, rendered, real)
    if (options.output / "rendered.pt").exists():  # a run that was broken off
        trainer.average.load_state_dict(torch.load(options.output / "rendered.pt"))
    else:
        trainer.run(Stage(1, "rendered", options.steps, 2e-3, 0), rendered, None, backgrounds, validation)
        export(trainer.average, options.output / "rendered.onnx")
    if real is not None:
        alignment = align(trainer.average, rendered, real)
        rounded = {name: np.round(value, 5).tolist() for name, value in alignment.items()}
        (options.output / "alignment.json").write_text(json.dumps(rounded) + "\n")
        rendered, real = apply(alignment, rendered, "rendered"), apply(alignment, real, "real")
        validation = {
            "unseen": plain_crops(apply(alignment, unseen, "rendered"), 600),
            "real": plain_crops(apply(alignment, load_real(options.real, held_out=True), "real"), 100),
        }
        trainer.run(Stage(2, "mixed", options.more, 1e-3, 0.25), rendered, real, backgrounds, validation)
    export(trainer.average, options.output / "landmarks.onnx")


def align(net: LandmarkNet, rendered: Pictures, real: Pictures) -> dict[str, F64]:
    """What brings both kinds of labels to one definition, see `training/definitions.py`."""
    crops, labels = plain_crops(real, len(real))
    rendered_moves, real_moves = definitions.definition_moves(
        definitions.difference(answers(net, crops), labels)
    )
    frontal = plain_crops(rendered.only(np.abs(asymmetry(rendered.points)) < 0.05), 500)[1]
    return {
        "rendered_jaw": definitions.even_spacing(frontal[:, JAW]), "rendered_moves": rendered_moves,
        "real_jaw": definitions.even_spacing(labels[:, JAW]), "real_moves": real_moves,
    }  # fmt: skip


def apply(alignment: Mapping[str, F64], pictures: Pictures, kind: str) -> Pictures:
    """The pictures with their labels in the common definition; kind: rendered or real."""
    points = definitions.align_labels(pictures.points, alignment[f"{kind}_jaw"], alignment[f"{kind}_moves"])
    return replace(pictures, points=points)


def asymmetry(points: F32) -> F32:
    """How far (n,) the nose is from the middle of the temples, in widths of the face: a sign of yaw."""
    width = points[:, LEFT_TEMPLE, 0] - points[:, RIGHT_TEMPLE, 0]
    return np.asarray(
        (points[:, NOSE_TIP, 0] - points[:, TEMPLES, 0].mean(1)) / np.where(np.abs(width) < 1, 1, width)
    )


def write_facts(
    options: argparse.Namespace, trainer: Trainer, rendered: Pictures, real: Pictures | None
) -> None:
    """What the model card tells of the training."""
    facts = {
        "rendered": len(rendered),
        "people": len(set(rendered.person)),
        "real": len(real) if real else 0,
        "real_people": len(set(real.person)) if real else 0,
        "steps": options.steps + (options.more if real else 0),
        "seed": options.seed,
        "parameters": sum(p.numel() for p in trainer.net.parameters()),
    }
    (options.output / "facts.json").write_text(json.dumps(facts, indent=1) + "\n")


if __name__ == "__main__":
    main()
