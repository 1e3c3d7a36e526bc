"""Train what tells the landmarker faces from other things, also behind bars, nets and letters; points stay as they are.

    python -m training.face_head make --parts PARTS --real DATA --hands HANDS --mistaken FILE --output SHARDS
    python -m training.face_head train --shards SHARDS --held-out HELD --output OUT [--seconds 2000] [--resume]

The shipped network gives the features, rounded as they are at run time, and is not changed.  A small head learns from
them: of faces the logit is to be as high as it was and at least `Goal.face`, behind a pattern that leaves them plain to
see `Goal.plain`; of hands, things and parts of pictures without a face as low as it was and at most `Goal.other`.
Both as they are and filled, as `guise.aam.landmarks.glances` judges them.  The first command keeps features in SHARDS,
and may run several times at once with seeds of their own; FILE is the output of `mistaken.py`.  The second learns from
all that are there, also from those that come meanwhile.  OUT receives `state.pt`, from which --resume goes on, and
`landmarks.onnx`: the shipped network with the new head, which runs as `branches.py` says.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import onnxruntime
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from guise.aam.landmarks import LEFT_EYE, RIGHT_EYE
from guise.aam.landmarks.schemes import IBUG68, NOSE_BASE
from guise.common.arrays import F32, F64, U8
from training.augment import Props, Strength, negative, objects_alone, sample
from training.backgrounds import faceless_photos, random_background
from training.branches import FEATURES, branch, joined
from training.canvas import SIZE
from training.cutouts import make_props
from training.data import Labelled, Packed, Pictures, load_parts, load_real
from training.exposure import camera, light
from training.patterns import before, is_plain
from training.stored_weights import halve

SHIPPED = Path(__file__).parents[1] / "aam" / "data" / "landmarks.onnx"
SHAPES = (128, 8, 8), (64, 16, 16), (32, 32, 32), (192,)
CROPS = 1280  # in a shard
LOWERED = 5.0  # of all logits at the end: faces' rise without a limit, and what looks like one has less again
BATCH, MIXED_SHARDS, CHAPTER_SECONDS = 128, 3, 120

Rng = np.random.Generator
Shard = list[NDArray[Any]]  # shipped logits, features, asked-for logits, and whether there is a face


@dataclass(frozen=True)
class Goal:
    """Logits that are asked for, and shares of what is shown."""

    face: float = 2.0
    plain: float = 4.5
    other: float = -3.0
    faces: float = 0.42
    mistaken: float = 0.5  # of the others
    real: float = 0.35  # of the faces
    patterned: float = 0.6
    hard: float = 0.4  # of the faces that are not: beyond a side of the picture, as a negative, or blurred
    filled: float = 0.35
    small: float = 0.25
    kept_easy: float = 0.6  # of what was no face to the shipped network either


GOAL = Goal()


class Head(nn.Module):
    """Features -> logit (n,).  It starts as the shipped one: the convolutions' part is 0."""

    def __init__(self) -> None:
        super().__init__()
        self.fine = nn.Sequential(nn.Conv2d(32, 32, 3, 2, 1), nn.ReLU())
        self.middle = nn.Sequential(nn.Conv2d(96, 64, 3, 2, 1), nn.ReLU())
        self.coarse = nn.Sequential(nn.Conv2d(192, 96, 1), nn.ReLU(), nn.Conv2d(96, 48, 3, 1, 1), nn.ReLU())
        self.last = nn.Sequential(nn.Linear(48 * 64, 48), nn.ReLU(), nn.Linear(48, 1))
        self.whole = nn.Linear(192, 1)
        nn.init.zeros_(self.last[2].weight)
        nn.init.zeros_(self.last[2].bias)

    def forward(self, coarse: Tensor, middle: Tensor, fine: Tensor, whole: Tensor) -> Tensor:
        """Of the trunk's three feature maps and what is known of the whole face."""
        x = self.middle(torch.cat([middle / 4, self.fine(fine / 4)], 1))
        x = self.coarse(torch.cat([coarse / 4, x], 1)).flatten(1)
        logit: Tensor = (self.last(x) + self.whole(whole))[:, 0]
        return logit


