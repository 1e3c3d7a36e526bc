"""Train the multi-task face network: points, irises, parsing.

    python -m training.train_face --parts PARTS --real DATA --output OUT [--hands HANDS] [--resume]

PARTS is the output of `render_people.py`, DATA holds `pairs/london` and `real`, whose trainable pictures are used as
well, and HANDS is the output of `render_hands.py`. Training proceeds in chapters. Each reads the parts rendered so far
and ends by writing `state.pt`, from which --resume continues; SIGTERM ends a chapter early without losing anything. OUT
receives `curves.csv`, `chapters.csv` (steps and parts) and `face.pt`, the running average of the weights. The trunk
starts from the shipped landmarker (`dequantise.py`) unless --scratch is given. Samples depend only on the seed, the
batch number and the parts.
"""

from __future__ import annotations

import argparse
import copy
import csv
import json
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset

from training.augment import ALONE, FOLLOWED, HEADS, Props, Strength, negative, sample
from training.canvas import SIZE, Sample
from training.crops import plain_samples
from training.cutouts import make_props
from training.data import Pictures, by_hands, join, load_part, load_real, part_files
from training.definitions import Alignment, read_alignment
from training.dequantise import load_shipped
from training.face_net import MAPS, FaceNet
from training.measure import answers_of, figures_of
from training.parsing_labels import CLASSES, OCCLUDER

SHIPPED = Path(__file__).parents[1] / "aam" / "data" / "landmarks.onnx"
CHAPTER_STEPS = 250  # after which newly rendered parts are read and the curves get a line
NONE, POSSIBLE, EXACT = 0, 1, 2  # what is known of a sample's parsing
OUTLINE_CELLS, OUTLINE_WEIGHT = 5, 2.0  # cells so near the outline of an occluder count so much more
# How much a cell of each class counts: small classes would be drowned by skin and background.
CLASS_WEIGHTS = (0.6, 0.8, 2.0, 3.0, 2.0, 3.0, 1.0, 1.5, 3.0, 2.0)

Batch = tuple[Tensor, ...]


@dataclass(frozen=True)
class Goal:
    """What a training is for: the shares of its samples, how its crops lie, and how much each loss counts.

    Parameters
    ----------
    negative, real : shares of samples without a face, and of real pictures
    strength : how far the crops are off
    points, iris, parsing : factors of the losses
    """

    negative: float = 0.1
    real: float = 0.2
    strength: Strength = field(default_factory=Strength)
    points: float = 1.0
    iris: float = 0.4
    parsing: float = 2.0


# `points`: one network for everything.  `landmarks`: its points alone, in half the time.  `parsing`: a network of its
# own for irises and parsing, which runs on crops of a face that is followed; the points then merely steady its trunk.
# `refinement`: the same from weights that have no points any more.  `head`: parsing of crops that hold the whole head.
GOALS = {
    "points": Goal(),
    "landmarks": Goal(strength=ALONE, iris=0.0, parsing=0.0),
    "parsing": Goal(negative=0.05, real=0.28, strength=FOLLOWED, points=0.2, iris=0.6, parsing=4.0),
    "refinement": Goal(
        negative=0.0, real=0.25, strength=replace(FOLLOWED, hidden=0.5), points=0.0, iris=0.6, parsing=4.0
    ),
    "head": Goal(negative=0.0, real=0.2, strength=HEADS, points=0.0, iris=0.0, parsing=4.0),
}


