"""Learn where another's features lie on a head, from rendered swaps.

    python -m training.placement --swaps PARTS [--first-weights placement.npz --runs 4]

PARTS is the output of `render_swaps.py`. The shipped landmarker finds the points of donors and scenes, so that they are
defined, and err, as in real clips; where the donor's features belong is known from the truths. A small network corrects
what `ShapeTransfer` makes of tracked points. It also sees the scenes' points without the errors of single frames, else
it would take large movements for errors and weaken them. The pictures of some groups are held back and measured. Writes
`aam/data/placement.npz`: `centre` and `scale` of the inputs, and weight and bias of each layer.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import nn

from guise.aam.landmarks import Face, open_landmarker
from guise.aam.landmarks.schemes import BROWS, EYES, LIPS, MIRROR, NOSE, RIGID_WEIGHTS
from guise.aam.reference import ReferenceFrame
from guise.aam.shape_transfer import FEATURES, Placement, ShapeTransfer
from guise.aam.similarity import align_planar
from guise.aam.solid_shape import LIMITS, HeadPose, SolidPrior
from guise.common.arrays import F64

OUT = Path(__file__).parents[1] / "aam" / "data" / "placement.npz"
REST_FRAMES = 3, 10  # of which a rest shape is the mean
MAX_MISS_FACE_WIDTHS = 0.06  # mean distance from the truth, beyond which the landmarker missed the face
HELD_OUT = 6  # every so manieth group
HIDDEN = 96
REFERENCE = ReferenceFrame.canonical()
KEPT = 0.7  # of the correction: on people not trained with, less than all of it is nearest
PARTS = {"brows": BROWS, "eyes": EYES, "nose": NOSE, "mouth": LIPS}


@dataclass(frozen=True, eq=False)
class Group:
    """Points of one group, by person (and donor) and scene: found ones, NaN where missed, and exact ones."""

    donors: F64  # (p, k, 81, 2)
    scenes: F64
    true_donors: F64
    true_scenes: F64
    truths: F64  # (p, p, k, 81, 2) by head and donor, NaN with their own face


def read_group(path: Path) -> Group:
    """A group of `render_swaps.py`, with the points that the landmarker finds; donors' in the pictures with hair."""
    landmarker = open_landmarker("builtin")
    with np.load(path) as file:
        data = {name: file[name] for name in file.files}
    people, k = int(data["people"]), int(data["scenes"])
    exact, ends = data["face81"].astype(np.float64), np.cumsum(data["length"])
    found = np.full((2 * people * k, *exact.shape[1:]), np.nan)
    with_hair = len(exact) - people * k
    seen = [*range(with_hair, len(exact)), *range(people * k, 2 * people * k)]
    for at, i in enumerate(seen):
        coded = data["jpeg"][ends[i] - data["length"][i] : ends[i]]
        picture = cv2.cvtColor(cv2.imdecode(coded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        face = landmarker.refine(picture, Face.around(exact[i], 1.0))
        if face is not None and _miss(face.points, exact[i]) < MAX_MISS_FACE_WIDTHS:
            found[at] = face.points
    truths = np.full((people, people, k, *exact.shape[1:]), np.nan)
    truths[~np.eye(people, dtype=bool)] = exact[2 * people * k : with_hair].reshape(-1, k, *exact.shape[1:])
    both = 2, people, k, *exact.shape[1:]
    return Group(*found.reshape(both), *exact[: len(found)].reshape(both), truths)


def mirrored(group: Group, width: int) -> Group:
    """The group in a mirror, in pictures of that width."""
    order = list(MIRROR)
    return Group(*(points[..., order, :] * (-1, 1) + (width - 1, 0) for points in vars(group).values()))


def steadied(group: Group) -> Group:
    """The group with the scenes' points as the landmarker finds each person's on average."""
    scenes = group.scenes.copy()
    found, exact = (
        np.hstack(both) for both in ((group.donors, scenes), (group.true_donors, group.true_scenes))
    )
    for head, k in np.argwhere(np.isfinite(scenes).all((2, 3))):
        aligned = REFERENCE.align(scenes[head, k])
        steady = _as(group.true_scenes[head, k], scenes[head, k], aligned)
        steady += _bias(found[head], exact[head])
        scenes[head, k] = _as(steady, aligned, scenes[head, k])
    return replace(group, scenes=scenes)


@dataclass(frozen=True, eq=False)
class Place:
    """A donor's face on a scene's head: who it is, and what carries the scene's shape (81, 2) over in its pose."""

    head: int
    donor: int
    scene: int
    shape: F64
    pose: HeadPose
    transfer: ShapeTransfer

    def drawn(self) -> F64:
        """(81, 2) pixels, where the face is drawn."""
        to_picture = align_planar(REFERENCE.align(self.shape), self.shape, RIGID_WEIGHTS)
        return to_picture.apply(self.transfer.apply(self.shape, self.pose))


def transferred(group: Group, rng: np.random.Generator, *, learned: bool = True) -> Iterator[Place]:
    """All donors' faces on others' heads, as far as the scene is found; `learned` as in `ShapeTransfer`."""
    prior = SolidPrior.shipped()
    aligned, aligned_donors = (
        [[REFERENCE.align(s) for s in shapes if np.isfinite(s).all()] for shapes in some]
        for some in (group.scenes, group.donors)
    )
    for head, scenes in enumerate(group.scenes):
        for donor in range(len(group.donors)):
            if donor == head or min(len(aligned[head]), len(aligned_donors[donor])) < REST_FRAMES[0]:
                continue
            own = _neutral([*aligned[head], *aligned_donors[head]], rng)
            other = _neutral(aligned_donors[donor], rng)
            transfer = ShapeTransfer(prior.rest_of(own), prior.rest_of(other), REFERENCE, learned=learned)
            known, deviation = transfer.source.identity, LIMITS.remembered_deviation
            for k, scene in enumerate(scenes):
                if np.isfinite(scene).all():
                    pose = prior.fit(scene, known=known, deviation=deviation).pose
                    yield Place(head, donor, k, scene, pose, transfer)


def rows(group: Group, rng: np.random.Generator) -> Iterator[tuple[F64, F64]]:
    """Inputs of the network, and how far the features of `ShapeTransfer` are from where they belong, face widths."""
    for place in transferred(group, rng, learned=False):
        scene, transfer, donor = place.shape, place.transfer, place.donor
        seen = REFERENCE.to_grid(scene).apply(scene)
        ideal = _as(group.truths[place.head, donor, place.scene], scene, seen)
        ideal += _bias(group.donors[donor], group.true_donors[donor])
        away = (ideal - transfer.apply(scene, place.pose))[FEATURES] / REFERENCE.resolution
        yield transfer.inputs(scene, place.pose).ravel(), away.ravel()


def _neutral(shapes: list[F64], rng: np.random.Generator) -> F64:
    """The mean of some shapes, as a clip that holds them would give."""
    count = min(len(shapes), int(rng.integers(*REST_FRAMES, endpoint=True)))
    return np.asarray(np.mean([shapes[i] for i in rng.choice(len(shapes), count, replace=False)], axis=0))


def _bias(found: F64, exact: F64) -> F64:
    """(81, 2) how far the landmarker's points lie from the exact ones of a person, on the grid."""
    pairs = [(f, e) for f, e in zip(found, exact, strict=True) if np.isfinite(f).all()]
    return np.asarray(np.mean([REFERENCE.align(f) - _as(e, f, REFERENCE.align(f)) for f, e in pairs], axis=0))


def _as(points: F64, shape: F64, aligned: F64) -> F64:
    """Points moved by the similarity that takes a shape to its aligned form."""
    (a, b), (u, v) = shape.mean(0), aligned.mean(0)
    z, w = ((s[:, 0] - c) + 1j * (s[:, 1] - d) for s, c, d in ((shape, a, b), (aligned, u, v)))
    factor = (np.conj(z) @ w) / (np.conj(z) @ z)
    moved = factor * ((points[:, 0] - a) + 1j * (points[:, 1] - b))
    return np.column_stack([moved.real + u, moved.imag + v])


def _miss(found: F64, exact: F64) -> float:
    return float(np.linalg.norm(found - exact, axis=1).mean() / np.ptp(exact[:, 0]))


def train(
    inputs: F64, away: F64, steps: int, seed: int = 0, first: dict[str, np.ndarray] | None = None
) -> dict[str, np.ndarray]:
    """Weights of the network, which may go on from others."""
    torch.manual_seed(seed)
    centre, scale = inputs.mean(0), inputs.std(0) + 1e-3
    if first is not None:
        centre, scale = first["centre"].astype(np.float64), first["scale"].astype(np.float64)
    x, y = (torch.tensor(a, dtype=torch.float32) for a in ((inputs - centre) / scale, 100 * away))
    hidden = [nn.Linear(x.shape[1], HIDDEN), nn.SiLU(), nn.Dropout(0.1)]
    net = nn.Sequential(
        *hidden, nn.Linear(HIDDEN, HIDDEN), nn.SiLU(), nn.Dropout(0.1), nn.Linear(HIDDEN, y.shape[1])
    )
    nn.init.zeros_(net[-1].weight)
    layers = [layer for layer in net if isinstance(layer, nn.Linear)]
    for number, layer in enumerate(layers if first is not None else []):
        factor = 100 / KEPT if layer is layers[-1] else 1.0
        layer.weight.data = torch.tensor(first[f"weight_{number}"].T * factor, dtype=torch.float32)
        layer.bias.data = torch.tensor(first[f"bias_{number}"] * factor, dtype=torch.float32)
    optimiser = torch.optim.AdamW(net.parameters(), 2e-3, weight_decay=0.05)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2e-3, steps)
    for _ in range(steps):
        some = torch.randint(len(x), (128,))
        missed = net(x[some] + 0.15 * torch.randn(128, x.shape[1])) - y[some]
        loss = (missed.view(128, -1, 2).square().sum(2) + 0.05).sqrt().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    weights = {"centre": centre, "scale": scale}
    for number, layer in enumerate(layers):
        weights[f"weight_{number}"] = layer.weight.detach().numpy().T
        weights[f"bias_{number}"] = layer.bias.detach().numpy()
    for name in (f"weight_{number}", f"bias_{number}"):
        weights[name] *= KEPT / 100
    return {name: np.asarray(value, np.float32) for name, value in weights.items()}


def mean_of(some: list[dict[str, np.ndarray]], first: dict[str, np.ndarray] | None) -> dict[str, np.ndarray]:
    """The mean of the weights of some runs, and with those from which they went on: nearer to the truth than one run.

    Wortsman et al., Model soups, ICML 2022.
    """
    mean = {name: np.mean([one[name] for one in some], axis=0, dtype=np.float32) for name in some[0]}
    return mean if first is None else {name: (value + first[name]) / 2 for name, value in mean.items()}


def _report(name: str, missed: F64) -> None:
    """Mean distances of features from where they belong, of the face's width."""
    lengths = 100 * np.linalg.norm(missed.reshape(len(missed), -1, 2), axis=2)
    parts = {part: lengths[:, np.isin(FEATURES, group)].mean() for part, group in PARTS.items()}
    print(
        f"{name}: {lengths.mean():.2f} %;", ", ".join(f"{part} {value:.2f}" for part, value in parts.items())
    )


def _write(path: Path, weights: dict[str, np.ndarray]) -> None:
    np.savez_compressed(path, **{name: value.astype(np.float16) for name, value in weights.items()})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--swaps", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--first-weights", type=Path, help="placement.npz to go on from")
    parser.add_argument("--runs", type=int, default=1, help="of which the mean is taken")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    torch.set_num_threads(1)
    rng, found = np.random.default_rng(0), []
    for i, path in enumerate(sorted(given.swaps.glob("group_*.npz"))):
        group = read_group(path)
        for steady, some in enumerate((group, steadied(group))):
            for side in (some, mirrored(some, 0)):
                found += [(*row, i, steady) for row in rows(side, rng)]
    inputs, away, number, steady = (np.array(column) for column in zip(*found, strict=True))
    held = number % HELD_OUT == 0
    judged = held & (steady == 0)
    _report("rule", away[judged])
    first = dict(np.load(given.first_weights)) if given.first_weights else None
    _write(given.out, train(inputs[~held], away[~held], given.steps, first=first))
    network = Placement(given.out)
    _report("network", away[judged] - [network(one).ravel() for one in inputs[judged]])
    runs = [train(inputs, away, given.steps, seed, first) for seed in range(given.runs)]
    _write(given.out, mean_of(runs, first))
    print(
        f"{len(inputs)} swaps of {len(set(number))} groups; {given.out.name} {given.out.stat().st_size} bytes"
    )


if __name__ == "__main__":
    main()