class Mistaken:
    """Crops of what a detector took for a face, as `mistaken.py` wrote them; decoded on access."""

    def __init__(self, file: Path) -> None:
        with np.load(file) as stored:
            ends, lengths, data = np.cumsum(stored["length"]), stored["length"], stored["jpeg"]
            codes = [data[end - length : end].copy() for end, length in zip(ends, lengths, strict=True)]
            chance = np.exp(np.clip(stored["logit"], -8, 2) / 4)
        self.pictures = Packed(codes, colour=True)
        self.shares: F64 = np.cumsum(chance / chance.sum())

    def any(self, rng: Rng) -> U8:
        """One of them; those that looked more like faces more often."""
        crop = self.pictures[min(int(np.searchsorted(self.shares, rng.random())), len(self.shares) - 1)]
        if rng.random() < 0.5:
            crop = crop[:, ::-1]
        if rng.random() < 0.5:
            linear, middle = rng.uniform(0.8, 1.3) * np.eye(2), np.full(2, (SIZE - 1) / 2)
            matrix = np.column_stack([linear, middle + rng.normal(0, 6, 2) - linear @ middle])
            crop = np.asarray(cv2.warpAffine(crop, matrix, (SIZE, SIZE)), np.uint8)
        return camera(rng, light(rng, np.ascontiguousarray(crop)))


class Crops:
    """Makes crops, and shards of what the shipped network sees of them.

    sources : rendered and real pictures.   mistaken : crops without a face, or None.
    """

    def __init__(
        self, network: Path, sources: tuple[Pictures, Pictures], props: Props, photos: Sequence[U8] = (),
        mistaken: Mistaken | None = None,
    ) -> None:  # fmt: skip
        self.sources, self.props, self.photos, self.mistaken = sources, props, photos, mistaken
        model = onnx.load(network)
        for name in FEATURES:
            model.graph.output.append(helper.make_empty_tensor_value_info(_kept(name)))
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.log_severity_level = 1, 3
        content = model.SerializeToString()
        self._shipped = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])

    def make(self, rng: Rng) -> Shard:
        """A shard: logits (n,), features (n, ...), logits that are asked for (n,), whether there is a face (n,)."""
        rows: list[list[NDArray[Any]]] = []
        while len(rows) < CROPS:
            is_face = bool(rng.random() < GOAL.faces)
            crop, least = self.face(rng) if is_face else (self.other(rng), GOAL.other)
            row = self._shipped.run(["face", *map(_kept, FEATURES)], {"crop": crop[None]})
            told = float(row[0][0])
            if is_face or told >= GOAL.other or rng.random() < GOAL.kept_easy:
                asked = max(told, least) if is_face else min(told, least)
                rows.append([*row, np.array([asked], np.float32), np.array([is_face])])
        return [np.concatenate(column) for column in zip(*rows, strict=True)]

    def face(self, rng: Rng) -> tuple[U8, float]:
        """A crop with a face, and the logit that is the least for it."""
        source = self.sources[int(rng.random() < GOAL.real)]
        while True:
            one, least = source[int(rng.integers(len(source)))], GOAL.face
            is_patterned, is_before = rng.random() < GOAL.patterned, rng.random() < 0.4
            if is_patterned and is_before:
                near = one.points[IBUG68].astype(np.float64)
                image, opacity = self._through(rng, one.image, near)
                if not is_plain(opacity, near):
                    continue
                one = replace(one, image=image, mask=None)
            strength = replace(Strength(), hidden=0.1 if is_patterned else 0.42)
            made = sample(rng, one, self.props, strength, mapped=False)
            crop = made.crop
            if is_patterned and not is_before:
                near = made.points[IBUG68].astype(np.float64)
                crop, opacity = self._through(rng, crop, near)
                if not is_plain(opacity, near):
                    continue
            if not is_patterned and rng.random() < GOAL.hard:
                crop, least = _hard(rng, crop), -np.inf
            return _viewed(rng, crop), GOAL.plain if is_patterned else least

    def other(self, rng: Rng) -> U8:
        """A crop without a face, now and then behind a pattern."""
        source = self.sources[int(rng.random() < 0.5)]
        one, kind = source[int(rng.integers(len(source)))], rng.random()
        if self.mistaken is not None and rng.random() < GOAL.mistaken:
            crop = self.mistaken.any(rng)
        elif kind < 0.3:
            crop = negative(rng, one.image, one.points, self.props.backgrounds)
        elif kind < 0.5:
            crop = objects_alone(rng, one, self.props)
        else:
            crop = self._scene(rng, one)
        if rng.random() < 0.35:
            crop, _ = self._through(rng, crop, rng.uniform(0, SIZE, (len(IBUG68), 2)))
        return _viewed(rng, crop)

    def _scene(self, rng: Rng, one: Labelled) -> U8:
        """A part of a background, made up or real, in any way up."""
        side = int(rng.choice([128, 192, 256]))
        picture = random_background(rng, side, side, self.photos, 0.5)
        size = int(side * rng.uniform(0.25, 1))
        x, y = rng.integers(0, side - size + 1, 2)
        part = np.rot90(picture[y : y + size, x : x + size], int(rng.choice([0, 0, 0, 1, 2, 3])))
        return np.asarray(cv2.resize(np.ascontiguousarray(part), (SIZE, SIZE)), np.uint8)

    def _through(self, rng: Rng, image: U8, face: Any) -> tuple[U8, F32]:
        near = face[[*RIGHT_EYE, *LEFT_EYE]].mean(0)
        near = near + rng.uniform(0.15, 0.9) * (face[NOSE_BASE] - near)
        side = float(np.ptp(face, axis=0).max())
        pitch = float(np.clip(side * np.exp(rng.uniform(np.log(0.1), np.log(0.9))), 4, 160))
        behind = random_background(rng, *image.shape[:2], self.photos)
        return before(rng, image, pitch, near, behind)