@dataclass(frozen=True)
class Course:
    """Length and rate of the training: warm up, constant, and a cosine to zero over the last part.

    It is over after so many steps or seconds, whichever comes first.
    """

    steps: int
    rate: float
    seconds: float = np.inf
    warm: int = 300
    decay: float = 0.35

    def passed(self, step: int, seconds: float) -> float:
        """Share of it that is over, 0 to 1."""
        return min(1.0, max(step / self.steps, seconds / self.seconds))

    def at(self, step: int, seconds: float) -> float:
        """Factor of the rate."""
        rest = min(1.0, (1 - self.passed(step, seconds)) / self.decay)
        warm = max(1, min(self.warm, self.steps // 10))
        return float(min((step + 1) / warm, 0.5 * (1 - np.cos(np.pi * rest))))


class Samples(IterableDataset[tuple[NDArray, ...]]):
    """Batches from first to last, each from a generator of its own: (seed, number)."""

    def __init__(
        self, rendered: Pictures, real: Pictures | None, props: Props, numbers: range, batch: int, seed: int,
        goal: Goal = GOALS["points"],
    ) -> None:  # fmt: skip
        self.rendered, self.real, self.props = rendered, real, props
        self.numbers, self.batch, self.seed, self.goal = numbers, batch, seed, goal

    def __iter__(self) -> Iterator[tuple[NDArray, ...]]:
        """Yield this worker's share of the batches."""
        cv2.setNumThreads(1)
        info = torch.utils.data.get_worker_info()
        if info:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the trainer's own is inherited
        start, step = (info.id, info.num_workers) if info else (0, 1)
        for number in self.numbers[start::step]:
            yield self.make(number)

    def make(self, number: int) -> tuple[NDArray, ...]:
        """Batch `number`: crops, points, face, iris, iris_seen, maps uint8, what is known of the maps."""
        rng = np.random.default_rng([self.seed, number])
        cv2.setRNGSeed(int(rng.integers(1 << 31)))
        n = self.batch
        crops, points = np.empty((n, SIZE, SIZE, 3), np.uint8), np.zeros((n, 81, 2), np.float32)
        face, iris, open_ = (
            np.ones(n, np.float32),
            np.zeros((n, 2, 3), np.float32),
            np.zeros((n, 2), np.float32),
        )
        maps, known = np.zeros((n, len(CLASSES), MAPS, MAPS), np.uint8), np.zeros(n, np.uint8)
        for k in range(n):
            source = self.real if rng.random() < self.goal.real and self.real is not None else self.rendered
            one = source[int(rng.integers(len(source)))]
            if rng.random() < self.goal.negative:
                crops[k], face[k] = negative(rng, one.image, one.points, self.props.backgrounds), 0
                continue
            made = sample(rng, one, self.props, self.goal.strength, mapped=self.goal.parsing > 0)
            crops[k], points[k], iris[k], open_[k] = made.crop, made.points, made.iris, made.iris_seen
            maps[k], known[k] = np.round(made.maps * 255), EXACT if made.exact else POSSIBLE
        return crops, points, face, iris, open_, maps, known


def loss_of(net: FaceNet, batch: Batch, goal: Goal = GOALS["points"]) -> tuple[Tensor, dict[str, float]]:
    """Sum of the losses of points, irises and parsing, and the figures of the curves."""
    crops, points, face, iris, open_, maps, known = batch
    stem, pyramid, coarse = net.features(crops)
    loss, figures = points_loss(net.points_of(pyramid, coarse), points, face)
    total = goal.points * loss
    if goal.iris:
        figures["iris"] = iris_loss(*net.found_irises(pyramid), iris, open_)
        total = total + goal.iris * figures["iris"]
    if goal.parsing:
        figures["parsing"] = parsing_loss(net.parsing_of(stem, pyramid).float(), maps, known)
        total = total + goal.parsing * figures["parsing"]
    figures = {"loss": total, **figures}
    return total, {name: float(value.detach()) for name, value in figures.items()}


def points_loss(seen: tuple[Tensor, ...], points: Tensor, face: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
    """Gaussian likelihood and distances of the points (n, 81, 2) where there is a face (n,), and the face's entropy.

    seen : what `LandmarkNet.points_of` gives
    """
    mixed, local, guess, log_sigma, logit = seen
    there = face > 0.5
    squared = ((mixed - points) ** 2).sum(-1)
    likelihood = (0.5 * squared * torch.exp(-2 * log_sigma) + 2 * log_sigma)[there].mean()
    near = (local - points).abs()[there].clamp(max=40).mean()
    far = (guess - points).abs()[there].mean()
    entropy = F.binary_cross_entropy_with_logits(logit, face)
    figures = {"points_px": squared[there].sqrt().mean(), "face": entropy}
    return likelihood + 0.3 * near + 0.3 * far + entropy, figures


def iris_loss(found: Tensor, log_sigma: Tensor, iris: Tensor, open_: Tensor) -> Tensor:
    """Gaussian likelihood of the centres (n, 2, 2), and the radii's relative error, of the irises to be seen (n, 2)."""
    squared = ((found[..., :2] - iris[..., :2]) ** 2).sum(-1)
    likelihood = 0.5 * squared * torch.exp(-2 * log_sigma) + 2 * log_sigma
    distance = (found[..., :2] - iris[..., :2]).abs().sum(-1).clamp(max=40)
    radius = (found[..., 2] / iris[..., 2].clamp(min=0.5) - 1).abs()
    return ((likelihood + 0.3 * distance + radius) * open_).sum() / open_.sum().clamp(min=1)


def parsing_loss(logits: Tensor, maps: Tensor, known: Tensor) -> Tensor:
    """Cross entropy and Dice loss where the shares are exact, otherwise the probability of impossible classes.

    logits : (n, classes, 64, 64); maps : the same, uint8, 255 is 1; known : (n,) NONE, POSSIBLE or EXACT.
    """
    log_chance = F.log_softmax(logits, 1)
    total = logits.sum() * 0
    exact, possible = known == EXACT, known == POSSIBLE
    if exact.any():
        share, chance = maps[exact].float() / 255, log_chance[exact]
        weight = torch.tensor(CLASS_WEIGHTS, device=logits.device)[None, :, None, None]
        cost = (weight * share * chance).sum(1) * (1 + OUTLINE_WEIGHT * outlines(share[:, OCCLUDER]))
        total = total - cost.mean() * exact.float().mean()
        both = (chance.exp() * share).sum((0, 2, 3))
        either = chance.exp().sum((0, 2, 3)) + share.sum((0, 2, 3))
        total = total + 0.5 * (1 - (2 * both + 1) / (either + 1)).mean()
    if possible.any():
        allowed = log_chance[possible].masked_fill(maps[possible] < 128, -30.0)
        total = total - torch.logsumexp(allowed, 1).mean() * possible.float().mean()
    return total


def outlines(share: Tensor) -> Tensor:
    """How near the cells (n, 64, 64) are to an occluder's outline, 0..1, given its share of each."""
    most = F.max_pool2d(share[:, None], OUTLINE_CELLS, 1, OUTLINE_CELLS // 2)
    least = -F.max_pool2d(-share[:, None], OUTLINE_CELLS, 1, OUTLINE_CELLS // 2)
    return (most - least)[:, 0]


class Trainer:
    """Network, its running average, optimiser, curves."""

    def __init__(
        self, output: Path, course: Course, batch: int, seed: int, workers: int, device: str = "cpu",
        goal: Goal = GOALS["points"], chapter_steps: int = CHAPTER_STEPS,
    ) -> None:  # fmt: skip
        torch.manual_seed(seed)
        self.goal, self.chapter_steps = goal, chapter_steps
        self.net, self.device = FaceNet(), torch.device(device)
        # Without instructions for it, bfloat16 takes ten times as long as float32.
        self._halved = device != "cpu" or torch.ops.mkldnn._is_mkldnn_bf16_supported()
        self.course, self.batch, self.seed, self.workers = course, batch, seed, workers
        self.output, self.step, self.start, self.ended = output, 0, time.time(), False
        output.mkdir(parents=True, exist_ok=True)

    def end(self, *_: object) -> None:
        """Stop after this step and save."""
        self.ended = True

    @property
    def over(self) -> bool:
        """Whether the course is."""
        return self.course.passed(self.step, time.time() - self.start) >= 1

    def prepare(self) -> None:
        """Make the average and the optimiser, once the network has its first weights."""
        self.net = self.net.to(self.device, memory_format=torch.channels_last)
        self.average = copy.deepcopy(self.net)
        self.optimiser = torch.optim.AdamW(self.net.parameters(), lr=self.course.rate, weight_decay=0.01)

    def resume(self) -> None:
        """Continue from `state.pt`."""
        state = torch.load(self.output / "state.pt", map_location=self.device)
        self.net.load_state_dict(state["net"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step = state["step"]

    def save(self) -> None:
        """Write `state.pt` and `face.pt`, whole or not at all."""
        state = {
            "net": self.net.state_dict(), "average": self.average.state_dict(), "step": self.step,
            "optimiser": self.optimiser.state_dict(),
        }  # fmt: skip
        for name, what in (("state.pt", state), ("face.pt", self.average.state_dict())):
            torch.save(what, self.output / f"{name}.partial")
            (self.output / f"{name}.partial").replace(self.output / name)

    def chapter(self, rendered: Pictures, real: Pictures | None, props: Props, validation: Mapping) -> None:
        """Train on to the next multiple of the chapters' steps."""
        last = min(self.course.steps, (self.step // self.chapter_steps + 1) * self.chapter_steps)
        samples = Samples(rendered, real, props, range(self.step, last), self.batch, self.seed, self.goal)
        loader = DataLoader(
            samples, batch_size=None, num_workers=self.workers, prefetch_factor=4 if self.workers else None
        )
        sums: dict[str, float] = {}
        first = self.step
        for batch in loader:
            sums = {k: sums.get(k, 0) + v for k, v in self._learn(batch).items()}
            if self.ended or self.over:
                break
        self._log({k: v / (self.step - first) for k, v in sums.items()}, validation)
        self.save()

    def _learn(self, batch: Batch) -> dict[str, float]:
        for group in self.optimiser.param_groups:
            group["lr"] = self.course.rate * self.course.at(self.step, time.time() - self.start)
        self.net.train()
        batch = tuple(part.to(self.device, non_blocking=True) for part in batch)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self._halved):
            loss, figures = loss_of(self.net, batch, self.goal)
        self.optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimiser.step()
        self.step += 1
        self._follow(min(0.998, self.step / (self.step + 20)))
        return figures

    @torch.no_grad()
    def _follow(self, keep: float) -> None:
        for mine, new in zip(self.average.state_dict().values(), self.net.state_dict().values(), strict=True):
            if mine.dtype.is_floating_point:
                mine.lerp_(new, 1 - keep)
            else:
                mine.copy_(new)

    def _log(self, figures: dict[str, float], validation: Mapping) -> None:
        row = {"step": self.step, "seconds": round(time.time() - self.start)}
        row |= {k: f"{v:.4f}" for k, v in figures.items()}
        if self.step % (2 * self.chapter_steps) == 0:
            answer = answers_of(copy.deepcopy(self.average).cpu())
            for name, samples in ((name, samples) for name, samples in validation.items() if samples):
                measured = figures_of(answer, samples)
                row |= {f"{name}_{k}": f"{v:.3f}" for k, v in measured.items() if isinstance(v, float)}
        print(" ".join(f"{k}={v}" for k, v in row.items()), flush=True)
        _append(self.output / "curves.csv", row)


def _append(path: Path, row: Mapping[str, object]) -> None:
    """One line of `key=value` pairs: which figures there are changes as training goes on."""
    with path.open("a", newline="") as file:
        csv.writer(file).writerow([f"{k}={v}" for k, v in row.items()])


class Shelf:
    """The rendered parts that exist, each read once."""

    def __init__(self, folder: Path, alignment: Alignment | None, limit: int | None = None) -> None:
        self._folder, self._alignment, self._limit = folder, alignment, limit
        self._read: dict[Path, tuple[Pictures, Pictures]] = {}

    def refresh(self) -> int:
        """Read new parts; return how many there are."""
        for file in part_files(self._folder)[: self._limit]:
            if file not in self._read:
                self._read[file] = load_part(file, False), load_part(file, True)
        return len(self._read)

    def pictures(self, *, held_out: bool) -> Pictures:
        """All that is read, points in the package's definition if there is an alignment."""
        joined = join([pair[held_out] for pair in self._read.values() if len(pair[held_out])])
        return self._alignment.rendered(joined) if self._alignment else joined


def write_facts(options: argparse.Namespace, done: int, rendered: Pictures, real: Pictures | None) -> None:
    """Write what the model card says about the training."""
    start = "from the weights shipped before"
    if options.scratch or (options.first_weights and options.first_weights.suffix == ".pt"):
        start = "from random weights"
    facts = {
        "goal": options.goal, "rendered": len(rendered), "held": len(by_hands(rendered)[1]),
        "people": len(set(rendered.person)), "real": len(real) if real else 0,
        "real_people": len(set(real.person)) if real else 0, "steps": options.steps, "done": done,
        "batch": options.batch, "seed": options.seed,
        "start": start,
    }  # fmt: skip
    (options.output / "facts.json").write_text(json.dumps(facts, indent=1) + "\n")


def parsed() -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description="Train the multi-task face network.")
    parser.add_argument("--parts", type=Path, required=True, help="folder of rendered parts")
    parser.add_argument("--real", type=Path, required=True, help="folder with pairs/london and real")
    parser.add_argument("--hands", type=Path, help="rendered hands")
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument(
        "--seconds", type=float, default=np.inf, help="end after so long at the latest; not repeatable then"
    )
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--limit", type=int, help="use at most this many parts")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--goal", choices=sorted(GOALS), default="points")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--chapter-steps", type=int, default=CHAPTER_STEPS, help="more for a faster machine")
    parser.add_argument("--resume", action="store_true", help="continue from OUT/state.pt if it exists")
    parser.add_argument(
        "--first-weights", type=Path, help="face.pt of another run, or face.onnx, to start from"
    )
    parser.add_argument("--scratch", action="store_true", help="start from random weights")
    parser.add_argument(
        "--alignment", type=Path, help="what align_definitions.py wrote; default: the shipped one"
    )
    parser.add_argument(
        "--as-given", action="store_true", help="rendered people alone, points as the meshes have them"
    )
    return parser.parse_args()


def begin(trainer: Trainer, options: argparse.Namespace, first: Callable[[], Samples]) -> None:
    """Give a trainer the weights that it goes on from; the shipped ones are fitted to crops of `first` samples."""
    if options.first_weights and options.first_weights.suffix == ".pt":
        trainer.net.load_state_dict(torch.load(options.first_weights, map_location="cpu"))
    elif not options.scratch:
        samples = first()
        crops = np.concatenate([samples.make(k)[0] for k in samples.numbers])
        load_shipped(trainer.net, options.first_weights or SHIPPED, crops)
        if not options.first_weights:
            trainer.net.start_irises()
    trainer.prepare()
    if options.resume and (options.output / "state.pt").exists():
        trainer.resume()


def held_back(
    options: argparse.Namespace, shelf: Shelf, alignment: Alignment | None
) -> dict[str, list[Sample]]:
    """What a trainer is judged by: faces of people it does not see, behind hands and behind other things."""
    unseen, behind = by_hands(shelf.pictures(held_out=True))
    framing = GOALS[options.goal].strength.framing
    props = make_props(options.seed + 1, options.hands, held_out=True)
    validation = {
        "unseen": plain_samples(unseen, 240, framing=framing),
        "hand": plain_samples(behind, 120, framing=framing),
        "occluded": plain_samples(unseen, 240, props=props, framing=framing),
    }
    if alignment:
        real = load_real(options.real, held_out=True, framing=framing)
        validation["real"] = plain_samples(alignment.real(real), 40, framing=framing)
    return validation


def main() -> None:
    options = parsed()
    torch.set_flush_denormal(True)  # before any thread is made: far weights of heat maps are tiny
    torch.set_num_threads(options.threads)
    cv2.setNumThreads(0)  # before OpenCV starts any: the workers are forked
    alignment = None if options.as_given else read_alignment(options.alignment)
    shelf = Shelf(options.parts, alignment, options.limit)
    framing = GOALS[options.goal].strength.framing
    real = load_real(options.real, held_out=False, framing=framing)
    real = alignment.real(real) if alignment else real
    shelf.refresh()
    trainer = Trainer(
        options.output,
        Course(options.steps, options.rate, options.seconds),
        options.batch,
        options.seed,
        options.workers,
        options.device,
        GOALS[options.goal],
        options.chapter_steps,
    )
    props = make_props(options.seed, options.hands)
    begin(
        trainer,
        options,
        lambda: Samples(
            shelf.pictures(held_out=False), real if alignment else None, props, range(8), 64, options.seed + 1,
            GOALS[options.goal],
        ),
    )  # fmt: skip
    validation = held_back(options, shelf, alignment)
    signal.signal(signal.SIGTERM, trainer.end)
    while not (trainer.over or trainer.ended):
        count, rendered = shelf.refresh(), shelf.pictures(held_out=False)
        _append(
            options.output / "chapters.csv", {"step": trainer.step, "parts": count, "pictures": len(rendered)}
        )
        trainer.chapter(rendered, real if alignment else None, props, validation)
        write_facts(options, trainer.step, rendered, real if alignment else None)


if __name__ == "__main__":
    main()