def _hard(rng: Rng, crop: U8) -> U8:
    """A face of which much is beyond a side of the picture, in a negative, or out of focus."""
    kind = rng.random()
    if kind < 0.6:
        crop, edge, side = crop.copy(), int(rng.uniform(0.3, 0.64) * SIZE), int(rng.integers(4))
        np.rot90(crop, side)[:edge] = 0
        return crop
    return (
        255 - crop if kind < 0.8 else np.asarray(cv2.GaussianBlur(crop, (0, 0), rng.uniform(1, 6)), np.uint8)
    )


def _viewed(rng: Rng, crop: U8) -> U8:
    """As it is, small, or filled as glances are."""
    kind = rng.random()
    if kind < GOAL.filled:
        how = (None, cv2.MORPH_CLOSE, cv2.MORPH_OPEN)[int(rng.integers(3))]
        side = int(rng.integers(56, 76))
        fine = cv2.resize(crop, (2 * side, 2 * side), interpolation=cv2.INTER_AREA)
        if how is not None:
            fine = cv2.morphologyEx(fine, how, np.ones((9, 9), np.uint8))
        crop = np.asarray(cv2.resize(fine, (side, side), interpolation=cv2.INTER_AREA), np.uint8)
    elif kind < GOAL.filled + GOAL.small:
        side = int(rng.integers(14, 72))
        crop = np.asarray(cv2.resize(crop, (side, side), interpolation=cv2.INTER_AREA), np.uint8)
    return np.asarray(cv2.resize(crop, (SIZE, SIZE)), np.uint8)


def loss_of(found: Tensor, asked: Tensor, is_face: Tensor) -> Tensor:
    """How far logits (n,) are on the wrong side of those asked for, Huber's loss."""
    off = torch.where(is_face > 0.5, asked - found, found - asked)
    return F.huber_loss(F.relu(off), torch.zeros_like(off), delta=2.0)


def graft(head: Head, network: Path, path: Path) -> None:
    """Write the network with the head in place of what gave its logit; what a training goes on from stays in it."""
    head = copy.deepcopy(head)
    head.whole.bias.data -= LOWERED
    alone, names = path.with_suffix(".head.onnx"), ("coarse", "middle", "fine", "whole")
    torch.onnx.export(
        head.eval(), tuple(torch.zeros(1, *shape) for shape in SHAPES), str(alone), dynamo=False, opset_version=17,
        input_names=list(names), output_names=["face"],
    )  # fmt: skip
    model, new = joined(onnx.load(network)), onnx.load(alone)
    alone.unlink()
    needed, nodes = set(FEATURES) | {"points", "sigma"}, []
    for node in reversed(model.graph.node):
        if needed & set(node.output):
            nodes.insert(0, node)
            needed |= set(node.input)
    known = dict(zip(names, FEATURES, strict=True))
    for node in new.graph.node:
        for names_of in (node.input, node.output):
            names_of[:] = [known.get(name, f"face/{name}") for name in names_of]
        node.name = f"face{node.name}"
    weights = [
        one for one in model.graph.initializer if one.name in needed or one.name.startswith("net.face")
    ]
    for one in new.graph.initializer:
        one.name = f"face/{one.name}"
    del model.graph.node[:], model.graph.initializer[:]
    model.graph.node.extend(nodes)
    model.graph.initializer.extend([*weights, *new.graph.initializer])
    if_asked(model, list(new.graph.node))
    onnx.checker.check_model(model)
    onnx.save(model, path)
    halve(path)
    branch(path)


def if_asked(model: onnx.ModelProto, nodes: list[onnx.NodeProto]) -> None:
    """Add nodes that give `face/face` as the output `face`, unless the input `looks` is false: it is 0 then."""
    given = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1]) for name in ("face/face", "face/none")
    ]
    none = helper.make_node(
        "Constant", [], ["face/none"], value=numpy_helper.from_array(np.zeros(1, np.float32))
    )
    branches = {
        "then_branch": helper.make_graph(nodes, "asked", [], given[:1]),
        "else_branch": helper.make_graph([none], "unasked", [], given[1:]),
    }
    graph = model.graph
    graph.node.append(helper.make_node("If", ["looks"], ["face"], name="face", **branches))
    del graph.input[1:]
    graph.input.append(helper.make_tensor_value_info("looks", TensorProto.BOOL, []))
    graph.initializer.append(numpy_helper.from_array(np.array(True), "looks"))


def start(head: Head, network: Path) -> None:
    """Give a head what the network told faces by before there was one."""
    values = _initialisers(network)
    for part in ("weight", "bias"):
        getattr(head.whole, part).data.copy_(torch.from_numpy(values[f"net.face.{part}"].copy()))


class Features:
    """Shards as the head wants them."""

    def __init__(self, network: Path) -> None:
        values, self._steps = _initialisers(network), list[tuple[float, int] | None]()
        made = {name: node for node in onnx.load(network).graph.node for name in node.output}
        for name in FEATURES:
            scale, zero = made[name].input[1:3] if _kept(name) != name else ("", "")
            self._steps.append((float(values[scale]), int(values[zero])) if scale else None)

    def of(self, shard: Shard, rows: Any) -> list[Tensor]:
        """Features of some rows."""
        found = []
        for column, step in zip(shard[1:5], self._steps, strict=True):
            values = torch.from_numpy(column[rows]).float()
            found.append(values if step is None else (values - step[1]) * step[0])
        return found


def _kept(name: str) -> str:
    """Name of features as they are kept: in 8 bits where the network rounds them."""
    return name.replace("Relu_output_0_Dequantize", "Relu_output_0_Quantize")


def _initialisers(network: Path) -> dict[str, NDArray[Any]]:
    return {one.name: numpy_helper.to_array(one) for one in onnx.load(network).graph.initializer}


@torch.no_grad()
def figures(head: Head, held: Shard, features: Features) -> dict[str, float]:
    """Shares of faces that are missed and of others that are taken for faces, with the shipped logit and the new."""
    head.eval()
    parts = [slice(i, i + BATCH) for i in range(0, len(held[0]), BATCH)]
    new = np.concatenate([head(*features.of(held, part)).numpy() for part in parts])
    face, rows = held[6] > 0.5, {}
    for name, logits in (("shipped", held[0]), ("new", new)):
        rows[f"{name}_missed"] = float((logits[face] < 0).mean())
        rows[f"{name}_false"] = float((logits[~face] > 0).mean())
    return rows


class Trainer:
    """A head, the running average of its weights, and what is needed to go on."""

    def __init__(self, network: Path, output: Path, rate: float) -> None:
        self.network, self.output, self.rate, self.step = network, output, rate, 0
        self.head = Head()
        start(self.head, network)
        keep = torch.optim.swa_utils.get_ema_multi_avg_fn(0.997)
        self.average = torch.optim.swa_utils.AveragedModel(self.head, multi_avg_fn=keep)
        self.optimiser = torch.optim.AdamW(self.head.parameters(), lr=rate, weight_decay=0.02)

    def learn(self, shards: Sequence[Shard], features: Features, rng: Rng, passed: float) -> float:
        """One batch of rows of several shards; the loss.   passed : share of the course that is over."""
        count = len(shards[0][0])
        picked = [(shard, rng.choice(count, BATCH // len(shards), replace=False)) for shard in shards]
        seen = [torch.cat(part) for part in zip(*(features.of(*pair) for pair in picked), strict=True)]
        asked, is_face = (
            torch.cat([torch.from_numpy(shard[k][rows]).float() for shard, rows in picked]) for k in (5, 6)
        )
        self.step += 1
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate * min(1, self.step / 60) * 0.5 * (1 + math.cos(math.pi * min(1, passed)))
        self.head.train()
        loss = loss_of(self.head(*seen), asked, is_face)
        self.optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.head.parameters(), 5.0)
        self.optimiser.step()
        self.average.update_parameters(self.head)
        return float(loss.detach())

    def parts(self) -> dict[str, Any]:
        """What has a state, by name."""
        return {"head": self.head, "average": self.average, "optimiser": self.optimiser}

    def resume(self) -> None:
        """Go on from `state.pt`."""
        state = torch.load(self.output / "state.pt", weights_only=True)
        for name, part in self.parts().items():
            part.load_state_dict(state[name])
        self.step = state["step"]

    def save(self) -> None:
        """Write `state.pt` and `landmarks.onnx`."""
        state = {name: part.state_dict() for name, part in self.parts().items()} | {"step": self.step}
        torch.save(state, self.output / "state.part")
        (self.output / "state.part").replace(self.output / "state.pt")
        graft(self.average.module, self.network, self.output / "landmarks.onnx")


def make(options: argparse.Namespace) -> None:
    """Write shards."""
    held = options.held_out
    sources = (load_parts(options.parts, held_out=held), load_real(options.real, held_out=held))
    props = make_props(5 + held, options.hands, held_out=held)
    others = () if held else (faceless_photos(options.real / "real"), Mistaken(options.mistaken))
    crops = Crops(options.network, sources, props, *others)
    for number in range(options.shards):
        rng = np.random.default_rng([options.seed, number])
        cv2.setRNGSeed(int(rng.integers(1 << 31)))
        columns = {str(k): column for k, column in enumerate(crops.make(rng))}
        part = options.output / f"part_{options.seed}_{number:04d}.npz"
        np.savez(part, **columns)
        part.replace(part.with_name(part.name.replace("part", "shard")))


def train(options: argparse.Namespace) -> None:
    """Learn from shards."""
    trainer = Trainer(options.network, options.output, options.rate)
    features, rng = Features(options.network), np.random.default_rng(options.seed)
    if options.resume:
        trainer.resume()
    parts = [_read(file) for file in sorted(options.held_out.glob("shard_*.npz"))]
    held = [np.concatenate(column) for column in zip(*parts, strict=True)]
    known: dict[Path, Shard] = {}
    began, losses = time.monotonic(), list[float]()
    chapter = passed = 0.0
    while passed < 1:
        known |= {file: _read(file) for file in options.shards.glob("shard_*.npz") if file not in known}
        shards = [known[file] for file in sorted(known)]
        for _ in range(len(shards)):
            mixed = rng.choice(len(shards), min(MIXED_SHARDS, len(shards)), replace=False)
            passed = (time.monotonic() - began) / options.seconds
            losses.append(trainer.learn([shards[k] for k in mixed], features, rng, passed))
        if passed >= 1 or passed * options.seconds - chapter > CHAPTER_SECONDS:
            chapter = passed * options.seconds
            found = figures(trainer.average.module, held, features)
            row = {"step": trainer.step, "shards": len(shards), "loss": float(np.mean(losses)), **found}
            print(" ".join(f"{k}={v:.4g}" for k, v in row.items()), flush=True)
            losses.clear()
            trainer.save()


def _read(file: Path) -> Shard:
    with np.load(file) as stored:
        return [stored[str(k)] for k in range(len(stored.files))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    maker, trainer = commands.add_parser("make"), commands.add_parser("train")
    for name in ("parts", "real", "hands"):
        maker.add_argument(f"--{name}", type=Path, required=True)
    maker.add_argument("--mistaken", type=Path)
    maker.add_argument("--held-out", action="store_true", help="of people held out")
    maker.add_argument("--shards", type=int, default=60)
    trainer.add_argument("--shards", type=Path, required=True)
    trainer.add_argument("--held-out", type=Path, required=True, help="shards of people held out")
    trainer.add_argument("--seconds", type=float, default=2000)
    trainer.add_argument("--rate", type=float, default=2e-3)
    trainer.add_argument("--resume", action="store_true")
    for one in (maker, trainer):
        one.add_argument("--network", type=Path, default=SHIPPED, help="(default: the shipped one)")
        one.add_argument("--output", type=Path, required=True)
        one.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(options.seed)
    torch.set_flush_denormal(True)
    cv2.setNumThreads(1)
    options.output.mkdir(parents=True, exist_ok=True)
    (make if options.command == "make" else train)(options)


if __name__ == "__main__":
    main()
